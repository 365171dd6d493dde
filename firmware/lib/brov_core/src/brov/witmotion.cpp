#include "brov/witmotion.h"

namespace brov {

namespace {

constexpr std::uint8_t kSync = 0x55;
constexpr std::uint8_t kAcceleration = 0x51, kAngularRate = 0x52, kAngle = 0x53, kMagneticField = 0x54;
constexpr std::uint64_t kAliveUs = 1200000;
constexpr std::uint64_t kSampleSpanUs = 100000;  // four packets take 46 ms; older parts are from before a gap
constexpr std::uint64_t kThinningSlackUs = 5000;
constexpr std::uint64_t kBurstUs = 100000;
constexpr std::uint64_t kSilenceUs = 2000000, kSetAgainUs = 10000000, kCommandGapUs = 100000;

constexpr std::uint8_t kUnlockCommand[] = {0xFF, 0xAA, 0x69, 0x88, 0xB5};
constexpr std::uint8_t kOutputsCommand[] = {0xFF, 0xAA, 0x02, 0x1E, 0x00};  // 0x51 to 0x54
constexpr std::uint8_t kSaveCommand[] = {0xFF, 0xAA, 0x00, 0x00, 0x00};

struct OutputRate {
  std::uint32_t mhz;
  std::uint8_t code;
};
constexpr OutputRate kOutputRates[] = {{1000, 3}, {2000, 4}, {5000, 5}, {10000, 6}, {20000, 7}};

constexpr std::uint64_t period_us(std::uint32_t rate_mhz) { return 1000000000u / rate_mhz; }

constexpr OutputRate output_rate(std::uint32_t rate_mhz) {
  for (const OutputRate& rate : kOutputRates) {
    if (rate.mhz >= rate_mhz) {
      return rate;
    }
  }
  return kOutputRates[4];
}

void copy(const std::array<std::int16_t, 3>& from, std::int16_t (&to)[3]) {
  for (std::size_t axis = 0; axis < from.size(); ++axis) {
    to[axis] = from[axis];
  }
}

std::int16_t scaled(std::int16_t raw, std::int64_t full_scale) {
  return static_cast<std::int16_t>(divide_rounded(raw * full_scale, 32768));
}

}  // namespace

void WitMotionReader::feed(Bytes batch, std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink) {
  for (std::size_t i = 0; i < batch.size; ++i) {
    buffer_[size_] = batch[i];
    arrived_us_[size_] = arrival_us(now_us, batch.size - 1 - i, kSensorBaud);
    ++size_;
    search(now_us, rate_mhz, sink);
  }
}

// Leaves an incomplete candidate at the start of the buffer, or nothing.
void WitMotionReader::search(std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink) {
  if (size_ == 1 && buffer_[0] != kSync) {
    size_ = 0;
  }
  while (size_ >= 2) {
    const bool known_type = (buffer_[1] & 0xF0) == 0x50;
    if (known_type && size_ < kPacketBytes) {
      return;
    }
    std::uint8_t sum = 0;
    for (std::size_t i = 0; i + 1 < size_; ++i) {
      sum = static_cast<std::uint8_t>(sum + buffer_[i]);
    }
    if (known_type && sum == buffer_[kPacketBytes - 1]) {
      packet(now_us, rate_mhz, sink);
      size_ = 0;
      return;
    }
    ++errors_;
    drop_to_next_sync();
  }
}

void WitMotionReader::drop_to_next_sync() {
  std::size_t start = 1;
  while (start < size_ && buffer_[start] != kSync) {
    ++start;
  }
  for (std::size_t i = start; i < size_; ++i) {
    buffer_[i - start] = buffer_[i];
    arrived_us_[i - start] = arrived_us_[i];
  }
  size_ -= start;
}

void WitMotionReader::packet(std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink) {
  ++packets_;
  packet_seen_.set(now_us);
  const std::uint64_t time_us = arrived_us_[0];
  Axes values{};
  for (std::size_t axis = 0; axis < values.size(); ++axis) {
    values[axis] = static_cast<std::int16_t>(get_u16(&buffer_[2 + 2 * axis]));
  }
  switch (buffer_[1]) {
    case kAcceleration:
      acceleration_ = values;
      acceleration_seen_.set(now_us);
      open_.time_us = time_us;
      copy(values, open_.acceleration);
      has_open_ = true;
      has_rate_ = false;
      break;
    case kAngularRate:
      if (belongs_to_open(time_us)) {
        copy(values, open_.angular_rate);
        has_rate_ = true;
      }
      break;
    case kAngle:
      angle_ = values;
      angle_seen_.set(now_us);
      break;
    case kMagneticField:
      if (belongs_to_open(time_us) && has_rate_) {
        copy(values, open_.magnetic_field);
        has_open_ = false;
        complete(now_us, rate_mhz, sink);
      }
      break;
    default:
      break;
  }
}

bool WitMotionReader::belongs_to_open(std::uint64_t time_us) const {
  return has_open_ && time_us <= open_.time_us + kSampleSpanUs;
}

void WitMotionReader::complete(std::uint64_t now_us, std::uint32_t rate_mhz, ReportSink& sink) {
  const std::uint64_t time_us = open_.time_us;
  interval_us_ = sample_us_ > 0 && time_us > sample_us_ ? time_us - sample_us_ : 0;
  sample_us_ = time_us;
  sample_seen_.set(now_us);
  if (time_us + kThinningSlackUs < next_us_) {
    return;
  }
  const std::uint64_t period = period_us(rate_mhz);
  const std::uint64_t on_grid = next_us_ + period, from_here = time_us + period - kThinningSlackUs;
  next_us_ = on_grid > from_here ? on_grid : from_here;
  gather(open_, period, sink);
}

void WitMotionReader::gather(const ImuSample& sample, std::uint64_t period, ReportSink& sink) {
  if (gathered_count_ > 0 && sample.time_us > gathered_[gathered_count_ - 1u].time_us + 3 * period) {
    send_burst(period, sink);
  }
  gathered_[gathered_count_] = sample;
  ++gathered_count_;
  if ((2u * gathered_count_ + 1u) * period >= 2 * kBurstUs || gathered_count_ == gathered_.size()) {
    send_burst(period, sink);
  }
}

void WitMotionReader::send_burst(std::uint64_t period, ReportSink& sink) {
  const std::uint64_t first_us = gathered_[0].time_us, last_us = gathered_[gathered_count_ - 1u].time_us;
  const std::uint64_t spacing_us = gathered_count_ > 1 ? (last_us - first_us) / (gathered_count_ - 1u) : period;
  sink.imu_burst(static_cast<std::uint32_t>(first_us), static_cast<std::uint32_t>(spacing_us), gathered_.data(),
                 gathered_count_);
  gathered_count_ = 0;
}

void WitMotionReader::configure(std::uint64_t now_us, std::uint32_t rate_mhz, Hal& hal) {
  if (command_ == Command::kNone) {
    if (sample_seen_.within(now_us, kSilenceUs) || now_us - set_us_ < kSetAgainUs) {
      return;
    }
    command_ = Command::kUnlock;
    whole_set_ = true;
  }
  if (now_us < command_us_) {
    return;
  }
  if (!looked_) {
    looked_ = true;
    set_us_ = now_us;
    if (delivers_as_set(now_us, rate_mhz)) {
      command_ = Command::kNone;
      return;
    }
  }
  const std::uint8_t rate_command[] = {0xFF, 0xAA, 0x03, output_rate(rate_mhz).code, 0x00};
  Bytes data;
  switch (command_) {
    case Command::kUnlock:
      data = {kUnlockCommand, sizeof kUnlockCommand};
      set_us_ = whole_set_ ? now_us : set_us_;
      command_ = whole_set_ ? Command::kOutputs : Command::kRate;
      break;
    case Command::kOutputs:
      data = {kOutputsCommand, sizeof kOutputsCommand};
      command_ = Command::kRate;
      break;
    case Command::kRate:
      data = {rate_command, sizeof rate_command};
      command_ = whole_set_ && may_save_ ? Command::kSave : Command::kNone;
      break;
    case Command::kSave:
      data = {kSaveCommand, sizeof kSaveCommand};
      may_save_ = false;
      command_ = Command::kNone;
      break;
    case Command::kNone:
      return;
  }
  command_us_ = now_us + kCommandGapUs;
  hal.port_write(Port::kImu, data, now_us);
}

bool WitMotionReader::delivers_as_set(std::uint64_t now_us, std::uint32_t rate_mhz) const {
  const std::uint64_t wanted_us = period_us(output_rate(rate_mhz).mhz);
  const std::uint64_t off_us = interval_us_ > wanted_us ? interval_us_ - wanted_us : wanted_us - interval_us_;
  return sample_seen_.within(now_us, kSilenceUs) && interval_us_ > 0 && 4 * off_us <= wanted_us;
}

void WitMotionReader::rate_changed() {
  if (command_ == Command::kNone) {
    whole_set_ = false;
  }
  command_ = Command::kUnlock;
}

void WitMotionReader::fill(SensorFields& fields, std::uint64_t now_us) const {
  fields.imu_packets = packets_;
  fields.imu_errors = errors_;
  fields.imu_alive = packet_seen_.within(now_us, kAliveUs) ? 1 : 0;
  if (angle_seen_.within(now_us, kAliveUs)) {
    fields.roll_cdeg = scaled(angle_[0], 18000);
    fields.pitch_cdeg = scaled(angle_[1], 18000);
    fields.yaw_cdeg = scaled(angle_[2], 18000);
  }
  if (acceleration_seen_.within(now_us, kAliveUs)) {
    for (std::size_t axis = 0; axis < acceleration_.size(); ++axis) {
      fields.acceleration_mg[axis] = scaled(acceleration_[axis], 16000);
    }
  }
}

}  // namespace brov
