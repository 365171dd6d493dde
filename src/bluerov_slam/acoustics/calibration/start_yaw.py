"""The yaw at the start, averaged at rest, with a covariance that knows how slowly a compass wobbles.

A magnetometer's yaw at rest wanders by 0.36 to 0.56 deg with a correlation time of 40 to 80 s (measured in the logs of
the thesis). Of a first-order Gauss-Markov process of variance V and time constant T the mean over t seconds has

    variance = V v,   v = 2 (T/t) (1 - (T/t) (1 - exp(-t/T)))

which for a minute is 0.74 V: hardly better than one sample. And the scatter about one's own mean shows V (1 - v) only,
so that a short average looks far better than it is. Both are put right here; how much scatter one session can show is
told by its few independent samples, the rest is what is known of such compasses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LEAST_S = 60.0
WOBBLE_RAD = math.radians(0.5)
WOBBLE_TIME_S = 60.0
PRIOR_SAMPLES = 4.0
"""How many independent samples of scatter the knowledge about other sessions is worth."""


@dataclass(frozen=True, slots=True)
class StartYaw:
    """`std_rad` of the mean's slow error; `reason` says what is missing, empty if nothing."""

    yaw_rad: float
    std_rad: float
    seconds: float
    wobble_rad: float
    reason: str


def average_yaw(
    times_s: ArrayLike,
    yaw_rad: ArrayLike,
    turned_rad: ArrayLike | None = None,
    wobble_time_s: float = WOBBLE_TIME_S,
    wanted_std_rad: float = math.radians(0.3),
) -> StartYaw:
    """The yaw at the last instant, from yaws of a vehicle at rest or one whose gyro tells how it turned.

    Args:
        times_s: (n,) increasing.
        yaw_rad: (n,) of the attitude filter or the compass; NaN where there is none.
        turned_rad: (n,) yaw since the first instant by the gyro alone, where the vehicle was not at rest.
        wobble_time_s: Correlation time of the wobble.
        wanted_std_rad: What the average is for.
    """
    times, yaws = np.asarray(times_s, dtype=np.float64), np.asarray(yaw_rad, dtype=np.float64)
    turned = np.zeros(len(times)) if turned_rad is None else np.asarray(turned_rad, dtype=np.float64)
    good = np.isfinite(times) & np.isfinite(yaws) & np.isfinite(turned)
    times, yaws, turned = times[good], yaws[good], turned[good]
    if len(times) < 2 or not times[-1] > times[0]:
        return StartYaw(math.nan, math.nan, 0.0, math.nan, "no yaw to average")
    base = yaws - turned
    # A mean direction first, so that north is no seam.
    middle = math.atan2(float(np.sin(base).mean()), float(np.cos(base).mean()))
    off = (base - middle + math.pi) % math.tau - math.pi
    steps = np.diff(times)
    weights = np.concatenate((steps[:1], steps[:-1] + steps[1:], steps[-1:])) * 0.5
    weights /= weights.sum()
    mean = float(weights @ off)
    seconds = float(times[-1] - times[0])
    kept = share_kept(seconds, wobble_time_s)
    scatter = float(weights @ (off - mean) ** 2) / max(1.0 - kept, 1e-3)
    samples = max(seconds / (2.0 * wobble_time_s), 1e-3)
    variance = (PRIOR_SAMPLES * WOBBLE_RAD**2 + samples * scatter) / (PRIOR_SAMPLES + samples)
    std = math.sqrt(variance * kept)
    reason = ""
    if seconds < LEAST_S:
        reason = f"averaged over {seconds:.0f} s, at least {LEAST_S:.0f} s are needed"
    elif std > wanted_std_rad:
        longer_s = needed_s(math.sqrt(variance), wanted_std_rad, wobble_time_s)
        reason = (
            f"{math.degrees(std):.2f} deg after {seconds:.0f} s; the wobble averages out to "
            f"{math.degrees(wanted_std_rad):.2f} deg in {longer_s:.0f} s"
        )
    yaw = (middle + mean + float(turned[-1]) + math.pi) % math.tau - math.pi
    return StartYaw(yaw, std, seconds, math.sqrt(variance), reason)


