#include "rig.h"

#include <doctest/doctest.h>

#include <algorithm>

using namespace brov;

namespace {

constexpr std::uint64_t kByte = 10000000;  // ten bits in units of 1 / baud us
constexpr std::uint64_t kTickUs = 1000;

std::uint32_t baud_of(Port port, std::uint32_t link_baud) {
  if (port == Port::kHost) return link_baud;
  return port == Port::kSonarA || port == Port::kSonarB ? kSonarBaud : kSensorBaud;
}

void put(Buffer& into, std::uint64_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) into.push_back(static_cast<std::uint8_t>(value >> 8 * i));
}

}  // namespace

void TestHal::link_write(Bytes frame, std::uint64_t now_us) {
  REQUIRE(frame.size >= kFrameOverhead);
  SentFrame sent;
  sent.at_us = now_us;
  sent.starts_us = now_us + (line_.backlog(now_us) * kByte + baud_ - 1) / baud_;
  line_.write(frame.size, now_us);
  sent.out_us = now_us + (line_.backlog(now_us) * kByte + baud_ - 1) / baud_;
  sent.type = frame[2];
  sent.payload.assign(frame.data + 5, frame.data + frame.size - 1);
  CHECK(frame_of(sent.type, sent.payload) == Buffer(frame.data, frame.data + frame.size));
  link.push_back(std::move(sent));
}

void TestHal::link_set_baud(std::uint32_t baud, std::uint64_t now_us) {
  baud_ = baud;
  line_.set_baud(baud, now_us);
  baud_changes.push_back({now_us, baud});
}

Rig::Rig(const Settings& settings, std::uint64_t boot_us) : hal(settings.baud), now_us(boot_us) {
  BootInfo info;
  info.boot_us = boot_us;
  info.boot_count = 7;
  info.reset_reason = 4;
  board = std::make_unique<Board>(hal, settings, info);
}

void Rig::send(Port port, const Buffer& bytes, std::uint64_t at_us) {
  const std::uint32_t baud = baud_of(port, 921600);
  std::uint64_t& free = free_us_[static_cast<std::size_t>(port)];
  free = std::max(free, std::max(at_us, now_us) * baud);
  for (const std::uint8_t byte : bytes) {
    free += kByte;
    coming_[static_cast<std::size_t>(port)].push_back({(free + baud - 1) / baud, byte});
  }
}

void Rig::send_at_once(Port port, const Buffer& bytes) {
  for (const std::uint8_t byte : bytes) coming_[static_cast<std::size_t>(port)].push_back({now_us, byte});
}

void Rig::command(std::uint8_t type, const Buffer& payload) { send_at_once(Port::kHost, frame_of(type, payload)); }

void Rig::run_until(std::uint64_t until_us) {
  for (std::uint64_t tick_us = (now_us / kTickUs + 1) * kTickUs; tick_us <= until_us; tick_us += kTickUs) {
    for (std::size_t port = 0; port < coming_.size(); ++port) {
      Buffer arrived;
      auto& coming = coming_[port];
      for (; !coming.empty() && coming.front().at_us <= tick_us; coming.pop_front()) {
        arrived.push_back(coming.front().byte);
      }
      if (!arrived.empty()) board->receive(static_cast<Port>(port), view(arrived));
    }
    hal.models.set_time(tick_us);
    board->tick(tick_us);
  }
  now_us = until_us;
}

std::vector<SentFrame> Rig::sent(std::uint8_t type) const {
  std::vector<SentFrame> frames;
  for (const SentFrame& frame : hal.link) {
    if (frame.type == type) frames.push_back(frame);
  }
  return frames;
}

std::size_t Rig::sent_bytes(bool sonar_data) const {
  std::size_t bytes = 0;
  for (const SentFrame& frame : hal.link) {
    if (frame.is_sonar_data() == sonar_data) bytes += frame.bytes();
  }
  return bytes;
}

StatusFields Rig::status() const {
  const auto frames = sent(0x06);
  REQUIRE(!frames.empty());
  return unpack_status(frames.back().payload);
}

StatusFields Rig::ask_status() {
  static std::uint64_t token = 1;
  ++token;
  command(0x23, time_sync(0, token));
  for (int i = 0; i < 1000; ++i) {
    run_for(kTickUs);
    if (!sent(0x06).empty() && status().echoed_host_us == token) return status();
  }
  FAIL("no STATUS came");
  return {};
}

