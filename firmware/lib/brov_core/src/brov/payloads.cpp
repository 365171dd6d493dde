#include "brov/payloads.h"

namespace brov {
namespace {

// Writes one field behind the other.
class Writer {
 public:
  explicit Writer(std::uint8_t* into) : at_(into) {}

  void u8(std::uint8_t v) { *at_++ = v; }
  void u16(std::uint16_t v) {
    put_u16(at_, v);
    at_ += 2;
  }
  void u24(std::uint32_t v) {
    put_u24(at_, v);
    at_ += 3;
  }
  void u32(std::uint32_t v) {
    put_u32(at_, v);
    at_ += 4;
  }
  void u64(std::uint64_t v) {
    put_u64(at_, v);
    at_ += 8;
  }
  void i16(std::int16_t v) { u16(static_cast<std::uint16_t>(v)); }
  void i32(std::int32_t v) { u32(static_cast<std::uint32_t>(v)); }
  void i16x3(const std::int16_t (&v)[3]) {
    for (const std::int16_t one : v) i16(one);
  }
  const std::uint8_t* at() const { return at_; }

 private:
  std::uint8_t* at_;
};

constexpr std::uint8_t kStatusLayout = 1;
constexpr std::uint8_t kImuScaleHwt905 = 1;

}  // namespace

void pack_sensors(const SensorFields& fields, std::uint8_t (&into)[kSensorsBytes]) {
  Writer out(into);
  out.u32(fields.device_ms);
  out.i16(fields.roll_cdeg);
  out.i16(fields.pitch_cdeg);
  out.i16(fields.yaw_cdeg);
  out.i16x3(fields.acceleration_mg);
  out.u32(fields.imu_packets);
  out.u16(fields.imu_errors);
  out.u8(fields.imu_alive);
  out.i32(fields.latitude_e7);
  out.i32(fields.longitude_e7);
  out.i16(fields.altitude_dm);
  out.u8(fields.satellites);
  out.u8(fields.gps_alive);
  out.u16(fields.conductivity_dus);
  out.u16(fields.ec_salinity_cpsu);
  out.u8(fields.ec_alive);
  out.u8(fields.extension);
  out.u24(fields.full_conductivity_dus);
  out.u24(fields.full_pressure_pa);
  out.u16(fields.pressure_dmbar);
  out.i16(fields.depth_temperature_cdegc);
  out.u8(fields.depth_ok);
  out.i16(fields.temperature_cdegc);
  out.u8(fields.temperature_ok);
  out.u16(fields.sound_speed_dmps);
  out.u16(fields.depth_cm);
  out.u8(fields.salinity_dpsu);
  out.u32(fields.a_packets);
  out.u32(fields.a_bytes);
  out.u32(fields.b_packets);
  out.u32(fields.b_bytes);
}

void pack_status(const StatusFields& fields, std::uint8_t (&into)[kStatusBytes]) {
  Writer out(into);
  out.u8(kStatusLayout);
  for (const std::uint8_t part : fields.version) out.u8(part);
  out.u32(fields.uptime_ms);
  out.u16(fields.boot_count);
  out.u8(fields.reset_reason);
  out.u8(fields.link_load_percent);
  out.u32(fields.tx_bytes);
  for (const std::uint32_t count : fields.pings_dropped) out.u32(count);
  for (const std::uint32_t count : fields.frame_errors) out.u32(count);
  for (const std::uint32_t count : fields.overflow_bytes) out.u32(count);
  out.u16(fields.i2c_errors);
  out.u16(fields.imu_errors);
  out.u16(fields.gps_errors);
  out.u16(fields.ec_errors);
  out.u16(fields.bad_commands);
  out.u64(fields.echoed_host_us);
  out.u32(fields.echo_device_us);
}

void pack_gps(const GpsFields& fields, std::uint8_t (&into)[kGpsBytes]) {
  Writer out(into);
  out.u32(fields.t_us);
  out.u8(fields.fix);
  out.u8(fields.satellites);
  out.u16(fields.hdop_x100);
  out.i32(fields.latitude_e7);
  out.i32(fields.longitude_e7);
  out.i32(fields.altitude_mm);
  out.u16(fields.speed_cmps);
  out.u16(fields.course_cdeg);
  out.u64(fields.utc_ms);
}

std::size_t pack_imu_burst(std::uint32_t t0_us, std::uint32_t dt_us, const ImuSample* samples, std::uint8_t count,
                           std::uint8_t* into) {
  Writer out(into);
  out.u32(t0_us);
  out.u32(dt_us);
  out.u8(count);
  out.u8(kImuScaleHwt905);
  for (std::size_t i = 0; i < count; ++i) {
    out.i16x3(samples[i].acceleration);
    out.i16x3(samples[i].angular_rate);
    out.i16x3(samples[i].magnetic_field);
  }
  return static_cast<std::size_t>(out.at() - into);
}

void pack_ack(std::uint8_t acked_type, std::uint8_t sequence, AckResult result, std::uint8_t (&into)[kAckBytes]) {
  into[0] = acked_type;
  into[1] = sequence;
  into[2] = static_cast<std::uint8_t>(result);
}

}  // namespace brov
