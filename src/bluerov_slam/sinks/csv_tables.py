"""A dive as tables: sensors, GPS, index of its pings, and positions from outside if there are any.

Units stand in the column names; unknown is empty.
"""

from __future__ import annotations

import csv
import datetime
import math
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from bluerov_slam.records import CtdSample, GpsFix, Ping, PositionFix, Record, SensorSample
from bluerov_slam.sinks.dive_track import DiveTrack

_TIME = ("utc", "unix_s", "monotonic_s")
_SENSORS = (
    "roll_deg", "pitch_deg", "yaw_deg", "acceleration_x_mps2", "acceleration_y_mps2", "acceleration_z_mps2",
    "gps_latitude_deg", "gps_longitude_deg", "gps_altitude_m", "gps_satellites", "temperature_degc",
    "depth_sensor_temperature_degc", "pressure_pa", "depth_m", "conductivity_s_per_m", "salinity_psu",
    "ec_salinity_psu", "sound_speed_mps", "a_packets", "a_bytes", "b_packets", "b_bytes",
)  # fmt: skip
_GPS = (
    "fix", "satellites", "hdop", "latitude_deg", "longitude_deg", "altitude_m", "speed_mps", "course_deg",
    "utc_of_receiver_unix_s",
)  # fmt: skip
_PINGS = (
    "channel", "sub_channel", "number", "samples", "first_sample", "resolution_m", "range_m", "decimation",
    "samples_lost", "latitude_deg", "longitude_deg", "yaw_deg", "pitch_deg", "roll_deg", "depth_m",
)  # fmt: skip
_POSITIONS = (
    "source", "latitude_deg", "longitude_deg", "north_variance_m2", "north_east_covariance_m2", "east_variance_m2",
    "depth_m",
)  # fmt: skip
POSITIONS = "positions.csv"
TABLES = {"sensors.csv": _SENSORS, "gps.csv": _GPS, "pings.csv": _PINGS}


class CsvTables:
    """Writes the three files into `folder`, which must exist. Use as a context manager; may raise OSError."""

    def __init__(self, folder: Path, track: DiveTrack) -> None:
        self.rows = dict.fromkeys(TABLES, 0)
        self._folder = folder
        self._track = track
        self._offset_s = track.utc_offset_s
        self._streams: list[TextIO] = []
        self._tables: dict[str, Any] = {}
        self._waiting: SensorSample | None = None
        for name, columns in TABLES.items():
            self._begin(name, columns)

    def __enter__(self) -> CsvTables:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._write_sensors(None)
        for stream in self._streams:
            stream.close()

    def write(self, record: Record) -> None:
        """Write the row of a record, if its type has one."""
        if isinstance(record, SensorSample):
            self._write_sensors(None)
            self._waiting = record
        elif isinstance(record, CtdSample):
            self._write_sensors(record)
        elif isinstance(record, GpsFix):
            self._row("gps.csv", record.measured_s, _gps_values(record))
        elif isinstance(record, PositionFix):
            self._write_position(record)
        elif isinstance(record, Ping):
            self._row("pings.csv", record.measured_s, self._ping_values(record))

    def _begin(self, name: str, columns: Sequence[str]) -> None:
        stream = (self._folder / name).open("w", newline="", encoding="utf-8")
        self._streams.append(stream)
        self._tables[name] = csv.writer(stream)
        self._tables[name].writerow((*_TIME, *columns))

    def _write_position(self, fix: PositionFix) -> None:
        if POSITIONS not in self._tables:
            self.rows[POSITIONS] = 0
            self._begin(POSITIONS, _POSITIONS)
        covariance = fix.covariance_ne_m2 or (None, None, None)
        values = (fix.source, fix.latitude_deg, fix.longitude_deg, *covariance, fix.depth_m)
        self._row(POSITIONS, fix.measured_s, values)

    def _write_sensors(self, ctd: CtdSample | None) -> None:
        """The sample that waits for the CTD computed from it."""
        sample, self._waiting = self._waiting, None
        if sample is not None:
            self._row("sensors.csv", sample.measured_s, _sensor_values(sample, ctd))

    def _row(self, table: str, measured_s: float, values: Sequence[object]) -> None:
        unix_s = None if self._offset_s is None else measured_s + self._offset_s
        time = (_iso(unix_s), _cell(unix_s, 6), _cell(measured_s, 6))
        self._tables[table].writerow((*time, *map(_cell, values)))
        self.rows[table] += 1

    def _ping_values(self, ping: Ping) -> tuple[object, ...]:
        state = self._track.at(ping.measured_s)
        return (
            ping.channel.value,
            ping.sub_channel,
            ping.number,
            len(ping.samples),
            ping.first_sample,
            ping.resolution_m,
            (ping.first_sample + len(ping.samples)) * ping.resolution_m,
            ping.decimation,
            sum(end - start for start, end in ping.gaps),
            state.latitude_deg,
            state.longitude_deg,
            _degrees(state.yaw_rad),
            _degrees(state.pitch_rad),
            _degrees(state.roll_rad),
            state.depth_m,
        )


def _sensor_values(sample: SensorSample, ctd: CtdSample | None) -> tuple[object, ...]:
    return (
        _degrees(sample.roll_rad),
        _degrees(sample.pitch_rad),
        _degrees(sample.yaw_rad),
        *(sample.acceleration_frd_mps2 or (None, None, None)),
        sample.gps_latitude_deg,
        sample.gps_longitude_deg,
        sample.gps_altitude_m,
        sample.gps_satellites,
        sample.temperature_degc,
        sample.depth_sensor_temperature_degc,
        sample.pressure_pa,
        ctd.depth_m if ctd else sample.depth_wire_m,
        sample.conductivity_s_per_m,
        ctd.salinity_psu if ctd else sample.salinity_wire_psu,
        sample.ec_salinity_psu,
        ctd.sound_speed_mps if ctd else sample.sound_speed_wire_mps,
        sample.a_packets,
        sample.a_bytes,
        sample.b_packets,
        sample.b_bytes,
    )


def _gps_values(fix: GpsFix) -> tuple[object, ...]:
    return (
        fix.fix.value,
        fix.satellites,
        fix.hdop,
        fix.latitude_deg,
        fix.longitude_deg,
        fix.altitude_m,
        fix.speed_mps,
        _degrees(fix.course_rad),
        fix.utc_unix_s,
    )


def _cell(value: object, digits: int = 9) -> object:
    """As few digits as the value needs; NaN and None are empty."""
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(round(value, digits))
    return "" if value is None else value


def _iso(unix_s: float | None) -> str:
    if unix_s is None:
        return ""
    return datetime.datetime.fromtimestamp(unix_s, datetime.UTC).isoformat(timespec="milliseconds")


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)
