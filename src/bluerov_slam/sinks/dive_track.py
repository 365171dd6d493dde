"""Where the vehicle was and what the water was like at any instant of a recorded dive, as far as it is known.

Filled from a first pass over the records, asked in a second. Values are interpolated between neighbours; further from a
measurement than the times below they are unknown, so a position of the surface never follows the vehicle down.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.records import CtdSample, FixType, GpsFix, Record, SensorSample

POSITION_AGE_S = 3.0
ATTITUDE_AGE_S = 3.0
WATER_AGE_S = 10.0

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DiveState:
    """The vehicle at one instant. None is unknown."""

    utc_unix_s: float | None
    latitude_deg: float | None
    longitude_deg: float | None
    course_rad: float | None
    speed_mps: float | None
    fix: int
    satellites: int
    roll_rad: float | None
    pitch_rad: float | None
    yaw_rad: float | None
    depth_m: float | None
    temperature_degc: float | None
    conductivity_s_per_m: float | None
    pressure_pa: float | None
    sound_speed_mps: float | None


class DiveTrack:
    """Collects samples with `add`; then answers `at`. `utc_offset_s` is UTC less host time where no GPS tells."""

    def __init__(self, utc_offset_s: float | None) -> None:
        self._recorded_offset_s = utc_offset_s
        self._attitude: list[tuple[float, ...]] = []
        self._water: list[tuple[float, ...]] = []
        self._fixes: list[tuple[float, ...]] = []
        self._surface: list[tuple[float, ...]] = []
        self._gps_offsets_s: list[float] = []
        self._tables: dict[str, _Table] | None = None

    @classmethod
    def of(cls, records: Iterable[Record], utc_offset_s: float | None) -> DiveTrack:
        """The track of these records."""
        track = cls(utc_offset_s)
        for record in records:
            track.add(record)
        return track

    def add(self, record: Record) -> None:
        """Take what a record tells about vehicle, water or time."""
        if isinstance(record, SensorSample):
            self._add_sample(record)
        elif isinstance(record, CtdSample):
            values = (
                record.depth_m,
                record.temperature_degc,
                record.conductivity_s_per_m,
                record.pressure_pa,
                record.sound_speed_mps,
            )
            self._water.append((record.measured_s, *map(_nan, values)))
        elif isinstance(record, GpsFix):
            self._add_fix(record)

    @property
    def utc_offset_s(self) -> float | None:
        """UTC less host time: by the dive's own GPS, else as recorded, else unknown."""
        if self._gps_offsets_s:
            return float(np.median(self._gps_offsets_s))
        return self._recorded_offset_s

    def at(self, measured_s: float) -> DiveState:
        """The vehicle at this host time."""
        tables = self._tables = self._tables or self._build()
        roll, pitch, yaw = tables["attitude"].at(measured_s)
        depth, temperature, conductivity, pressure, sound_speed = tables["water"].at(measured_s)
        latitude, longitude, course, speed, fix, satellites = tables["position"].at(measured_s)
        offset_s = self.utc_offset_s
        known = latitude is not None and longitude is not None
        return DiveState(
            utc_unix_s=None if offset_s is None else measured_s + offset_s,
            latitude_deg=latitude if known else None,
            longitude_deg=longitude if known else None,
            course_rad=_wrapped(course),
            speed_mps=speed,
            fix=int(fix) if known and fix is not None else 0,
            satellites=int(satellites) if satellites is not None else 0,
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rad=_wrapped(yaw),
            depth_m=depth,
            temperature_degc=temperature,
            conductivity_s_per_m=conductivity,
            pressure_pa=pressure,
            sound_speed_mps=sound_speed,
        )

    def _add_sample(self, sample: SensorSample) -> None:
        angles = (sample.roll_rad, sample.pitch_rad, sample.yaw_rad)
        self._attitude.append((sample.measured_s, *map(_nan, angles)))
        if sample.gps_latitude_deg is not None and sample.gps_longitude_deg is not None:
            position = (sample.gps_latitude_deg, sample.gps_longitude_deg, math.nan, math.nan, 3.0)
            self._surface.append((sample.measured_s, *position, float(sample.gps_satellites)))

    def _add_fix(self, fix: GpsFix) -> None:
        if fix.utc_unix_s is not None and fix.fix is not FixType.NONE:
            self._gps_offsets_s.append(fix.utc_unix_s - fix.measured_s)
        if fix.latitude_deg is None or fix.longitude_deg is None:
            return
        values = (fix.latitude_deg, fix.longitude_deg, fix.course_rad, fix.speed_mps)
        self._fixes.append((fix.measured_s, *map(_nan, values), float(fix.fix), float(fix.satellites)))

    def _build(self) -> dict[str, _Table]:
        return {
            "attitude": _Table(self._attitude, 3, ATTITUDE_AGE_S, angles=(0, 2)),
            "water": _Table(self._water, 5, WATER_AGE_S),
            "position": _Table(self._fixes or self._surface, 6, POSITION_AGE_S, angles=(2,), steps=(4, 5)),
        }


class _Table:
    """Columns over time, each interpolated over its own known values."""

    def __init__(
        self,
        rows: list[tuple[float, ...]],
        width: int,
        age_s: float,
        angles: tuple[int, ...] = (),
        steps: tuple[int, ...] = (),
    ) -> None:
        table = np.array(rows, np.float64).reshape(-1, width + 1)
        table = table[np.argsort(table[:, 0], kind="stable")]
        self._age_s = age_s
        self._steps = steps
        self._columns: list[tuple[FloatArray, FloatArray]] = []
        for column in range(width):
            known = ~np.isnan(table[:, column + 1])
            values = table[known, column + 1]
            self._columns.append((table[known, 0], np.unwrap(values) if column in angles else values))

    def at(self, time_s: float) -> list[float | None]:
        return [self._value(column, time_s) for column in range(len(self._columns))]

    def _value(self, column: int, time_s: float) -> float | None:
        times_s, values = self._columns[column]
        after = int(np.searchsorted(times_s, time_s))
        before = after - 1
        near_after = after < len(times_s) and times_s[after] - time_s <= self._age_s
        near_before = before >= 0 and time_s - times_s[before] <= self._age_s
        if near_after and near_before and column not in self._steps:
            share = (time_s - times_s[before]) / max(times_s[after] - times_s[before], 1e-9)
            return float(values[before] + share * (values[after] - values[before]))
        if near_before:
            return float(values[before])
        return float(values[after]) if near_after else None


def _nan(value: float | None) -> float:
    return math.nan if value is None else value


def _wrapped(angle_rad: float | None) -> float | None:
    """0 to 2 pi."""
    return None if angle_rad is None else angle_rad % (2.0 * math.pi)
