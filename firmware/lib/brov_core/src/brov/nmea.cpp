#include "brov/nmea.h"

#include "brov/checksums.h"
#include "brov/decimal.h"

namespace brov {

namespace {

constexpr std::uint64_t kAliveUs = 3000000, kGsaUs = 2500000, kOtherHalfUs = 400000;
constexpr std::int64_t kNanoPerHundred = 100 * kNano;  // ddmm.mmmm: degrees count hundreds

bool is(Bytes text, char c) { return text.size == 1 && text[0] == static_cast<std::uint8_t>(c); }

bool same(Bytes a, Bytes b) {
  if (a.size != b.size) {
    return false;
  }
  for (std::size_t i = 0; i < a.size; ++i) {
    if (a[i] != b[i]) {
      return false;
    }
  }
  return true;
}

int hex_digit(std::uint8_t c) {
  if (c >= '0' && c <= '9') {
    return c - '0';
  }
  if (c >= 'A' && c <= 'F') {
    return c - 'A' + 10;
  }
  return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

// `count` digits from `at` as a number, -1 if they are not all there.
int digits(Bytes text, std::size_t at, std::size_t count) {
  if (text.size < at + count) {
    return -1;
  }
  int value = 0;
  for (std::size_t i = at; i < at + count; ++i) {
    if (text[i] < '0' || text[i] > '9') {
      return -1;
    }
    value = 10 * value + (text[i] - '0');
  }
  return value;
}

// (d)ddmm.mmmm and its hemisphere.
bool coordinate(Bytes text, Bytes hemisphere, char positive, char negative, std::int64_t limit_deg, std::int32_t& e7) {
  std::int64_t nano = 0;
  if (!parse_decimal(text, nano) || !(is(hemisphere, positive) || is(hemisphere, negative))) {
    return false;
  }
  const std::int64_t whole_deg = nano / kNanoPerHundred, minutes_nano = nano % kNanoPerHundred;
  if (whole_deg > limit_deg || minutes_nano >= 60 * kNano) {
    return false;
  }
  const std::int64_t value = whole_deg * 10000000 + divide_rounded(minutes_nano, 6000);
  if (value > limit_deg * 10000000) {
    return false;
  }
  e7 = static_cast<std::int32_t>(is(hemisphere, positive) ? value : -value);
  return true;
}

// hhmmss(.s...) in ms of the day, -1 if it is not that.
std::int64_t time_of_day_ms(Bytes time) {
  const int hours = digits(time, 0, 2), minutes = digits(time, 2, 2), seconds = digits(time, 4, 2);
  std::int64_t seconds_nano = 0;
  if (hours < 0 || hours > 23 || minutes < 0 || minutes > 59 || seconds < 0 || seconds > 60 ||
      !parse_decimal(time.from(4), seconds_nano) || seconds_nano >= 61 * kNano) {
    return -1;
  }
  return (hours * 60 + minutes) * 60000 + divide_rounded(seconds_nano, 1000000);
}

// ddmmyy of this century in days since 1970, -1 if there is no such day.
std::int64_t days_since_1970(Bytes date) {
  constexpr int kDays[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
  const int day = digits(date, 0, 2), month = digits(date, 2, 2), year = digits(date, 4, 2);
  if (date.size != 6 || day < 1 || month < 1 || month > 12 || year < 0) {
    return -1;
  }
  const bool leap = year % 4 == 0;
  if (day > kDays[month - 1] + (leap && month == 2 ? 1 : 0)) {
    return -1;
  }
  std::int64_t days = 10957 + year * 365 + (year + 3) / 4;
  for (int m = 1; m < month; ++m) {
    days += kDays[m - 1] + (leap && m == 2 ? 1 : 0);
  }
  return days + day - 1;
}

}  // namespace

// Empty beyond the last field.
struct NmeaReader::Sentence {
  explicit Sentence(Bytes text) {
    std::size_t start = 0;
    for (std::size_t i = 0; i <= text.size && count < fields.size(); ++i) {
      if (i == text.size || text[i] == ',') {
        fields[count++] = text.first(i).from(start);
        start = i + 1;
      }
    }
  }
  Bytes operator[](std::size_t i) const { return i < count ? fields[i] : Bytes(); }

  std::array<Bytes, 20> fields{};
  std::size_t count = 0;
};

void NmeaReader::feed(Bytes batch, std::uint64_t now_us, ReportSink& sink) {
  for (std::size_t i = 0; i < batch.size; ++i) {
    const std::uint8_t byte = batch[i];
    if (byte == '$') {
      errors_ = static_cast<std::uint16_t>(errors_ + (in_line_ ? 1 : 0));
      in_line_ = true;
      size_ = 0;
      line_us_ = arrival_us(now_us, batch.size - 1 - i, kSensorBaud);
    }
    if (!in_line_) {
      continue;
    }
    if (byte == '\r' || byte == '\n') {
      in_line_ = false;
      end_line(now_us, sink);
    } else if (size_ == line_.size()) {
      in_line_ = false;
      ++errors_;
    } else {
      line_[size_++] = byte;
    }
  }
}

// $address,field,...*hh
void NmeaReader::end_line(std::uint64_t now_us, ReportSink& sink) {
  constexpr std::size_t kCheckBytes = 3;
  if (size_ > kCheckBytes && line_[size_ - kCheckBytes] == '*') {
    const int high = hex_digit(line_[size_ - 2]), low = hex_digit(line_[size_ - 1]);
    const Bytes text(&line_[1], size_ - 1 - kCheckBytes);
    if (high >= 0 && low >= 0 && xor8(text) == 16 * high + low) {
      sentence_seen_.set(now_us);
      sentence(text, now_us, sink);
      return;
    }
  }
  ++errors_;
}

void NmeaReader::sentence(Bytes text, std::uint64_t now_us, ReportSink& sink) {
  const Sentence fields(text);
  const Bytes address = fields[0];
  if (address.size != 5) {
    return;
  }
  const auto ends_with = [address](char a, char b, char c) {
    return address[2] == a && address[3] == b && address[4] == c;
  };
  if (ends_with('G', 'S', 'A')) {
    gsa_mode_ = static_cast<std::uint8_t>(is(fields[2], '2') ? 2 : is(fields[2], '3') ? 3 : 0);
    gsa_seen_.set(now_us);
  } else if (ends_with('G', 'G', 'A')) {
    join(fields[1], true, now_us, sink);
    take_gga(fields);
  } else if (ends_with('R', 'M', 'C')) {
    join(fields[1], false, now_us, sink);
    take_rmc(fields);
  }
  if (pending_.has_gga && pending_.has_rmc) {
    send(now_us, sink);
  }
}

// Makes the pending report one of this instant that still lacks this kind of sentence.
void NmeaReader::join(Bytes time, bool is_gga, std::uint64_t now_us, ReportSink& sink) {
  if (time.size > kMaxTimeBytes || time_of_day_ms(time) < 0) {
    time = Bytes();
  }
  const bool pending = pending_.has_gga || pending_.has_rmc;
  const bool has_this_kind = is_gga ? pending_.has_gga : pending_.has_rmc;
  if (pending && (has_this_kind || !same(time, Bytes(pending_.time.data(), pending_.time_size)))) {
    send(now_us, sink);
  }
  if (!pending_.has_gga && !pending_.has_rmc) {
    pending_.fields.t_us = static_cast<std::uint32_t>(line_us_);
    pending_.since_us = now_us;
    pending_.time_size = time.size;
    for (std::size_t i = 0; i < time.size; ++i) {
      pending_.time[i] = time[i];
    }
  }
}

// $--GGA,time,lat,N,lon,E,quality,satellites,hdop,altitude,M,...
void NmeaReader::take_gga(const Sentence& gga) {
  GpsFields& report = pending_.fields;
  pending_.has_gga = true;
  // 7 is typed in by hand, 8 simulated.
  pending_.gga_valid = digits(gga[6], 0, 1) > 0 && gga[6].size == 1 && !is(gga[6], '7') && !is(gga[6], '8');
  std::int32_t latitude_e7 = 0, longitude_e7 = 0;
  if (coordinate(gga[2], gga[3], 'N', 'S', 90, latitude_e7) && coordinate(gga[4], gga[5], 'E', 'W', 180, longitude_e7)) {
    pending_.has_position = true;
    report.latitude_e7 = latitude_e7;
    report.longitude_e7 = longitude_e7;
  }
  std::int64_t nano = 0;
  if (parse_decimal(gga[7], nano)) {
    report.satellites = static_cast<std::uint8_t>(clamped(nano / kNano, 0, 255));
  }
  if (parse_decimal(gga[8], nano)) {
    report.hdop_x100 = static_cast<std::uint16_t>(clamped(divide_rounded(nano, kNano / 100), 0, 65534));
  }
  if (parse_signed_decimal(gga[9], nano)) {
    pending_.has_altitude = true;
    report.altitude_mm = static_cast<std::int32_t>(clamped(divide_rounded(nano, kNano / 1000), INT32_MIN, INT32_MAX));
  }
}

// $--RMC,time,status,lat,N,lon,E,knots,course,date,...
void NmeaReader::take_rmc(const Sentence& rmc) {
  GpsFields& report = pending_.fields;
  pending_.has_rmc = true;
  pending_.rmc_valid = is(rmc[2], 'A');
  std::int32_t latitude_e7 = 0, longitude_e7 = 0;
  if (!pending_.has_position && coordinate(rmc[3], rmc[4], 'N', 'S', 90, latitude_e7) &&
      coordinate(rmc[5], rmc[6], 'E', 'W', 180, longitude_e7)) {
    pending_.has_position = true;
    report.latitude_e7 = latitude_e7;
    report.longitude_e7 = longitude_e7;
  }
  std::int64_t nano = 0;
  if (parse_decimal(rmc[7], nano)) {
    // 1 knot = 463 / 9 cm/s
    const std::int64_t knots_nano = clamped(nano, 0, 2000 * kNano);
    report.speed_cmps = static_cast<std::uint16_t>(clamped(divide_rounded(knots_nano * 463, 9 * kNano), 0, 65534));
  }
  if (parse_decimal(rmc[8], nano)) {
    report.course_cdeg = static_cast<std::uint16_t>(divide_rounded(nano, kNano / 100) % 36000);
  }
  const std::int64_t ms = time_of_day_ms(rmc[1]), days = days_since_1970(rmc[9]);
  if (ms >= 0 && days >= 0) {
    report.utc_ms = static_cast<std::uint64_t>(days * 86400000 + ms);
  }
}

void NmeaReader::send(std::uint64_t now_us, ReportSink& sink) {
  GpsFields report = pending_.fields;
  const bool invalid = (pending_.has_gga && !pending_.gga_valid) || (pending_.has_rmc && !pending_.rmc_valid);
  if (invalid || !pending_.has_position) {
    report.fix = 0;
    report.latitude_e7 = report.longitude_e7 = report.altitude_mm = 0;
    report.speed_cmps = report.course_cdeg = 0xFFFF;
  } else if (gsa_mode_ >= 2 && gsa_seen_.within(now_us, kGsaUs)) {
    report.fix = gsa_mode_;
  } else {
    report.fix = pending_.has_altitude ? 3 : 2;
  }
  pending_ = Pending{};
  report_ = report;
  report_seen_.set(now_us);
  sink.gps_report(report);
}

void NmeaReader::tick(std::uint64_t now_us, ReportSink& sink) {
  if ((pending_.has_gga || pending_.has_rmc) && now_us - pending_.since_us >= kOtherHalfUs) {
    send(now_us, sink);
  }
}

void NmeaReader::fill(SensorFields& fields, std::uint64_t now_us) const {
  fields.gps_alive = sentence_seen_.within(now_us, kAliveUs) ? 1 : 0;
  if (!report_seen_.within(now_us, kAliveUs)) {
    return;
  }
  fields.satellites = report_.satellites;
  if (report_.fix > 0) {
    fields.latitude_e7 = report_.latitude_e7;
    fields.longitude_e7 = report_.longitude_e7;
    fields.altitude_dm = static_cast<std::int16_t>(clamped(divide_rounded(report_.altitude_mm, 100), INT16_MIN, INT16_MAX));
  }
}

}  // namespace brov
