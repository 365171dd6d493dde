import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.quaternion import Quaternion
from pymavlink.rotmat import Matrix3, Vector3

from bluerov_slam.protocol import mavlink_navigation as nav
from bluerov_slam.records import NavMode, NavState

ROLL, PITCH, YAW = 0.2, -0.35, 2.1


def covariance(seed: int, size: int, scale: float) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(size, size)) * scale
    return root @ root.T


def nav_state(**changes: object) -> NavState:
    pose = covariance(1, 6, 0.02)
    pose[:3, :3] += np.diag([4.0, 1.0, 0.04])
    quaternion = tuple(float(q) for q in Quaternion([ROLL, PITCH, YAW]).q)
    state = NavState(
        measured_s=1234.567891, arrived_s=1234.6, mode=NavMode.AIDED, origin_deg=(54.0, 10.0),
        position_ned_m=(12.0, -7.5, 3.25), velocity_ned_mps=(0.6, -0.2, 0.1), quaternion_ned_frd=quaternion,
        angular_rate_frd_radps=(0.01, -0.02, 0.03), pose_covariance=pose,
        velocity_covariance_m2ps2=covariance(2, 3, 0.1), depth_m=3.25, depth_std_m=0.05, altitude_m=None,
        current_ne_mps=None, current_std_mps=None, last_fix_s=1234.0, distance_m=10.0, reset_counter=3,
    )  # fmt: skip
    return replace(state, **changes)


def sent(state: NavState, **options: object) -> mavlink.MAVLink_odometry_message:
    """The message as whoever receives its bytes sees it."""
    fields = nav.odometry_fields(state, max_std_m=10.0, **options)
    packed = mavlink.MAVLink_odometry_message(**fields).pack(mavlink.MAVLink(None, 1, 197))
    (message,) = mavlink.MAVLink(None).parse_buffer(bytearray(packed))
    return message


def full(triangle: list[float]) -> np.ndarray:
    """A symmetric 6 x 6 matrix from the first six, next five, next four... elements: the message's own definition."""
    values = iter(triangle)
    matrix = np.zeros((6, 6))
    for row in range(6):
        for column in range(row, 6):
            matrix[row, column] = matrix[column, row] = next(values)
    return matrix


def as_array(matrix: Matrix3) -> np.ndarray:
    return np.array([[row.x, row.y, row.z] for row in (matrix.a, matrix.b, matrix.c)])


def test_frames_are_those_that_ardupilot_takes():
    message = sent(nav_state())
    assert message.frame_id == mavlink.MAV_FRAME_LOCAL_FRD
    assert message.child_frame_id == mavlink.MAV_FRAME_BODY_FRD
    assert message.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_GPS_INS
    assert message.time_usec == 1234567891
    assert message.reset_counter == 3


def test_position_is_north_east_down_of_the_autopilots_origin():
    message = sent(nav_state(), offset_ned_m=(100.0, -50.0, 0.0), resets=254)
    assert (message.x, message.y, message.z) == pytest.approx((112.0, -57.5, 3.25))
    assert message.reset_counter == 1


def test_the_autopilot_finds_our_velocity_again_with_our_quaternion():
    """As ArduPilot does it: the quaternion turns the velocity of the message to north, east, down."""
    message = sent(nav_state())
    quaternion = Quaternion(list(message.q))
    velocity_ned = as_array(quaternion.dcm) @ np.array([message.vx, message.vy, message.vz])
    assert velocity_ned == pytest.approx((0.6, -0.2, 0.1), abs=1e-6)
    assert quaternion.euler == pytest.approx((ROLL, PITCH, YAW), abs=1e-6)
    assert (message.rollspeed, message.pitchspeed, message.yawspeed) == pytest.approx((0.01, -0.02, 0.03))


def test_velocity_covariance_turned_back_is_ours():
    state = nav_state()
    matrix = full(sent(state).velocity_covariance)
    dcm = as_array(Quaternion(list(state.quaternion_ned_frd)).dcm)
    assert dcm @ matrix[:3, :3] @ dcm.T == pytest.approx(state.velocity_covariance_m2ps2, rel=1e-5, abs=1e-9)
    assert np.isnan(matrix[3:, :]).all(), "errors of the turn rates are not stated"


