"""Imports a telemetry log (.tlog): the autopilot's messages as the records they are when they arrive live.

The autopilot's attitude is taken as it is. Its raw IMU messages (2 Hz as ground stations ask for them) are not: they
are too slow to integrate, and gyro and compass are inside the attitude already.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bluerov_slam.errors import RecordingError
from bluerov_slam.protocol.mavlink_map import vehicle_record
from bluerov_slam.records import Event, EventLevel, FixType, GpsFix, PositionFix, Record
from bluerov_slam.sources.imported_log import ImportedLog, ImportReport, LogClock, PositionWatch
from bluerov_slam.sources.vehicle_log import LoggedFrame, read_vehicle_log

KIND = "MAVLink telemetry log"

_VEHICLE_MESSAGES = {
    "ATTITUDE": "attitudes (ATTITUDE)",
    "SERVO_OUTPUT_RAW": "thruster outputs (SERVO_OUTPUT_RAW)",
    "BATTERY_STATUS": "battery states (BATTERY_STATUS)",
    "SCALED_PRESSURE2": "water pressures (SCALED_PRESSURE2, the external sensor)",
}
# Senders of these have identities of their own.
_INSTRUMENT_MESSAGES = {
    "VISION_POSITION_DELTA": "DVL displacements (VISION_POSITION_DELTA)",
    "DISTANCE_SENSOR": "heights above the bottom (DISTANCE_SENSOR)",
}
_ARDUPILOT = 3
# GPS_TYPE of ArduPilot: where its GPS_RAW_INT comes from.
_GPS_TYPE_MAVLINK = 14
_FIX_2D = 2
# ArduPilot and the acoustic systems send this as "no idea".
_HDOP_NONE = 99.0
# GPS_INPUT's ignore_flags.
_IGNORE_HORIZONTAL_ACCURACY = 1 << 6
_DEGREES_PER_UNIT = 1e-7
_LEVELS = ((3, EventLevel.ERROR), (4, EventLevel.WARNING))


def import_telemetry_log(path: Path) -> ImportedLog:
    """Every record of the log. Raises RecordingError naming the cure."""
    report = ImportReport()
    frames = read_vehicle_log(path, lambda count: _count(report, "damaged bytes between the frames", count))
    messages = _decoded(frames, report)
    records = _Records(messages, report).collect()
    if not report.read:
        raise RecordingError(
            f"{path}: {len(frames)} MAVLink frames, but nothing of an autopilot that navigation can use: "
            "give a .tlog recorded while the vehicle was connected"
        )
    return ImportedLog(KIND, frames[0].time_unix_s, True, records, report)


@dataclass(frozen=True, slots=True)
class _Message:
    time_unix_s: float
    system: int
    component: int
    name: str
    fields: dict[str, Any]


def _decoded(frames: Iterable[LoggedFrame], report: ImportReport) -> list[_Message]:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    parser = mavlink.MAVLink(None)
    messages: list[_Message] = []
    for frame in frames:
        try:
            message = parser.decode(bytearray(frame.data))
        except mavlink.MAVError as error:
            unknown = "unknown" in str(error)
            reason = "frames of a message we do not know" if unknown else "frames whose checksum is wrong"
            report.left_out[reason] += 1
            continue
        except Exception:  # whatever its unpacking meets in rubbish whose checksum is right
            report.left_out["frames that do not unpack"] += 1
            continue
        name, fields = message.get_type(), message.to_dict()
        messages.append(_Message(frame.time_unix_s, message.get_srcSystem(), message.get_srcComponent(), name, fields))
    return messages


class _Records:
    """Picks what navigation can use out of the messages of one log."""

    def __init__(self, messages: list[_Message], report: ImportReport) -> None:
        self._messages = messages
        self._report = report
        self._clock = LogClock(report, boot_times=True)
        self._watches: dict[str, PositionWatch] = {}
        self._autopilot = _find_autopilot(messages, report)
        self._unused: Counter[str] = Counter()
        self._gps_type = self._find_gps_type()
        self._given = any(message.name == "GPS_INPUT" and _is_fix(message.fields) for message in messages)

    def collect(self) -> list[Record]:
        """Every record, in order."""
        records = []
        for message in self._messages:
            own = (message.system, message.component) == self._autopilot
            boot_ms = message.fields.get("time_boot_ms")
            at_s = self._clock.at(message.time_unix_s, boot_ms * 1e-3 if own and boot_ms else None)
            record = self._record(message, own, at_s)
            if record is not None:
                records.append(record)
        if unused := sum(self._unused.values()):
            _count(self._report, f"messages of {len(self._unused)} kinds that navigation has no use for", unused)
        for name, watch in self._watches.items():
            if watch.is_frozen:
                self._report.note(
                    f"{name} gave one and the same position all the time: it was frozen; check the topside receiver"
                )
        if self._autopilot is not None and not self._report.read[_VEHICLE_MESSAGES["SCALED_PRESSURE2"]]:
            self._report.note("no message of an external pressure sensor (SCALED_PRESSURE2): the depth is unknown")
        return records

    def _record(self, message: _Message, own: bool, at_s: float) -> Record | None:
        name, fields = message.name, message.fields
        if name == "GPS_INPUT" and self._same_vehicle(message):
            return self._given_position(fields, at_s)
        if name == "GPS_RAW_INT" and own:
            return self._autopilots_position(fields, at_s)
        if name == "STATUSTEXT" and own:
            self._report.read["texts of the autopilot (STATUSTEXT)"] += 1
            level = next((level for most, level in _LEVELS if fields["severity"] <= most), EventLevel.INFO)
            return Event(at_s, level, f"autopilot: {fields['text']}")
        what = _VEHICLE_MESSAGES.get(name) if own else None
        if name in _INSTRUMENT_MESSAGES and self._same_vehicle(message):
            what = _INSTRUMENT_MESSAGES[name]
        if what is None:
            self._unused[name] += 1
            return None
        if name == "BATTERY_STATUS" and fields["id"] != 0:
            self._report.left_out["battery states of a second battery"] += 1
            return None
        record = vehicle_record(name, fields, at_s)
        if record is None:
            self._report.left_out[f"{name} without a usable value"] += 1
        else:
            self._report.read[what] += 1
        return record

    def _given_position(self, fields: dict[str, Any], at_s: float) -> PositionFix | None:
        """GPS_INPUT: what an acoustic or surface system gave the autopilot."""
        if not _is_fix(fields):
            self._report.left_out["GPS_INPUT without a fix (fix type below 2, or hdop 99.99)"] += 1
            return None
        ignored = int(fields["ignore_flags"]) & _IGNORE_HORIZONTAL_ACCURACY
        accuracy_m = 0.0 if ignored else float(fields["horiz_accuracy"])
        return self._fix("GPS_INPUT", fields, at_s, accuracy_m)

    def _autopilots_position(self, fields: dict[str, Any], at_s: float) -> PositionFix | GpsFix | None:
        """GPS_RAW_INT: a receiver on the autopilot, or an echo of GPS_INPUT."""
        if self._given:
            self._report.left_out["GPS_RAW_INT: the autopilot's echo of GPS_INPUT"] += 1
            return None
        if int(fields["fix_type"]) < _FIX_2D:
            self._report.left_out["GPS_RAW_INT without a fix"] += 1
            return None
        accuracy_m = int(fields.get("h_acc", 0)) / 1000.0
        fix = self._fix("GPS_RAW_INT", fields, at_s, accuracy_m)
        if fix is None or self._gps_type in (None, _GPS_TYPE_MAVLINK):
            return fix
        return _receiver_fix(fields, fix)

    def _fix(self, name: str, fields: dict[str, Any], at_s: float, accuracy_m: float) -> PositionFix | None:
        latitude_deg = int(fields["lat"]) * _DEGREES_PER_UNIT
        longitude_deg = int(fields["lon"]) * _DEGREES_PER_UNIT
        if reason := self._watches.setdefault(name, PositionWatch()).objection(latitude_deg, longitude_deg):
            self._report.left_out[f"{name} positions {reason}"] += 1
            return None
        self._report.read[f"positions ({name})"] += 1
        variance_m2 = accuracy_m**2
        covariance = (variance_m2, 0.0, variance_m2) if variance_m2 > 0.0 and math.isfinite(variance_m2) else None
        return PositionFix(at_s, at_s, name.lower(), latitude_deg, longitude_deg, covariance)

    def _same_vehicle(self, message: _Message) -> bool:
        return self._autopilot is None or message.system in (self._autopilot[0], 255)

    def _find_gps_type(self) -> int | None:
        for message in self._messages:
            if message.name == "PARAM_VALUE" and message.fields["param_id"] in ("GPS_TYPE", "GPS1_TYPE"):
                return int(message.fields["param_value"])
        return None


def _find_autopilot(messages: list[_Message], report: ImportReport) -> tuple[int, int] | None:
    """System and component of the ArduPilot most heard; without a heartbeat, of who sends ATTITUDE."""
    counts = Counter(
        (message.system, message.component)
        for message in messages
        if message.name == "HEARTBEAT" and message.fields["autopilot"] == _ARDUPILOT
    )
    if not counts:
        counts = Counter((message.system, message.component) for message in messages if message.name == "ATTITUDE")
    if not counts:
        return None
    (chosen, _), *others = counts.most_common()
    if others:
        report.note(f"{len(counts)} autopilots in this log; system {chosen[0]} was heard most and is taken")
    return chosen


def _is_fix(fields: dict[str, Any]) -> bool:
    hdop = float(fields["hdop"])
    return int(fields["fix_type"]) >= _FIX_2D and math.isfinite(hdop) and hdop < _HDOP_NONE


def _receiver_fix(fields: dict[str, Any], fix: PositionFix) -> GpsFix:
    speed_cmps, course_cdeg, hdop_c = int(fields["vel"]), int(fields["cog"]), int(fields["eph"])
    fix_3d = int(fields["fix_type"]) > _FIX_2D
    return GpsFix(
        fix.measured_s,
        fix.arrived_s,
        FixType.FIX_3D if fix_3d else FixType.FIX_2D,
        int(fields["satellites_visible"]),
        hdop_c / 100.0 if hdop_c != 0xFFFF else None,
        fix.latitude_deg,
        fix.longitude_deg,
        int(fields["alt"]) / 1000.0 if fix_3d else None,
        speed_cmps / 100.0 if speed_cmps != 0xFFFF else None,
        math.radians(course_cdeg / 100.0) if course_cdeg != 0xFFFF else None,
        None,
    )


def _count(report: ImportReport, what: str, count: int) -> None:
    if count:
        report.left_out[what] += count
