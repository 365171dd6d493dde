"""A check of a rig as JSON: every place with the attitude read there, and the verdict; read again for a later check."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.errors import RecordingError
from bluerov_slam.rig.check import CheckReadings
from bluerov_slam.sinks.whole_output import in_whole

if TYPE_CHECKING:
    from bluerov_slam.rig.check import CheckVerdict, RigCheck
    from bluerov_slam.rig.dimensions import Floats

FORMAT, VERSION = "bluerov-slam rig check", 1
_SAME = 1e-6
"""mm or deg: places of another version of the test are other places."""
_LARGEST_BYTES = 10_000_000
_OTHER = "give the --json file of an earlier `rig check` of this rig"


@dataclass(frozen=True, slots=True, eq=False)
class CheckFile:
    """What a file holds.

    Attributes:
        source: "simulated" with its rig's seed, or the port of a real rig.
        outcome: of its verdict.
        readings: all attitudes.
    """

    source: str
    outcome: str
    readings: CheckReadings


def write_check(
    path: Path, check: RigCheck, readings: CheckReadings, verdict: CheckVerdict, outcome: str, words: list[str],
    source: str, measured_unix_s: float,
) -> None:  # fmt: skip
    """The whole file. Raises RecordingError."""
    zeros = verdict.zeros
    content: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "source": source,
        "t_unix": measured_unix_s,
        "home_deg": _row(readings.home),
        "servo_test": _places(check.servo_places, readings.servos),
        "zero_test": _places(check.zero_places, readings.zeros),
        "missing": list(readings.missing),
        "ended": readings.ended,
        "held": readings.held,
        "verdict": {
            "outcome": outcome,
            "words": words,
            "compared": verdict.compared,
            "servo_faults": [
                {"platform": each.servo[0] + 1, "servo": each.servo[1] + 1, "fault": each.fault}
                for each in (verdict.servos.findings if verdict.servos else ())
            ],
            "wrong_zero": None
            if zeros is None or zeros.finding is None
            else {
                "platform": zeros.finding.servo[0] + 1,
                "servo": zeros.finding.servo[1] + 1,
                "off_deg": float(np.degrees(zeros.finding.size or 0.0)),
                "std_deg": float(np.degrees(zeros.size_std_rad)),
                "or_platform_servo": [[i + 1, j + 1] for i, j in zeros.finding.others],
            },
            "unknown": list(verdict.unknown),
        },
    }
    try:
        with in_whole(path) as unfinished:
            unfinished.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror}; give a place that can be written") from error


def read_check(path: Path, check: RigCheck) -> CheckFile:
    """A file of the same places. Raises RecordingError."""
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise RecordingError(f"{path} is too large for a check of a rig; {_OTHER}")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}; {_OTHER}") from error
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{path} is no JSON file; {_OTHER}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT or content.get("version") != VERSION:
        raise RecordingError(f"{path} is no check of a rig in a format that is known here; {_OTHER}")
    try:
        readings = CheckReadings(
            _attitudes([content["home_deg"]])[0],
            _read_places(content["servo_test"], check.servo_places),
            _read_places(content["zero_test"], check.zero_places),
        )
        return CheckFile(str(content["source"]), str(content["verdict"]["outcome"]), readings)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise RecordingError(f"{path} is damaged or of another kind of rig ({error}); {_OTHER}") from error


def _places(points: Floats, attitudes: Floats) -> list[dict[str, Any]]:
    shown = points.copy()
    shown[..., 3:] = np.degrees(shown[..., 3:])
    return [
        {"set_points_mm_deg": place.tolist(), "attitude_deg": _row(attitude)}
        for place, attitude in zip(shown, attitudes, strict=True)
    ]


def _row(attitude_rad: Floats) -> list[float] | None:
    """Null where it is missing."""
    return np.degrees(attitude_rad).tolist() if np.isfinite(attitude_rad).all() else None


def _read_places(rows: list[dict[str, Any]], points: Floats) -> Floats:
    there = np.array([row["set_points_mm_deg"] for row in rows], np.float64)
    wanted = points.copy()
    wanted[..., 3:] = np.degrees(wanted[..., 3:])
    if there.shape != wanted.shape or not np.abs(there - wanted).max() <= _SAME:
        raise ValueError("its places are others")
    return _attitudes([row["attitude_deg"] for row in rows])


def _attitudes(rows: list[list[float] | None]) -> Floats:
    found = np.array([[np.nan] * 3 if row is None else row for row in rows], np.float64)
    if found.shape != (len(rows), 3) or np.any(np.abs(found) > 360.0):
        raise ValueError("an attitude is not three angles in degrees")
    return np.asarray(np.radians(found))
