"""Replays the thesis's filters on its logged raw fixes: the proof of which column is which, and what was not logged.

Neither the time between fixes nor the displacement that dead reckoning gave was logged. Both can be had back: the
transmitter sends at one rate, so the time is a whole number of its periods, and only one number makes the replayed
acoustic filter print what the receiver printed, in three axes at once; with the time known, the displacement is what
the combined filter must have been told.

A state can be taken up from a log only with two rows behind it: positions are printed, velocities follow from two of
them. From there the filter runs on raw fixes alone, and a row counts as replayed when its print is met. Where no number
of periods does that (the log starts, a line was lost) it is taken up anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.acoustics.thesis_filters import (
    ZERO,
    Covariance,
    ThesisState,
    Triple,
    gain_of_fix,
    gain_of_fix_and_displacement,
    steady_covariance,
    step,
    step_fused,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.acoustics.thesis_log import Floats, ThesisLog, ThesisRows

MOST_PERIODS = 15
TIMER_WRAPS_S = 15.618
"""After a longer interval the receiver took the rest for the interval."""
PERIODS_S = (1.0100, 1.0180)
"""Where the transmitter's period is looked for; its nominal second is long by the error of its RC oscillator."""
USUAL_PERIODS = {"stationary": 3, "rapid": 5, "gradual": 5}

PRINTED_TO_M = 1e-5
"""Two decimals of a millimetre. A replayed row may miss by the rounding of what it starts from and of its own print."""
_TOLERANCE_M = 2.0 * PRINTED_TO_M
_TAKE_UP_TOLERANCE_M = 4.0 * PRINTED_TO_M
_GRID = 81
_LIKE_USUAL = 0.2
"""This part of the fixes at least came three in line at the usual interval."""
_POLISH_TOLERANCES_M = (8.0 * _TOLERANCE_M, 2.0 * _TOLERANCE_M)
"""Wide at first: a filter run with a period that is not quite right misses the prints."""
_SETTLING_ROWS = 8
"""So many fixes later nothing is left of what the state was taken up with."""
_NUDGE_S = 1e-5
_ODD_STEP_S, _ODD_RESOLUTION_S = 0.1, 1e-4
_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Replay:
    """One log, row by row; NaN or 0 where a row was not replayed.

    `periods`: since the row before. `interval_s`: the same as time, and also the odd one that fits a row whose interval
    is no number of periods; such a row does not count as replayed.
    `acoustic_miss_mm` (n, 3): replayed less printed position of the acoustic filter.
    `still_miss_mm` (n, 3): of the combined filter told no displacement, where its print is met so.
    `displacement_mm` (n, 3): what the combined filter was told: recovered, or zero where its print is met without any.
    """

    period_s: float
    periods: NDArray[np.int64]
    interval_s: Floats
    acoustic_miss_mm: Floats
    still_miss_mm: Floats
    displacement_mm: Floats

    @property
    def replayed(self) -> NDArray[np.bool_]:
        return np.asarray(self.periods > 0)


def replay(log: ThesisLog, period_s: float | None = None) -> Replay:
    """Replays a log; the period is found from the log itself unless given."""
    if period_s is None:
        period_s = find_period_s(log)
    acoustic = _replay_acoustic(log.rows, log.motion, period_s)
    still, displacement = _replay_fused(log.rows, acoustic.interval_s)
    return Replay(period_s, acoustic.periods, acoustic.interval_s, acoustic.miss_mm, still, displacement)


def find_period_s(log: ThesisLog) -> float:
    """The transmitter's period in the receiver's clock: that with which most three rows in line agree best."""
    low, high = PERIODS_S
    count = USUAL_PERIODS[log.motion]
    best = 0.5 * (low + high)
    for width in (0.5 * (high - low), 2e-4, 2e-5):
        grid = np.linspace(best - width, best + width, _GRID)
        best = float(grid[int(np.argmin([_typical_miss_mm(log.rows, count * period) for period in grid]))])
    for tolerance_m in _POLISH_TOLERANCES_M:
        best += _replay_acoustic(log.rows, log.motion, best, tolerance_m).period_correction_s
    return best


