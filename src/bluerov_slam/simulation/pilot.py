"""Who flies the simulated vehicle: it sees where it is, not quite, and steers along a route as a pilot would.

Heading and depth hold as ArduSub has them, a stick for ahead and aside. It learns the current as it goes, and never
asks more of a thruster than it has.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from bluerov_slam.simulation.hull import DRAG_X, DRAG_Y, drag_n
from bluerov_slam.simulation.noise_processes import GaussMarkov
from bluerov_slam.simulation.thrusters import ThrusterFrame, pwm_for_us

_MISJUDGED_M, _MISJUDGED_S = 0.35, 40.0
_WANDERING_RAD, _WANDERING_S = math.radians(1.5), 12.0
_CATCH_UP_PER_S = 0.25
_MOST_EXTRA_MPS = 0.35
_LEARN_PER_S = 0.15
_MOST_CURRENT_MPS = 0.9
_EASING_MPS2 = 0.15
_STICK_STEP_N = 1.5
_MOST_STICKS_N = 105.0  # ahead and aside together: leaves the thrusters something to turn with
_TURN_RADPS = math.radians(14.0)
_HEADING_NM_PER_RAD, _HEADING_NM_PER_RADPS, _MOST_TURN_NM = 3.0, 2.2, 6.0
_DEPTH_N_PER_M, _DEPTH_N_PER_MPS, _DEPTH_N_PER_MS, _MOST_HEAVE_N = 70.0, 80.0, 6.0, 60.0
_LEVEL_NM_PER_RAD, _LEVEL_NM_PER_RADPS = 1.5, 0.9
# What share of the cross current is met with the heading, the rest with the side stick; more where it is strong.
_CRAB_SHARE, _CRAB_SHARE_PER_MPS, _MOST_CRAB_SHARE = 0.5, 1.4, 0.95
_WAITS_M = 4.0


class Target(NamedTuple):
    """Where the vehicle should be, and how it should move; `depth_m` None: afloat, no vertical thrust."""

    north_m: float
    east_m: float
    depth_m: float | None
    heading_rad: float
    speed_mps: float
    course_rad: float


class Route(Protocol):
    """A target for every instant of a schedule."""

    def target(self, schedule_s: float) -> Target:
        """Where to be at this time of the schedule."""


class Seen(NamedTuple):
    """The true state as the pilot's instruments show it, NED and FRD."""

    north_m: float
    east_m: float
    depth_m: float
    velocity_ned_mps: tuple[float, float, float]
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    rates_radps: tuple[float, float, float]


