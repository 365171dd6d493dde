#pragma once

#include "FreeRTOS.h"

using TaskHandle_t = void*;
using TaskFunction_t = void (*)(void*);

BaseType_t xTaskCreatePinnedToCore(TaskFunction_t code, const char* name, std::uint32_t stack_bytes, void* argument,
                                   UBaseType_t priority, TaskHandle_t* created, BaseType_t core);
void vTaskDelay(TickType_t ticks);
BaseType_t xTaskNotifyGive(TaskHandle_t task);
std::uint32_t ulTaskNotifyTake(BaseType_t clear_on_exit, TickType_t ticks);
