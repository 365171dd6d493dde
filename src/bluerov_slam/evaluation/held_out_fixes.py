"""N8: how well the navigator predicts position fixes that it was not given, on real acoustic dives.

The rule, the same for every log: with t0 the first fix, a block of L seconds begins at t0 + 60 s + k (L + 30 s) for
k = 0, 1, 2 and so on. Fixes inside a block are held out; the 30 s between blocks are given. A block counts if it holds
a fix and if a fix was given in the 5 s before it. The navigator's state goes on through all blocks, as on a dive.

What is held out is compared with two causal predictions: the navigator's, and the last fix moved on with the velocity
between it and the newest fix at least a second older.

An outlier is a fix to which the vehicle cannot have gone and come back from: there are a fix before it and one after
it, at most 15 s apart, that a vehicle of 2 m/s can have visited both, with 3 m for the noise of two fixes, but neither
the way to this fix nor the way from it. A step that stays is none, be it a manoeuvre or a new error of the system.
Outliers that were held out judge nobody.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.pipeline.navigator import Navigator, NavigatorOptions
from bluerov_slam.records import PositionFix

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bluerov_slam.navigation.ekf import UpdateResult
    from bluerov_slam.records import Record

BLOCKS_S = (5.0, 10.0, 24.0)
_FIRST_BLOCK_S, _BETWEEN_BLOCKS_S, _FRESH_S = 60.0, 30.0, 5.0
_BASE_S = 1.0
_FOLLOWING = 12
_OUTLIER_WITHIN_S, _FASTEST_MPS, _NOISE_M = 15.0, 2.0, 3.0
_ELLIPSE = 0.95


@dataclass(frozen=True, slots=True)
class HeldOut:
    """One held-out fix: which block, how long into it, both predictions' errors, and whether it lay in our ellipse."""

    block: int
    since_fix_s: float
    ours_m: float
    baseline_m: float
    nis: float
    outlier: bool


@dataclass(frozen=True, slots=True)
class GivenFixes:
    """What the navigator made of the fixes it was given: outliers by the rule above, and the rest."""

    outliers: int
    outliers_refused: int
    others: int
    others_refused: int


def inside_ellipse(nis: float) -> bool:
    """Whether an error lies inside the stated 95 % ellipse."""
    return nis <= chi_square_quantile(_ELLIPSE, 2.0)


def predict_held_out(
    records: Sequence[Record], block_s: float, options: NavigatorOptions | None = None
) -> tuple[list[HeldOut], GivenFixes]:
    """Run a dive with blocks of fixes held out."""
    fixes = [record for record in records if isinstance(record, PositionFix)]
    places = _local(fixes)
    outliers = _outliers(np.array([fix.measured_s for fix in fixes]), places)
    first_s = fixes[0].measured_s
    navigator = Navigator(options)
    results: list[UpdateResult] = []
    navigator.on_update = results.append
    held: list[HeldOut] = []
    counts = {False: [0, 0], True: [0, 0]}
    given: list[int] = []
    number = -1
    for place, record in enumerate(records):
        if not isinstance(record, PositionFix):
            navigator.feed(record)
            continue
        number += 1
        block = _block_of(record.measured_s - first_s, block_s)
        if block is None:
            results.clear()
            navigator.feed(record)
            told = [result for result in results if result.sensor == "position"]
            refused = not any(result.accepted for result in told)
            counts[bool(outliers[number])][0] += 1
            counts[bool(outliers[number])][1] += refused
            given.append(number)
            continue
        begins_s = first_s + _FIRST_BLOCK_S + block * (block_s + _BETWEEN_BLOCKS_S)
        if not given or begins_s - fixes[given[-1]].measured_s > _FRESH_S:
            continue
        error, nis = _tried(navigator, record, records[place + 1 : place + 1 + _FOLLOWING])
        if error is None:
            continue
        at_s = record.measured_s
        guess = _constant_velocity(fixes, places, given, at_s)
        since_s = at_s - fixes[given[-1]].measured_s
        off_m = float(math.hypot(*(places[number] - guess)))
        held.append(HeldOut(block, since_s, error, off_m, nis, bool(outliers[number])))
    return held, GivenFixes(counts[True][0], counts[True][1], counts[False][0], counts[False][1])


def _block_of(after_s: float, block_s: float) -> int | None:
    """The block that this time after the first fix lies in."""
    cycles, into_s = divmod(after_s - _FIRST_BLOCK_S, block_s + _BETWEEN_BLOCKS_S)
    return int(cycles) if cycles >= 0 and into_s < block_s else None


def _tried(navigator: Navigator, fix: PositionFix, following: Sequence[Record]) -> tuple[float | None, float]:
    """How far the fix lies from what the navigator expects, and its NIS; a copy is asked, so nothing is learnt."""
    listener, navigator.on_update = navigator.on_update, None
    asked = copy.deepcopy(navigator)
    navigator.on_update = listener
    answers: list[UpdateResult] = []
    asked.on_update = answers.append
    # A fix newer than the motion sensors waits in the navigator for their next sample.
    for record in (fix, *(each for each in following if not isinstance(each, PositionFix))):
        asked.feed(record)
        for answer in answers:
            if answer.sensor == "position":
                return float(math.hypot(*answer.residual[:2])), answer.nis
    return None, math.nan


def _constant_velocity(
    fixes: Sequence[PositionFix], places: NDArray[np.float64], given: Sequence[int], at_s: float
) -> NDArray[np.float64]:
    """The last given fix moved on with the velocity between it and the newest one at least a second older."""
    last = given[-1]
    velocity = np.zeros(2)
    for before in reversed(given[:-1]):
        apart_s = fixes[last].measured_s - fixes[before].measured_s
        if apart_s >= _BASE_S - 1e-3:
            velocity = (places[last] - places[before]) / apart_s
            break
    return np.asarray(places[last] + velocity * (at_s - fixes[last].measured_s))


def _local(fixes: Sequence[PositionFix]) -> NDArray[np.float64]:
    frame = LocalFrame(fixes[0].latitude_deg, fixes[0].longitude_deg)
    return np.array([frame.to_ned_m(fix.latitude_deg, fix.longitude_deg)[:2] for fix in fixes])


def _outliers(at_s: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Fixes between two others that fit each other, and that fit neither."""
    found = np.zeros(len(at_s), dtype=bool)
    for index in range(len(at_s)):
        first, last = np.searchsorted(at_s, (at_s[index] - _OUTLIER_WITHIN_S, at_s[index] + _OUTLIER_WITHIN_S))
        near = np.arange(first, last)
        away = near[~_reachable(at_s[near], places[near], at_s[index], places[index])]
        before, after = away[away < index], away[away > index]
        found[index] = any(
            np.any(
                _reachable(at_s[after], places[after], at_s[one], places[one])[
                    at_s[after] <= at_s[one] + _OUTLIER_WITHIN_S
                ]
            )
            for one in before
        )
    return found


def _reachable(
    at_s: NDArray[np.float64], places: NDArray[np.float64], from_s: float, from_place: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which fixes one vehicle can have visited with another."""
    apart_m = np.hypot(*(places - from_place).T)
    return np.asarray(apart_m <= _NOISE_M + _FASTEST_MPS * np.abs(at_s - from_s))
