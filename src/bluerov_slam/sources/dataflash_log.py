"""Imports a dataflash log (.BIN) of ArduSub: what the autopilot wrote on its own card, in its own time.

Barometer instance 0 is the air inside the electronics tube, instance 1 the water outside; only the second is a depth.
The time is the autopilot's since it was switched on; the log knows the date only if a GPS told the autopilot.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bluerov_slam.errors import RecordingError
from bluerov_slam.protocol.mavlink_map import ORIENTATION_DOWN
from bluerov_slam.records import (
    FixType,
    GpsFix,
    PositionFix,
    Record,
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleRange,
    VehicleServoOutput,
)
from bluerov_slam.sources.imported_log import SMALL_STEP_S, ImportedLog, ImportReport, PositionWatch

KIND = "dataflash log of the autopilot"
MAGIC = b"\xa3\x95"

_PARAMETER = "PARM"
_DESCRIPTIONS = frozenset({"FMT", "FMTU", "UNIT", "MULT"})

_EARLIEST_UNIX_S = 946_684_800.0
_GPS_TYPE_MAVLINK = 14
_RANGE_GOOD = 4
_SERVOS = 16
# A gyro sample older than this says nothing of the rates at an attitude.
_RATE_AGE_S = 0.2
_NAN3 = (math.nan, math.nan, math.nan)


def import_dataflash_log(path: Path) -> ImportedLog:
    """Every record of the log. Raises RecordingError naming the cure."""
    report = ImportReport()
    complaints = io.StringIO()
    # The library writes what it stumbles over to standard error.
    with contextlib.redirect_stderr(complaints), contextlib.redirect_stdout(complaints):
        entries, timebase_s = _read(path, report)
    if damaged := len(complaints.getvalue().splitlines()):
        report.left_out["damaged places in the file"] += damaged
    timed = _in_order([entry for entry in entries if isinstance(entry.get("TimeUS"), int)], report)
    if not timed:
        raise RecordingError(f"{path}: a dataflash log without a single entry; download it from the autopilot again")
    start_s = timed[0]["TimeUS"] * 1e-6
    records = _Records(_parameters(entries), start_s, report).collect(timed)
    if not report.read:
        raise RecordingError(
            f"{path}: a dataflash log without attitude, pressure or position: set LOG_BITMASK so that the autopilot "
            "logs them (ArduSub's default does)"
        )
    start_unix_s = start_s + timebase_s
    dated = start_unix_s > _EARLIEST_UNIX_S
    if not dated:
        report.note("the log has no date (no GPS set the autopilot's clock): its time counts from the switch-on")
    return ImportedLog(KIND, start_unix_s if dated else None, dated, records, report)


def _read(path: Path, report: ImportReport) -> tuple[list[dict[str, Any]], float]:
    """The entries we use, and what to add to the autopilot's time to get UTC."""
    from pymavlink import DFReader

    try:
        reader = DFReader.DFReader_binary(str(path))
    except Exception as error:  # whatever the library meets in a damaged file
        raise RecordingError(f"{path}: not a readable dataflash log ({error}); download it again") from error
    entries: list[dict[str, Any]] = []
    unused: Counter[str] = Counter()
    try:
        while (message := reader.recv_msg()) is not None:
            kind = message.get_type()
            if kind in _READERS or kind == _PARAMETER:
                entries.append(message.to_dict())
            elif kind not in _DESCRIPTIONS:
                unused[kind] += 1
    except Exception:  # a cut or damaged end: what was read so far stands
        report.left_out["damaged places in the file"] += 1
    finally:
        reader.filehandle.close()
    if unused:
        report.left_out[f"entries of {len(unused)} kinds that navigation has no use for"] += unused.total()
    return entries, float(getattr(reader.clock, "timebase", 0.0))


def _in_order(entries: list[dict[str, Any]], report: ImportReport) -> list[dict[str, Any]]:
    """Without entries whose time lies ahead of both neighbours': a damaged one would take all that follows with it."""
    kept: list[dict[str, Any]] = []
    for number, entry in enumerate(entries):
        time_s = entry["TimeUS"] * 1e-6
        following = entries[number + 1]["TimeUS"] * 1e-6 if number + 1 < len(entries) else time_s
        before = kept[-1]["TimeUS"] * 1e-6 if kept else time_s
        if time_s - following > SMALL_STEP_S or before - time_s > SMALL_STEP_S:
            report.left_out["entries whose time is out of order"] += 1
            continue
        kept.append(entry)
    return kept


def _parameters(entries: list[dict[str, Any]]) -> dict[str, float]:
    return {str(entry["Name"]): float(entry["Value"]) for entry in entries if entry["mavpackettype"] == _PARAMETER}


