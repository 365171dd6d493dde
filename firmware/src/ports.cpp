#include "ports.h"

#include <esp_task_wdt.h>

#include "pins.h"

namespace brov {

namespace {

constexpr BaseType_t kCore = 0;
constexpr std::uint32_t kStackBytes = 4096;
// The USB line comes first: its FIFO is empty 108 us after the interrupt that asks for more, at 921 600 baud.
constexpr UBaseType_t kWriterPriority = 20, kMoverPriority = 18;

// 16 KB are 178 ms of a sonar. Eight commands of 263 bytes at most wait at once.
constexpr HardwareUart::Buffers kSonarBuffers{16384, 4096};

}  // namespace

Ports::Ports(std::uint32_t link_baud)
    : link_(link_baud),
      sonar_a_(UART_NUM_1, pins::kSonarARx, pins::kSonarATx, kSonarBuffers),
      sonar_b_(UART_NUM_2, pins::kSonarBRx, pins::kSonarBTx, kSonarBuffers),
      imu_(pins::kImuRx, pins::kImuTx),
      gps_(pins::kGpsRx, pins::kGpsTx),
      ec_(pins::kEcRx, pins::kEcTx) {}

void Ports::start(Board& board) {
  board_ = &board;
  xTaskCreatePinnedToCore(run_mover, "mover", kStackBytes, this, kMoverPriority, nullptr, kCore);
}

void Ports::run_mover(void* self) {
  Ports& ports = *static_cast<Ports*>(self);
  ports.begin_all();
  xTaskCreatePinnedToCore(run_writer, "writer", kStackBytes, self, kWriterPriority, &ports.writer_, kCore);
  ports.link_.set_writer(ports.writer_);
  ESP_ERROR_CHECK(esp_task_wdt_add(nullptr));
  for (;;) {
    ports.move();
    esp_task_wdt_reset();
    vTaskDelay(1);
  }
}

void Ports::run_writer(void* self) { static_cast<Ports*>(self)->link_.run_writer(); }

// Here, and not in setup(): a driver's interrupts belong to the core that installs it.
void Ports::begin_all() {
  link_.begin();
  sonar_a_.begin(kSonarBaud);
  sonar_b_.begin(kSonarBaud);
  imu_.begin();
  gps_.begin();
  ec_.begin();
}

void Ports::move() {
  const auto take = [this](Port port, auto& from) {
    const std::size_t count = from.read(block_, sizeof block_);
    if (count != 0) board_->receive(port, Bytes(block_, count));
  };
  take(Port::kSonarA, sonar_a_);
  take(Port::kSonarB, sonar_b_);
  take(Port::kHost, link_);
  take(Port::kImu, imu_);
  take(Port::kGps, gps_);
  take(Port::kEc, ec_);
  // One byte of one of them: the others wait a millisecond longer.
  if (!imu_.send_one()) ec_.send_one();
}

void Ports::write(Port port, Bytes data) {
  switch (port) {
    case Port::kSonarA: sonar_a_.write(data); break;
    case Port::kSonarB: sonar_b_.write(data); break;
    case Port::kImu: imu_.write(data); break;
    case Port::kEc: ec_.write(data); break;
    case Port::kHost:
    case Port::kGps: break;  // the board never writes to these
  }
}

}  // namespace brov
