"""Every sensor: its Jacobian against finite differences, its residual against the truth, its frames and signs."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bluerov_slam.navigation.measurements import (
    BlockValue,
    CompassHeading,
    Depth,
    GravityDirection,
    GroundVelocity,
    HorizontalPosition,
    HorizontalVelocity,
    MagneticField,
    SensorAngles,
    WaterVelocity,
    ZeroRate,
    ZeroVelocity,
)
from bluerov_slam.navigation.process import Earth
from bluerov_slam.navigation.rotation import euler_from_rotation, rotation_from_euler
from bluerov_slam.navigation.state import NavEstimate, StateLayout
from navigation.finite_differences import derivative, random_estimate, seeds

FULL = StateLayout.make(extra=(("isbl_mounting", 3), ("thruster_field", 2)))
BARE = StateLayout.make(without=[name for name, _ in StateLayout.make().blocks[3:]])
GRAVITY = 9.81
LEVER = (0.3, -0.2, 0.15)
RATE = np.array([0.2, -0.3, 0.4])
DECLINATION = 0.07
DIP = 1.2


def value(estimate: NavEstimate, name: str) -> np.ndarray:
    return estimate.block(name) if name in estimate.layout else np.zeros(dict(FULL.blocks)[name])


def heading_of(estimate: NavEstimate) -> float:
    return euler_from_rotation(estimate.rotation_ned_frd)[2]


def deviation_of(estimate: NavEstimate) -> float:
    a, b, c = value(estimate, "compass")
    heading = heading_of(estimate)
    return float(a + b * math.cos(heading) + c * math.sin(heading) + value(estimate, "compass_wander")[0])


def true_rate(estimate: NavEstimate) -> np.ndarray:
    return RATE - value(estimate, "gyro_bias")


# What each sensor would read, without noise, if the estimate given were the truth: written anew, from the contract.
def gps(truth: NavEstimate) -> HorizontalPosition:
    antenna = truth.position_ned_m + truth.rotation_ned_frd @ LEVER
    north, east = antenna[:2] + value(truth, "gps_wander")
    return HorizontalPosition(1.0, north, east, np.eye(2), lever_arm_frd_m=LEVER)


def external(truth: NavEstimate) -> HorizontalPosition:
    beacon = truth.position_ned_m + truth.rotation_ned_frd @ LEVER
    covariance = np.array([[2.0, 0.5], [0.5, 1.0]])
    return HorizontalPosition(1.0, beacon[0], beacon[1], covariance, "position", LEVER, wanders=False)


def gps_velocity(truth: NavEstimate) -> HorizontalVelocity:
    antenna = truth.velocity_ned_mps + truth.rotation_ned_frd @ np.cross(true_rate(truth), LEVER)
    return HorizontalVelocity(1.0, antenna[0], antenna[1], np.eye(2), "gps", LEVER, RATE)


def depth(truth: NavEstimate) -> Depth:
    sensor = truth.position_ned_m + truth.rotation_ned_frd @ LEVER
    return Depth(1.0, float(sensor[2] + value(truth, "depth_bias")[0]), 0.02, lever_arm_frd_m=LEVER)


def compass(truth: NavEstimate) -> CompassHeading:
    return CompassHeading(1.0, heading_of(truth) + deviation_of(truth) + math.tau, 0.03)


def field(truth: NavEstimate) -> MagneticField:
    level = math.cos(DIP)
    heading, load = heading_of(truth), 0.4
    by_cosine, by_sine = load * value(truth, "thruster_field")
    thrusters = by_cosine * math.cos(heading) + by_sine * math.sin(heading)
    turned = DECLINATION - deviation_of(truth) - thrusters
    field_ned = np.array([level * math.cos(turned), level * math.sin(turned), math.sin(DIP)])
    field_frd = 48.0 * truth.rotation_ned_frd.T @ field_ned
    return MagneticField(1.0, field_frd, DECLINATION, 0.03, thruster_load=load)


def gravity(truth: NavEstimate) -> GravityDirection:
    acceleration = np.array([0.1, 0.2, -0.1])
    at_rest = truth.rotation_ned_frd.T @ np.array([0.0, 0.0, -GRAVITY])
    force = at_rest + acceleration + value(truth, "accel_bias")
    return GravityDirection(1.0, force, GRAVITY, acceleration_frd_mps2=acceleration)


def angles(truth: NavEstimate) -> SensorAngles:
    roll, pitch, heading = euler_from_rotation(truth.rotation_ned_frd)
    return SensorAngles(1.0, roll, pitch, heading + deviation_of(truth), 0.005)


def tilt(truth: NavEstimate) -> SensorAngles:
    roll, pitch, _ = euler_from_rotation(truth.rotation_ned_frd)
    return SensorAngles(1.0, roll, pitch, None, 0.005)


def thrust(truth: NavEstimate) -> WaterVelocity:
    water_ned = truth.velocity_ned_mps - np.append(value(truth, "current"), 0.0)
    water_frd = truth.rotation_ned_frd.T @ water_ned
    water_frd[:2] /= 1.0 + value(truth, "thrust_scale")
    return WaterVelocity(1.0, water_frd, (0.05, 0.06, 0.07))


def surge_and_sway(truth: NavEstimate) -> WaterVelocity:
    return WaterVelocity(1.0, np.asarray(thrust(truth).velocity_frd_mps)[:2], 0.05)


def steady_thrust(truth: NavEstimate) -> WaterVelocity:
    """The steady part is the velocity itself here, else the Jacobian would not be the derivative: that is its point."""
    velocity = np.asarray(thrust(truth).velocity_frd_mps)
    return WaterVelocity(1.0, velocity, 0.05, steady_frd_mps=velocity[:2])


def dvl(truth: NavEstimate) -> GroundVelocity:
    body = truth.rotation_ned_frd.T @ truth.velocity_ned_mps + np.cross(true_rate(truth), LEVER)
    scale, yaw = value(truth, "dvl")
    instrument = (1.0 + scale) * rotation_from_euler(0.0, 0.0, float(yaw)).T @ body
    return GroundVelocity(1.0, instrument, np.diag((1e-4, 1e-4, 2e-4)), RATE, LEVER)


def no_motion(truth: NavEstimate) -> ZeroVelocity:
    return ZeroVelocity(1.0)


def no_turn(truth: NavEstimate) -> ZeroRate:
    seen = truth.rotation_ned_frd.T @ Earth(60.0).rate_ned_radps + value(truth, "gyro_bias")
    return ZeroRate(1.0, seen, latitude_deg=60.0)


def known_current(truth: NavEstimate) -> BlockValue:
    return BlockValue(1.0, "current", value(truth, "current").copy(), np.eye(2))


SENSORS: dict[str, Callable[[NavEstimate], object]] = {
    function.__name__: function
    for function in (
        gps, external, gps_velocity, depth, compass, field, gravity, angles, tilt, thrust, surge_and_sway,
        steady_thrust, dvl,
        no_motion, no_turn, known_current,
    )
}  # fmt: skip
NEEDS = {"no_turn": "gyro_bias", "known_current": "current"}


@pytest.mark.parametrize("layout", [FULL, BARE], ids=["full", "bare"])
@pytest.mark.parametrize("name", SENSORS)
@given(seed=seeds, apart=st.sampled_from([0.0, 0.05, 0.3]))
def test_jacobian_is_the_derivative_of_the_prediction(name, layout, seed, apart):
    """Also where the estimate is far from what the sensor says: `apart` in every unit."""
    truth = random_estimate(layout, seed)
    estimate = truth.copy()
    estimate.add_error(apart * np.random.default_rng(seed + 1).uniform(-1.0, 1.0, layout.size))
    assume(estimate.rotation_ned_frd[2, 0] ** 2 < 0.95)
    measurement = SENSORS[name](truth)

    def residual(at: NavEstimate) -> np.ndarray:
        innovation = measurement.evaluate(at, layout)
        assert innovation is not None
        return innovation.residual

    innovation = measurement.evaluate(estimate, layout)
    if NEEDS.get(name, "position") not in layout:
        assert innovation is None
        return
    # Levelled by an attitude that is off by 0.3 rad twice, a field of 69 deg dip may stand upright: no heading then.
    assume(innovation is not None or name != "field")
    assume(np.abs(innovation.residual).max() < 3.0 or name in ("gps", "external"))
    expected = -derivative(residual, estimate)
    scale = 1.0 + np.abs(expected).max()
    np.testing.assert_allclose(innovation.jacobian / scale, expected / scale, atol=3e-8)
    assert innovation.noise.shape == (len(innovation.residual),) * 2


@pytest.mark.parametrize("layout", [FULL, BARE], ids=["full", "bare"])
@pytest.mark.parametrize("name", sorted(set(SENSORS) - {"no_motion"}))
@given(seed=seeds)
def test_the_truth_leaves_no_residual(name, layout, seed):
    truth = random_estimate(layout, seed)
    assume(truth.rotation_ned_frd[2, 0] ** 2 < 0.95)
    innovation = SENSORS[name](truth).evaluate(truth, layout)
    if NEEDS.get(name, "position") in layout:
        np.testing.assert_allclose(innovation.residual, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", sorted(set(SENSORS) - {"no_motion"}))
@given(seed=seeds)
def test_the_jacobian_explains_the_residual_of_a_small_error(name, seed):
    """measured - predicted = H error: the sign that the filter relies on."""
    truth = random_estimate(FULL, seed)
    assume(truth.rotation_ned_frd[2, 0] ** 2 < 0.9)
    error = 1e-5 * np.random.default_rng(seed + 1).uniform(-1.0, 1.0, FULL.size)
    estimate = truth.copy()
    estimate.add_error(-error)
    innovation = SENSORS[name](truth).evaluate(estimate, FULL)
    np.testing.assert_allclose(innovation.residual, innovation.jacobian @ error, atol=1e-8)


def test_standing_still_shows_the_velocity():
    estimate = NavEstimate(FULL, 0.0, velocity=(0.1, -0.2, 0.3))
    np.testing.assert_allclose(ZeroVelocity(0.0).evaluate(estimate, FULL).residual, (-0.1, 0.2, -0.3))


def test_a_heading_means_nothing_with_the_bow_straight_down():
    estimate = NavEstimate(FULL, 0.0, rotation_from_euler(0.0, -1.5, 0.3))
    assert compass(estimate).evaluate(estimate, FULL) is None
    assert MagneticField(0.0, (1.0, 0.0, 0.0), 0.0, 0.1).evaluate(estimate, FULL) is None
    assert len(angles(estimate).evaluate(estimate, FULL).residual) == 2


def test_a_vertical_field_has_no_heading():
    estimate = NavEstimate(FULL, 0.0)
    assert MagneticField(0.0, (0.01, 0.0, 1.0), 0.0, 0.1).evaluate(estimate, FULL) is None
    assert MagneticField(0.0, (math.nan, 0.0, 1.0), 0.0, 0.1).evaluate(estimate, FULL) is None


def test_gravity_counts_for_less_the_more_the_vehicle_accelerates():
    estimate = NavEstimate(FULL, 0.0)
    still = GravityDirection(0.0, (0.0, 0.0, -GRAVITY), GRAVITY).evaluate(estimate, FULL)
    shaken = GravityDirection(0.0, (0.0, 0.0, -GRAVITY - 1.0), GRAVITY).evaluate(estimate, FULL)
    assert still.noise[0, 0] == pytest.approx(0.3**2)
    assert shaken.noise[0, 0] == pytest.approx(2.3**2)


def test_a_compass_error_of_roll_reaches_the_heading_through_the_dip():
    """Facing north at a dip of 69 deg a roll error of 1 deg is a heading error of 2.6 deg: tan(dip)."""
    estimate = NavEstimate(FULL, 0.0)
    by_roll = field(estimate).evaluate(estimate, FULL).jacobian[0, 6]
    assert by_roll == pytest.approx(-math.tan(DIP) * math.cos(DECLINATION))
    assert compass(estimate).evaluate(estimate, FULL).jacobian[0, 6] == 0.0


def test_a_dvls_scale_and_yaw_are_learned_from_the_steady_part():
    estimate = NavEstimate(FULL, 0.0, velocity=(0.9, 0.2, 0.0), dvl=(0.25, 0.0))
    measured = GroundVelocity(0.0, (0.5, 0.1, 0.0), np.eye(3), steady_frd_mps=(0.5, 0.25))
    by_dvl = measured.evaluate(estimate, FULL).jacobian[:, FULL["dvl"]]
    np.testing.assert_allclose(by_dvl, [[0.4, 0.25], [0.2, -0.5], [0.0, 0.0]])


def test_the_thrusts_scale_is_learned_from_the_steady_part():
    estimate = NavEstimate(FULL, 0.0)
    innovation = WaterVelocity(0.0, (0.5, 0.1), 0.05, steady_frd_mps=(0.4, 0.0)).evaluate(estimate, FULL)
    np.testing.assert_array_equal(innovation.jacobian[:, FULL["thrust_scale"]], [[-0.4, 0.0], [0.0, 0.0]])


def test_a_dvl_mounted_to_starboard_sees_a_forward_run_to_port():
    estimate = NavEstimate(FULL, 0.0, velocity=(1.0, 0.0, 0.0), dvl=(0.0, 0.1))
    predicted = -GroundVelocity(0.0, (0.0, 0.0, 0.0), np.eye(3)).evaluate(estimate, FULL).residual
    np.testing.assert_allclose(predicted, (math.cos(0.1), -math.sin(0.1), 0.0))
