"""The cases R1... of `bluerov-slam rig evaluate`: which there are, and the rows they give.

A case lives in a module that ends with `CASES = (RigCase(...), ...)`; naming the module below is all that it takes.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bluerov_slam.evaluation.navigation_table import Row, Target
from bluerov_slam.evaluation.statistics import Interval

if TYPE_CHECKING:
    from bluerov_slam.acoustics.thesis_log import ThesisLog
    from bluerov_slam.rig.dimensions import Floats

MODULES = (
    "rig_kinematics_cases",
    "rig_calibration_cases",
    "rig_motion_cases",
    "rig_firmware_cases",
    "rig_truth_cases",
    "rig_zero_cases",
)
"""Modules of this package, in the order of the table."""


@dataclass(frozen=True, slots=True)
class RigFirmware:
    """How a case reaches the rig's firmware, which this pure package cannot start; both raise LinkError with the cure.

    Attributes:
        angles_rad: What it makes of set points (n, 4, 6), (n, 4, 6); NaN where it refuses them.
        counts: What was counted when it ran under QEMU, by the ids of its report.
    """

    angles_rad: Callable[[Floats], Floats]
    counts: Callable[[], Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class RigRun:
    """What a case may use: how much is drawn, by which seed, the thesis's logs and the rig's firmware where needed."""

    seed: int = 1000
    effort: float = 1.0
    logs: Sequence[ThesisLog] = ()
    firmware: RigFirmware | None = None

    def count(self, full: int, least: int = 1) -> int:
        """How many draws of a case that takes `full` at the effort of 1."""
        return max(least, round(full * self.effort))


@dataclass(frozen=True)
class RigCase:
    """A group of figures; `needs_logs`: it cannot run without the thesis's real logs."""

    id: str
    title: str
    run: Callable[[RigRun], list[Row]]
    needs_logs: bool = False


def all_cases() -> dict[str, RigCase]:
    """By id, in the order of the ids."""
    found: dict[str, RigCase] = {}
    for name in MODULES:
        for case in importlib.import_module(f"bluerov_slam.evaluation.{name}").CASES:
            found[case.id] = case
    return dict(sorted(found.items(), key=lambda item: int(item[0][1:])))


def figure(
    place: str,
    name: str,
    value: float,
    unit: str,
    low: float | None = None,
    high: float | None = None,
    aim: float | None = None,
) -> Row:
    """A row of one number that is no statistic: at least `low`, at most `high`; `aim` is on the side of the limit."""
    must = None if low is None and high is None else Target(low, high)
    wanted = None if aim is None else Target(low=aim) if high is None else Target(high=aim)
    return Row(place, name, Interval(value, value, value), unit, must, wanted)
