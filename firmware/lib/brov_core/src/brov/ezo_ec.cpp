#include "brov/ezo_ec.h"

#include "brov/decimal.h"

namespace brov {

namespace {

constexpr std::uint64_t kAliveUs = 3000000;
constexpr std::uint64_t kLineGapUs = 100000;   // a line is sent in one go
constexpr std::uint64_t kLineSpanUs = 3000000;  // a reading comes every second
constexpr std::uint64_t kSilenceUs = 5000000, kSetAgainUs = 15000000, kCommandGapUs = 400000;
constexpr std::int64_t kMostConductivityDus = 0xFFFFFE;
constexpr std::int64_t kMostSalinityPsu = 42;  // of the probe's own range; a larger number is no salinity

struct Text {
  const char* text;
  std::size_t size;
  Bytes bytes() const { return {reinterpret_cast<const std::uint8_t*>(text), size}; }
};

constexpr Text kCommands[] = {{"O,EC,1\r", 7}, {"O,S,1\r", 6}, {"O,TDS,0\r", 8}, {"O,SG,0\r", 7}, {"C,1\r", 4}};
constexpr std::size_t kCommandCount = sizeof kCommands / sizeof kCommands[0];
constexpr Text kAnswers[] = {{"*OK", 3}, {"*RS", 3}, {"*RE", 3}, {"*WA", 3}, {"*UV", 3}, {"*OV", 3}, {"*SL", 3}};

bool is_answer(Bytes line) {
  for (const Text& answer : kAnswers) {
    bool same = line.size == answer.size;
    for (std::size_t i = 0; same && i < line.size; ++i) {
      same = line[i] == answer.bytes()[i];
    }
    if (same) {
      return true;
    }
  }
  return line[0] == '?';
}

}  // namespace

void EzoEcReader::feed(Bytes batch, std::uint64_t now_us) {
  for (std::size_t i = 0; i < batch.size; ++i) {
    const std::uint8_t byte = batch[i];
    if (byte == '\n') {
      continue;
    }
    const std::uint64_t time_us = arrival_us(now_us, batch.size - 1 - i, kSensorBaud);
    if (size_ > 0 && time_us > byte_us_ + kLineGapUs) {
      // Cut off; what follows may be the tail of another line, and a tail is a number too.
      errors_ = static_cast<std::uint16_t>(errors_ + (too_long_ ? 0 : 1));
      size_ = 0;
      too_long_ = has_end_ = false;
    }
    byte_us_ = time_us;
    if (byte == '\r') {
      if (size_ > 0 && !too_long_ && whole_) {
        end_line(now_us);
      }
      size_ = 0;
      too_long_ = false;
      has_end_ = true;
      end_us_ = time_us;
      continue;
    }
    if (size_ == 0) {
      whole_ = has_end_ && time_us <= end_us_ + kLineSpanUs;
    }
    if (size_ < line_.size()) {
      line_[size_++] = byte;
    } else if (!too_long_) {
      too_long_ = true;
      ++errors_;
    }
  }
}

void EzoEcReader::end_line(std::uint64_t now_us) {
  const Bytes line(line_.data(), size_);
  if (!is_answer(line) && !take_reading(line, now_us)) {
    ++errors_;
  }
}

// `conductivity` or `conductivity,salinity`
bool EzoEcReader::take_reading(Bytes text, std::uint64_t now_us) {
  std::size_t comma = 0;
  while (comma < text.size && text[comma] != ',') {
    ++comma;
  }
  const bool has_salinity = comma < text.size;
  std::int64_t conductivity_nano = 0, salinity_nano = 0;
  if (!parse_decimal(text.first(comma), conductivity_nano)) {
    return false;
  }
  if (has_salinity &&
      (!parse_decimal(text.from(comma + 1), salinity_nano) || salinity_nano > kMostSalinityPsu * kNano)) {
    return false;
  }
  conductivity_dus_ =
      static_cast<std::uint32_t>(clamped(divide_rounded(conductivity_nano, kNano / 10), 0, kMostConductivityDus));
  salinity_cpsu_ =
      has_salinity ? static_cast<std::uint16_t>(divide_rounded(salinity_nano, kNano / 100)) : std::uint16_t{0xFFFF};
  reading_seen_.set(now_us);
  if (has_salinity) {
    both_seen_.set(now_us);
  }
  return true;
}

void EzoEcReader::configure(std::uint64_t now_us, Hal& hal) {
  if (!configuring_) {
    if (both_seen_.within(now_us, kSilenceUs) || now_us - set_us_ < kSetAgainUs) {
      return;
    }
    configuring_ = true;
  }
  if (now_us < command_us_) {
    return;
  }
  if (command_ == 0) {
    set_us_ = now_us;
  }
  hal.port_write(Port::kEc, kCommands[command_].bytes(), now_us);
  command_us_ = now_us + kCommandGapUs;
  ++command_;
  if (command_ == kCommandCount) {
    command_ = 0;
    configuring_ = false;
  }
}

bool EzoEcReader::alive(std::uint64_t now_us) const { return reading_seen_.within(now_us, kAliveUs); }

void EzoEcReader::fill(SensorFields& fields, std::uint64_t now_us) const {
  if (!alive(now_us)) {
    return;
  }
  fields.ec_alive = 1;
  fields.conductivity_dus = static_cast<std::uint16_t>(clamped(conductivity_dus_, 0, 0xFFFF));
  fields.full_conductivity_dus = conductivity_dus_;
  fields.ec_salinity_cpsu = salinity_cpsu_;
}

}  // namespace brov
