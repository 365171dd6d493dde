"""The navigator's messages: ODOMETRY and the origin to the autopilot, GPS_INPUT and parameters from the vehicle. Pure.

What ArduPilot makes of ODOMETRY (its GCS_MAVLINK::handle_odometry and AP_VisualOdom): any frames but
MAV_FRAME_LOCAL_FRD for the pose and MAV_FRAME_BODY_FRD for the velocity are dropped without a word. The MAVLink
backend (VISO_TYPE 1) takes the position as metres north, east, down of the EKF's own origin, and turns the velocity to
NED with our quaternion. From the pose covariance it reads the diagonal, if the first element is a number: so either the
whole diagonal is known, or the first element is NaN. A velocity with a NaN in it is left out by the EKF. After 0.3 s
without a message the source counts as lost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.protocol.navigation_json import euler_angles_rad
from bluerov_slam.records import NavState, PositionFix

if TYPE_CHECKING:
    from numpy.typing import NDArray

Fields = dict[str, Any]
Vector = tuple[float, float, float]

MAV_FRAME_BODY_FRD = 12
MAV_FRAME_LOCAL_FRD = 20
MAV_ESTIMATOR_TYPE_GPS_INS = 5
MAV_CMD_REQUEST_MESSAGE = 512
GPS_GLOBAL_ORIGIN_ID = 49
NAN = float("nan")
# Roll and yaw cannot be told apart beyond this: their errors are not stated there.
STEEPEST_PITCH_RAD = math.radians(80.0)
FIX_2D = 2
# What positioning systems send for "no idea" is 99.99.
HDOP_NONE = 99.0
IGNORE_HORIZONTAL_ACCURACY = 1 << 6
_DEGREES_PER_UNIT = 1e-7
_UPPER = tuple((row, column) for row in range(6) for column in range(row, 6))


def odometry_fields(
    state: NavState, *, max_std_m: float, offset_ned_m: Vector = (0.0, 0.0, 0.0), resets: int = 0
) -> Fields | None:
    """ODOMETRY (331) of a state whose position, velocity and attitude are known, else None.

    Args:
        max_std_m: the horizontal uncertainty at which quality is down to 1 %.
        offset_ned_m: our origin as seen from the autopilot's.
        resets: jumps beyond the state's own, such as a change of that offset.
    """
    position, velocity, quaternion = state.position_ned_m, state.velocity_ned_mps, state.quaternion_ned_frd
    std_m = horizontal_std_m(state.pose_covariance)
    if position is None or velocity is None or quaternion is None or std_m is None:
        return None
    if not all(map(math.isfinite, (*position, *velocity, *quaternion, *offset_ned_m))):
        return None
    rotation_ned_frd = rotation_of(quaternion)
    velocity_frd_mps = rotation_ned_frd.T @ np.asarray(velocity)
    rates = state.angular_rate_frd_radps or (NAN, NAN, NAN)
    return {
        "time_usec": int(state.measured_s * 1e6),
        "frame_id": MAV_FRAME_LOCAL_FRD,
        "child_frame_id": MAV_FRAME_BODY_FRD,
        "x": position[0] + offset_ned_m[0],
        "y": position[1] + offset_ned_m[1],
        "z": position[2] + offset_ned_m[2],
        "q": list(quaternion),
        "vx": float(velocity_frd_mps[0]),
        "vy": float(velocity_frd_mps[1]),
        "vz": float(velocity_frd_mps[2]),
        "rollspeed": rates[0],
        "pitchspeed": rates[1],
        "yawspeed": rates[2],
        "pose_covariance": _pose_covariance(state.pose_covariance, quaternion),
        "velocity_covariance": _velocity_covariance(state.velocity_covariance_m2ps2, rotation_ned_frd),
        "reset_counter": (state.reset_counter + resets) % 256,
        "estimator_type": MAV_ESTIMATOR_TYPE_GPS_INS,
        "quality": quality_percent(std_m, max_std_m),
    }


def quality_percent(std_m: float, max_std_m: float) -> int:
    """100 for a position without error, 1 at the limit and beyond."""
    return max(1, min(100, round(100.0 * (1.0 - std_m / max_std_m))))


def horizontal_std_m(pose_covariance: NDArray[np.float64] | None) -> float | None:
    """The larger standard deviation of the horizontal position, None while it is unknown."""
    if pose_covariance is None:
        return None
    nn, ee, ne = float(pose_covariance[0, 0]), float(pose_covariance[1, 1]), float(pose_covariance[0, 1])
    larger = (nn + ee) / 2.0 + math.hypot((nn - ee) / 2.0, ne)
    return math.sqrt(larger) if math.isfinite(larger) and larger >= 0.0 else None


def rotation_of(quaternion_wxyz: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """The rotation matrix of a unit quaternion: v_ned = R v_frd."""
    w, x, y, z = quaternion_wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def euler_error_jacobian(quaternion_wxyz: tuple[float, float, float, float]) -> NDArray[np.float64] | None:
    """From a small rotation about north, east, down to errors of roll, pitch, yaw; None when the vehicle stands on end.

    Inverse of the rates' relation: rotation = roll' (cos yaw cos pitch, sin yaw cos pitch, -sin pitch)
    + pitch' (-sin yaw, cos yaw, 0) + yaw' (0, 0, 1).
    """
    _, pitch, yaw = euler_angles_rad(quaternion_wxyz)
    if abs(pitch) > STEEPEST_PITCH_RAD:
        return None
    c, s, secant, tangent = math.cos(yaw), math.sin(yaw), 1.0 / math.cos(pitch), math.tan(pitch)
    return np.array([[c * secant, s * secant, 0.0], [-s, c, 0.0], [c * tangent, s * tangent, 1.0]])


def set_origin_fields(system_id: int, latitude_deg: float, longitude_deg: float, time_us: int) -> Fields:
    """SET_GPS_GLOBAL_ORIGIN (48) at sea level: heights above it are not ours to tell."""
    return {
        "target_system": system_id,
        "latitude": round(latitude_deg / _DEGREES_PER_UNIT),
        "longitude": round(longitude_deg / _DEGREES_PER_UNIT),
        "altitude": 0,
        "time_usec": time_us,
    }


def ask_origin_fields(system_id: int, component_id: int) -> Fields:
    """COMMAND_LONG (76): send GPS_GLOBAL_ORIGIN, please."""
    return {
        "target_system": system_id,
        "target_component": component_id,
        "command": MAV_CMD_REQUEST_MESSAGE,
        "confirmation": 0,
        "param1": float(GPS_GLOBAL_ORIGIN_ID),
        **{f"param{i}": 0.0 for i in range(2, 8)},
    }


def origin_deg(fields: Mapping[str, Any]) -> tuple[float, float] | None:
    """Where GPS_GLOBAL_ORIGIN (49) puts the autopilot's origin."""
    latitude_deg = int(fields["latitude"]) * _DEGREES_PER_UNIT
    longitude_deg = int(fields["longitude"]) * _DEGREES_PER_UNIT
    nowhere = latitude_deg == 0.0 and longitude_deg == 0.0
    return None if nowhere or abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0 else (latitude_deg, longitude_deg)


