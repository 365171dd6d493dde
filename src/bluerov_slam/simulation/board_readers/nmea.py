"""NMEA 0183 of a GPS receiver: GGA, RMC and GSA joined to one report a second."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from bluerov_slam.protocol.checksums import xor8
from bluerov_slam.protocol.esp32_messages import GpsFields
from bluerov_slam.simulation.board_readers.decimal_text import NANO, parse_decimal, parse_signed_decimal
from bluerov_slam.simulation.board_readers.readings import (
    NEVER_US,
    Fields,
    ReportSink,
    Stamp,
    arrival_us,
    clamped,
    divide_rounded,
)

_MAX_LINE_BYTES = 100
_MAX_TIME_BYTES = 12
_MAX_FIELDS = 20
_ALIVE_US, _GSA_US, _OTHER_HALF_US = 3_000_000, 2_500_000, 400_000
_I32_MIN, _I32_MAX = -(1 << 31), (1 << 31) - 1
_CHECKED = re.compile(rb"\$(.*)\*([0-9A-Fa-f]{2})", re.DOTALL)
_NOTHING = GpsFields(0, 0, 0, 0xFFFF, 0, 0, 0, 0xFFFF, 0xFFFF, 0)  # all ones: unknown


@dataclass(slots=True)
class _Pending:
    """What GGA and RMC of one instant have said so far."""

    time: bytes
    since_us: int
    fields: GpsFields
    has_gga: bool = False
    has_rmc: bool = False
    valid: bool = True
    has_position: bool = False
    has_altitude: bool = False


class NmeaReader:
    """Bytes in, reports and the newest position out."""

    def __init__(self) -> None:
        self.errors = 0
        self._line: bytearray | None = None
        self._line_us = 0
        self._pending: _Pending | None = None
        self._gsa_mode = 0
        self._report = _NOTHING
        self._gsa_seen, self._sentence_seen, self._report_seen = Stamp(), Stamp(), Stamp()

    def feed(self, batch: bytes, now_us: int, sink: ReportSink) -> None:
        """Take bytes, the last of which came now."""
        for index, byte in enumerate(batch):
            if byte == ord("$"):
                if self._line is not None:
                    self._count_error()
                self._line = bytearray()
                self._line_us = arrival_us(now_us, len(batch) - 1 - index)
            if self._line is None:
                continue
            if byte in b"\r\n":
                line, self._line = self._line, None
                self._end_line(bytes(line), now_us, sink)
            elif len(self._line) == _MAX_LINE_BYTES:
                self._line = None
                self._count_error()
            else:
                self._line.append(byte)

    def _count_error(self) -> None:
        self.errors = self.errors + 1 & 0xFFFF

    def _end_line(self, line: bytes, now_us: int, sink: ReportSink) -> None:
        match = _CHECKED.fullmatch(line)
        if match is None or xor8(match[1]) != int(match[2], 16):
            self._count_error()
            return
        self._sentence_seen.set(now_us)
        self._sentence(match[1].split(b",")[:_MAX_FIELDS], now_us, sink)

    def _sentence(self, fields: list[bytes], now_us: int, sink: ReportSink) -> None:
        fields += [b""] * (_MAX_FIELDS - len(fields))
        kind = fields[0][2:] if len(fields[0]) == 5 else b""
        if kind == b"GSA":
            self._gsa_mode = {b"2": 2, b"3": 3}.get(fields[2], 0)
            self._gsa_seen.set(now_us)
        elif kind == b"GGA":
            _take_gga(self._join(fields[1], True, now_us, sink), fields)
        elif kind == b"RMC":
            _take_rmc(self._join(fields[1], False, now_us, sink), fields)
        if self._pending and self._pending.has_gga and self._pending.has_rmc:
            self._send(self._pending, now_us, sink)

    def _join(self, time: bytes, is_gga: bool, now_us: int, sink: ReportSink) -> _Pending:
        if len(time) > _MAX_TIME_BYTES or _time_of_day_ms(time) is None:
            time = b""
        pending = self._pending
        if pending and (pending.time != time or (pending.has_gga if is_gga else pending.has_rmc)):
            self._send(pending, now_us, sink)
        if self._pending is None:
            self._pending = _Pending(time, now_us, replace(_NOTHING, t_us=self._line_us & 0xFFFFFFFF))
        return self._pending

    def _send(self, pending: _Pending, now_us: int, sink: ReportSink) -> None:
        report = pending.fields
        if not pending.valid or not pending.has_position:
            nothing = {
                "latitude_e7": 0,
                "longitude_e7": 0,
                "altitude_mm": 0,
                "speed_cmps": 0xFFFF,
                "course_cdeg": 0xFFFF,
            }
            report = replace(report, fix=0, **nothing)
        elif self._gsa_mode >= 2 and self._gsa_seen.within(now_us, _GSA_US):
            report = replace(report, fix=self._gsa_mode)
        else:
            report = replace(report, fix=3 if pending.has_altitude else 2)
        self._pending = None
        self._report = report
        self._report_seen.set(now_us)
        sink.gps_report(report)

    def tick(self, now_us: int, sink: ReportSink) -> None:
        """Send a report that has waited long enough for its other half."""
        if self._pending and now_us - self._pending.since_us >= _OTHER_HALF_US:
            self._send(self._pending, now_us, sink)

    @property
    def next_us(self) -> int:
        """When a report will have waited long enough."""
        return self._pending.since_us + _OTHER_HALF_US if self._pending else NEVER_US

    def fill(self, fields: Fields, now_us: int) -> None:
        """Write position, altitude, satellites and alive."""
        fields["gps_alive"] = int(self._sentence_seen.within(now_us, _ALIVE_US))
        if not self._report_seen.within(now_us, _ALIVE_US):
            return
        fields["satellites"] = self._report.satellites
        if self._report.fix > 0:
            fields["latitude_e7"] = self._report.latitude_e7
            fields["longitude_e7"] = self._report.longitude_e7
            fields["altitude_dm"] = clamped(divide_rounded(self._report.altitude_mm, 100), -32_768, 32_767)


def _take_gga(pending: _Pending, gga: list[bytes]) -> None:
    """$--GGA,time,lat,N,lon,E,quality,satellites,hdop,altitude,M,..."""
    pending.has_gga = True
    pending.valid &= gga[6] in (b"1", b"2", b"3", b"4", b"5", b"6", b"9")
    latitude_e7 = _coordinate(gga[2], gga[3], b"N", b"S", 90)
    longitude_e7 = _coordinate(gga[4], gga[5], b"E", b"W", 180)
    if latitude_e7 is not None and longitude_e7 is not None:
        pending.has_position = True
        pending.fields = replace(pending.fields, latitude_e7=latitude_e7, longitude_e7=longitude_e7)
    satellites, hdop, altitude = parse_decimal(gga[7]), parse_decimal(gga[8]), parse_signed_decimal(gga[9])
    if satellites is not None:
        pending.fields = replace(pending.fields, satellites=min(satellites // NANO, 255))
    if hdop is not None:
        pending.fields = replace(pending.fields, hdop_x100=min(divide_rounded(hdop, NANO // 100), 65_534))
    if altitude is not None:
        pending.has_altitude = True
        altitude_mm = clamped(divide_rounded(altitude, NANO // 1000), _I32_MIN, _I32_MAX)
        pending.fields = replace(pending.fields, altitude_mm=altitude_mm)


def _take_rmc(pending: _Pending, rmc: list[bytes]) -> None:
    """$--RMC,time,status,lat,N,lon,E,knots,course,date,..."""
    pending.has_rmc = True
    pending.valid &= rmc[2] == b"A"
    latitude_e7 = _coordinate(rmc[3], rmc[4], b"N", b"S", 90)
    longitude_e7 = _coordinate(rmc[5], rmc[6], b"E", b"W", 180)
    if not pending.has_position and latitude_e7 is not None and longitude_e7 is not None:
        pending.has_position = True
        pending.fields = replace(pending.fields, latitude_e7=latitude_e7, longitude_e7=longitude_e7)
    knots, course = parse_decimal(rmc[7]), parse_decimal(rmc[8])
    if knots is not None:
        speed_cmps = min(divide_rounded(min(knots, 2000 * NANO) * 463, 9 * NANO), 65_534)
        pending.fields = replace(pending.fields, speed_cmps=speed_cmps)
    if course is not None:
        pending.fields = replace(pending.fields, course_cdeg=divide_rounded(course, NANO // 100) % 36_000)
    ms, days = _time_of_day_ms(rmc[1]), _days_since_1970(rmc[9])
    if ms is not None and days is not None:
        pending.fields = replace(pending.fields, utc_ms=days * 86_400_000 + ms)


def _coordinate(text: bytes, hemisphere: bytes, positive: bytes, negative: bytes, limit_deg: int) -> int | None:
    nano = parse_decimal(text)
    if nano is None or hemisphere not in (positive, negative):
        return None
    whole_deg, minutes_nano = divmod(nano, 100 * NANO)
    value = whole_deg * 10_000_000 + divide_rounded(minutes_nano, 6000)
    if minutes_nano >= 60 * NANO or value > limit_deg * 10_000_000:
        return None
    return value if hemisphere == positive else -value


def _digits(text: bytes, at: int) -> int | None:
    two = text[at : at + 2]
    return int(two) if len(two) == 2 and two.isdigit() else None


def _time_of_day_ms(time: bytes) -> int | None:
    hours, minutes, seconds, seconds_nano = (
        _digits(time, 0),
        _digits(time, 2),
        _digits(time, 4),
        parse_decimal(time[4:]),
    )
    if hours is None or minutes is None or seconds is None or seconds_nano is None:
        return None
    if hours > 23 or minutes > 59 or seconds > 60 or seconds_nano >= 61 * NANO:
        return None
    return (hours * 60 + minutes) * 60_000 + divide_rounded(seconds_nano, 1_000_000)


def _days_since_1970(date: bytes) -> int | None:
    day, month, year = _digits(date, 0), _digits(date, 2), _digits(date, 4)
    if len(date) != 6 or day is None or month is None or year is None or not 1 <= month <= 12:
        return None
    lengths = [31, 29 if year % 4 == 0 else 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31]
    if not 1 <= day <= lengths[month - 1]:
        return None
    return 10_957 + year * 365 + (year + 3) // 4 + sum(lengths[: month - 1]) + day - 1
