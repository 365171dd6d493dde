"""The bound of a simulated dive: linearised about what the vehicle really did, with the noise it really had.

Left out because it only makes the true problem harder: tilt errors in the compass, the thrusters' field,
the tether, gyro scale, the worse first fixes after surfacing, gaps of the DVL. Left out because it helps less than a
hundredth: the accelerometers, which smooth noise that adds a few metres to tens. The compass is heading only: the
strength of the field, which knows of hard iron too, is not used. GPS is its positions only: speed and course, which the
navigator uses as well, would lower the bound of the surface run.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.bounds import Bound, Fixes, Gyro, Track, Uncertainty, bound
from bluerov_slam.simulation import instrument_errors, virtual_autopilot
from bluerov_slam.simulation.conditions import conditions_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bluerov_slam.simulation.dive import DiveTruth, TrueTrack
    from bluerov_slam.simulation.dive_plan import DivePlan

_STEP_S = 1.0
_BOUND_EVERY = 10
_SWAY_SHARE = 0.5  # of the thrust scale's spread: docs/navigation.md section 4
_GPS_CORRELATION_S = 60.0
# The gyro's white noise and a resolution of 0.061 deg/s, both at 20 Hz; the heading that 20 samples of the
# magnetometer give in a second.
GYRO = Gyro(
    noise_rad_rt_s=math.hypot(instrument_errors.GYRO_WHITE_RADPS, math.radians(0.061) / math.sqrt(12.0))
    * math.sqrt(0.05),
    bias_radps=math.radians(0.15),
    bias_walk_radps_rt_s=math.radians(15.0 / 3600.0) * math.sqrt(2.0 / 300.0),
    compass_noise_rad=math.radians(0.05),
)


def dive_bound(plan: DivePlan, truth: DiveTruth, fixes_at_s: Sequence[float]) -> Bound:
    """Every tenth second of the track and its end. `fixes_at_s`: when the receiver had a position."""
    times = np.arange(truth.start_s, truth.end_s + 1e-9, _STEP_S)
    track = true_track(truth.track(times), truth.track(times[:-1] + 0.5 * _STEP_S), over_ground=plan.dvl)
    steps = sorted({round((at_s - truth.start_s) / _STEP_S) for at_s in fixes_at_s if at_s <= times[-1]})
    fixes = Fixes(steps, instrument_errors.GPS_WHITE_M, instrument_errors.GPS_WANDER_M, _GPS_CORRELATION_S)
    first = round((truth.track_start_s - truth.start_s) / _STEP_S)
    epochs = np.unique(np.append(np.arange(first, track.steps + 1, _BOUND_EVERY), track.steps))
    return bound(track, uncertainty_of(plan), fixes, gyro=GYRO, epochs=epochs)


def uncertainty_of(plan: DivePlan) -> Uncertainty:
    """What a vehicle of this plan is drawn from, in the nominal family."""
    conditions = conditions_of(plan.conditions)
    water = Uncertainty(
        conditions.current_std_mps,
        conditions.current_walk_mps_per_root_s,
        conditions.speed_scale_std,
        conditions.compass_total_rad,
        conditions.compass_wander_rad,
        odometry_mps_rt_s=conditions.unmodelled_velocity_m_per_root_s,
        slip_share=0.0,
        sway_share=_SWAY_SHARE,
        mounting_rad=virtual_autopilot.DVL_MOUNTING_STD_RAD if plan.dvl else 0.0,
    )
    if not plan.dvl:
        return water
    noise = virtual_autopilot.DVL_NOISE_MPS * math.sqrt(virtual_autopilot.DVL_INTERVAL_S)
    return water.with_dvl(noise, virtual_autopilot.DVL_SCALE_STD)


def true_track(at: TrueTrack, between: TrueTrack, over_ground: bool) -> Track:
    """The track a bound is linearised about: positions at the steps, velocities in the middle between them."""
    heading = np.arctan2(between.rotation_ned_frd[:, 1, 0], between.rotation_ned_frd[:, 0, 0])
    velocity_ned = between.velocity_ned_mps
    if not over_ground:
        velocity_ned = np.einsum("nij,nj->ni", between.rotation_ned_frd, between.water_velocity_frd_mps)
    velocity = _level(velocity_ned, heading)
    return Track(_STEP_S, at.position_ned_m[:, :2], heading, velocity[:, 0], velocity[:, 1])


def _level(velocity_ned_mps: NDArray[np.float64], heading_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Forward and to starboard in the horizontal plane."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    north, east = velocity_ned_mps[:, 0], velocity_ned_mps[:, 1]
    return np.column_stack((cos * north + sin * east, cos * east - sin * north))
