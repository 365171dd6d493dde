"""Imports the CSV log that QGroundControl writes beside its telemetry log: a row a second, in the pilot's own units.

QGroundControl writes the depth in the unit the pilot has chosen and does not say which. `altitudeTuning` is always in
metres, so that the ratio of the two tells. The clock is the computer's local time, without its zone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import PositionFix, Record, VehicleAttitude, VehicleBattery, VehicleDepth, VehicleRange
from bluerov_slam.sources.csv_columns import number, read_rows, time_of_day
from bluerov_slam.sources.imported_log import ImportedLog, ImportReport, LogClock, PositionWatch

KIND = "QGroundControl CSV log"

Row = dict[str, str]
_NEEDED = ("Timestamp", "roll", "pitch", "heading")
_RATES = ("rollRate", "pitchRate", "yawRate")
_METRES_PER_FOOT = 0.3048
# Samples and metres of depth that the ratio of the two altitudes needs; how near it must come to a unit's.
_RATIO_ROWS, _RATIO_SPREAD_M, _RATIO_TOLERANCE = 20, 0.3, 0.03
_FIX_2D = 2.0
_HDOP_NONE = 99.0


def import_ground_station_csv(path: Path, utc_offset_h: float | None = None) -> ImportedLog:
    """Every record of the log; `utc_offset_h` is local time less UTC. Raises RecordingError naming the cure."""
    report = ImportReport()
    rows = []
    for row in read_rows(path, _NEEDED, report):
        stamp_s = time_of_day(row["Timestamp"])
        if stamp_s is None:
            report.left_out["rows without a readable Timestamp"] += 1
        else:
            rows.append((stamp_s, row))
    if not rows:
        raise RecordingError(f"{path}: a QGroundControl log without a row; it starts when the vehicle is connected")
    clock = LogClock(report, boot_times=False)
    to_records = _Rows([row for _, row in rows], report)
    records: list[Record] = []
    for stamp_s, row in rows:
        records += to_records.records(row, clock.at(stamp_s))
    if to_records.watch.is_frozen:
        report.note("gps.lat and gps.lon never changed: the position was frozen; check the topside receiver")
    if utc_offset_h is None:
        report.note("the log's times are local and name no zone: give --utc-offset to date it (for example -7)")
    if not report.read:
        raise RecordingError(f"{path}: every row is empty (--.--): the vehicle was not connected")
    start_unix_s = rows[0][0] - (utc_offset_h or 0.0) * 3600.0
    return ImportedLog(KIND, start_unix_s, utc_offset_h is not None, records, report)


class _Rows:
    """Makes the records of each row."""

    def __init__(self, rows: list[Row], report: ImportReport) -> None:
        self.watch = PositionWatch()
        self._report = report
        self._metres = _metres_per_unit(rows, report)
        # ArduSub's QGroundControl leaves these columns at 0: then the rates are unknown, not zero.
        self._has_rates = any(number(row, name) for row in rows for name in _RATES)
        if not self._has_rates:
            report.note("the columns of the turn rates are always 0: the rates are unknown")
        self._makers: tuple[Callable[[Row, float], Record | None], ...] = (
            self._attitude,
            self._depth,
            self._battery,
            self._range,
            self._position,
        )

    def records(self, row: Row, at_s: float) -> list[Record]:
        """What this row tells."""
        made = (maker(row, at_s) for maker in self._makers)
        return [record for record in made if record is not None]

    def _attitude(self, row: Row, at_s: float) -> VehicleAttitude | None:
        roll, pitch, heading = (number(row, name) for name in ("roll", "pitch", "heading"))
        if roll is None or pitch is None or heading is None:
            self._report.left_out["rows without an attitude (--.--)"] += 1
            return None
        rates = [number(row, name) if self._has_rates else None for name in _RATES]
        x, y, z = (math.nan if rate is None else math.radians(rate) for rate in rates)
        self._report.read["attitudes (roll, pitch, heading)"] += 1
        yaw = math.remainder(math.radians(heading), math.tau)
        return VehicleAttitude(at_s, _log_ms(at_s), math.radians(roll), math.radians(pitch), yaw, (x, y, z))

    def _depth(self, row: Row, at_s: float) -> VehicleDepth | None:
        altitude = number(row, "altitudeRelative")
        if altitude is None or self._metres is None:
            self._report.left_out["rows without a depth (altitudeRelative)"] += 1
            return None
        self._report.read["depths (altitudeRelative)"] += 1
        return VehicleDepth(at_s, _log_ms(at_s), None, -altitude * self._metres, None)

    def _battery(self, row: Row, at_s: float) -> VehicleBattery | None:
        voltage_v, current_a = number(row, "battery0.voltage"), number(row, "battery0.current")
        remaining = number(row, "battery0.percentRemaining")
        if voltage_v is None and current_a is None and remaining is None:
            return None
        self._report.read["battery states"] += 1
        return VehicleBattery(at_s, voltage_v, current_a, None if remaining is None else round(remaining))

    def _range(self, row: Row, at_s: float) -> VehicleRange | None:
        distance = number(row, "distanceSensor.rotationPitch270")
        if distance is None or distance <= 0.0 or self._metres is None:
            return None
        self._report.read["heights above the bottom"] += 1
        return VehicleRange(at_s, _log_ms(at_s), distance * self._metres, None)

    def _position(self, row: Row, at_s: float) -> PositionFix | None:
        latitude_deg, longitude_deg = number(row, "gps.lat"), number(row, "gps.lon")
        lock, hdop = number(row, "gps.lock"), number(row, "gps.hdop")
        if latitude_deg is None or longitude_deg is None:
            self._report.left_out["rows without a position (--.--)"] += 1
            return None
        if (lock is not None and lock < _FIX_2D) or (hdop is not None and hdop >= _HDOP_NONE):
            self._report.left_out["positions without a lock"] += 1
            return None
        if reason := self.watch.objection(latitude_deg, longitude_deg):
            self._report.left_out[f"positions {reason}"] += 1
            return None
        self._report.read["positions (gps.lat, gps.lon)"] += 1
        return PositionFix(at_s, at_s, "qgroundcontrol_gps", latitude_deg, longitude_deg, None)


def _metres_per_unit(rows: list[Row], report: ImportReport) -> float | None:
    """How many metres one unit of the log's depths has; None if it can be neither metres nor feet."""
    pairs = [(number(row, "altitudeTuning"), number(row, "altitudeRelative")) for row in rows]
    known = np.array([pair for pair in pairs if None not in pair], dtype=np.float64)
    if len(known) < _RATIO_ROWS or np.ptp(known[:, 0]) < _RATIO_SPREAD_M:
        report.note("the log does not show in which unit its depths are: metres are assumed")
        return 1.0
    ratio = float(np.polyfit(known[:, 0], known[:, 1], 1)[0])
    if abs(ratio - 1.0) <= _RATIO_TOLERANCE:
        return 1.0
    if abs(ratio * _METRES_PER_FOOT - 1.0) <= _RATIO_TOLERANCE:
        report.note("the log's depths are in feet (altitudeRelative against altitudeTuning): converted to metres")
        return _METRES_PER_FOOT
    report.note(f"the log's depths are in no unit we know ({ratio:.2f} to the metre): they were left out")
    return None


def _log_ms(at_s: float) -> int:
    """Milliseconds since the log's beginning, where the autopilot's own are not logged."""
    return round(at_s * 1000.0)