def test_pose_covariance_is_what_drawn_errors_show():
    """By drawing: poses scattered as the state says have the message's covariance in x, y, z, roll, pitch, yaw."""
    state = nav_state()
    random = np.random.default_rng(7)
    draws = random.multivariate_normal(np.zeros(6), state.pose_covariance, size=40_000)
    estimate = Quaternion(list(state.quaternion_ned_frd)).dcm
    angles = np.empty((len(draws), 3))
    for index, error in enumerate(draws[:, 3:]):
        angle = float(np.linalg.norm(error))
        axis = error / angle
        turn = Matrix3()
        turn.from_axis_angle(Vector3(*map(float, axis)), angle)
        angles[index] = (turn * estimate).to_euler()
    sample = np.cov(np.hstack([draws[:, :3], angles]).T)
    matrix = full(sent(state).pose_covariance)
    scale = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
    assert np.abs(sample - matrix).max() > 0.0
    assert (np.abs(sample - matrix) / scale).max() < 0.03


def test_ardupilots_reading_of_the_covariance_is_a_number():
    """It takes the diagonal from places 0, 6, 11 and 15, 18, 20 as soon as the first one is a number."""
    message = sent(nav_state())
    variances = [message.pose_covariance[place] for place in (0, 6, 11, 15, 18, 20)]
    assert all(math.isfinite(value) and value > 0.0 for value in variances)
    assert variances[:3] == pytest.approx(np.diag(nav_state().pose_covariance)[:3], rel=1e-5)


@pytest.mark.parametrize("pitch", [math.radians(89.0), math.radians(-85.0)])
def test_standing_on_end_the_whole_pose_covariance_is_unknown(pitch):
    quaternion = tuple(float(q) for q in Quaternion([0.1, pitch, 1.0]).q)
    assert all(map(math.isnan, sent(nav_state(quaternion_ned_frd=quaternion)).pose_covariance))


def test_a_covariance_with_a_hole_is_unknown_as_a_whole():
    pose = nav_state().pose_covariance.copy()
    pose[5, 5] = math.nan
    assert math.isnan(sent(nav_state(pose_covariance=pose)).pose_covariance[0])
    assert math.isnan(sent(nav_state(velocity_covariance_m2ps2=None)).velocity_covariance[0])


@pytest.mark.parametrize(
    "changes",
    [
        {"position_ned_m": None},
        {"velocity_ned_mps": None},
        {"quaternion_ned_frd": None},
        {"pose_covariance": None},
        {"velocity_ned_mps": (math.nan, 0.0, 0.0)},
        {"position_ned_m": (math.inf, 0.0, 0.0)},
        {"pose_covariance": np.full((6, 6), math.nan)},
    ],
)
def test_nothing_is_sent_of_a_pose_that_is_not_known(changes):
    assert nav.odometry_fields(nav_state(**changes), max_std_m=10.0) is None


def test_unknown_turn_rates_are_not_a_number():
    assert math.isnan(sent(nav_state(angular_rate_frd_radps=None)).yawspeed)


@pytest.mark.parametrize(("std_m", "percent"), [(0.0, 100), (2.5, 75), (9.99, 1), (25.0, 1)])
def test_quality_falls_with_the_uncertainty(std_m, percent):
    assert nav.quality_percent(std_m, 10.0) == percent


def gps_input(**changes: object) -> dict[str, object]:
    fields = {"fix_type": 3, "hdop": 1.0, "lat": 543219876, "lon": 101356789, "ignore_flags": 0, "horiz_accuracy": 1.5}
    return fields | changes


def test_gps_input_becomes_a_position_fix():
    fix = nav.position_fix(gps_input(), 5.0)
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((54.3219876, 10.1356789))
    assert fix.covariance_ne_m2 == pytest.approx((2.25, 0.0, 2.25))
    assert nav.position_fix(gps_input(ignore_flags=1 << 6), 5.0).covariance_ne_m2 is None
    assert nav.position_fix(gps_input(horiz_accuracy=0.0), 5.0).covariance_ne_m2 is None


@pytest.mark.parametrize(
    "changes", [{"hdop": 99.99}, {"hdop": math.nan}, {"fix_type": 1}, {"lat": 0, "lon": 0}, {"lat": 910000000}]
)
def test_what_is_no_fix_becomes_none(changes):
    assert nav.position_fix(gps_input(**changes), 5.0) is None


@pytest.mark.parametrize("value", ["VISO_TYPE", b"VISO_TYPE\0\0\0", list("VISO_TYPE") + ["\0"] * 7])
def test_parameter_names_come_in_three_shapes(value):
    assert nav.parameter_name(value) == "VISO_TYPE"
