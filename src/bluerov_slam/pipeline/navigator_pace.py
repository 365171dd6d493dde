"""How lively the vehicle moves where no sensor tells its velocity, learned from how far old forecasts were off.

Without IMU, thrusters and DVL the filter takes the velocity for a Gauss-Markov process about the water's. How large it
is differs from a vehicle that hovers at a wall to one that sweeps a field, and every forecast's ellipse hangs on it. So
each fix is compared with what was forecast for it about ten seconds before: on average such an error has a NIS of one
per degree of freedom, or the process is made larger or smaller until it has. The next fix tells little of that: it is
too near.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.navigation.ekf import ErrorStateFilter, Innovation
    from bluerov_slam.pipeline.navigator_options import ImuOptions

    Array = NDArray[np.float64]

LEAD_S = 10.0
# Where fixes come seldom, a forecast may be somewhat younger or a good deal older than that.
YOUNGEST_S, OLDEST_S = 9.0, 25.0
LEARNED_IN_S = 30.0
# A fix after a gap tells no more than one of a steady stream.
LONGEST_TOLD_S = 5.0
# Nor does a wild one.
MOST_TOLD = 8.0


@dataclass(frozen=True, slots=True)
class Forecast:
    """From an instant on: a fix's place, velocity, current, north and east of each; and their covariance (6, 6)."""

    at_s: float
    state: Array
    covariance: Array


class Pace:
    """`speed_std_mps` is the process's standard deviation per axis."""

    def __init__(self, options: ImuOptions) -> None:
        self.speed_std_mps = options.kinematic_speed_std_mps
        self._limits = options.kinematic_speed_limits_mps
        self._time_s = options.kinematic_velocity_time_s
        self._forecasts: deque[Forecast] = deque()
        self._told_s = -math.inf

    @property
    def walk_mps(self) -> float:
        """Velocity per root second that drives the process."""
        return self.speed_std_mps * math.sqrt(2.0 / self._time_s)

    def hold(self) -> None:
        """The motion is measured again, or the track was moved: older forecasts say nothing any more."""
        self._forecasts.clear()

    def begin(self, filter_: ErrorStateFilter, fix_ne_m: Array, innovation: Innovation) -> None:
        """Forecast from here on, with what a fix says of the filter it has just corrected."""
        rows = np.zeros((6, filter_.layout.size))
        rows[:2] = innovation.jacobian
        rows[2, 3] = rows[3, 4] = 1.0
        place = filter_.layout["current"]
        rows[4, place.start] = rows[5, place.start + 1] = 1.0
        values = filter_.estimate.values
        state = np.concatenate((fix_ne_m - innovation.residual, values[3:5], values[place]))
        self._forecasts.append(Forecast(filter_.at_s, state, rows @ filter_.covariance @ rows.T))

    def compare(self, at_s: float, fix_ne_m: Array, noise_m2: Array, wander_m2: Array, wander_time_s: float) -> None:
        """Learn from a fix, good or bad: with its white noise and its slow error, (2, 2) each."""
        kept = self._forecasts
        while len(kept) > 1 and kept[1].at_s <= at_s - LEAD_S:
            kept.popleft()
        since_s, self._told_s = at_s - self._told_s, max(at_s, self._told_s)
        ahead_s = at_s - kept[0].at_s if kept else 0.0
        if not YOUNGEST_S <= ahead_s <= OLDEST_S:
            return
        expected, covariance = self._ahead(kept[0], ahead_s)
        covariance += noise_m2 - math.expm1(-2.0 * ahead_s / wander_time_s) * wander_m2
        error = fix_ne_m - expected
        ratio = min(0.5 * float(error @ np.linalg.solve(covariance, error)), MOST_TOLD)
        told = min(max(since_s, 0.0), LONGEST_TOLD_S) / LEARNED_IN_S
        low, high = self._limits
        self.speed_std_mps = min(max(self.speed_std_mps * math.exp(0.5 * told * (ratio - 1.0)), low), high)

    def _ahead(self, forecast: Forecast, ahead_s: float) -> tuple[Array, Array]:
        time_s = self._time_s
        left = math.exp(-ahead_s / time_s)
        reach_s = time_s * (1.0 - left)
        move = np.hstack((np.eye(2), reach_s * np.eye(2), (ahead_s - reach_s) * np.eye(2)))
        walked_s3 = time_s**2 * (ahead_s - 2.0 * reach_s + 0.5 * time_s * (1.0 - left * left))
        walked = self.walk_mps**2 * walked_s3 * np.eye(2)
        return move @ forecast.state, move @ forecast.covariance @ move.T + walked
