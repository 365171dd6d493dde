#include <doctest/doctest.h>

#include "brov/checksums.h"
#include "reader_rig.h"

using namespace brov;

namespace {

std::string sentence(const std::string& body) {
  const std::uint8_t check = xor8(bytes_of(body));
  return "$" + body + "*" + to_hex(Bytes(&check, 1)) + "\r\n";
}

struct Gps {
  void say(const std::string& text, std::uint64_t now_us) {
    reader.feed(bytes_of(text), now_us, reports);
  }
  const GpsFields& only() const {
    REQUIRE(reports.gps.size() == 1);
    return reports.gps[0];
  }
  SensorFields fields(std::uint64_t now_us) const {
    SensorFields fields;
    reader.fill(fields, now_us);
    return fields;
  }

  NmeaReader reader;
  KeptReports reports;
};

// One second of a receiver with a fix, in the digits of u-blox, from a public manual; the checksums are the receiver's.
const std::string kUblox =
    "$GPRMC,041845.00,A,3846.50323,N,12115.39233,W,0.264,,040814,,,A*67\r\n"
    "$GPVTG,,T,,M,0.264,N,0.488,K,A*27\r\n";
const std::string kGga = "GPGGA,041845.00,3846.50323,N,12115.39233,W,1,03,7.16,72.5,M,-26.8,M,,";
const std::string kUbloxWithoutFix =
    "$GPRMC,,V,,,,,,,,,,N*53\r\n"
    "$GPVTG,,,,,,,,,N*30\r\n"
    "$GPGGA,,,,,,0,00,99.99,,,,,,*48\r\n"
    "$GPGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99*30\r\n"
    "$GPGSV,1,1,00*79\r\n"
    "$GPGLL,,,,,,V,N*64\r\n";

std::string rmc(const std::string& time, const std::string& date) {
  return sentence("GNRMC," + time + ",A,0100.00000,N,00200.00000,E,0.000,0.00," + date + ",,,A");
}
std::string gga(const std::string& time, const std::string& rest = "1,08,1.00,10.0,M,48.0,M,,") {
  return sentence("GNGGA," + time + ",0100.00000,N,00200.00000,E," + rest);
}
std::string at(const std::string& latitude, const std::string& longitude) {
  return sentence("GNGGA,120000.00," + latitude + "," + longitude + ",1,08,1.00,10.0,M,48.0,M,,");
}

}  // namespace

TEST_CASE("a u-blox receiver with a fix") {
  Gps gps;
  gps.say(kUblox + sentence(kGga), 5000000);
  const GpsFields& report = gps.only();
  CHECK(report.fix == 3);
  CHECK(report.satellites == 3);
  CHECK(report.hdop_x100 == 716);
  CHECK(report.latitude_e7 == 387750538);      // 38 + 46.50323 / 60
  CHECK(report.longitude_e7 == -1212565388);   // -(121 + 15.39233 / 60), rounded half away from zero
  CHECK(report.altitude_mm == 72500);
  CHECK(report.speed_cmps == 14);              // 0.264 knots = 13.58 cm/s
  CHECK(report.course_cdeg == 0xFFFF);         // left empty at rest: unknown, not north
  CHECK(report.utc_ms == 1407125925000u);      // 2014-08-04 04:18:45
  CHECK(gps.reader.errors() == 0);
  const SensorFields fields = gps.fields(5000000);
  CHECK(fields.gps_alive == 1);
  CHECK(fields.latitude_e7 == 387750538);
  CHECK(fields.longitude_e7 == -1212565388);
  CHECK(fields.altitude_dm == 725);
  CHECK(fields.satellites == 3);
}

TEST_CASE("a u-blox receiver without a fix is alive and has no position") {
  Gps gps;
  gps.say(kUbloxWithoutFix, 5000000);
  const GpsFields& report = gps.only();
  CHECK(report.fix == 0);
  CHECK(report.satellites == 0);
  CHECK(report.hdop_x100 == 9999);
  CHECK(report.latitude_e7 == 0);
  CHECK(report.longitude_e7 == 0);
  CHECK(report.utc_ms == 0);
  CHECK(gps.reader.errors() == 0);
  CHECK(gps.fields(5000000).gps_alive == 1);
  CHECK(gps.fields(5000000).latitude_e7 == 0);
}

TEST_CASE("without a fix the receiver's last position is not passed on") {
  Gps gps;
  gps.say(sentence("GNRMC,041845.00,V,3846.50323,N,12115.39233,W,1.0,90.00,040814,,,N") +
              sentence("GNGGA,041845.00,3846.50323,N,12115.39233,W,0,02,9.16,72.5,M,-26.8,M,,"),
          5000000);
  const GpsFields& report = gps.only();
  CHECK(report.fix == 0);
  CHECK(report.latitude_e7 == 0);
  CHECK(report.longitude_e7 == 0);
  CHECK(report.altitude_mm == 0);
  CHECK(report.speed_cmps == 0xFFFF);
  CHECK(report.course_cdeg == 0xFFFF);
  CHECK(report.satellites == 2);
  CHECK(report.utc_ms == 1407125925000u);
  CHECK(gps.fields(5000000).altitude_dm == 0);
}

