"""Set points in time: smooth and as fast as the servos allow, and the thesis's two profiles.

Smooth: a C2 cubic spline through the waypoints, at rest at both ends; along it the servo angles theta(s). The greatest
speed keeps |theta'| ds/dt within the servos' speed and |theta'' (ds/dt)^2 + theta' d2s/dt2| within their acceleration:
swept forwards and backwards over a grid of s (Bobrow, Dubowsky, Gibson 1985, doi:10.1177/027836498500400301). That is
optimal but its acceleration jumps. Moving means of s(t), `smoothing_s` in all, bound the jerk: acceleration becomes
continuous, the path stays the same. Where a mean looks past a corner of the speed limit, all is slowed down to keep it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.rig.dimensions import AxisLimits
from bluerov_slam.rig.limits import FO_SHIP_LIMITS, Limit, PlatformLimits, checked_set_points, platform_margins
from bluerov_slam.rig.platform import servo_angles_rad

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions

STEP_S = 0.05
STEPS = {"gradual": 16, "rapid": 6}
STEPS_ON_AXIS_CHANGE = {"gradual": 24, "rapid": 20}
SERVO_SPEED_RADPS = float(np.radians(60.0) / 0.17)
"""MG996R at 4.8 V by its data sheet, without load: 0.17 s for 60 degrees."""
SERVO_ACCELERATION_RADPS2 = 40.0
"""Reaches that speed in 0.15 s. Not in any data sheet: an assumption."""
_GRID = 64
"""Points of the path between two waypoints."""
_FINER = 8
"""Steps of the calculation in one of the result."""
_ROUNDING = 1e-9

Kind = Literal["gradual", "rapid"]


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Set points at equal steps of time.

    Attributes:
        times_s: (n,), from zero.
        set_points: (n, P, 6).
        servo_angles_rad: (n, P, 6).
        bound_s: what the servos' speed and acceleration allow on this path, without smoothing; NaN if not calculated.
    """

    times_s: Floats
    set_points: Floats
    servo_angles_rad: Floats
    bound_s: float

    @property
    def duration_s(self) -> float:
        """Until the last set point."""
        return float(self.times_s[-1])


def published_steps(kind: Kind, start: Floats, end: Floats, axis_change: bool = False) -> tuple[Floats, Floats]:
    """Times and set points (n + 1, ...) of one published move: linear, 50 ms a step, the end after the last.

    Args:
        kind: "gradual" takes 16 steps, "rapid" 6; with a change of axis 24 and 20.
        start: set points (..., 6).
        end: likewise.
        axis_change: whether the move before was along another axis.
    """
    count = (STEPS_ON_AXIS_CHANGE if axis_change else STEPS)[kind]
    begin, last = checked_set_points(start), checked_set_points(end)
    share = np.arange(count).reshape(-1, *(1,) * begin.ndim) / count
    steps = begin + share * (last - begin)
    return np.asarray(STEP_S * np.arange(count + 1)), np.concatenate([steps, last[None]])


def smooth_path(
    waypoints: Floats,
    dimensions: StackDimensions,
    servo_speed_radps: float = SERVO_SPEED_RADPS,
    servo_acceleration_radps2: float = SERVO_ACCELERATION_RADPS2,
    smoothing_s: float = 0.06,
    step_s: float = 0.02,
    limits: PlatformLimits = FO_SHIP_LIMITS,
) -> Trajectory:
    """Through set points (n, P, 6) from rest to rest.

    It comes to rest where the way turns by more than 60 degrees, and where a curve through the waypoints would pass a
    limit: there it goes straight from one to the next.

    Raises OutOfValidityError if the straight way between two waypoints passes a limit, with its name and where.
    """
    points = checked_set_points(waypoints, (len(dimensions.platforms), 6))
    moved = np.abs(np.diff(points, axis=0)).max(axis=(1, 2), initial=0.0) > 1e-12
    points = points[np.concatenate([[True], moved])]
    machine = _Machine(dimensions, limits, servo_speed_radps, servo_acceleration_radps2)
    pieces, bound_s = [points[:1]], 0.0
    for run in _runs(points, machine):
        piece, least_s = _run(run, machine, smoothing_s, step_s)
        pieces.append(piece[1:])
        bound_s += least_s
    way = np.concatenate(pieces)
    return Trajectory(np.asarray(step_s * np.arange(len(way))), way, machine.angles(way), bound_s)


