"""Bent rays: sound in layers whose speed changes linearly with depth, without a step size anywhere.

In such a layer a ray is an arc of a circle. With the invariant p = cos(angle) / c and s = |sin(angle)| at the two ends
a and b of a leg inside one layer of gradient g, free of division by g:

    x = p dz (c_a + c_b) / (s_a + s_b),    t = artanh(g q) / g,
    q = dz (c_a + c_b) (1 + s_a s_b) / ((s_a + s_b) (c_a^2 + c_b^2 - p^2 c_a^2 c_b^2))

A ray of one p goes up and down between an upper and a lower end: the surface or the bottom, where it is reflected, or
the depth where p c = 1, where it turns. So what arrives at a receiver is counted by the first direction and the number
of ends it came by, and for each of these the range is one function of the launch angle (eigenrays: its roots).

Angles are those of the way the sound goes, radians, down positive. Sources: Jensen et al., Computational Ocean
Acoustics (2011), section 3.3; for a single gradient t = arcosh(1 + g^2 (r^2 + dz^2) / (2 c_1 c_2)) / |g|.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater.profile import Extension

if TYPE_CHECKING:
    from bluerov_slam.navigation.seawater.profile import WaterColumn

Array = NDArray[np.float64]

SOUND_SPEEDS_MPS = (300.0, 1800.0)
FLATTEST_RAD = 1e-7
GRID = 1400
"""Launch angles tried between flat and vertical: half of them in steps of equal ratio, so that flat rays are seen."""

MOST_STEPS = 60
RANGE_TOLERANCE = 1e-6
"""Relative: where a search ends further off it found a gap between two families of rays, not a ray."""


@dataclass(frozen=True, eq=False)
class SoundProfile:
    """Sound speed at increasing depths, linear in between; the first is the surface and the last the bottom.

    `bridged`: stretches in which nothing was measured and the straight line between their ends is a guess.
    """

    depth_m: Array
    sound_speed_mps: Array
    bridged: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        depth, speed = np.asarray(self.depth_m, dtype=np.float64), np.asarray(self.sound_speed_mps, dtype=np.float64)
        if depth.ndim != 1 or depth.shape != speed.shape or len(depth) < 2:
            raise OutOfValidityError(f"a sound-speed profile of {depth.size} depths and {speed.size} speeds")
        if not (np.isfinite(depth).all() and (np.diff(depth) > 0.0).all()):
            raise OutOfValidityError("the depths of a sound-speed profile must increase")
        low, high = SOUND_SPEEDS_MPS
        if not ((speed > low) & (speed < high)).all():
            raise OutOfValidityError(
                f"sound speeds {speed.min():.6g} to {speed.max():.6g} m/s, expected {low} to {high}"
            )
        object.__setattr__(self, "depth_m", depth)
        object.__setattr__(self, "sound_speed_mps", speed)

    @classmethod
    def constant(cls, sound_speed_mps: float, bottom_m: float) -> SoundProfile:
        """The same everywhere: straight rays."""
        return cls(np.array((0.0, bottom_m)), np.full(2, sound_speed_mps))

    @classmethod
    def of_samples(
        cls, depth_m: ArrayLike, sound_speed_mps: ArrayLike, bottom_m: float, longest_gap_m: float = 5.0
    ) -> SoundProfile:
        """From samples in any order. NaNs are left out, equal depths averaged; the outermost values go on to the ends.

        Stretches longer than `longest_gap_m` without a sample stand in `bridged`.
        """
        depth = np.asarray(depth_m, dtype=np.float64)
        speed = np.asarray(sound_speed_mps, dtype=np.float64)
        good = np.isfinite(depth) & np.isfinite(speed) & (depth >= 0.0) & (depth <= bottom_m)
        if not good.any():
            raise OutOfValidityError(f"no sample of the sound speed between the surface and {bottom_m:.6g} m")
        nodes, where = np.unique(depth[good], return_inverse=True)
        means = np.bincount(where, speed[good]) / np.bincount(where)
        edges = np.concatenate(([0.0], nodes, [bottom_m]))
        bridged = tuple((upper, lower) for upper, lower in pairwise(edges.tolist()) if lower - upper > longest_gap_m)
        if nodes[0] > 0.0:
            nodes, means = np.concatenate(([0.0], nodes)), np.concatenate((means[:1], means))
        if nodes[-1] < bottom_m:
            nodes, means = np.concatenate((nodes, [bottom_m])), np.concatenate((means, means[-1:]))
        return cls(nodes, means, bridged)

    @classmethod
    def of_column(cls, column: WaterColumn, bottom_m: float) -> SoundProfile:
        """What the CTD found, from the surface to the bottom; holes and what lies beyond it stand in `bridged`."""
        inner = column.depth_m[(column.depth_m > 0.0) & (column.depth_m < bottom_m)]
        depth = np.concatenate(([0.0], inner, [bottom_m]))
        speed = np.asarray(column.sound_speed_at_mps(depth, Extension.NEAREST), dtype=np.float64)
        middle = 0.5 * (depth[:-1] + depth[1:])
        known = np.isfinite(np.asarray(column.sound_speed_at_mps(middle), dtype=np.float64))
        bridged = tuple(
            (float(upper), float(lower))
            for upper, lower, sure in zip(depth[:-1], depth[1:], known, strict=True)
            if not sure
        )
        return cls(depth, speed, bridged)

    @property
    def bottom_m(self) -> float:
        """Where it ends."""
        return float(self.depth_m[-1])

    def at_mps(self, depth_m: float) -> float:
        """The speed at a depth."""
        return float(np.interp(depth_m, self.depth_m, self.sound_speed_mps))

    def guessed(self, upper_m: float, lower_m: float) -> float:
        """The share of a stretch of depth in which the profile is a guess."""
        upper, lower = min(upper_m, lower_m), max(upper_m, lower_m)
        if lower == upper:
            return float(any(a <= upper <= b for a, b in self.bridged))
        overlap = sum(max(0.0, min(b, lower) - max(a, upper)) for a, b in self.bridged)
        return overlap / (lower - upper)


@dataclass(frozen=True, slots=True)
class EigenRay:
    """One way from source to receiver."""

    travel_time_s: float
    launch_rad: float
    arrival_rad: float
    surface_bounces: int
    bottom_bounces: int
    turns: int

    @property
    def direct(self) -> bool:
        """Whether nothing reflected it."""
        return self.surface_bounces == 0 and self.bottom_bounces == 0

    @property
    def seen_at_rad(self) -> float:
        """Elevation (down positive) at which the receiver sees the source on this way."""
        return -self.arrival_rad


def eigenrays(
    profile: SoundProfile, source_depth_m: float, receiver_depth_m: float, range_m: float, most_bounces: int = 2
) -> list[EigenRay]:
    """All ways with at most so many reflections, the first to arrive first.

    Two rays that nearly coincide (at a caustic) may be missed. Raises OutOfValidityError for depths outside the water.
    """
    _check_depth(profile, source_depth_m)
    _check_depth(profile, receiver_depth_m)
    if not range_m >= 0.0:
        raise OutOfValidityError(f"range {range_m} m, expected 0 or more")
    if range_m == 0.0:
        return _vertical(profile, source_depth_m, receiver_depth_m, most_bounces)
    flat = np.geomspace(FLATTEST_RAD, 0.1, GRID // 2)
    angles = np.concatenate((flat, np.linspace(0.1, 0.5 * math.pi, GRID // 2 + 1)[1:]))
    table = _Fan(profile, source_depth_m, receiver_depth_m, angles)
    rays: list[EigenRay] = []
    # A turning ray comes by ends without being reflected; a handful of them covers any profile of this scale.
    for downward in (True, False):
        for passed in range(2 * most_bounces + 3):
            rays += _roots(profile, source_depth_m, receiver_depth_m, range_m, table, downward, passed, most_bounces)
    rays.sort(key=lambda ray: ray.travel_time_s)
    return _distinct(rays)


def direct_ray(
    profile: SoundProfile, source_depth_m: float, receiver_depth_m: float, range_m: float
) -> EigenRay | None:
    """The first arrival without reflection; None in a shadow."""
    direct = [ray for ray in eigenrays(profile, source_depth_m, receiver_depth_m, range_m, 0) if ray.direct]
    return direct[0] if direct else None


def bend_rad(profile: SoundProfile, source_depth_m: float, receiver_depth_m: float, range_m: float) -> float | None:
    """By how much further down than along the straight line the receiver sees the source; None in a shadow."""
    ray = direct_ray(profile, source_depth_m, receiver_depth_m, range_m)
    if ray is None:
        return None
    return ray.seen_at_rad - math.atan2(source_depth_m - receiver_depth_m, range_m)


@dataclass(frozen=True, slots=True)
class Reach:
    """Where a ray comes to a depth."""

    range_m: float
    travel_time_s: float
    angle_rad: float


def reach_of_depth(profile: SoundProfile, from_depth_m: float, elevation_rad: float, to_depth_m: float) -> Reach | None:
    """Where the ray that leaves at an elevation first comes to a depth without being reflected; None if it never does.

    Sound takes the same way back: with the elevation at which a source of known depth is seen this is its horizontal
    range, where the straight line says depth difference / tan(elevation).
    """
    _check_depth(profile, from_depth_m)
    _check_depth(profile, to_depth_m)
    downward = elevation_rad > 0.0 or (elevation_rad == 0.0 and to_depth_m > from_depth_m)
    angle = np.array([max(abs(elevation_rad), FLATTEST_RAD)])
    fan = _Fan(profile, from_depth_m, to_depth_m, angle)
    for passed in (0, 1):
        arrival = fan.arrival(downward, passed)
        if np.isfinite(arrival.range_m[0]) and arrival.bounces[0] == 0:
            sign = 1.0 if arrival.downward else -1.0
            return Reach(float(arrival.range_m[0]), float(arrival.time_s[0]), sign * float(fan.receiver_angle[0]))
    return None


def corrected_position_m(
    profile: SoundProfile, receiver_depth_m: float, source_depth_m: float, position_ned_m: ArrayLike
) -> Array | None:
    """A source's position (relative to the receiver, NED) as bent rays have it, from the one straight rays gave.

    The bearing stays; the range becomes that of the ray seen at the same elevation. None where no ray gets there.
    """
    north, east, down = np.asarray(position_ned_m, dtype=np.float64).tolist()
    level = math.hypot(north, east)
    if level < 1e-9:
        return np.array((north, east, source_depth_m - receiver_depth_m))
    reach = reach_of_depth(profile, receiver_depth_m, math.atan2(down, level), source_depth_m)
    if reach is None:
        return None
    stretch = reach.range_m / level
    return np.array((north * stretch, east * stretch, source_depth_m - receiver_depth_m))


class _Arrival(NamedTuple):
    range_m: Array
    time_s: Array
    bounces: NDArray[np.int64]  # of both kinds; -1 where there is no such ray
    surface: NDArray[np.int64]
    bottom: NDArray[np.int64]
    kinds: NDArray[np.int64]  # which ends are reflections: neighbours of one kind belong to one family
    downward: bool


class _Fan:
    """Rays from one source at many launch angles (up and down alike): ways to the ends and to the receiver's depth."""

    def __init__(self, profile: SoundProfile, source_m: float, receiver_m: float, angle: Array) -> None:
        depth = np.unique(np.concatenate((profile.depth_m, [source_m, receiver_m])))
        self._depth = depth
        self._speed = np.interp(depth, profile.depth_m, profile.sound_speed_mps)
        self._source = int(np.searchsorted(depth, source_m))
        self._receiver = int(np.searchsorted(depth, receiver_m))
        speed = self._speed[self._source]
        self._p = np.cos(angle) / speed
        ratio = (self._speed - speed) * (self._speed + speed) / (speed * speed)
        square = np.sin(angle) ** 2 - np.cos(angle) ** 2 * ratio[:, None]
        # At the source itself the sine is that of the angle.
        square[self._source] = np.sin(angle) ** 2
        with np.errstate(invalid="ignore"):
            self._sine = np.where(square > 0.0, np.sqrt(square), np.nan)
        self._x, self._t = self._layers()
        self.lower = self._end(self._source, +1)
        self.upper = self._end(self._source, -1)
        self.from_lower = self._end(self._receiver, +1)
        self.from_upper = self._end(self._receiver, -1)
        self._between = self._leg(self._source, self._receiver)
        # Beyond an end of its own a ray never comes: the receiver has to lie between them.
        self._reachable = np.isfinite(self._between[0])
        self.receiver_angle = np.arctan2(self._sine[self._receiver], self._p * self._speed[self._receiver])

    def arrival(self, downward: bool, passed: int) -> _Arrival:
        """Rays that set out this way and come to the receiver's depth after `passed` ends."""
        lower, upper = self.lower, self.upper
        if passed == 0:
            fits = self._receiver > self._source if downward else self._receiver < self._source
            x, t = self._between
            x = np.where(self._reachable & fits, x, np.nan)
            none = np.zeros(len(x), dtype=np.int64)
            return _Arrival(x, t, np.where(np.isfinite(x), 0, -1), none, none, none, downward)
        first, other = (lower, upper) if downward else (upper, lower)
        crossing_x, crossing_t = lower.x + upper.x, lower.t + upper.t
        last_is_first = passed % 2 == 1
        back = (
            (self.from_lower if downward else self.from_upper)
            if last_is_first
            else (self.from_upper if downward else self.from_lower)
        )
        x = first.x + (passed - 1) * crossing_x + back.x
        t = first.t + (passed - 1) * crossing_t + back.t
        x = np.where(self._reachable, x, np.nan)
        at_first, at_other = (passed + 1) // 2, passed // 2
        hits_first = first.reflects * at_first
        hits_other = other.reflects * at_other
        surface = hits_other if downward else hits_first
        bottom = hits_first if downward else hits_other
        kinds = 2 * first.reflects + (other.reflects if at_other else 0)
        bounces = np.where(np.isfinite(x), surface + bottom, -1)
        return _Arrival(x, t, bounces, surface, bottom, kinds, downward != last_is_first)

    def _layers(self) -> tuple[Array, Array]:
        """Range and time (layers, angles) of a ray through each whole layer; NaN where it does not get through."""
        dz = np.diff(self._depth)[:, None]
        above, below = self._speed[:-1, None], self._speed[1:, None]
        return _leg(self._p, dz, above, below, self._sine[:-1], self._sine[1:])

    def _leg(self, start: int, end: int) -> tuple[Array, Array]:
        low, high = min(start, end), max(start, end)
        return self._x[low:high].sum(axis=0), self._t[low:high].sum(axis=0)

    def _end(self, start: int, step: int) -> _End:
        """From a node to where the ray is reflected or turns."""
        count = self._sine.shape[1]
        x, t = np.zeros(count), np.zeros(count)
        running = np.isfinite(self._sine[start])
        reflects = np.zeros(count, dtype=np.int64)
        last = len(self._depth) - 1 if step > 0 else 0
        node = start
        while node != last:
            ahead = node + step
            layer = min(node, ahead)
            through = running & np.isfinite(self._sine[ahead])
            turning = running & ~through
            if turning.any():
                # The speed grows to 1 / p inside this layer: an arc up to its vertex.
                gradient = (self._speed[ahead] - self._speed[node]) / abs(self._depth[ahead] - self._depth[node])
                vertex = 1.0 / self._p[turning]
                dz = (vertex - self._speed[node]) / gradient
                sine = self._sine[node][turning]
                more_x, more_t = _leg(
                    self._p[turning], dz, np.full_like(dz, self._speed[node]), vertex, sine, np.zeros_like(dz)
                )
                x[turning] += more_x
                t[turning] += more_t
            x[through] += self._x[layer][through]
            t[through] += self._t[layer][through]
            running = through
            node = ahead
        reflects[running] = 1
        lost = ~np.isfinite(self._sine[start])
        x[lost] = np.nan
        return _End(x, t, reflects)


