// A board in virtual time with everything around it: what the board's tests drive and look at.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "brov/board.h"
#include "brov/checksums.h"
#include "hex.h"
#include "native/i2c_models.h"
#include "native/paced_line.h"

// One AA55 frame that the board handed over.
struct SentFrame {
  std::uint64_t at_us = 0;      // the tick
  std::uint64_t starts_us = 0;  // when its first bit leaves, rounded up
  std::uint64_t out_us = 0;     // when its last bit has left, rounded up
  std::uint8_t type = 0;
  Buffer payload;

  std::size_t bytes() const { return payload.size() + brov::kFrameOverhead; }
  bool is_sonar_data() const { return type >= 0x02 && type <= 0x04; }
};

struct PortWrite {
  std::uint64_t at_us;
  brov::Port port;
  Buffer bytes;
};

class TestHal final : public brov::Hal, private brov::I2cModels::Listener {
 public:
  explicit TestHal(std::uint32_t baud) : baud_(baud), line_(baud) { models.set_state(brov::BusState::kBothSilent); }

  void link_write(brov::Bytes frame, std::uint64_t now_us) override;
  std::uint32_t link_backlog(std::uint64_t now_us) override { return stuck ? 1000 : line_.backlog(now_us); }
  void link_set_baud(std::uint32_t baud, std::uint64_t now_us) override;
  void port_write(brov::Port port, brov::Bytes data, std::uint64_t now_us) override {
    writes.push_back({now_us, port, Buffer(data.data, data.data + data.size)});
  }
  brov::I2cBus& i2c() override { return models; }
  void save_settings(const brov::Settings& settings) override { saved.push_back(settings); }

  bool stuck = false;  // the line takes nothing
  std::vector<SentFrame> link;
  std::vector<PortWrite> writes;
  std::vector<brov::Settings> saved;
  struct BaudChange {
    std::uint64_t at_us;
    std::uint32_t baud;
  };
  std::vector<BaudChange> baud_changes;
  brov::I2cModels models{*this};
  std::size_t i2c_recoveries = 0;

 private:
  void i2c_recovered() override { ++i2c_recoveries; }

  std::uint32_t baud_;
  brov::PacedLine line_;
};

// Ticks every millisecond; bytes arrive at the pace of their UART.
class Rig {
 public:
  explicit Rig(std::uint32_t baud = 115200, std::uint64_t boot_us = 0) : Rig(settings_at(baud), boot_us) {}
  Rig(const brov::Settings& settings, std::uint64_t boot_us);

  static brov::Settings settings_at(std::uint32_t baud) {
    brov::Settings settings;
    settings.baud = baud;
    return settings;
  }

  // Bytes whose first one begins at `at_us`, or behind those that are on their way already.
  void send(brov::Port port, const Buffer& bytes, std::uint64_t at_us = 0);
  // All of them there at once, as from a full buffer.
  void send_at_once(brov::Port port, const Buffer& bytes);
  // A whole frame from the host, there at once.
  void command(std::uint8_t type, const Buffer& payload);

  void run_until(std::uint64_t until_us);
  void run_for(std::uint64_t us) { run_until(now_us + us); }
  std::size_t on_its_way(brov::Port port) const { return coming_[static_cast<std::size_t>(port)].size(); }

  std::vector<SentFrame> sent(std::uint8_t type) const;
  std::size_t sent_bytes(bool sonar_data) const;
  // Newest STATUS; there must be one.
  brov::StatusFields status() const;
  // Asks for a STATUS and waits for it.
  brov::StatusFields ask_status();

  TestHal hal;
  std::uint64_t now_us;
  std::unique_ptr<brov::Board> board;

 private:
  struct Arrival {
    std::uint64_t at_us;  // of its last bit, rounded up
    std::uint8_t byte;
  };
  std::array<std::deque<Arrival>, 6> coming_;
  std::array<std::uint64_t, 6> free_us_{};  // in units of 1 / baud us
};

// BB55.
struct KoggerMode {
  std::uint8_t type = 1, version = 0;
  bool mark = false, response = false;
};
Buffer kogger_frame(std::uint8_t id, const Buffer& payload, KoggerMode mode = {}, bool mod255 = false);
Buffer chart(std::uint16_t seq_offset, const Buffer& samples, KoggerMode mode = {}, std::uint16_t resolution_mm = 30,
             std::uint16_t first_sample = 0);
// A whole ping in chunks of 200.
Buffer ping(std::size_t samples, std::uint8_t seed = 0, KoggerMode mode = {}, std::size_t chunk = 200);

Buffer frame_of(std::uint8_t type, const Buffer& payload);
Buffer config(std::uint8_t sequence, std::initializer_list<std::pair<std::uint8_t, std::uint32_t>> pairs);
Buffer time_sync(std::uint8_t sequence, std::uint64_t host_us);
Buffer kogger_command(std::uint8_t sequence, const Buffer& inner);
Buffer noise(std::size_t bytes, std::uint32_t seed);

brov::StatusFields unpack_status(const Buffer& payload);