class _Records:
    """Makes records of the entries of one log."""

    def __init__(self, parameters: dict[str, float], start_s: float, report: ImportReport) -> None:
        self._gps_type = parameters.get("GPS_TYPE", parameters.get("GPS1_TYPE"))
        self._start_s = start_s
        self._report = report
        self._watch = PositionWatch()
        self._rates: tuple[float, tuple[float, float, float]] = (-math.inf, _NAN3)

    def collect(self, entries: list[dict[str, Any]]) -> list[Record]:
        """Every record, in order."""
        records = list(self._records(entries))
        if not any(isinstance(record, VehicleDepth) for record in records):
            self._report.note("no external pressure sensor (barometer instance 1) in this log: the depth is unknown")
        if self._watch.is_frozen:
            self._report.note("GPS gave one and the same position all the time: it was frozen")
        return records

    def _records(self, entries: list[dict[str, Any]]) -> Iterator[Record]:
        for entry in entries:
            kind = entry["mavpackettype"]
            reader = _READERS.get(kind)
            if reader is None:
                continue
            try:
                record = reader(self, entry, entry["TimeUS"] * 1e-6 - self._start_s)
            except (KeyError, TypeError, ValueError, OverflowError):
                self._report.left_out[f"{kind} entries of a format we do not know"] += 1
                continue
            if record is not None:
                yield record

    def _read(self, what: str) -> None:
        self._report.read[what] += 1

    def imu(self, entry: dict[str, Any], at_s: float) -> None:
        if int(entry.get("I", 0)) == 0:
            self._rates = (at_s, (float(entry["GyrX"]), float(entry["GyrY"]), float(entry["GyrZ"])))
            self._report.left_out["IMU samples: attitude is taken from the autopilot, which has them inside"] += 1

    def attitude(self, entry: dict[str, Any], at_s: float) -> VehicleAttitude | None:
        roll, pitch, yaw = (math.radians(float(entry[name])) for name in ("Roll", "Pitch", "Yaw"))
        if not all(map(math.isfinite, (roll, pitch, yaw))):
            self._report.left_out["attitudes without numbers"] += 1
            return None
        self._read("attitudes (ATT)")
        seen_s, rates = self._rates
        fresh = at_s - seen_s <= _RATE_AGE_S
        return VehicleAttitude(
            at_s, _boot_ms(entry), roll, pitch, math.remainder(yaw, math.tau), rates if fresh else _NAN3
        )

    def pressure(self, entry: dict[str, Any], at_s: float) -> VehicleDepth | None:
        if entry["mavpackettype"] == "BARO" and int(entry.get("I", 0)) != 1:
            self._report.left_out["internal air pressures (barometer instance 0)"] += 1
            return None
        pressure_pa, temperature_degc = float(entry["Press"]), float(entry["Temp"])
        if int(entry.get("Health", 1)) == 0 or not math.isfinite(pressure_pa) or pressure_pa <= 0.0:
            self._report.left_out["water pressures that the autopilot calls unhealthy"] += 1
            return None
        self._read("water pressures (barometer instance 1, the external sensor)")
        return VehicleDepth(
            at_s, _boot_ms(entry), pressure_pa, None, temperature_degc if math.isfinite(temperature_degc) else None
        )

    def servo(self, entry: dict[str, Any], at_s: float) -> VehicleServoOutput:
        self._read("thruster outputs (RCOU)")
        pwm_us = tuple(int(entry.get(f"C{number}", 0)) for number in range(1, _SERVOS + 1))
        return VehicleServoOutput(at_s, int(entry["TimeUS"]), pwm_us)

    def battery(self, entry: dict[str, Any], at_s: float) -> VehicleBattery | None:
        if int(entry.get("Instance", 0)) != 0:
            return None
        voltage_v, current_a = float(entry["Volt"]), float(entry["Curr"])
        remaining = int(entry.get("RemPct", 255))
        self._read("battery states (BAT)")
        return VehicleBattery(
            at_s,
            voltage_v if math.isfinite(voltage_v) and voltage_v > 0.0 else None,
            # A board without a current sensor logs its offset: negative.
            current_a if math.isfinite(current_a) and current_a >= 0.0 else None,
            remaining if 0 <= remaining <= 100 else None,
        )

    def position(self, entry: dict[str, Any], at_s: float) -> PositionFix | GpsFix | None:
        if int(entry.get("I", 0)) != 0:
            return None
        status = int(entry["Status"])
        if status < FixType.FIX_2D:
            self._report.left_out["GPS entries without a fix"] += 1
            return None
        latitude_deg, longitude_deg = float(entry["Lat"]), float(entry["Lng"])
        if reason := self._watch.objection(latitude_deg, longitude_deg):
            self._report.left_out[f"GPS positions {reason}"] += 1
            return None
        self._read("positions (GPS)")
        if self._gps_type in (None, _GPS_TYPE_MAVLINK):
            return PositionFix(at_s, at_s, "autopilot_gps", latitude_deg, longitude_deg, None)
        return GpsFix(
            at_s,
            at_s,
            FixType.FIX_3D if status > FixType.FIX_2D else FixType.FIX_2D,
            int(entry["NSats"]),
            float(entry["HDop"]),
            latitude_deg,
            longitude_deg,
            float(entry["Alt"]) if status > FixType.FIX_2D else None,
            float(entry["Spd"]),
            math.radians(float(entry["GCrs"])),
            None,
        )

    def range(self, entry: dict[str, Any], at_s: float) -> VehicleRange | None:
        distance_m = float(entry["Dist"])
        good = int(entry.get("Stat", _RANGE_GOOD)) == _RANGE_GOOD
        if not good or int(entry.get("Orient", ORIENTATION_DOWN)) != ORIENTATION_DOWN or not distance_m > 0.0:
            self._report.left_out["distances that are out of range or do not look down"] += 1
            return None
        self._read("heights above the bottom (RFND)")
        quality = int(entry.get("Quality", -1))
        return VehicleRange(at_s, _boot_ms(entry), distance_m, quality if 0 <= quality <= 100 else None)


def _boot_ms(entry: dict[str, Any]) -> int:
    return int(entry["TimeUS"]) // 1000


_READERS: dict[str, Callable[[_Records, dict[str, Any], float], Record | None]] = {
    "IMU": _Records.imu,
    "ATT": _Records.attitude,
    "BARO": _Records.pressure,
    "BAR2": _Records.pressure,
    "RCOU": _Records.servo,
    "BAT": _Records.battery,
    "GPS": _Records.position,
    "RFND": _Records.range,
}