def position_fix(fields: Mapping[str, Any], arrived_s: float) -> PositionFix | None:
    """GPS_INPUT (232) as an outside position; None without a fix, or for one at 0, 0."""
    hdop = float(fields["hdop"])
    if int(fields["fix_type"]) < FIX_2D or not hdop < HDOP_NONE:
        return None
    latitude_deg, longitude_deg = (int(fields[key]) * _DEGREES_PER_UNIT for key in ("lat", "lon"))
    if (latitude_deg == 0.0 and longitude_deg == 0.0) or abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0:
        return None
    stated = not int(fields["ignore_flags"]) & IGNORE_HORIZONTAL_ACCURACY
    variance_m2 = float(fields["horiz_accuracy"]) ** 2 if stated else 0.0
    covariance = (variance_m2, 0.0, variance_m2) if math.isfinite(variance_m2) and variance_m2 > 0.0 else None
    return PositionFix(arrived_s, arrived_s, "gps_input", latitude_deg, longitude_deg, covariance)


def parameter_name(value: object) -> str:
    """`param_id` as text: pymavlink gives text or bytes, mavlink2rest a list of characters."""
    if isinstance(value, bytes):
        value = value.decode("ascii", "replace")
    text = "".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
    return text.split("\0", 1)[0]


def _pose_covariance(
    covariance: NDArray[np.float64] | None, quaternion_wxyz: tuple[float, float, float, float]
) -> list[float]:
    """21 numbers of x, y, z, roll, pitch, yaw."""
    jacobian = euler_error_jacobian(quaternion_wxyz)
    if covariance is None or jacobian is None:
        return [NAN] * 21
    change = np.eye(6)
    change[3:, 3:] = jacobian
    turned = change @ covariance @ change.T
    if not np.isfinite(turned).all():
        return [NAN] * 21
    return [float(turned[place]) for place in _UPPER]


def _velocity_covariance(covariance: NDArray[np.float64] | None, rotation_ned_frd: NDArray[np.float64]) -> list[float]:
    """21 numbers of vx, vy, vz, roll rate, pitch rate, yaw rate; those of the rates are not stated."""
    if covariance is None or not np.isfinite(covariance).all():
        return [NAN] * 21
    full = np.full((6, 6), NAN)
    full[:3, :3] = rotation_ned_frd.T @ covariance @ rotation_ned_frd
    return [float(full[place]) for place in _UPPER]
