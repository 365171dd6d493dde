#include "esp32_rig.h"

#include <algorithm>

#include <doctest/doctest.h>

#include "Arduino.h"
#include "brov/checksums.h"

void Esp32::boot() { setup(); }

void Esp32::run_until(std::uint64_t us) {
  while (machine.now_us() < us) {
    const std::uint64_t before_us = machine.now_us();
    loop();
    // A pass that had nothing to wait for still takes some time.
    machine.spend(20);
    longest_pass_us = std::max(longest_pass_us, machine.now_us() - before_us);
    ++passes;
  }
}

void Esp32::parse() {
  const std::vector<fake::WireByte>& sent = machine.uart(0).sent();
  const auto value = [&](std::size_t i) { return sent[i].value; };
  while (parsed_ < sent.size()) {
    if (value(parsed_) != 0xAA) {
      const char letter = static_cast<char>(value(parsed_));
      const bool printable = (letter >= ' ' && letter <= '~') || letter == '\r' || letter == '\n';
      REQUIRE_MESSAGE(printable, "neither text nor a frame at byte " << parsed_);
      text_ += letter;
      ++parsed_;
      continue;
    }
    if (sent.size() - parsed_ < brov::kFrameOverhead) return;
    const std::size_t length = static_cast<std::size_t>(value(parsed_ + 3)) << 8 | value(parsed_ + 4);
    const std::size_t whole = length + brov::kFrameOverhead;
    if (sent.size() - parsed_ < whole) return;
    LinkFrame frame{value(parsed_ + 2), {}, sent[parsed_].start_ns / 1000, 0, sent[parsed_].baud};
    Buffer checked;
    for (std::size_t i = 2; i < whole - 1; ++i) checked.push_back(value(parsed_ + i));
    REQUIRE(value(parsed_ + 1) == 0x55);
    REQUIRE(brov::xor8(view(checked)) == value(parsed_ + whole - 1));
    frame.payload.assign(checked.begin() + 3, checked.end());
    const fake::WireByte& last = sent[parsed_ + whole - 1];
    frame.end_us = (last.start_ns + 10000000000u / last.baud) / 1000;
    REQUIRE(last.baud == frame.baud);
    frames_.push_back(frame);
    parsed_ += whole;
  }
}

std::vector<LinkFrame> Esp32::frames() {
  parse();
  return frames_;
}

std::vector<LinkFrame> Esp32::frames(brov::MessageType type) {
  std::vector<LinkFrame> chosen;
  for (const LinkFrame& frame : frames()) {
    if (frame.type == static_cast<std::uint8_t>(type)) chosen.push_back(frame);
  }
  return chosen;
}

std::string Esp32::text() {
  parse();
  return text_;
}

brov::StatusFields Esp32::status() {
  const auto all = frames(brov::MessageType::kStatus);
  REQUIRE_FALSE(all.empty());
  return unpack_status(all.back().payload);
}

void Esp32::command(std::uint8_t type, const Buffer& payload, std::uint32_t baud) {
  machine.uart(0).arrive(frame_of(type, payload), machine.now_us(), baud);
}

void feed_pings(fake::Uart& sonar, std::size_t samples, unsigned per_s, std::uint64_t from_us, unsigned seconds) {
  const Buffer bytes = ping(samples);
  for (unsigned i = 0; i < per_s * seconds; ++i) sonar.arrive(bytes, from_us + i * 1000000u / per_s, brov::kSonarBaud);
}

std::string ascii(const std::vector<fake::WireByte>& bytes) {
  std::string text;
  for (const fake::WireByte& byte : bytes) text += static_cast<char>(byte.value);
  return text;
}

Buffer ascii(const std::string& text) { return {text.begin(), text.end()}; }
