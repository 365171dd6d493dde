// What the host sends down: commands for the sonars, settings, questions for the time. docs/firmware-core.md section 4.
#pragma once

#include "brov/aa55.h"
#include "brov/byte_ring.h"
#include "brov/hal.h"
#include "brov/payloads.h"
#include "brov/settings.h"
#include "brov/sonar_traffic.h"
#include "brov/transmitter.h"

namespace brov {

class HostCommands {
 public:
  // What only the board can do.
  class Listener {
   public:
    virtual void time_sync(std::uint64_t host_us, std::uint64_t now_us) = 0;
    virtual void settings_changed(const Settings& before, std::uint64_t now_us) = 0;

   protected:
    ~Listener() = default;
  };

  HostCommands(Hal& hal, Settings& settings, Transmitter& transmitter, SonarTraffic& sonars, Listener& listener)
      : hal_(hal), settings_(settings), transmitter_(transmitter), sonars_(sonars), listener_(listener) {}

  void receive(Bytes data) { ring_.write(data); }  // from another core, if need be
  void take(std::uint64_t now_us);                 // one tick's batch

  bool has_input() const { return ring_.size() != 0; }
  std::uint16_t bad_commands() const { return bad_commands_; }

 private:
  void obey(const FrameDecoder::Frame& frame, std::uint64_t now_us);
  void relay(Channel channel, std::uint8_t type, Bytes payload, std::uint64_t now_us);
  void configure(Bytes payload, std::uint64_t now_us);
  void acknowledge(std::uint8_t type, std::uint8_t sequence, AckResult result);

  Hal& hal_;
  Settings& settings_;
  Transmitter& transmitter_;
  SonarTraffic& sonars_;
  Listener& listener_;
  ByteRing<2048> ring_;
  FrameDecoder decoder_;
  std::uint16_t bad_commands_ = 0;
};

}  // namespace brov
