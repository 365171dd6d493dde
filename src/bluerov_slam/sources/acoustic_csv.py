"""Imports what a Water Linked UGPS G2 topside logged (a folder of CSV files): positions of the vehicle in the water.

The device measures x (forward), y (starboard) and z (down) from its antenna. The antenna's own compass turns them to
north, the boat's GNSS puts them on the globe. `std` is the device's own standard deviation, taken per axis.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from pathlib import Path

from bluerov_slam.errors import RecordingError
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.records import PositionFix, Record
from bluerov_slam.sources.csv_columns import number, read_rows
from bluerov_slam.sources.imported_log import ImportedLog, ImportReport, LogClock

KIND = "Water Linked G2 acoustic positions"
MARK = "_g2_acoustic.csv"

# Antenna heading and boat position further away in time than this are unknown.
_ORIENTATION_AGE_S = 1.0
_BOAT_AGE_S = 3.0
# What the device says where it knows nothing.
_STD_NONE_M = 100.0


def import_acoustic_folder(folder: Path) -> ImportedLog:
    """Every valid, new position. Raises RecordingError naming the cure."""
    acoustic = _only(folder, MARK)
    report = ImportReport()
    needed = ("timestamp", "position_valid", "x", "y", "z", "std")
    antenna = _series(_only(folder, "_g2_orientation.csv"), ("yaw",), report)
    boat = _series(_only(folder, "_g2_position.csv"), ("lat", "lon"), report)
    clock = LogClock(report, boot_times=False)
    records: list[Record] = []
    before: tuple[float | None, ...] | None = None
    start_s: float | None = None
    for row in read_rows(acoustic, needed, report):
        stamp_s = number(row, "timestamp")
        if stamp_s is None:
            report.left_out["rows without a timestamp"] += 1
            continue
        start_s = stamp_s if start_s is None else start_s
        at_s = clock.at(stamp_s)
        values = tuple(number(row, name) for name in ("x", "y", "z", "std"))
        if values[:3] == before:
            report.left_out["positions that repeat the one before: nothing new was measured"] += 1
            continue
        before = values[:3]
        if row["position_valid"].strip().lower() not in ("true", "1"):
            report.left_out["positions the device calls invalid"] += 1
        elif any(value is None for value in values) or (values[3] or 0.0) >= _STD_NONE_M:
            report.left_out["positions without an error of their own (std 100)"] += 1
        else:
            x, y, z, std = (float(value) for value in values if value is not None)
            fix = _fix(at_s, (x, y, z), std, antenna.at(stamp_s, _ORIENTATION_AGE_S), boat.at(stamp_s, _BOAT_AGE_S))
            if fix is None:
                report.left_out["positions without antenna heading or boat position at their time"] += 1
            else:
                report.read["positions (acoustic)"] += 1
                records.append(fix)
    if start_s is None or not records:
        raise RecordingError(f"{acoustic}: no valid position; was the locator in the water and switched on?")
    report.note("bearings are by the antenna's own compass; the boat's heading is not used")
    report.note("positions alone give no attitude: the track is made of fixes and what lies between them")
    return ImportedLog(KIND, start_s, True, records, report)


class _Series:
    """Values by time; asked for the newest that is not too old."""

    def __init__(self, times: list[float], values: list[tuple[float, ...]]) -> None:
        self._times = times
        self._values = values

    def at(self, time_s: float, age_s: float) -> tuple[float, ...] | None:
        """The newest values up to this time."""
        place = bisect_right(self._times, time_s) - 1
        return self._values[place] if place >= 0 and time_s - self._times[place] <= age_s else None


def _series(path: Path, columns: tuple[str, ...], report: ImportReport) -> _Series:
    times: list[float] = []
    values: list[tuple[float, ...]] = []
    for row in read_rows(path, ("timestamp", *columns), report):
        stamp_s = number(row, "timestamp")
        cells = [number(row, name) for name in columns]
        known = tuple(cell for cell in cells if cell is not None)
        if stamp_s is None or len(known) < len(cells) or (times and stamp_s < times[-1]):
            report.left_out[f"rows of {path.name} without values or out of order"] += 1
            continue
        times.append(stamp_s)
        values.append(known)
    return _Series(times, values)


def _fix(
    at_s: float,
    antenna_frd_m: tuple[float, float, float],
    std_m: float,
    yaw_deg: tuple[float, ...] | None,
    boat_deg: tuple[float, ...] | None,
) -> PositionFix | None:
    if yaw_deg is None or boat_deg is None:
        return None
    x, y, z = antenna_frd_m
    cosine, sine = math.cos(math.radians(yaw_deg[0])), math.sin(math.radians(yaw_deg[0]))
    north_m, east_m = cosine * x - sine * y, sine * x + cosine * y
    latitude_deg, longitude_deg, _ = LocalFrame(*boat_deg).to_geodetic(north_m, east_m)
    return PositionFix(at_s, at_s, "water_linked_g2", latitude_deg, longitude_deg, (std_m**2, 0.0, std_m**2), z)


def _only(folder: Path, ending: str) -> Path:
    found = sorted(folder.glob(f"*{ending}"))
    if not found:
        raise RecordingError(f"{folder}: no file *{ending}; give the folder with all CSV files of the topside")
    if len(found) > 1:
        raise RecordingError(f"{folder}: {len(found)} files *{ending}; give a folder with one dive")
    return found[0]