TEST_CASE("each hemisphere has its sign") {
  struct Case {
    const char *latitude, *longitude;
    std::int32_t latitude_e7, longitude_e7;
  };
  for (const Case& c : {Case{"3351.00000,S", "15112.60000,E", -338500000, 1512100000},
                        Case{"3351.00000,N", "15112.60000,E", 338500000, 1512100000},
                        Case{"5130.00000,N", "00007.20000,W", 515000000, -1200000},
                        Case{"2254.00000,S", "04312.00000,W", -229000000, -432000000},
                        Case{"9000.00000,S", "18000.00000,W", -900000000, -1800000000}}) {
    Gps gps;
    gps.say(at(c.latitude, c.longitude), 1000000);
    gps.reader.tick(2000000, gps.reports);
    CAPTURE(c.latitude);
    CHECK(gps.only().fix == 3);
    CHECK(gps.only().latitude_e7 == c.latitude_e7);
    CHECK(gps.only().longitude_e7 == c.longitude_e7);
  }
}

TEST_CASE("a position that is none is no fix") {
  using Case = std::pair<const char*, const char*>;
  for (const Case& position :
       {Case{"9000.00010,N", "00000.00000,E"}, {"4560.00000,N", "00000.00000,E"}, {"4500.00000,N", "18000.00010,E"},
        {"4500.00000,X", "00000.00000,E"}, {"4500.00000,", "00000.00000,E"}, {",N", "00000.00000,E"},
        {"45x0.00000,N", "00000.00000,E"}, {"-4500.00000,N", "00000.00000,E"}, {"4500.00000,N", ","},
        {"99999999999999999999999999,N", "00000.00000,E"}}) {
    Gps gps;
    CAPTURE(position.first);
    gps.say(at(position.first, position.second), 1000000);
    gps.reader.tick(2000000, gps.reports);
    CHECK(gps.only().fix == 0);
    CHECK(gps.only().latitude_e7 == 0);
    CHECK(gps.reader.errors() == 0);
  }
}

TEST_CASE("absurd numbers saturate") {
  Gps gps;
  gps.say(sentence("GNRMC,120000.00,A,0100.00000,N,00200.00000,E,99999999999999,99999999999999,010125,,,A") +
              gga("120000.00", "1,99999,99999999,-99999999999,M,48.0,M,,"),
          1000000);
  CHECK(gps.only().satellites == 255);
  CHECK(gps.only().hdop_x100 == 65534);
  CHECK(gps.only().altitude_mm == INT32_MIN);
  CHECK(gps.only().speed_cmps == 65534);
  CHECK(gps.only().course_cdeg < 36000);
  CHECK(gps.fields(1000000).altitude_dm == INT16_MIN);
}

TEST_CASE("any talker, in either case of the checksum") {
  for (const char* talker : {"GP", "GN", "GL", "GA", "GB", "BD"}) {
    Gps gps;
    gps.say(sentence(std::string(talker) + "RMC,120000.00,A,0100.0,N,00200.0,E,0.0,0.0,010125,,,A"), 1000000);
    gps.say(sentence(std::string(talker) + "GGA,120000.00,0100.0,N,00200.0,E,1,08,1.0,10.0,M,48.0,M,,"), 1000000);
    CHECK(gps.only().fix == 3);
  }
  Gps gps;
  gps.say("$GPGSA,A,2,18,21,15,,,,,,,,,,7.23,7.16,1.00*0A\r\n$GPGSA,A,2,18,21,15,,,,,,,,,,7.23,7.16,1.00*0a\r\n", 1000000);
  CHECK(gps.reader.errors() == 0);
}

TEST_CASE("bad checksums, missing ones, cut and endless lines are errors") {
  const std::string good = sentence(kGga);
  Gps gps;
  gps.say("$GPGGA,041845.00,3846.50323,N,12115.39233,W,1,03,7.16,72.5,M,-26.8,M,,*5F\r\n", 1000000);
  CHECK(gps.reader.errors() == 1);
  CHECK(gps.fields(1000000).gps_alive == 0);
  gps.say("$" + kGga + "\r\n", 1100000);
  CHECK(gps.reader.errors() == 2);
  gps.say("$GPGGA,04" + good, 1200000);  // cut by the next one
  CHECK(gps.reader.errors() == 3);
  CHECK(gps.fields(1200000).gps_alive == 1);
  gps.say("$" + std::string(100, 'x') + "\r\n", 1300000);
  CHECK(gps.reader.errors() == 4);
  gps.say("$\r\n*00\r\n\x80\xFF,,,\r\n", 1400000);
  CHECK(gps.reader.errors() == 5);
  gps.reader.tick(1700000, gps.reports);
  CHECK(gps.reports.gps.size() == 1);
}