@dataclass(frozen=True, slots=True)
class _Machine:
    """What the servos of a stack can do."""

    dimensions: StackDimensions
    limits: PlatformLimits
    speed_radps: float
    acceleration_radps2: float

    def angles(self, points: Floats) -> Floats:
        """(n, P, 6) of set points (n, P, 6)."""
        each = [servo_angles_rad(points[:, i], platform) for i, platform in enumerate(self.dimensions.platforms)]
        return np.stack(each, axis=1)

    def broken(self, way: Floats) -> tuple[int, Limit] | None:
        """The first platform that cannot follow and its limit."""
        for i, platform in enumerate(self.dimensions.platforms):
            margins = platform_margins(way[:, i], platform, self.limits).by_limit()
            # A waypoint on an axis limit is allowed; rounding along the way to it must not forbid it.
            least = [np.where(v > -_ROUNDING, 0.0, -1.0) for v in margins.values()]
            bad = np.min(least, axis=0) < 0.0
            if bad.any():
                at = int(np.argmax(bad))
                broken = platform_margins(way[at, i], platform, self.limits).broken()
                return i, broken or Limit.AXIS
        return None


def _runs(points: Floats, machine: _Machine) -> list[_Spline]:
    """The way from rest to rest, piece by piece."""
    found: list[_Spline] = []
    begin = 0
    step = np.diff(points, axis=0).reshape(len(points) - 1, -1) / np.tile(AxisLimits().array(), points.shape[1])
    for i in range(1, len(points)):
        last = i == len(points) - 1
        if not last:
            a, b = step[i - 1], step[i]
            last = float(a @ b) < 0.5 * float(np.linalg.norm(a) * np.linalg.norm(b))
        if last:
            found += _curve_or_lines(points[begin : i + 1], begin, machine)
            begin = i
    return found


def _curve_or_lines(points: Floats, first: int, machine: _Machine) -> list[_Spline]:
    curve = _spline(points, first, machine)
    if machine.broken(curve(curve.grid())) is None:
        return [curve]
    lines = [_spline(points[i : i + 2], first + i, machine) for i in range(len(points) - 1)]
    for i, line in enumerate(lines):
        if (broken := machine.broken(line(line.grid()))) is not None:
            platform, limit = broken
            raise OutOfValidityError(
                f"platform {platform + 1} cannot go from waypoint {first + i} to the next: {limit.words}"
            )
    return lines


def _run(path: _Spline, machine: _Machine, smoothing_s: float, step_s: float) -> tuple[Floats, float]:
    """Set points from rest to rest at equal steps of time, and the time that it would take without smoothing."""
    s = path.grid()
    along = machine.angles(path(s)).reshape(len(s), -1)
    times = _fastest(s, along, machine.speed_radps, machine.acceleration_radps2)
    least_s = float(times[-1])
    fine_s = step_s / _FINER
    run = np.interp(np.arange(int(np.ceil(least_s / fine_s)) + 1) * fine_s, times, s)
    half = max(1, round(0.25 * smoothing_s / fine_s))
    run = _mean(_mean(run, half), half)  # two short means: the acceleration's ramps become smooth too
    fastest = float(np.abs(np.diff(machine.angles(path(run)), axis=0)).max() / fine_s)
    slower = max(1.0, fastest / machine.speed_radps)
    duration_s = slower * fine_s * (len(run) - 1)
    clock = np.asarray(np.arange(int(np.ceil(duration_s / step_s)) + 1) * step_s)
    return path(_between(clock, slower * fine_s, run)), least_s


