#pragma once

#include <cstdlib>

using esp_err_t = int;
#define ESP_OK 0
#define ESP_FAIL -1
#define ESP_ERROR_CHECK(x)              \
  do {                                  \
    if ((x) != ESP_OK) std::abort();    \
  } while (0)