TEST_CASE("every single bit error is noticed") {
  const std::string good = sentence(kGga);
  for (std::size_t i = 0; i + 2 < good.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      Gps gps;
      std::string bad = good;
      bad[i] = static_cast<char>(bad[i] ^ 1 << bit);
      gps.say(bad, 1000000);
      gps.reader.tick(2000000, gps.reports);
      // Case of a hexadecimal digit is no content.
      const bool same = i + 4 >= good.size() && bit == 5;
      CHECK(gps.reports.gps.size() == (same && gps.reader.errors() == 0 ? 1 : 0));
    }
  }
}

TEST_CASE("a line of a hundred characters is one, of a hundred and one not") {
  const std::string start = "GPTXT,";
  Gps gps;
  gps.say(sentence(start + std::string(100 - 1 - 3 - start.size(), 'x')), 1000000);
  CHECK(gps.reader.errors() == 0);
  gps.say(sentence(start + std::string(101 - 1 - 3 - start.size(), 'x')), 1000000);
  CHECK(gps.reader.errors() == 1);
}

TEST_CASE("every split point gives the same report") {
  const std::string stream = kUblox + sentence(kGga);
  for (std::size_t split = 0; split <= stream.size(); ++split) {
    Gps gps;
    gps.say(stream.substr(0, split), 1000000);
    gps.say(stream.substr(split), 1001000);
    CHECK(gps.only().latitude_e7 == 387750538);
    CHECK(gps.reader.errors() == 0);
  }
}

TEST_CASE("the time of a report is that of its first dollar sign") {
  Gps gps;
  const std::string first = rmc("120000.00", "010125");
  gps.say("noise" + first, 1000000);
  gps.say(gga("120000.00"), 1090000);
  CHECK(gps.only().t_us == 1000000 - (first.size() - 1) * 10000000 / 9600);
}

TEST_CASE("midnight UTC and the turn of the year") {
  Gps gps;
  gps.say(rmc("235959.00", "311224") + gga("235959.00"), 1000000);
  gps.say(rmc("000000.00", "010125") + gga("000000.00"), 2000000);
  REQUIRE(gps.reports.gps.size() == 2);
  CHECK(gps.reports.gps[0].utc_ms == 1735689599000u);
  CHECK(gps.reports.gps[1].utc_ms == 1735689600000u);
}

TEST_CASE("dates of the century, leap years included") {
  struct Case {
    const char *time, *date;
    std::uint64_t utc_ms;
  };
  for (const Case& c : {Case{"000000.00", "010100", 946684800000u}, Case{"120000.25", "290200", 951825600250u},
                        Case{"000000.00", "010300", 951868800000u}, Case{"235959.99", "290224", 1709251199990u},
                        Case{"000000", "010170", 3155760000000u}, Case{"235959.9996", "311299", 4102444800000u},
                        Case{"235960.50", "311216", 1483228800500u}, Case{"000000.00", "290225", 0u},
                        Case{"000000.00", "310425", 0u}, Case{"000000.00", "001225", 0u},
                        Case{"000000.00", "011325", 0u}, Case{"240000.00", "010125", 0u},
                        Case{"006000.00", "010125", 0u}, Case{"000061.00", "010125", 0u}, Case{"", "010125", 0u},
                        Case{"000000.00", "", 0u}, Case{"000000.00", "1125", 0u}, Case{"0000", "010125", 0u}}) {
    Gps gps;
    CAPTURE(c.time);
    CAPTURE(c.date);
    gps.say(rmc(c.time, c.date) + gga(c.time), 1000000);
    CHECK(gps.only().utc_ms == c.utc_ms);
  }
}

TEST_CASE("either order of GGA and RMC makes one report at once") {
  for (const bool gga_first : {false, true}) {
    Gps gps;
    const std::string halves[] = {rmc("120000.00", "010125"), gga("120000.00")};
    gps.say(halves[gga_first ? 1 : 0], 1000000);
    CHECK(gps.reports.gps.empty());
    gps.say(halves[gga_first ? 0 : 1], 1100000);
    CHECK(gps.only().satellites == 8);
    CHECK(gps.only().utc_ms == 1735732800000u);
  }
}

