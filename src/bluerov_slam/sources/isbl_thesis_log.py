"""Reads the raw serial logs of the thesis's 27 test sessions (PuTTY text), as they are: cut lines, restarts, garbage.

A line of data has an axis, a set point and 15 numbers:

    A, 25.00: 46.91, 47.05, -427.19; 44.80, 46.25, -413.85; 110.00, 98.61, -619.72; 110.00, 116.78, -631.04; ...

filter on sound alone; filter with dead reckoning; raw fix; truth (mm); roll, pitch, yaw (degrees). What it is not is
counted by kind, so that every line of every log is accounted for.
"""

from __future__ import annotations

import re
import tarfile
from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from io import BytesIO
from pathlib import Path, PurePosixPath

import numpy as np

from bluerov_slam.acoustics.thesis_log import TESTS_MM, ThesisLog, ThesisRows
from bluerov_slam.errors import RecordingError

_SUFFIX = ".log"
_MOTION_OF = {"s": "stationary", "d_r": "rapid", "d_g": "gradual"}
_NAME = re.compile(r"test_x(-?\d+)_y(-?\d+)_z(-?\d+)_(s|d_r|d_g)")
_NUMBER = r"(-?\d+\.\d\d)"
_VALUES = "; ".join([", ".join([_NUMBER] * 3)] * 5) + ";$"
_WHOLE = re.compile(rf"^([XYZABC]), (-?\d+(?:\.\d\d)?): {_VALUES}")
# Characters lost at the front: the set point, if anything of it is left, may be a part of a number.
_CUT = re.compile(rf"^(?:[XYZABC]?,)? ?-?\d*\.?\d*: {_VALUES}")
_BOOT = re.compile(
    r"^(=~=~.* PuTTY log|x{20}|ets |rst:|configsip:|clk_drv:|mode:|load:|entry |HelloWorld!|MPU6050 Found!"
    r"|Accelerometer range|Gyro range|Filter bandwidth|Zoffset:)"
)


class LineKind(StrEnum):
    """What a line of a log is."""

    WHOLE = "complete data lines"
    CUT = "data lines that lost their first characters"
    GARBAGE = "console garbage"
    AXIS = "lone axis letters (cut last lines)"
    DISCARD = "DISCARD"
    BUTTON = "button messages"
    BOOT = "boot and banner lines"
    BLANK = "blank"


@dataclass(slots=True)
class ThesisLogs:
    """The logs in the order of their names, and how many lines of each kind they hold."""

    logs: list[ThesisLog] = field(default_factory=list)
    census: Counter[LineKind] = field(default_factory=Counter)


def read_thesis_logs(path: Path) -> ThesisLogs:
    """All logs of a folder or of a tar archive. Raises RecordingError when there is none or one cannot be read."""
    try:
        if path.is_dir():
            files = path.glob(f"*{_SUFFIX}")
            return _parsed([(file.stem, file.read_bytes().decode("latin-1")) for file in files], str(path))
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read as logs of the thesis: {error}") from error
    return read_thesis_archive(content, str(path))


def read_thesis_archive(content: bytes, name: str = "the archive") -> ThesisLogs:
    """All logs of a tar archive's bytes; `name` is for the same errors."""
    try:
        with tarfile.open(fileobj=BytesIO(content)) as archive:
            members = [member for member in archive if member.isfile() and member.name.endswith(_SUFFIX)]
            texts = [
                # Bytes of garbage become characters one by one.
                (PurePosixPath(member.name).stem, file.read().decode("latin-1"))
                for member in members
                if (file := archive.extractfile(member)) is not None
            ]
    except (OSError, tarfile.TarError) as error:
        # The archive's own words are a line for each way in which it was tried.
        why = str(error).partition("\n")[0].rstrip(":")
        raise RecordingError(
            f"{name}: cannot be read as logs of the thesis, a tar archive: {why}; fetch it again"
        ) from error
    return _parsed(texts, name)


def parse_thesis_log(name: str, text: str, census: Counter[LineKind]) -> ThesisLog:
    """One log; `name` without suffix tells place and motion. Counts every line in `census`."""
    parts = _NAME.fullmatch(name)
    if parts is None:
        raise RecordingError(f"{name}: the name tells no transmitter position and motion")
    x_mm, y_mm, z_mm = (float(parts[k]) for k in (1, 2, 3))
    if (x_mm, y_mm) not in TESTS_MM:
        raise RecordingError(f"{name}: no test had its transmitter at x {x_mm:g}, y {y_mm:g} mm")
    test = TESTS_MM.index((x_mm, y_mm)) + 1
    rows = _rows(text, census)
    if not len(rows):
        raise RecordingError(f"{name}: no line of data in it")
    return ThesisLog(name, test, _MOTION_OF[parts[4]], (x_mm, y_mm, z_mm), rows)


def _rows(text: str, census: Counter[LineKind]) -> ThesisRows:
    lines: list[int] = []
    whole: list[bool] = []
    after_discard: list[bool] = []
    segment: list[int] = []
    axis: list[str] = []
    setpoint: list[float] = []
    values: list[list[float]] = []
    presses = 0
    before = LineKind.BLANK
    # Garbage holds lone carriage returns, which end a line, too; what follows the last line end is the cut last line.
    for number, line in enumerate(re.split("\r\n|\n|\r", text), start=1):
        kind, match = _kind_of(line)
        census[kind] += 1
        presses += kind is LineKind.BUTTON
        if match is not None:
            complete = kind is LineKind.WHOLE
            lines.append(number)
            whole.append(complete)
            after_discard.append(before is LineKind.DISCARD)
            segment.append(1 + presses)
            axis.append(match[1] if complete else "")
            setpoint.append(float(match[2]) if complete else np.nan)
            values.append([float(value) for value in match.groups()[-15:]])
        before = kind
    table = np.array(values, dtype=float).reshape(-1, 5, 3)
    return ThesisRows(
        line=np.array(lines, dtype=np.int64),
        whole=np.array(whole, dtype=np.bool_),
        after_discard=np.array(after_discard, dtype=np.bool_),
        segment=np.array(segment, dtype=np.int64),
        axis=np.array(axis, dtype=np.str_),
        setpoint=np.array(setpoint, dtype=float),
        acoustic_mm=table[:, 0],
        fused_mm=table[:, 1],
        raw_mm=table[:, 2],
        true_mm=table[:, 3],
        attitude_deg=table[:, 4],
    )


def _kind_of(line: str) -> tuple[LineKind, re.Match[str] | None]:
    for kind, pattern in ((LineKind.WHOLE, _WHOLE), (LineKind.CUT, _CUT)):
        match = pattern.match(line)
        if match is not None:
            return kind, match
    if not line.strip():
        return LineKind.BLANK, None
    if line == "DISCARD":
        return LineKind.DISCARD, None
    if len(line) == 1 and line in "XYZABC":
        return LineKind.AXIS, None
    if line.startswith("BUTTON PRESSED"):
        return LineKind.BUTTON, None
    return (LineKind.BOOT if _BOOT.match(line) else LineKind.GARBAGE), None


def _parsed(texts: list[tuple[str, str]], place: str) -> ThesisLogs:
    """From (name without suffix, text) of every log."""
    found = ThesisLogs()
    for name, text in sorted(texts):
        found.logs.append(parse_thesis_log(name, text, found.census))
    if not found.logs:
        raise RecordingError(
            f"{place}: no log of the thesis in it (expected names like test_x1426_y0_z-694_s{_SUFFIX})"
        )
    return found
