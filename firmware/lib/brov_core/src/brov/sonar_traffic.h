// Both sonars: what they send to the queue, raw where the line has room for both, compressed where not.
// docs/firmware-core.md section 2.
#pragma once

#include "brov/settings.h"
#include "brov/sonar_port.h"
#include "brov/transmitter.h"

namespace brov {

// Commands sent to one sonar that it has not answered yet.
class PendingCommands {
 public:
  bool full(std::uint64_t now_us);
  void add(std::uint64_t now_us) { sent_us_[count_++] = now_us; }
  void clear() { count_ = 0; }

 private:
  static constexpr std::size_t kMost = 8;
  std::array<std::uint64_t, kMost> sent_us_{};
  std::size_t count_ = 0;
};

class SonarTraffic {
 public:
  SonarTraffic(Transmitter& transmitter, const Settings& settings)
      : transmitter_(transmitter), settings_(settings) {}

  void receive(Channel channel, Bytes data) { side(channel).port.receive(data); }
  void take(Channel channel, std::uint64_t now_us);
  void end_after_silence(Channel channel, std::uint64_t now_us);

  PendingCommands& pending(Channel channel) { return side(channel).pending; }
  const SonarPort& port(Channel channel) const { return sides_[static_cast<std::size_t>(channel)].port; }

 private:
  struct Side {
    SonarPort port;
    PendingCommands pending;
    std::uint8_t compressed_pings = 0;
  };
  class Outlet;

  Side& side(Channel channel) { return sides_[static_cast<std::size_t>(channel)]; }
  void choose_raw();
  void send_ping(Channel channel, const PingCollector& ping);
  void send_raw(Channel channel, const PingCollector& ping);
  void send_compressed(Channel channel, const PingCollector& ping);

  Transmitter& transmitter_;
  const Settings& settings_;
  std::array<Side, 2> sides_{};
  bool raw_ = false;
};

}  // namespace brov
