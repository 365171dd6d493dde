"""From the delays of one pulse to a direction in the body's axes, and with attitude and depth to a position."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.array import rank_of
from bluerov_slam.acoustics.position import AcousticSolution, solve_source
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.rotation import exp_so3, rotation_from_quaternion
from bluerov_slam.pipeline.acoustic_callers import Expected

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.acoustics.time_differences.result import TimeDifferences
    from bluerov_slam.pipeline.acoustic_beacon import Beacon
    from bluerov_slam.pipeline.acoustic_options import AcousticOptions
    from bluerov_slam.records import NavState

    Array = NDArray[np.float64]

# A raw record may wait this long for room on the link, and is then solved with the attitude of its own instant.
KEPT_S: Final = 60.0
KEPT_EVERY_S: Final = 0.04
# A gap in the attitude longer than this is not bridged.
LARGEST_GAP_S: Final = 0.3


@dataclass(frozen=True)
class Pose:
    """The vehicle at one instant: attitude with the covariance of its left error, depth if known."""

    measured_s: float
    rotation_ned_frd: Array
    rotation_covariance: Array
    rate_frd: Array
    depth_m: float | None
    depth_std_m: float | None
    origin_deg: tuple[float, float] | None = None
    position_ned_m: tuple[float, float, float] | None = None
    position_std_m: float = math.inf  # level, both axes together


class Poses:
    """The navigator's attitude and depth of the last minute."""

    def __init__(self) -> None:
        self._poses: deque[Pose] = deque()

    def observe(self, state: NavState) -> None:
        """Take a state; one without attitude says nothing."""
        if state.quaternion_ned_frd is None or state.pose_covariance is None:
            return
        poses = self._poses
        if poses and state.measured_s < poses[-1].measured_s + KEPT_EVERY_S:
            if state.measured_s < poses[-1].measured_s - KEPT_S:
                poses.clear()
            return
        known = state.angular_rate_frd_radps
        poses.append(
            Pose(
                state.measured_s,
                rotation_from_quaternion(np.array(state.quaternion_ned_frd)),
                np.array(state.pose_covariance[3:, 3:]),
                np.zeros(3) if known is None else np.array(known),
                state.depth_m,
                state.depth_std_m,
                state.origin_deg,
                state.position_ned_m,
                math.sqrt(max(0.0, float(state.pose_covariance[:2, :2].trace()))),
            )
        )
        while poses[0].measured_s < state.measured_s - KEPT_S:
            poses.popleft()

    def at(self, measured_s: float) -> Pose | None:
        """The nearest pose, turned on to the instant; None where there is none near it."""
        nearest = min(self._poses, key=lambda pose: abs(pose.measured_s - measured_s), default=None)
        if nearest is None:
            return None
        ahead_s = measured_s - nearest.measured_s
        if abs(ahead_s) > LARGEST_GAP_S:
            return None
        return replace(
            nearest,
            measured_s=measured_s,
            rotation_ned_frd=nearest.rotation_ned_frd @ exp_so3(nearest.rate_frd * ahead_s),
        )


@dataclass(frozen=True)
class Direction:
    """Towards the transmitter in body FRD: azimuth right positive, elevation down positive."""

    azimuth_rad: float
    elevation_rad: float
    covariance_rad2: Array


@dataclass(frozen=True)
class Placed:
    """The vehicle, by the transmitter's place. `reason` says why there is no position."""

    range_m: float | None = None
    range_std_m: float | None = None
    position_deg: tuple[float, float] | None = None
    covariance_ned_m2: Array | None = None
    reason: str = ""


def solve_direction(differences: TimeDifferences, options: AcousticOptions, sound_speed_mps: float) -> AcousticSolution:
    """From the delays alone, in the array's frame."""
    receivers = options.array.subset(differences.receivers.tolist())
    delays, covariance = differences.delays_s, differences.covariance_s2
    if len(receivers) > 4 or rank_of(receivers) < 3:
        return solve_source(receivers, delays, covariance, sound_speed_mps)
    # Four in space have one direction and one bend of the wave for any delays, and a wrong sound speed would be taken
    # for a source at arm's length, tens of degrees off.
    far = 10.0 * options.nearest_m
    found = solve_source(receivers, delays, covariance, sound_speed_mps, range_=(far, 0.3 * far))
    reason = "the delays do not fit one source" if found.reason else ""
    return replace(found, position_m=None, covariance_m2=None, reason=reason)


def direction_of(solution: AcousticSolution, options: AcousticOptions) -> Direction:
    """The direction of a solution in the array's frame, as unsure as one pulse's is however good its timing."""
    rotation = options.mounting.rotation_frd_array
    x, y, z = (rotation @ solution.direction).tolist()
    across = math.hypot(x, y)
    jacobian = np.zeros((2, 3))
    if across > 1e-9:
        jacobian[0] = (-y / across**2, x / across**2, 0.0)
        jacobian[1] = (-x * z / across, -y * z / across, across)
    across_it = np.eye(3) - np.outer(solution.direction, solution.direction)
    whole = solution.direction_covariance + options.direction_std_rad**2 * across_it
    covariance = rotation @ whole @ rotation.T
    return Direction(math.atan2(y, x), math.atan2(z, across), jacobian @ covariance @ jacobian.T)