class Pilot:
    """One pilot on one route; `steer` must be called step by step."""

    def __init__(self, route: Route, frame: ThrusterFrame, seed: int, start_s: float, step_s: float) -> None:
        self.behind_s = 0.0
        self._route = route
        self._start_s = start_s
        self._frame = frame
        self._step_s = step_s
        rng = np.random.default_rng([seed, 0x9107])
        self._misjudged = GaussMarkov(rng, (_MISJUDGED_M, _MISJUDGED_M), _MISJUDGED_S)
        self._wandering = GaussMarkov(rng, (_WANDERING_RAD,), _WANDERING_S)
        self._current_ne = [0.0, 0.0]
        self._heading_rad = route.target(start_s).heading_rad
        self._heave_n = 0.0
        self._wanted_ne = [0.0, 0.0]

    def steer(self, at_s: float, seen: Seen) -> list[int]:
        """PWM of every thruster until the next call."""
        target = self._route.target(at_s - self.behind_s)
        if self.behind_s:  # the times of diving and surfacing do not wait
            target = target._replace(depth_m=self._route.target(at_s).depth_m)
        misjudged_n, misjudged_e = self._misjudged.at(at_s - self._start_s).tolist()
        off_n, off_e = target.north_m - seen.north_m - misjudged_n, target.east_m - seen.east_m - misjudged_e
        speed_mps = target.speed_mps
        if math.hypot(off_n, off_e) > _WAITS_M:
            self.behind_s += self._step_s  # first back to the track, which waits
            speed_mps = 0.0
        wanted_n, wanted_e = speed_mps * math.cos(target.course_rad), speed_mps * math.sin(target.course_rad)
        extra_n, extra_e = _CATCH_UP_PER_S * off_n, _CATCH_UP_PER_S * off_e
        size = math.hypot(extra_n, extra_e)
        if size > _MOST_EXTRA_MPS:
            extra_n, extra_e = extra_n * _MOST_EXTRA_MPS / size, extra_e * _MOST_EXTRA_MPS / size
        surge_n, sway_n = self._sticks(seen, *self._eased(wanted_n + extra_n, wanted_e + extra_e))
        turn_nm = self._hold_heading(at_s, target, seen)
        heave_n = self._hold_depth(target, seen)
        roll_nm = -_LEVEL_NM_PER_RAD * seen.roll_rad - _LEVEL_NM_PER_RADPS * seen.rates_radps[0]
        pitch_nm = 0.0
        if self._frame.controls_pitch:
            pitch_nm = -_LEVEL_NM_PER_RAD * seen.pitch_rad - _LEVEL_NM_PER_RADPS * seen.rates_radps[1]
        if target.depth_m is None:
            roll_nm = pitch_nm = 0.0
        wanted = (surge_n, sway_n, heave_n, roll_nm, pitch_nm, turn_nm)
        return [pwm_for_us(sum(s * f for s, f in zip(share, wanted, strict=True))) for share in self._frame.share]

    def _eased(self, wanted_n: float, wanted_e: float) -> tuple[float, float]:
        """Nobody jerks the stick."""
        most = _EASING_MPS2 * self._step_s
        off_n, off_e = wanted_n - self._wanted_ne[0], wanted_e - self._wanted_ne[1]
        share = min(1.0, most / max(math.hypot(off_n, off_e), 1.0e-9))
        self._wanted_ne = [self._wanted_ne[0] + share * off_n, self._wanted_ne[1] + share * off_e]
        return self._wanted_ne[0], self._wanted_ne[1]

    def _sticks(self, seen: Seen, wanted_n: float, wanted_e: float) -> tuple[float, float]:
        """Forces ahead and to starboard for a wanted velocity over ground."""
        error_n, error_e = wanted_n - seen.velocity_ned_mps[0], wanted_e - seen.velocity_ned_mps[1]
        current = self._current_ne
        through_n, through_e = wanted_n - current[0], wanted_e - current[1]
        cos_y, sin_y = math.cos(seen.yaw_rad), math.sin(seen.yaw_rad)
        ahead = drag_n(cos_y * through_n + sin_y * through_e, DRAG_X) + 35.0 * (cos_y * error_n + sin_y * error_e)
        aside = drag_n(cos_y * through_e - sin_y * through_n, DRAG_Y) + 35.0 * (cos_y * error_e - sin_y * error_n)
        share = min(1.0, _MOST_STICKS_N / max(abs(ahead) + abs(aside), 1.0))
        if share == 1.0:  # at full throttle the error says nothing about the current
            for axis, error in enumerate((error_n, error_e)):
                learned = current[axis] - _LEARN_PER_S * error * self._step_s
                current[axis] = min(_MOST_CURRENT_MPS, max(-_MOST_CURRENT_MPS, learned))
        return _stick(share * ahead), _stick(share * aside)

    def _hold_heading(self, at_s: float, target: Target, seen: Seen) -> float:
        heading_rad = target.heading_rad
        if target.speed_mps > 0.05:
            north_mps, east_mps = self._current_ne
            cos_c, sin_c = math.cos(target.course_rad), math.sin(target.course_rad)
            along_mps = max(0.2, target.speed_mps - cos_c * north_mps - sin_c * east_mps)
            share = min(_MOST_CRAB_SHARE, _CRAB_SHARE + _CRAB_SHARE_PER_MPS * math.hypot(north_mps, east_mps))
            heading_rad -= share * math.atan2(cos_c * east_mps - sin_c * north_mps, along_mps)
        most = _TURN_RADPS * self._step_s
        turn = math.remainder(heading_rad - self._heading_rad, 2.0 * math.pi)
        self._heading_rad += min(most, max(-most, turn))
        wandering = float(self._wandering.at(at_s - self._start_s)[0])
        error = math.remainder(self._heading_rad + wandering - seen.yaw_rad, 2.0 * math.pi)
        moment = _HEADING_NM_PER_RAD * error - _HEADING_NM_PER_RADPS * seen.rates_radps[2]
        return min(_MOST_TURN_NM, max(-_MOST_TURN_NM, moment))

    def _hold_depth(self, target: Target, seen: Seen) -> float:
        if target.depth_m is None:
            self._heave_n = 0.0
            return 0.0
        error_m = target.depth_m - seen.depth_m
        if abs(error_m) < 1.0:
            self._heave_n = min(20.0, max(-20.0, self._heave_n + _DEPTH_N_PER_MS * error_m * self._step_s))
        force_n = _DEPTH_N_PER_M * error_m - _DEPTH_N_PER_MPS * seen.velocity_ned_mps[2] + self._heave_n
        return min(_MOST_HEAVE_N, max(-_MOST_HEAVE_N, force_n))


def _stick(force_n: float) -> float:
    return _STICK_STEP_N * round(force_n / _STICK_STEP_N)
