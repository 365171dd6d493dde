"""What a collection hears, what it asks for and what it keeps: the records between the sequence and its driver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.rig.published_tests import TRANSLATIONS, TURNS, Motion, Range

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Session:
    """One log: a place of the transmitter (mm, rig frame), a kind of motion, the axes' ranges (sums, mm or degrees).

    `fixes`: how many points a stationary session has; `passes`: how often a moving one goes through its axes.
    """

    name: str
    transmitter_mm: tuple[float, float, float]
    motion: Motion
    ranges: Mapping[str, Range] = field(default_factory=dict)
    order: str = TURNS + TRANSLATIONS
    repeats_last: bool = False
    fixes: int = 200
    passes: int = 1
    test: int | None = None


# Events ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Start:
    """The rig is at home and may move."""


@dataclass(frozen=True, slots=True)
class Replied:
    """What the receiver said to the depth: 1 good, 0 again, -1 given up."""

    code: int


@dataclass(frozen=True, slots=True)
class Moved:
    """The rig is where it was sent."""


@dataclass(frozen=True, slots=True)
class Refused:
    """The rig did not move, and why."""

    reason: str


@dataclass(frozen=True, eq=False)
class Result:
    """The receiver's line: three positions (3,) mm, its attitude (roll, pitch, yaw; rad), as sent."""

    acoustic_mm: Floats
    fused_mm: Floats
    raw_mm: Floats
    attitude_rad: Floats


@dataclass(frozen=True, slots=True)
class Damaged:
    """A line that is none of the receiver's fifteen numbers."""

    line: str


@dataclass(frozen=True, slots=True)
class Silent:
    """Nothing came in time."""


@dataclass(frozen=True, slots=True)
class Button:
    """Pause, and once more to go on."""


Event = Start | Replied | Moved | Refused | Result | Damaged | Silent | Button


# Actions -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Open:
    """A session begins: a log of its own."""

    session: Session


@dataclass(frozen=True, slots=True)
class SendDepth:
    """Tell the receiver its next x (m). Brings Replied or Silent."""

    x_m: float
    attempt: int


@dataclass(frozen=True, eq=False)
class Move:
    """All platforms from one set point (6,) to another, in so many steps of `STEP_S`. Brings Moved or Refused."""

    start: Floats
    end: Floats
    steps: int


@dataclass(frozen=True, slots=True)
class AwaitResult:
    """Brings Result, Damaged or Silent."""

    timeout_s: float


@dataclass(frozen=True, slots=True)
class Discard:
    """The next line's truth is none: DISCARD in the log."""


@dataclass(frozen=True, slots=True)
class Pressed:
    """The button's message in the log: where the sequence was (1 before the depth, 2 after it, 3 before the result)."""

    place: int


@dataclass(frozen=True, eq=False)
class Point:
    """One point of a session, whole or missing.

    Attributes:
        label: What the log says, mm or degrees (sum of four).
        set_point: Of each platform, (6,) mm and rad.
        published_truth_mm: As the thesis computes it, (3,).
        truth_mm, truth_covariance_mm2: Of the array's centre, (3,) and (3, 3); None where they are not known.
        missing: Why there is no result; "" where there is one.
    """

    session: str
    number: int
    axis: str
    label: float
    set_point: Floats
    published_truth_mm: Floats
    after_discard: bool
    result: Result | None = None
    truth_mm: Floats | None = None
    truth_covariance_mm2: Floats | None = None
    missing: str = ""


@dataclass(frozen=True, slots=True)
class Keep:
    """Write the point."""

    point: Point


@dataclass(frozen=True, slots=True)
class Hold:
    """Stop where the rig is, now; servos keep their angles."""

    reason: str


@dataclass(frozen=True, slots=True)
class Close:
    """The session's log is complete; `reason` where it ended early."""

    reason: str = ""


@dataclass(frozen=True, slots=True)
class Finished:
    """Nothing more to do; `reason` where it ended early."""

    reason: str = ""


Action = Open | SendDepth | Move | AwaitResult | Discard | Pressed | Keep | Hold | Close | Finished