def share_kept(seconds: float, wobble_time_s: float) -> float:
    """Variance of a Gauss-Markov process's mean over a time, as a share of its own."""
    ratio = wobble_time_s / seconds
    return 2.0 * ratio * (1.0 + ratio * math.expm1(-1.0 / ratio))


def needed_s(wobble_rad: float, wanted_std_rad: float, wobble_time_s: float = WOBBLE_TIME_S) -> float:
    """How long to average for a wanted standard deviation."""
    share = (wanted_std_rad / wobble_rad) ** 2
    if share >= 1.0:
        return 0.0
    low, high = 1e-3 * wobble_time_s, 1e6 * wobble_time_s
    for _ in range(80):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if share_kept(middle, wobble_time_s) > share else (low, middle)
    return high


class YawHold:
    """Yaw by gyro, held by a compass whose slow wobble is a state, and set by a reference where there is one.

    Unlike a complementary filter it does not follow the wobble: what moves slowly while the gyro sees nothing is the
    compass's error. States: yaw, gyro bias, wobble; radians and seconds.
    """

    GYRO_WALK = math.radians(0.01)
    BIAS_STD, BIAS_WALK = math.radians(0.02), math.radians(1e-4)
    COMPASS_STD = math.radians(0.1)

    def __init__(self, yaw_rad: float, wobble_time_s: float = WOBBLE_TIME_S, wobble_rad: float = WOBBLE_RAD) -> None:
        self._state = np.array((yaw_rad, 0.0, 0.0))
        self._covariance = np.diag((math.pi**2, self.BIAS_STD**2, wobble_rad**2))
        self._time_s, self._wobble = wobble_time_s, wobble_rad

    @property
    def yaw_rad(self) -> float:
        """As of the last call."""
        return float((self._state[0] + math.pi) % math.tau - math.pi)

    @property
    def std_rad(self) -> float:
        """Of that yaw."""
        return math.sqrt(float(self._covariance[0, 0]))

    def turn(self, turned_rad: float, interval_s: float) -> None:
        """What the gyro integrated over an interval."""
        decay = math.exp(-interval_s / self._time_s)
        step = np.array(((1.0, -interval_s, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, decay)))
        self._state = step @ self._state
        self._state[0] += turned_rad
        added = (
            self.GYRO_WALK**2 * interval_s,
            self.BIAS_WALK**2 * interval_s,
            self._wobble**2 * (1.0 - decay * decay),
        )
        self._covariance = step @ self._covariance @ step.T + np.diag(added)

    def rest(self, turned_rad: float, interval_s: float) -> None:
        """What the gyro integrated while nothing turned: that is its bias."""
        self.turn(0.0, interval_s)
        self._state[0] += interval_s * self._state[1]  # the turn above took the bias off a turn that there was not
        self._covariance[0, :] += interval_s * self._covariance[1, :]
        self._covariance[:, 0] += interval_s * self._covariance[:, 1]
        self._update(
            np.array((0.0, 1.0, 0.0)), turned_rad / interval_s, self.GYRO_WALK / math.sqrt(interval_s), wraps=False
        )

    def compass(self, yaw_rad: float) -> None:
        """A yaw that wobbles."""
        self._update(np.array((1.0, 0.0, 1.0)), yaw_rad, self.COMPASS_STD)

    def reference(self, yaw_rad: float, std_rad: float) -> None:
        """A yaw that does not: a known direction, a fixture."""
        self._update(np.array((1.0, 0.0, 0.0)), yaw_rad, std_rad)

    def _update(self, row: Array, value: float, std_rad: float, wraps: bool = True) -> None:
        residual = value - float(row @ self._state)
        if wraps:
            residual = math.remainder(residual, math.tau)
        carried = self._covariance @ row
        gain = carried / (float(row @ carried) + std_rad**2)
        self._state = self._state + gain * residual
        kept = np.eye(3) - np.outer(gain, row)
        self._covariance = kept @ self._covariance @ kept.T + std_rad**2 * np.outer(gain, gain)
