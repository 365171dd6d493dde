"""The check of a rig: every servo moved by itself, then many stances, judged by the attitude of the array alone.

    check = RigCheck()
    readings = check.run(bench)
    verdict = check.judge(readings, before=None)

`ServoTest` finds what does not move as told, `ZeroTest` what moves well from a wrong zero; here are the places to go
to, what becomes of readings that are missing, and one verdict of both. A reading is an attitude or it is missing with
its reason, never zero. Where too few came, nothing is accused and nothing is called good: it cannot tell.

Yaw counts from home, because the board's own zero is anywhere. Each answer of a servo is taken against the stances
before and after it, so that a compass that wanders slowly turns no servo.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.navigation.rotation import exp_so3, log_so3
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.servo_test import ServoTest, ServoVerdict, stance
from bluerov_slam.rig.zero_test import STANCES, ZeroTest, ZeroVerdict

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats

HOME_TRIES = 3
MOST_MISSING = 3
"""In a row, as in a collection: then the check ends."""
MOST_ACCUSED = 6
"""More servos at once is no servos' fault: their supply, the board's seat or its instrument is."""
LEAST_STANCES = STANCES // 2
LARGEST_MISFIT = 1.5
"""36 simulated good rigs (seeds 0 to 35) reached 1.06 at most; beyond it the figures of a good rig do not hold."""
TURN_STD_RAD = float(np.radians(0.3))
"""Of an answer, each axis: all servos play at each place and the compass wobbles (simulated, seeds 0 to 19: 0.17, 0.17
and 0.28 degrees)."""
_BESIDE = 3
"""Stances before a move, and as many after it, that its answer is taken against."""
_SAME_RAD = 5e-7
_SAID_EACH = 10


class Ended(Exception):
    """The bench cannot go on; its text says why."""


class Missing(Exception):
    """This reading did not come; its text says why."""


class Bench(Protocol):
    """A rig with an instrument on its tool."""

    def attitude_at(self, set_points: Floats) -> Floats:
        """Go there (platforms, 6) and read roll, pitch and yaw (3,), rad. Raises Missing and Ended."""


@dataclass(frozen=True, slots=True, eq=False)
class CheckReadings:
    """Attitudes (roll, pitch, yaw, rad) in the order of the places; NaN where missing.

    Attributes:
        home: at home, (3,).
        servos: at `RigCheck.servo_places`, (1 + 4 servos, 3).
        zeros: at `RigCheck.zero_places`, (stances, 3).
        missing: why readings are missing, a line each.
        ended: why it ended early, "" if it did not.
        held: why the zero test was left out, "" if it was not.
    """

    home: Floats
    servos: Floats
    zeros: Floats
    missing: tuple[str, ...] = ()
    ended: str = ""
    held: str = ""


@dataclass(frozen=True, slots=True)
class CheckVerdict:
    """What both tests say; None for a test that has too few readings to say anything.

    Attributes:
        servos: of the servo test.
        zeros: of the zero test.
        unknown: what cannot be told, and why; empty if everything can.
        compared: whether an earlier run of the rig took its build away.
    """

    servos: ServoVerdict | None
    zeros: ZeroVerdict | None
    unknown: tuple[str, ...]
    compared: bool = False


class RigCheck:
    """Places, run and judgement."""

    def __init__(self) -> None:
        self._servo_test, self._zero_test = ServoTest(imu_std_rad=TURN_STD_RAD), ZeroTest()
        self.servo_places = _servo_places(self._servo_test)
        self.zero_places = self._zero_test.stances

    def run(self, bench: Bench, progress: Callable[[str], None] = lambda _: None) -> CheckReadings:
        """All readings. After a servo that does not move as told the rig is not sent all over its workspace."""
        round_ = _Round(bench, progress)
        home = round_.first(np.zeros(self.zero_places.shape[1:]))
        none = np.full((len(self.zero_places), 3), np.nan)
        progress("One servo at a time")
        servos = round_.attitudes(self.servo_places, "servo test")
        held = ""
        if not round_.ended:
            verdict, _ = self._judge_servos(CheckReadings(home, servos, none), None)
            if verdict is None or any(each.fault != "offset" for each in verdict.findings):
                held = "the stances go all over the workspace, which is not for a rig that does not move as told"
        zeros = none
        if not held:
            if not round_.ended:
                progress("Zeros: stances from all over the workspace")
            zeros = round_.attitudes(self.zero_places, "zero test")
        return CheckReadings(home, servos, zeros, tuple(round_.missing), round_.ended, held)

    def judge(self, readings: CheckReadings, before: CheckReadings | None = None) -> CheckVerdict:
        """The verdict, against an earlier run of the same rig if there is one."""
        servos, unknown = self._judge_servos(readings, before)
        zeros, more = self._judge_zeros(readings, before)
        return CheckVerdict(servos, zeros, tuple(dict.fromkeys(unknown + more)), before is not None)

    def _judge_servos(
        self, readings: CheckReadings, before: CheckReadings | None
    ) -> tuple[ServoVerdict | None, list[str]]:
        moved, at_stance = _answers(readings)
        test = self._servo_test
        if before is not None:
            earlier = _answers(before)
            # What an earlier run has not measured would count as drawn, which no rig is.
            moved[np.isnan(earlier[0])] = np.nan
            if np.isfinite(earlier[1]).all():
                test = test.against(earlier)
        servos = len(test.servos)
        count = int(np.sum(np.isfinite(moved).all(axis=(1, 2)).reshape(servos, 2).all(axis=1)))
        if not np.isfinite(at_stance).all() or count <= servos // 2:
            return None, [f"only {count} of {servos} servos were moved and read"]
        verdict = test.judge(moved, at_stance)
        if len(verdict.findings) > MOST_ACCUSED:
            return None, [
                f"{len(verdict.findings)} of {servos} servos seem wrong at once, which is not theirs: look at "
                "their supply, at how the board sits on the rig and at its attitude"
            ]
        left_out = [f"servo {j + 1} of platform {i + 1} was not read" for i, j in verdict.untested]
        return verdict, left_out

    def _judge_zeros(
        self, readings: CheckReadings, before: CheckReadings | None
    ) -> tuple[ZeroVerdict | None, list[str]]:
        if readings.held:
            return None, [f"zeros: not tested, {readings.held}"]
        seen = _turned(readings.zeros, readings.home)
        test = self._zero_test
        if before is not None:
            earlier = _turned(before.zeros, before.home)
            seen[np.isnan(earlier)] = np.nan
            test = test.against(earlier)
        count = int(np.sum(np.isfinite(seen).all(axis=(1, 2))))
        if count < LEAST_STANCES:
            return None, [f"zeros: only {count} of {len(seen)} stances were read, {LEAST_STANCES} are needed"]
        verdict = test.judge(seen)
        if verdict.misfit > LARGEST_MISFIT:
            return None, [
                f"zeros: the attitudes scatter {verdict.misfit**0.5:.1f} times as much as those of a good rig with one "
                "wrong zero: more than one may be wrong, or parts are not as drawn; use the gauge"
            ]
        return verdict, []


class _Round:
    """Goes through places and keeps what is missing."""

    def __init__(self, bench: Bench, progress: Callable[[str], None]) -> None:
        self._bench, self._progress = bench, progress
        self._row, self._last = 0, np.full(3, np.nan)
        self.missing: list[str] = []
        self.ended = ""

    def first(self, home: Floats) -> Floats:
        """At home, from where yaw counts: tried some times, as nothing can be told without it."""
        found = np.full(3, np.nan)
        for _ in range(HOME_TRIES):
            found = self.attitudes(home[None], "home")[0]
            if np.isfinite(found).all() or self.ended:
                break
        return found

    def attitudes(self, places: Floats, name: str) -> Floats:
        """At each of the places; NaN from where it ended."""
        found = np.full((len(places), 3), np.nan)
        for k, place in enumerate(places):
            if self.ended:
                break
            try:
                attitude = self._bench.attitude_at(place)
                if not np.isfinite(attitude).all():
                    raise Missing("the attitude holds no number")
                if np.abs(attitude - self._last).max() < _SAME_RAD:
                    raise Missing("the board repeats its attitude to the last digit: its instrument may hang")
                found[k], self._last, self._row = attitude, attitude, 0
            except (Missing, Ended) as lost:
                self._row += 1
                self._progress(f"  {name} {k + 1} of {len(places)} is missing: {lost}")
                self.missing.append(f"{name} {k + 1}: {lost}")
                if isinstance(lost, Ended):
                    self.ended = str(lost)
                elif self._row >= MOST_MISSING:
                    self.ended = f"{MOST_MISSING} readings in a row are missing, the last because {lost}"
            if (k + 1) % _SAID_EACH == 0:
                self._progress(f"  {name}: {k + 1} of {len(places)}")
        return found


def _servo_places(test: ServoTest) -> Floats:
    """The stance, then each move and the stance again, as set points (1 + 4 servos, platforms, 6)."""
    points = stance(len(FO_SHIP.platforms))
    places = [points]
    for (i, _), angles in test.moves():
        moved = points.copy()
        moved[i] = plate_pose(angles[i], FO_SHIP.platforms[i], points[i]).set_point
        places += [moved, points]
    return np.array(places)


def _turned(attitudes_rad: Floats, home_rad: Floats) -> Floats:
    """Rotations (n, 3, 3) with yaw from home; NaN where an attitude is missing."""
    return rotations(attitudes_rad - np.array([0.0, 0.0, 1.0]) * home_rad)


def _answers(readings: CheckReadings) -> tuple[Floats, Floats]:
    """Rotations after each move (2 servos, 3, 3) as from one stance, and that stance (3, 3); NaN where missing."""
    turned = _turned(readings.servos, readings.home)
    stances, moves = turned[0::2], turned[1::2]
    moved = np.full_like(moves, np.nan)
    known = np.flatnonzero(np.isfinite(stances).all(axis=(1, 2)))
    if not len(known):
        return moved, np.full((3, 3), np.nan)
    first = stances[known[0]]
    mean = exp_so3(np.mean([log_so3(stances[k] @ first.T) for k in known], axis=0)) @ first
    for k in np.flatnonzero(np.isfinite(moves).all(axis=(1, 2))):
        around = stances[max(0, k + 1 - _BESIDE) : k + 1 + _BESIDE]
        beside = [each for each in around if np.isfinite(each).all()]
        if beside:
            moved[k] = exp_so3(np.mean([log_so3(moves[k] @ each.T) for each in beside], axis=0)) @ mean
    return moved, mean