TEST_CASE("half a report waits for 400 ms or for the next instant") {
  Gps gps;
  gps.say(rmc("120000.00", "010125"), 1000000);
  gps.reader.tick(1399999, gps.reports);
  CHECK(gps.reports.gps.empty());
  gps.reader.tick(1400000, gps.reports);
  REQUIRE(gps.reports.gps.size() == 1);
  CHECK(gps.reports.gps[0].fix == 2);
  CHECK(gps.reports.gps[0].satellites == 0);
  CHECK(gps.reports.gps[0].altitude_mm == 0);
  CHECK(gps.reports.gps[0].latitude_e7 == 10000000);
  gps.say(gga("120001.00"), 2000000);
  gps.say(rmc("120002.00", "010125"), 2100000);
  REQUIRE(gps.reports.gps.size() == 2);
  CHECK(gps.reports.gps[1].utc_ms == 0);
  CHECK(gps.reports.gps[1].fix == 3);
  gps.say(gga("120002.00"), 2200000);
  CHECK(gps.reports.gps.size() == 3);
}

TEST_CASE("the same kind again does not overwrite a half report") {
  Gps gps;
  gps.say(sentence("GPRMC,,V,,,,,,,,,,N"), 1000000);
  gps.say(sentence("GPRMC,,V,,,,,,,,,,N"), 1100000);
  CHECK(gps.reports.gps.size() == 1);
  gps.say(sentence("GPGGA,,,,,,0,00,99.99,,,,,,"), 1200000);
  CHECK(gps.reports.gps.size() == 2);
}

TEST_CASE("the fix type is the newest GSA's while it is fresh") {
  Gps gps;
  gps.say(sentence("GNGSA,A,2,01,02,03,,,,,,,,,,2.0,1.0,1.7"), 1000000);
  gps.say(rmc("120000.00", "010125") + gga("120000.00"), 3500000);
  gps.say(rmc("120001.00", "010125") + gga("120001.00"), 3500001);
  gps.say(sentence("GNGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99"), 4000000);
  gps.say(rmc("120002.00", "010125") + gga("120002.00"), 4100000);
  gps.say(rmc("120003.00", "010125") + gga("120003.00", "1,03,7.00,,,,,,"), 4200000);
  REQUIRE(gps.reports.gps.size() == 4);
  CHECK(gps.reports.gps[0].fix == 2);
  CHECK(gps.reports.gps[1].fix == 3);
  CHECK(gps.reports.gps[2].fix == 3);
  CHECK(gps.reports.gps[3].fix == 2);
}

TEST_CASE("what is typed in, simulated or declared invalid is no fix") {
  struct Case {
    const char *status, *quality;
    bool fix;
  };
  for (const Case& c : {Case{"A", "1", true}, Case{"A", "2", true}, Case{"A", "6", true}, Case{"V", "6", false},
                        Case{"A", "0", false}, Case{"A", "", false}, Case{"A", "7", false}, Case{"A", "8", false},
                        Case{"A", "11", false}, Case{"", "1", false}}) {
    Gps gps;
    CAPTURE(c.status);
    CAPTURE(c.quality);
    gps.say(sentence(std::string("GNRMC,120000.00,") + c.status + ",0100.0,N,00200.0,E,0.0,0.0,010125,,,A") +
                gga("120000.00", std::string(c.quality) + ",08,1.00,10.0,M,48.0,M,,"),
            1000000);
    CHECK((gps.only().fix > 0) == c.fix);
  }
}

TEST_CASE("old reports and a silent receiver fade from SENSORS") {
  Gps gps;
  gps.say(rmc("120000.00", "010125") + gga("120000.00"), 1000000);
  CHECK(gps.fields(4000000).latitude_e7 == 10000000);
  CHECK(gps.fields(4000000).gps_alive == 1);
  CHECK(gps.fields(4000001).latitude_e7 == 0);
  CHECK(gps.fields(4000001).satellites == 0);
  CHECK(gps.fields(4000001).gps_alive == 0);
}

TEST_CASE("speed and course come in the wire's units") {
  Gps gps;
  gps.say(sentence("GNRMC,120000.00,A,0100.0,N,00200.0,E,10.000,359.995,010125,,,A") + gga("120000.00"), 1000000);
  CHECK(gps.only().speed_cmps == 514);  // 5.1444 m/s
  CHECK(gps.only().course_cdeg == 0);   // 360.00 is north
}

TEST_CASE("a receiver without a fix for hours stays honest") {
  Gps gps;
  for (std::uint64_t second = 1; second <= 3 * 3600; ++second) {
    gps.say(kUbloxWithoutFix, second * 1000000);
    gps.reports.gps.clear();
  }
  CHECK(gps.reader.errors() == 0);
  CHECK(gps.fields(std::uint64_t{3} * 3600 * 1000000).gps_alive == 1);
  CHECK(gps.fields(std::uint64_t{3} * 3600 * 1000000).latitude_e7 == 0);
}