Buffer kogger_frame(std::uint8_t id, const Buffer& payload, KoggerMode mode, bool mod255) {
  Buffer frame = {0xBB, 0x55, 0x00};
  frame.push_back(static_cast<std::uint8_t>(mode.type | mode.version << 3 | (mode.mark ? 0x40 : 0) |
                                            (mode.response ? 0x80 : 0)));
  frame.push_back(id);
  frame.push_back(static_cast<std::uint8_t>(payload.size()));
  append(frame, payload);
  const Bytes body(frame.data() + 2, frame.size() - 2);
  const KoggerCheck check = mod255 ? kogger_mod255(body) : kogger_mod256(body);
  frame.push_back(check.c1);
  frame.push_back(check.c2);
  return frame;
}

Buffer chart(std::uint16_t seq_offset, const Buffer& samples, KoggerMode mode, std::uint16_t resolution_mm,
             std::uint16_t first_sample) {
  Buffer payload;
  put(payload, seq_offset, 2);
  put(payload, resolution_mm, 2);
  put(payload, first_sample, 2);
  append(payload, samples);
  return kogger_frame(kKoggerChartId, payload, mode);
}

Buffer ping(std::size_t samples, std::uint8_t seed, KoggerMode mode, std::size_t chunk) {
  Buffer stream;
  for (std::size_t start = 0; start < samples; start += chunk) {
    Buffer part(std::min(chunk, samples - start));
    for (std::size_t i = 0; i < part.size(); ++i) part[i] = static_cast<std::uint8_t>((start + i) * 13 / 7 + seed);
    append(stream, chart(static_cast<std::uint16_t>(start), part, mode));
  }
  return stream;
}

Buffer frame_of(std::uint8_t type, const Buffer& payload) {
  Buffer frame(payload.size() + kFrameOverhead);
  encode_frame(static_cast<MessageType>(type), view(payload), frame.data());
  return frame;
}

Buffer config(std::uint8_t sequence, std::initializer_list<std::pair<std::uint8_t, std::uint32_t>> pairs) {
  Buffer payload = {sequence};
  for (const auto& [key, value] : pairs) {
    payload.push_back(key);
    put(payload, value, 4);
  }
  return payload;
}

Buffer time_sync(std::uint8_t sequence, std::uint64_t host_us) {
  Buffer payload = {sequence};
  put(payload, host_us, 8);
  return payload;
}

Buffer kogger_command(std::uint8_t sequence, const Buffer& inner) {
  Buffer payload = {sequence};
  append(payload, inner);
  return payload;
}

Buffer noise(std::size_t bytes, std::uint32_t seed) {
  Buffer buffer(bytes);
  std::uint32_t state = seed * 2654435761u + 1;
  for (std::uint8_t& byte : buffer) {
    state = state * 1664525u + 1013904223u;
    byte = static_cast<std::uint8_t>(state >> 24);
  }
  return buffer;
}

// By offset, so that a layout that moved is seen.
StatusFields unpack_status(const Buffer& payload) {
  REQUIRE(payload.size() == 62);
  const std::uint8_t* at = payload.data();
  REQUIRE(at[0] == 1);
  StatusFields fields;
  for (std::size_t i = 0; i < 3; ++i) fields.version[i] = at[1 + i];
  fields.uptime_ms = get_u32(at + 4);
  fields.boot_count = get_u16(at + 8);
  fields.reset_reason = at[10];
  fields.link_load_percent = at[11];
  fields.tx_bytes = get_u32(at + 12);
  for (std::size_t i = 0; i < 2; ++i) {
    fields.pings_dropped[i] = get_u32(at + 16 + 4 * i);
    fields.frame_errors[i] = get_u32(at + 24 + 4 * i);
    fields.overflow_bytes[i] = get_u32(at + 32 + 4 * i);
  }
  fields.i2c_errors = get_u16(at + 40);
  fields.imu_errors = get_u16(at + 42);
  fields.gps_errors = get_u16(at + 44);
  fields.ec_errors = get_u16(at + 46);
  fields.bad_commands = get_u16(at + 48);
  fields.echoed_host_us = get_u64(at + 50);
  fields.echo_device_us = get_u32(at + 58);
  return fields;
}