class _End(NamedTuple):
    x: Array
    t: Array
    reflects: NDArray[np.int64]


def _leg(p: Array, dz: Array, speed_a: Array, speed_b: Array, sine_a: Array, sine_b: Array) -> tuple[Array, Array]:
    """Range and time of an arc inside one layer; `dz` positive."""
    total = speed_a + speed_b
    sines = sine_a + sine_b
    x = p * dz * total / sines
    below = speed_a * speed_a + speed_b * speed_b - (p * speed_a * speed_b) ** 2
    q = dz * total * (1.0 + sine_a * sine_b) / (sines * below)
    y = (speed_b - speed_a) / dz * q
    small = np.abs(y) < 1e-4
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(small, 1.0 + y * y / 3.0, np.arctanh(np.clip(y, -1.0, 1.0)) / np.where(y == 0.0, 1.0, y))
    return x, q * factor


def _roots(
    profile: SoundProfile,
    source_m: float,
    receiver_m: float,
    range_m: float,
    fan: _Fan,
    downward: bool,
    passed: int,
    most_bounces: int,
) -> list[EigenRay]:
    """Where the range as a function of the launch angle is the asked one."""
    arrival = fan.arrival(downward, passed)
    allowed = (arrival.bounces >= 0) & (arrival.bounces <= most_bounces)
    off = arrival.range_m - range_m
    with np.errstate(invalid="ignore"):
        crosses = allowed[:-1] & allowed[1:] & (arrival.kinds[:-1] == arrival.kinds[1:]) & (off[:-1] * off[1:] <= 0.0)
    found = np.flatnonzero(crosses)
    if not len(found):
        return []
    angles = np.arctan2(fan._sine[fan._source], fan._p * fan._speed[fan._source])
    middle, last, end = _refined(
        profile,
        source_m,
        receiver_m,
        range_m,
        downward,
        passed,
        (angles[found], angles[found + 1], off[found], off[found + 1]),
    )
    rays = []
    for index, angle in enumerate(middle.tolist()):
        if not abs(end.range_m[index] - range_m) <= RANGE_TOLERANCE * max(range_m, 1.0):
            continue
        sign = 1.0 if end.downward else -1.0
        rays.append(
            EigenRay(
                float(end.time_s[index]),
                angle if downward else -angle,
                sign * float(last.receiver_angle[index]),
                int(end.surface[index]),
                int(end.bottom[index]),
                passed - int(end.bounces[index]),
            )
        )
    return rays