def _typical_miss_mm(rows: ThesisRows, dt_s: float) -> float:
    """How far the third of three rows in line lies from where the first two take the filter, were all `dt_s` apart."""
    prior = steady_covariance(dt_s, fused=False).predicted(dt_s)
    gain = gain_of_fix(prior)
    printed, raw = rows.acoustic_mm, rows.raw_mm
    first, second, third = printed[:-2], printed[1:-1], printed[2:]
    second_prior = (second - gain.p_fix * raw[1:-1]) / (1.0 - gain.p_fix)
    velocity = (second_prior - first) / dt_s + gain.v_fix * (raw[1:-1] - second_prior)
    third_prior = second + dt_s * velocity
    miss = third_prior + gain.p_fix * (raw[2:] - third_prior) - third
    return float(np.quantile(np.abs(miss[:, 1:]), _LIKE_USUAL))


@dataclass(frozen=True, slots=True)
class _AcousticReplay:
    """As in `Replay`; the correction to the period is that for the least misses."""

    periods: NDArray[np.int64]
    interval_s: Floats
    miss_mm: Floats
    period_correction_s: float


def _replay_acoustic(
    rows: ThesisRows, motion: str, period_s: float, tolerance_m: float = _TOLERANCE_M
) -> _AcousticReplay:
    fixes, printed = _triples(rows.raw_mm), _triples(rows.acoustic_mm)
    steady = steady_covariance(USUAL_PERIODS[motion] * period_s, fused=False)
    periods = np.zeros(len(rows), dtype=np.int64)
    interval = np.full(len(rows), np.nan)
    miss = np.full((len(rows), 3), np.nan)
    slope_miss = slope_slope = 0.0
    state: ThesisState | None = None
    for i in range(1, len(rows)):
        if state is not None:
            count, after, far_m = _best(state, fixes[i], printed[i], period_s)
            if far_m <= tolerance_m:
                periods[i] = count
                interval[i] = count * period_s
                miss[i] = np.subtract(after.position_m, printed[i]) / _MM
                later = step(state, fixes[i], count * (period_s + _NUDGE_S))
                slope = np.subtract(later.position_m, after.position_m) / (_MM * _NUDGE_S)
                slope_miss += float(slope @ miss[i])
                slope_slope += float(slope @ slope)
                state = after
                continue
            odd_s = _odd_interval_s(state, fixes[i], printed[i])
            state = None if odd_s is None else step(state, fixes[i], odd_s)
            interval[i] = np.nan if odd_s is None else odd_s
        if state is None:
            state = _taken_up(fixes[i - 1 : i + 3], printed[i - 1 : i + 3], steady, period_s)
    return _AcousticReplay(periods, interval, miss, -slope_miss / slope_slope if slope_slope else 0.0)


def _odd_interval_s(state: ThesisState, fix: Triple, printed: Triple) -> float | None:
    """The interval of a row for which it is no number of periods: the receiver's timer had wrapped meanwhile."""

    def far_m(dt_s: float) -> float:
        return max(abs(a - b) for a, b in zip(step(state, fix, dt_s).position_m, printed, strict=True))

    best = min((k * _ODD_STEP_S for k in range(1, int(TIMER_WRAPS_S / _ODD_STEP_S))), key=far_m)
    width = _ODD_STEP_S
    while width > _ODD_RESOLUTION_S:
        best = min((best - width, best - 0.5 * width, best, best + 0.5 * width, best + width), key=far_m)
        width *= 0.5
    return best if best > 0.0 and far_m(best) <= _TOLERANCE_M else None


