#include <memory>

#include <Arduino.h>

#include "application.h"

namespace {

std::unique_ptr<brov::Application> application;

}  // namespace

void setup() { application = std::make_unique<brov::Application>(); }

void loop() { application->pass(); }
