// Payloads of AA55 frames written and read field by field. docs/protocol.md sections 1 and 2.
#pragma once

#include <array>

#include "brov/bytes.h"

namespace brov {

constexpr std::size_t kSensorsBytes = 76;
constexpr std::size_t kStatusBytes = 62;
constexpr std::size_t kGpsBytes = 32;
constexpr std::size_t kAckBytes = 3;
constexpr std::size_t kImuBurstHeaderBytes = 10;
constexpr std::size_t kImuSampleBytes = 18;
// A burst closes when (2 count + 1) periods reach 200 ms, so at 20 Hz and below no more than 2 samples gather.
constexpr std::uint8_t kMaxBurstSamples = 4;

// The wire's integers, in wire order. The caller has saturated them.
struct SensorFields {
  std::uint32_t device_ms = 0;
  std::int16_t roll_cdeg = 0, pitch_cdeg = 0, yaw_cdeg = 0;
  std::int16_t acceleration_mg[3] = {0, 0, 0};
  std::uint32_t imu_packets = 0;
  std::uint16_t imu_errors = 0;
  std::uint8_t imu_alive = 0;
  std::int32_t latitude_e7 = 0, longitude_e7 = 0;
  std::int16_t altitude_dm = 0;
  std::uint8_t satellites = 0, gps_alive = 0;
  std::uint16_t conductivity_dus = 0xFFFF, ec_salinity_cpsu = 0xFFFF;
  std::uint8_t ec_alive = 0;
  std::uint8_t extension = 1;
  std::uint32_t full_conductivity_dus = 0xFFFFFF;  // u24
  std::uint32_t full_pressure_pa = 0xFFFFFF;       // u24, 0.01 mbar = 1 Pa
  std::uint16_t pressure_dmbar = 0xFFFF;
  std::int16_t depth_temperature_cdegc = 0;
  std::uint8_t depth_ok = 0;
  std::int16_t temperature_cdegc = 0;
  std::uint8_t temperature_ok = 0;
  std::uint16_t sound_speed_dmps = 0xFFFF, depth_cm = 0xFFFF;
  std::uint8_t salinity_dpsu = 0xFF;
  std::uint32_t a_packets = 0, a_bytes = 0, b_packets = 0, b_bytes = 0;
};
void pack_sensors(const SensorFields& fields, std::uint8_t (&into)[kSensorsBytes]);

struct StatusFields {
  std::uint8_t version[3] = {0, 0, 0};
  std::uint32_t uptime_ms = 0;
  std::uint16_t boot_count = 0;
  std::uint8_t reset_reason = 0, link_load_percent = 0;
  std::uint32_t tx_bytes = 0;
  std::uint32_t pings_dropped[2] = {0, 0}, frame_errors[2] = {0, 0}, overflow_bytes[2] = {0, 0};
  std::uint16_t i2c_errors = 0, imu_errors = 0, gps_errors = 0, ec_errors = 0, bad_commands = 0;
  std::uint64_t echoed_host_us = 0;
  std::uint32_t echo_device_us = 0;
};
void pack_status(const StatusFields& fields, std::uint8_t (&into)[kStatusBytes]);

struct GpsFields {
  std::uint32_t t_us = 0;
  std::uint8_t fix = 0, satellites = 0;
  std::uint16_t hdop_x100 = 0xFFFF;
  std::int32_t latitude_e7 = 0, longitude_e7 = 0, altitude_mm = 0;
  std::uint16_t speed_cmps = 0xFFFF, course_cdeg = 0xFFFF;  // all ones: unknown, as for hdop_x100
  std::uint64_t utc_ms = 0;
};
void pack_gps(const GpsFields& fields, std::uint8_t (&into)[kGpsBytes]);

struct ImuSample {
  std::uint64_t time_us = 0;
  std::int16_t acceleration[3] = {0, 0, 0}, angular_rate[3] = {0, 0, 0}, magnetic_field[3] = {0, 0, 0};
};
// `into` has kImuBurstHeaderBytes + count * kImuSampleBytes bytes; returns that.
std::size_t pack_imu_burst(std::uint32_t t0_us, std::uint32_t dt_us, const ImuSample* samples, std::uint8_t count,
                           std::uint8_t* into);

enum class AckResult : std::uint8_t { kOk = 0, kBadInnerChecksum = 1, kUnknown = 2, kRejected = 3, kBusy = 4 };
void pack_ack(std::uint8_t acked_type, std::uint8_t sequence, AckResult result, std::uint8_t (&into)[kAckBytes]);

}  // namespace brov