def _best(state: ThesisState, fix: Triple, printed: Triple, period_s: float) -> tuple[int, ThesisState, float]:
    """The number of periods after which the filter prints what is nearest to the log, and how far off (worst axis)."""
    found = []
    for count in range(1, MOST_PERIODS + 1):
        after = step(state, fix, count * period_s)
        x, y, z = after.position_m
        far = max(abs(x - printed[0]), abs(y - printed[1]), abs(z - printed[2]))
        found.append((far, count, after))
    far, count, after = min(found, key=lambda each: each[0])
    return count, after, far


def _taken_up(
    fixes: list[Triple], printed: list[Triple], covariance: Covariance, period_s: float
) -> ThesisState | None:
    """The state after the second of four rows, if the two that follow can be had from it; None if they cannot."""
    if len(fixes) < 4:
        return None
    best: tuple[float, ThesisState] | None = None
    for count in range(1, MOST_PERIODS + 1):
        dt_s = count * period_s
        gain = gain_of_fix(covariance.predicted(dt_s))
        velocity = [
            ((here - gain.p_fix * fix) / (1.0 - gain.p_fix) - before) / dt_s
            for before, here, fix in zip(printed[0], printed[1], fixes[1], strict=True)
        ]
        state = ThesisState(printed[0], (velocity[0], velocity[1], velocity[2]), covariance)
        state = step(state, fixes[1], dt_s)
        ahead, far = state, 0.0
        for fix, there in zip(fixes[2:], printed[2:], strict=True):
            _, ahead, miss = _best(ahead, fix, there, period_s)
            far = max(far, miss)
            if far > _TAKE_UP_TOLERANCE_M:
                break
        else:
            if best is None or far < best[0]:
                best = (far, state)
    return None if best is None else best[1]


def _replay_fused(rows: ThesisRows, interval_s: Floats) -> tuple[Floats, Floats]:
    """Misses without displacement and the displacements needed for none, mm; NaN where the state is not sure yet."""
    fixes, printed = _triples(rows.raw_mm), _triples(rows.fused_mm)
    still = np.full((len(rows), 3), np.nan)
    displacement = np.full((len(rows), 3), np.nan)
    state: ThesisState | None = None
    sure_from = 0
    for i in range(1, len(rows)):
        dt_s = float(interval_s[i])
        if np.isnan(dt_s):
            state = None
        elif state is None:
            state = _fused_taken_up(fixes[i], printed[i - 1], printed[i], dt_s)
            sure_from = i + _SETTLING_ROWS
        else:
            after = step_fused(state, fixes[i], ZERO, dt_s)
            miss_m = np.subtract(after.position_m, printed[i])
            moved: Triple = ZERO
            if np.max(np.abs(miss_m)) > _TOLERANCE_M:
                share = gain_of_fix_and_displacement(state.covariance.predicted(dt_s), dt_s).p_displacement
                x, y, z = (-miss_m / share).tolist()
                moved = (x, y, z)
                after = step_fused(state, fixes[i], moved, dt_s)
            if i >= sure_from:
                displacement[i] = np.divide(moved, _MM)
                still[i] = miss_m / _MM if moved == ZERO else np.nan
            state = after
    return still, displacement


def _fused_taken_up(fix: Triple, before: Triple, here: Triple, dt_s: float) -> ThesisState:
    """The combined filter's state at a row, from its last two prints, had it been told no displacement."""
    covariance = steady_covariance(dt_s, fused=True)
    gain = gain_of_fix_and_displacement(covariance.predicted(dt_s), dt_s)
    # here = (1 - k)(before + dt v) + k fix - l dt v, with k and l the gains of fix and displacement on the position
    slope = (1.0 - gain.p_fix - gain.p_displacement) * dt_s
    vx, vy, vz = (
        (there - gain.p_fix * sound - (1.0 - gain.p_fix) * start) / slope
        for start, there, sound in zip(before, here, fix, strict=True)
    )
    return step_fused(ThesisState(before, (vx, vy, vz), covariance), fix, ZERO, dt_s)


def _triples(positions_mm: Floats) -> list[Triple]:
    return [(x * _MM, y * _MM, z * _MM) for x, y, z in positions_mm.tolist()]
