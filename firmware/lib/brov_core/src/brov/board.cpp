#include "brov/board.h"

#include "brov/derived.h"

namespace brov {

namespace {

constexpr std::uint64_t kSensorsPhaseUs = 50000, kStatusPhaseUs = 200000, kStatusPeriodUs = 1000000;
constexpr std::uint64_t kTickUs = 1000;
constexpr std::size_t kMaxSensorBatch = 256;

// A small sensor's bytes of this tick in one piece, as its reader wants them.
class SensorBatch {
 public:
  template <typename Ring>
  explicit SensorBatch(Ring& ring) {
    std::size_t left = ring.size();
    if (left > kMaxSensorBatch) left = kMaxSensorBatch;
    while (left != 0) {
      const Bytes piece = ring.front(left);
      for (std::size_t i = 0; i < piece.size; ++i) bytes_[size_ + i] = piece[i];
      size_ += piece.size;
      left -= piece.size;
      ring.consume(piece.size);
    }
  }
  bool empty() const { return size_ == 0; }
  Bytes bytes() const { return {bytes_, size_}; }

 private:
  std::uint8_t bytes_[kMaxSensorBatch];
  std::size_t size_ = 0;
};

}  // namespace

Board::Board(Hal& hal, const Settings& settings, const BootInfo& boot)
    : hal_(hal),
      settings_(settings),
      boot_(boot),
      transmitter_(hal, settings.baud, boot.boot_us),
      sonars_(transmitter_, settings_),
      host_(hal, settings_, transmitter_, sonars_, *this),
      bus_(hal.i2c()),
      sensors_job_(boot.boot_us + kSensorsPhaseUs),
      status_job_(boot.boot_us + kStatusPhaseUs) {
  imu_.start(boot.boot_us);
  ec_.start(boot.boot_us);
  depth_.start(boot.boot_us);
  celsius_.start(boot.boot_us);
}

void Board::receive(Port port, Bytes data) {
  switch (port) {
    case Port::kHost: host_.receive(data); break;
    case Port::kSonarA: sonars_.receive(Channel::kA, data); break;
    case Port::kSonarB: sonars_.receive(Channel::kB, data); break;
    case Port::kImu: imu_ring_.write(data); break;
    case Port::kGps: gps_ring_.write(data); break;
    case Port::kEc: ec_ring_.write(data); break;
  }
}

void Board::tick(std::uint64_t now_us) {
  take_inputs(now_us);
  run_jobs(now_us);
  transmitter_.tick(now_us);
}

std::uint64_t Board::next_wanted_us(std::uint64_t now_us) const {
  const bool more = host_.has_input() || sonars_.port(Channel::kA).has_input() ||
                    sonars_.port(Channel::kB).has_input() || imu_ring_.size() != 0 || gps_ring_.size() != 0 ||
                    ec_ring_.size() != 0;
  return more ? now_us : now_us + kTickUs;  // the I2C conversions and the line want every millisecond
}

void Board::take_inputs(std::uint64_t now_us) {
  host_.take(now_us);
  sonars_.take(Channel::kA, now_us);
  sonars_.take(Channel::kB, now_us);
  if (const SensorBatch imu(imu_ring_); !imu.empty()) imu_.feed(imu.bytes(), now_us, settings_.imu_rate_mhz, *this);
  if (const SensorBatch gps(gps_ring_); !gps.empty()) gps_.feed(gps.bytes(), now_us, *this);
  if (const SensorBatch ec(ec_ring_); !ec.empty()) ec_.feed(ec.bytes(), now_us);
}

void Board::run_jobs(std::uint64_t now_us) {
  depth_.tick(now_us, bus_);
  celsius_.tick(now_us, bus_);
  imu_.configure(now_us, settings_.imu_rate_mhz, hal_);
  ec_.configure(now_us, hal_);
  gps_.tick(now_us, *this);
  sonars_.end_after_silence(Channel::kA, now_us);
  sonars_.end_after_silence(Channel::kB, now_us);
  if (sensors_job_.due(now_us, sensors_period_us())) send_sensors(now_us);
  if (status_job_.due(now_us, kStatusPeriodUs)) send_status(now_us, 0, 0);
}

SensorFields Board::readings(std::uint64_t now_us) const {
  SensorFields fields;
  fields.device_ms = static_cast<std::uint32_t>(now_us / 1000);
  imu_.fill(fields, now_us);
  gps_.fill(fields, now_us);
  ec_.fill(fields, now_us);
  depth_.fill(fields, now_us);
  celsius_.fill(fields, now_us);
  fill_derived(fields, ec_, depth_, celsius_, now_us);
  fields.a_packets = sonars_.port(Channel::kA).packets();
  fields.a_bytes = sonars_.port(Channel::kA).bytes();
  fields.b_packets = sonars_.port(Channel::kB).packets();
  fields.b_bytes = sonars_.port(Channel::kB).bytes();
  return fields;
}

void Board::send_sensors(std::uint64_t now_us) {
  std::uint8_t payload[kSensorsBytes];
  pack_sensors(readings(now_us), payload);
  transmitter_.queue().put(Urgency::kSensors, MessageType::kSensors, Bytes(payload, sizeof payload));
}

void Board::send_status(std::uint64_t now_us, std::uint64_t echoed_host_us, std::uint32_t echo_device_us) {
  transmitter_.measure(now_us);
  StatusFields fields;
  for (std::size_t i = 0; i < 3; ++i) fields.version[i] = kFirmwareVersion[i];
  fields.uptime_ms = static_cast<std::uint32_t>(now_us / 1000);
  fields.boot_count = boot_.boot_count;
  fields.reset_reason = boot_.reset_reason;
  fields.link_load_percent = transmitter_.load_percent();
  fields.tx_bytes = transmitter_.tx_bytes();
  for (const Channel channel : {Channel::kA, Channel::kB}) {
    const auto i = static_cast<std::size_t>(channel);
    fields.pings_dropped[i] = transmitter_.queue().pings_dropped(channel);
    fields.frame_errors[i] = sonars_.port(channel).frame_errors();
    fields.overflow_bytes[i] = overflow_bytes(channel);
  }
  fields.i2c_errors = bus_.errors();
  fields.imu_errors = imu_.errors();
  fields.gps_errors = gps_.errors();
  fields.ec_errors = ec_.errors();
  fields.bad_commands = host_.bad_commands();
  fields.echoed_host_us = echoed_host_us;
  fields.echo_device_us = echo_device_us;
  std::uint8_t payload[kStatusBytes];
  pack_status(fields, payload);
  transmitter_.queue().put(Urgency::kReports, MessageType::kStatus, Bytes(payload, sizeof payload));
}

std::uint32_t Board::overflow_bytes(Channel channel) const {
  return sonars_.port(channel).overflow_bytes() + transmitter_.queue().lost_sonar_bytes(channel);
}

void Board::imu_burst(std::uint32_t t0_us, std::uint32_t dt_us, const ImuSample* samples, std::uint8_t count) {
  std::uint8_t payload[kImuBurstHeaderBytes + kMaxBurstSamples * kImuSampleBytes];
  const std::size_t size = pack_imu_burst(t0_us, dt_us, samples, count, payload);
  transmitter_.queue().put(Urgency::kReports, MessageType::kImuBurst, Bytes(payload, size));
}

void Board::gps_report(const GpsFields& report) {
  std::uint8_t payload[kGpsBytes];
  pack_gps(report, payload);
  transmitter_.queue().put(Urgency::kReports, MessageType::kGps, Bytes(payload, sizeof payload));
}

void Board::time_sync(std::uint64_t host_us, std::uint64_t now_us) {
  send_status(now_us, host_us, static_cast<std::uint32_t>(now_us));
}

void Board::settings_changed(const Settings& before, std::uint64_t now_us) {
  const bool sensors_rate = settings_.sensors_rate_mhz != before.sensors_rate_mhz;
  const bool imu_rate = settings_.imu_rate_mhz != before.imu_rate_mhz;
  if (sensors_rate) sensors_job_.restart(now_us + sensors_period_us());
  if (imu_rate) imu_.rate_changed();
  if (sensors_rate || imu_rate || settings_.decimation != before.decimation) hal_.save_settings(settings_);
}

}  // namespace brov