def place(
    differences: TimeDifferences,
    solution: AcousticSolution,
    pose: Pose | None,
    beacon: Beacon | None,
    options: AcousticOptions,
    sound_speed_mps: float,
) -> Placed:
    """Where the vehicle is: attitude turns the delays into NED, the difference of the depths gives the range."""
    if pose is None:
        return Placed(*_own_range(solution), reason="no position: the attitude is not known yet")
    rotation = pose.rotation_ned_frd @ options.mounting.rotation_frd_array
    receivers = options.array.subset(differences.receivers.tolist()) @ rotation.T
    direction = rotation @ solution.direction
    # An error of the attitude, and what turns one pulse's direction, act on the delays like errors of measurement.
    by_turn = np.cross(receivers[1:] - receivers[0], direction) / sound_speed_mps
    turned = pose.rotation_covariance + options.direction_std_rad**2 * np.eye(3)
    covariance = differences.covariance_s2 + by_turn @ turned @ by_turn.T
    depth = _depth_below(pose, beacon, options)
    found = solve_source(
        receivers,
        differences.delays_s,
        covariance,
        sound_speed_mps,
        depth=depth,
        start=direction if solution.position_m is None else rotation @ solution.position_m,
        front=rotation[:, 0],
    )
    if found.position_m is None or found.covariance_m2 is None:
        return Placed(*_own_range(solution), reason=f"no position: {_why(found, depth, beacon)}")
    range_m = float(np.linalg.norm(found.position_m))
    ahead = found.position_m / range_m
    range_std_m = math.sqrt(float(ahead @ found.covariance_m2 @ ahead))
    if beacon is None:
        return Placed(range_m, range_std_m, reason=NO_BEACON)
    north_m, east_m, _ = -found.position_m - pose.rotation_ned_frd @ options.mounting.lever_arm_frd_m
    latitude_deg, longitude_deg, _ = LocalFrame(beacon.latitude_deg, beacon.longitude_deg).to_geodetic(
        float(north_m), float(east_m)
    )
    own = np.diag((beacon.std_m**2, beacon.std_m**2, 0.0))
    covariance = found.covariance_m2 + own
    return Placed(range_m, range_std_m, (latitude_deg, longitude_deg), covariance)


def expected_of(pose: Pose, beacon: Beacon | None, options: AcousticOptions) -> Expected | None:
    """Where the transmitter should be by what the navigator holds of the vehicle; None where that is not known."""
    if beacon is None or beacon.depth_m is None or pose.origin_deg is None or pose.position_ned_m is None:
        return None
    north_m, east_m, _ = LocalFrame(*pose.origin_deg).to_ned_m(beacon.latitude_deg, beacon.longitude_deg)
    depth_m = pose.position_ned_m[2] if pose.depth_m is None else pose.depth_m
    array_m = np.array((*pose.position_ned_m[:2], depth_m)) + pose.rotation_ned_frd @ options.mounting.lever_arm_frd_m
    way_m = np.array((north_m, east_m, beacon.depth_m)) - array_m
    range_m = float(np.linalg.norm(way_m))
    if range_m < options.nearest_m:
        return None
    place = (pose.position_std_m**2 + beacon.std_m**2) / range_m**2
    std_rad = math.sqrt(place + max(0.0, float(pose.rotation_covariance.trace())) + options.direction_std_rad**2)
    return Expected(way_m / range_m, std_rad)


NO_BEACON: Final = "no position: the transmitter's place is not known; set acoustics.beacon"


def _own_range(solution: AcousticSolution) -> tuple[float | None, float | None]:
    """What five receivers or more tell by the curvature of the wave."""
    if solution.position_m is None or solution.covariance_m2 is None:
        return None, None
    range_m = float(np.linalg.norm(solution.position_m))
    ahead = solution.position_m / range_m
    return range_m, math.sqrt(float(ahead @ solution.covariance_m2 @ ahead))


def _depth_below(pose: Pose, beacon: Beacon | None, options: AcousticOptions) -> tuple[float, float] | None:
    """How far the transmitter lies below the array's centre, and how sure that is."""
    beacon_depth_m = options.beacon_depth_m if beacon is None else beacon.depth_m
    if pose.depth_m is None or pose.depth_std_m is None or beacon_depth_m is None:
        return None
    array_depth_m = pose.depth_m + float((pose.rotation_ned_frd @ options.mounting.lever_arm_frd_m)[2])
    return beacon_depth_m - array_depth_m, math.hypot(pose.depth_std_m, options.beacon_depth_std_m)


def _why(found: AcousticSolution, depth: tuple[float, float] | None, beacon: Beacon | None) -> str:
    if found.reason and found.converged:
        return found.reason
    if depth is not None:
        return "the range cannot be told at this elevation"
    if beacon is None or beacon.depth_m is None:
        return "the transmitter's depth is not known; set acoustics.beacon_depth_m"
    return "the vehicle's depth is not known"