class _Spline:
    """C2 cubic through set points over the way of the servos, without curvature at its ends; two points: a line."""

    def __init__(self, knots: Floats, values: Floats) -> None:
        flat = values.reshape(len(values), -1)
        step = np.diff(knots)
        slope = np.diff(flat, axis=0) / step[:, None]
        n = len(knots)
        system, right = np.zeros((n, n)), np.zeros_like(flat)
        for i in range(1, n - 1):
            system[i, i - 1 : i + 2] = step[i - 1], 2.0 * (step[i - 1] + step[i]), step[i]
            right[i] = 6.0 * (slope[i] - slope[i - 1])
        system[0, 0] = system[-1, -1] = 1.0
        self.knots, self.values, self.curves = knots, flat, np.linalg.solve(system, right)
        self.shape = values.shape[1:]

    def __call__(self, s: Floats) -> Floats:
        """At parameters (n,)."""
        i = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.knots) - 2)
        step = (self.knots[i + 1] - self.knots[i])[:, None]
        b = (s - self.knots[i])[:, None] / step
        a = 1.0 - b
        bent = ((a**3 - a) * self.curves[i] + (b**3 - b) * self.curves[i + 1]) * step**2 / 6.0
        return np.asarray(a * self.values[i] + b * self.values[i + 1] + bent).reshape(-1, *self.shape)

    def grid(self) -> Floats:
        """Parameters from end to end."""
        return np.linspace(0.0, self.knots[-1], _GRID * (len(self.knots) - 1) + 1)


def _spline(points: Floats, first: int, machine: _Machine) -> _Spline:
    angles = machine.angles(points)
    lost = np.isnan(angles).any(axis=(1, 2))
    if lost.any():
        raise OutOfValidityError(f"waypoint {first + int(np.argmax(lost))} cannot be reached: {Limit.REACH.words}")
    moved = np.abs(np.diff(angles, axis=0)).max(axis=(1, 2))
    return _Spline(np.concatenate([[0.0], np.cumsum(np.maximum(moved, 1e-6))]), points)


def _fastest(s: Floats, angles: Floats, speed: float, acceleration: float) -> Floats:
    """Times (n,) along the path by a sweep forwards and one backwards over the square of ds/dt."""
    step = float(s[1] - s[0])
    first = np.gradient(angles, step, axis=0, edge_order=2)
    second = np.gradient(first, step, axis=0, edge_order=2)
    slope, bend = np.abs(first), np.abs(second)
    with np.errstate(divide="ignore"):
        most = np.min((speed / np.maximum(slope, 1e-12)) ** 2, axis=1)
        most = np.minimum(most, np.min(acceleration / np.maximum(bend, 1e-12), axis=1))
    square = most.copy()
    square[0] = square[-1] = 0.0
    for order in (range(1, len(s)), range(len(s) - 2, -1, -1)):
        back = -1 if order.step > 0 else 1
        for i in order:
            before = square[i + back]
            room = np.maximum(acceleration - bend[i + back] * before, 0.0)
            gain = float(np.min(room / np.maximum(slope[i + back], 1e-12)))
            square[i] = min(square[i], before + 2.0 * step * gain)
    root = np.sqrt(square)
    return np.concatenate([[0.0], np.cumsum(2.0 * step / np.maximum(root[1:] + root[:-1], 1e-9))])


def _mean(run: Floats, half: int) -> Floats:
    """Moving mean over 2 half + 1 values of a run that rests before and after."""
    padded = np.concatenate([np.full(2 * half, run[0]), run, np.full(2 * half, run[-1])])
    total = np.concatenate([[0.0], np.cumsum(padded)])
    width = 2 * half + 1
    return np.asarray((total[width:] - total[:-width]) / width)


def _between(at_s: Floats, step_s: float, run: Floats) -> Floats:
    """Cubic through a run of equal steps of time (Catmull-Rom): linear pieces would put corners into the speed."""
    i = np.clip((at_s / step_s).astype(int), 0, len(run) - 2)
    t = np.clip(at_s / step_s - i, 0.0, 1.0)
    padded = np.concatenate([run[:1], run, run[-1:]])
    a, b, c, d = (padded[i + k] for k in range(4))
    return np.asarray(b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a))))
