"""Writes logs in the thesis's line format, which `sources/isbl_thesis_log.py` reads back.

A missing point has no line in that format: nothing stands for it, and what it leaves behind is the DISCARD before the
next line. Its reason is in our own log (`sinks/rig_log.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.collection import Action, Discard, Keep, Point, Pressed

if TYPE_CHECKING:
    from bluerov_slam.acoustics.thesis_log import ThesisRows

DISCARD = "DISCARD"
SUFFIX = ".log"


def data_line(axis: str, setpoint: float, groups: Sequence[Sequence[float]], setpoint_decimals: int = 2) -> str:
    """A line of data: filter on sound, filter with dead reckoning, raw fix, truth (mm); roll, pitch, yaw (degrees).

    The first test's log has whole set points without decimals; all others have two.
    """
    if len(axis) != 1 or len(groups) != 5:
        raise ValueError(f"a line has one axis and five groups of three, not {axis!r} and {len(groups)}")
    if not np.isfinite([setpoint, *(value for group in groups for value in group)]).all():
        raise ValueError("a line has room for numbers only: a point without a result has no line")
    values = "; ".join(", ".join(f"{value:.2f}" for value in group) for group in groups)
    return f"{axis}, {setpoint:.{setpoint_decimals}f}: {values};"


def lines_of_rows(rows: ThesisRows, setpoint_decimals: int = 2) -> Iterator[str]:
    """The data lines of rows that were read whole, with a DISCARD before each that followed one."""
    for k in range(len(rows)):
        if not rows.whole[k]:
            continue
        if rows.after_discard[k]:
            yield DISCARD
        groups = [part[k].tolist() for part in (rows.acoustic_mm, rows.fused_mm, rows.raw_mm, rows.true_mm)]
        yield data_line(
            str(rows.axis[k]), float(rows.setpoint[k]), [*groups, rows.attitude_deg[k].tolist()], setpoint_decimals
        )


def line_of_point(point: Point) -> str | None:
    """A collected point with the truth as published; None for one that is missing."""
    result = point.result
    if result is None:
        return None
    places = (result.acoustic_mm, result.fused_mm, result.raw_mm, point.published_truth_mm)
    return data_line(
        point.axis, point.label, [*(place.tolist() for place in places), np.degrees(result.attitude_rad).tolist()]
    )


class ThesisLogWriter:
    """One session's log; each line is on the disk before the next point is measured."""

    def __init__(self, path: Path, headline: str = "") -> None:
        """Create `path`; `headline` becomes its first line, which readers skip. Raises OSError."""
        self._file = path.open("x", encoding="ascii", newline="\n")
        if headline:
            self._write(f"=~=~=~=~=~=~=~=~=~=~=~= {headline} PuTTY log =~=~=~=~=~=~=~=~=~=~=~=")

    def take(self, action: Action) -> None:
        """Write what of an action belongs into the log. Raises OSError."""
        match action:
            case Discard():
                self._write(DISCARD)
            case Pressed(place):
                self._write(f"BUTTON PRESSED, {place}")
            case Keep(point):
                if (line := line_of_point(point)) is not None:
                    self._write(line)
            case _:
                pass

    def close(self) -> None:
        """Close the file. Raises OSError."""
        self._file.close()

    def _write(self, line: str) -> None:
        self._file.write(line + "\n")
        self._file.flush()
