"""The nine tests of the thesis as its logs show them: where the transmitter stood, which values each axis went through.

Values are sums over the four platforms, which are all set alike: millimetres for X, Y, Z and, for A, B, C (roll, pitch,
yaw), degrees, as the logs print them. Each test was made stationary, rapid and gradual. Where a log lacks the last
value of a range, the firmware's sum of float steps had just missed it. The text of the thesis gives the axes' limits
instead (5 mm, 16 mm, 15 degrees of each platform); the logs are what was done.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType

TRANSLATIONS, TURNS = "XYZ", "ABC"
AXES = TRANSLATIONS + TURNS

Range = tuple[float, float]


class Motion(StrEnum):
    """How the rig moves between two fixes."""

    STATIONARY = "stationary"
    RAPID = "rapid"
    GRADUAL = "gradual"


@dataclass(frozen=True, slots=True)
class PublishedTest:
    """One place of the transmitter (mm, rig frame).

    Attributes:
        ranges: First and last value of each axis.
        order: The axes in turn; the third test left B out and did C twice.
        repeats_last: Whether each axis does its last point twice, as the program did in the end.
        gradual: Ranges of the gradual test where they were others.
    """

    number: int
    transmitter_mm: tuple[float, float, float]
    ranges: Mapping[str, Range]
    order: str = TURNS + TRANSLATIONS
    repeats_last: bool = False
    gradual: Mapping[str, Range] = field(default_factory=dict)

    def ranges_of(self, motion: Motion) -> dict[str, Range]:
        """First and last value by axis."""
        return {**self.ranges, **(self.gradual if motion is Motion.GRADUAL else {})}


def step_of(axis: str, motion: Motion) -> float:
    """From one value to the next, mm or degrees of the four platforms together; none at rest."""
    if motion is Motion.STATIONARY:
        return 0.0
    if motion is Motion.RAPID:
        return 8.0
    return 2.0 if axis in TRANSLATIONS else 1.0


_MOVES: Mapping[str, Range] = MappingProxyType({"X": (20.0, -20.0), "Y": (20.0, -20.0), "Z": (64.0, -64.0)})
_FIRST_GRADUAL: Mapping[str, Range] = {"B": (16.0, -10.0), "X": (16.0, -18.0), "Y": (16.0, -18.0), "Z": (62.0, -64.0)}

PUBLISHED_TESTS = (
    PublishedTest(
        1,
        (1426.0, 0.0, -694.0),
        {**_MOVES, "A": (24.0, -24.0), "B": (16.0, -8.0), "C": (16.0, -16.0)},
        gradual=_FIRST_GRADUAL,
    ),
    PublishedTest(2, (2645.0, 0.0, -682.0), {**_MOVES, "A": (24.0, -24.0), "B": (16.0, -8.0), "C": (16.0, -16.0)}),
    PublishedTest(
        3,
        (3880.0, 0.0, -652.0),
        {**_MOVES, "A": (20.0, -20.0), "C": (8.0, -8.0)},
        order="ACCXYZ",
        repeats_last=True,
    ),
    PublishedTest(4, (1426.0, -152.0, -694.0), {**_MOVES, "A": (24.0, -24.0), "B": (16.0, -8.0), "C": (12.0, -20.0)}),
    PublishedTest(5, (1426.0, -305.0, -694.0), {**_MOVES, "A": (24.0, -24.0), "B": (12.0, -4.0), "C": (4.0, -20.0)}),
    PublishedTest(6, (2051.0, 305.0, -707.0), {**_MOVES, "A": (24.0, -24.0), "B": (16.0, -8.0), "C": (16.0, -8.0)}),
    PublishedTest(7, (2051.0, 610.0, -702.0), {**_MOVES, "A": (32.0, -16.0), "B": (12.0, -4.0), "C": (20.0, -4.0)}),
    PublishedTest(
        8,
        (2203.0, 762.0, -726.0),
        {**_MOVES, "A": (32.0, -8.0), "B": (8.0, 0.0), "C": (16.0, 0.0), "Z": (56.0, -64.0)},
    ),
    PublishedTest(9, (2645.0, 457.0, -708.0), {**_MOVES, "A": (32.0, -16.0), "B": (12.0, -4.0), "C": (20.0, -4.0)}),
)