def _refined(
    profile: SoundProfile,
    source_m: float,
    receiver_m: float,
    range_m: float,
    downward: bool,
    passed: int,
    bracket: tuple[Array, Array, Array, Array],
) -> tuple[Array, _Fan, _Arrival]:
    """Regula falsi with halved ordinates (Illinois), for all brackets at once."""
    low, high, low_off, high_off = bracket
    for _ in range(MOST_STEPS):
        with np.errstate(invalid="ignore", divide="ignore"):
            middle = (low * high_off - high * low_off) / (high_off - low_off)
        middle = np.where(np.isfinite(middle), middle, 0.5 * (low + high))
        fan = _Fan(profile, source_m, receiver_m, middle)
        arrival = fan.arrival(downward, passed)
        off = arrival.range_m - range_m
        if (np.abs(off) <= 1e-5 * RANGE_TOLERANCE * max(range_m, 1.0)).all():
            break
        same = np.sign(off) == np.sign(low_off)
        high_off = np.where(same, 0.5 * high_off, low_off)
        high = np.where(same, high, low)
        low, low_off = middle, off
    return middle, fan, arrival


def _vertical(profile: SoundProfile, source_m: float, receiver_m: float, most_bounces: int) -> list[EigenRay]:
    fan = _Fan(profile, source_m, receiver_m, np.array([0.5 * math.pi]))
    rays = []
    for downward in (True, False):
        for passed in range(most_bounces + 1):
            arrival = fan.arrival(downward, passed)
            if 0 <= arrival.bounces[0] <= most_bounces:
                rays.append(
                    EigenRay(
                        float(arrival.time_s[0]),
                        0.5 * math.pi if downward else -0.5 * math.pi,
                        0.5 * math.pi if arrival.downward else -0.5 * math.pi,
                        int(arrival.surface[0]),
                        int(arrival.bottom[0]),
                        0,
                    )
                )
    rays.sort(key=lambda ray: ray.travel_time_s)
    return rays


def _distinct(rays: list[EigenRay]) -> list[EigenRay]:
    """One ray may be found twice, from both sides of a grid angle, or as the same flat ray set out up and down."""
    kept: list[EigenRay] = []
    for ray in rays:
        if not any(
            abs(ray.travel_time_s - other.travel_time_s) < 1e-12 and abs(ray.launch_rad - other.launch_rad) < 1e-9
            for other in kept
        ):
            kept.append(ray)
    return kept


def _check_depth(profile: SoundProfile, depth_m: float) -> None:
    if not 0.0 <= depth_m <= profile.bottom_m:
        raise OutOfValidityError(f"depth {depth_m} m, the profile has 0 to {profile.bottom_m:.6g} m")
