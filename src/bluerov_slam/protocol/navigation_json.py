"""A NavState as the pages, the session log and the recording show it (docs/navigation.md, section 5).

Degrees only here, null for what is unknown. What a state does not know itself (its latitude and longitude, the newest
fix, what is sent to the autopilot) is handed in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bluerov_slam.records import NavMode, NavState

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from bluerov_slam.records import NavSensor

OFF = "off"
PROBABILITY = 0.95
CHI2_95_2DOF = 5.991
NORMAL_97_5 = 1.959964
# Slower than this, or than its own uncertainty, a course over ground is noise.
SLOWEST_COURSE_MPS = 0.05
LABELS = {
    "imu": "IMU",
    "compass": "Compass",
    "depth": "Depth",
    "gps": "GPS",
    "position": "Position fixes",
    "thrust": "Thruster model",
    "dvl": "DVL",
    "altitude": "Altitude",
    "acoustics": "Acoustics",
}
_MODE_TEXTS = {
    NavMode.STARTING: "Starting: waiting for the attitude",
    NavMode.ATTITUDE: "Attitude and depth only: no position fix so far",
    NavMode.DEAD_RECKONING: "Dead reckoning",
    NavMode.AIDED: "Position is held by fixes",
}


@dataclass(frozen=True, slots=True)
class FixOutcome:
    """What became of a position fix. `accepted` None: it was not tested (nothing to compare it with, not usable)."""

    measured_s: float
    source: str
    latitude_deg: float
    longitude_deg: float
    north_m: float | None
    east_m: float | None
    std_m: float | None
    accepted: bool | None


@dataclass(frozen=True, slots=True)
class Ellipse:
    """Where the vehicle is with 95 % probability. `bearing_rad`: of the long axis, clockwise from north, 0 to pi."""

    major_m: float
    minor_m: float
    bearing_rad: float


def navigation_json(
    state: NavState,
    position_deg: tuple[float, float] | None = None,
    *,
    text: str | None = None,
    fix: FixOutcome | None = None,
    odometry: dict[str, Any] | None = None,
    now_s: float | None = None,
    simulated: bool = False,
) -> dict[str, Any]:
    """The topic's `data`. `now_s`: to which instant ages are counted, else the state's own."""
    at_s = state.measured_s if now_s is None else now_s
    return {
        "mode": state.mode.value,
        "text": text or state_text(state),
        "origin": _origin(state.origin_deg),
        "position": _position(state, position_deg),
        "ellipse": ellipse_json(error_ellipse(state.pose_covariance)),
        "attitude": _attitude(state.quaternion_ned_frd),
        "std": _std(state),
        "velocity": _velocity(state),
        "current": _current(state),
        "altitude_m": _rounded(state.altitude_m, 2),
        "distance_m": _rounded(state.distance_m, 1),
        "since_fix_s": _age(at_s, state.last_fix_s),
        "reset_counter": state.reset_counter,
        "simulated": simulated,
        "sensors": [_sensor(sensor, at_s) for sensor in state.sensors],
        "fix": None if fix is None else fix_json(fix),
        "odometry": odometry or NO_ODOMETRY,
    }


def nothing_json(mode: str, text: str, *, simulated: bool = False) -> dict[str, Any]:
    """The same keys while there is no state: switched off, starting, or the estimator has crashed."""
    return {
        "mode": mode,
        "text": text,
        "origin": _origin(None),
        "position": dict.fromkeys(("north_m", "east_m", "depth_m", "latitude_deg", "longitude_deg")),
        "ellipse": ellipse_json(None),
        "attitude": _attitude(None),
        "std": dict.fromkeys(("heading_deg", "tilt_deg", "depth_m", "speed_mps")),
        "velocity": dict.fromkeys(("north_mps", "east_mps", "down_mps", "speed_mps", "course_deg")),
        "current": dict.fromkeys(("north_mps", "east_mps", "std_mps")),
        "altitude_m": None,
        "distance_m": None,
        "since_fix_s": None,
        "reset_counter": None,
        "simulated": simulated,
        "sensors": [],
        "fix": None,
        "odometry": NO_ODOMETRY,
    }


NO_ODOMETRY: dict[str, Any] = {"enabled": False, "sent": 0, "text": "Nothing is sent to the autopilot"}


def state_text(state: NavState) -> str:
    """One sentence for the pilot."""
    if state.mode is NavMode.DEAD_RECKONING:
        ellipse, since_s = error_ellipse(state.pose_covariance), _age(state.measured_s, state.last_fix_s)
        within = "" if ellipse is None else f", within {_metres(ellipse.major_m)}"
        return f"Dead reckoning{within}" + ("" if since_s is None else f", {_duration(since_s)} since the last fix")
    text = _MODE_TEXTS[state.mode]
    if state.mode is NavMode.AIDED and (ellipse := error_ellipse(state.pose_covariance)) is not None:
        return f"{text}, within {_metres(ellipse.major_m)}"
    return text


def short_text(state: NavState) -> str:
    """The same in at most forty characters, for a chip."""
    ellipse = error_ellipse(state.pose_covariance)
    within = "" if ellipse is None else f" within {_metres(ellipse.major_m)}"
    if state.mode is NavMode.AIDED:
        return f"Known{within}"
    if state.mode is NavMode.DEAD_RECKONING:
        return f"Dead reckoning{within}"
    return "No position yet" if state.mode is NavMode.ATTITUDE else "Starting"


def error_ellipse(pose_covariance: NDArray[np.float64] | None) -> Ellipse | None:
    """The 95 % ellipse of the horizontal position, None while that is unknown.

    Check: variances 9 and 4 m2 north and east without correlation -> 7.343 m and 4.895 m, bearing 0.
    """
    if pose_covariance is None:
        return None
    nn, ee, ne = float(pose_covariance[0, 0]), float(pose_covariance[1, 1]), float(pose_covariance[0, 1])
    if not (math.isfinite(nn) and math.isfinite(ee) and math.isfinite(ne)):
        return None
    middle, radius = (nn + ee) / 2.0, math.hypot((nn - ee) / 2.0, ne)
    bearing_rad = 0.5 * math.atan2(2.0 * ne, nn - ee) % math.pi
    major_m, minor_m = (math.sqrt(CHI2_95_2DOF * max(value, 0.0)) for value in (middle + radius, middle - radius))
    return Ellipse(major_m, minor_m, bearing_rad)


def ellipse_json(ellipse: Ellipse | None) -> dict[str, Any]:
    """Metres and degrees."""
    if ellipse is None:
        return {"major_m": None, "minor_m": None, "bearing_deg": None, "probability": PROBABILITY}
    return {
        "major_m": round(ellipse.major_m, 2),
        "minor_m": round(ellipse.minor_m, 2),
        "bearing_deg": round(math.degrees(ellipse.bearing_rad), 1),
        "probability": PROBABILITY,
    }


def euler_angles_rad(quaternion_wxyz: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """Roll, pitch and heading (0 to 2 pi) of a body FRD in NED.

    Check: w = z = sqrt(0.5), x = y = 0 -> roll 0, pitch 0, heading pi/2.
    """
    w, x, y, z = quaternion_wxyz
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, heading % math.tau


def nis_band(count: int) -> tuple[float, float] | None:
    """Between which values the mean of `count` normalised squared innovations lies with 95 % probability.

    Counted as if each value had one degree of freedom, which is the widest it can be. None without a value.
    Source: Wilson and Hilferty (1931), doi:10.1073/pnas.17.12.684.
    Check: 10 values -> 0.322 to 2.048 (exact: 0.325 to 2.048).
    """
    if count < 1:
        return None
    spread = 2.0 / (9.0 * count)
    low, high = (max(1.0 - spread + sign * NORMAL_97_5 * math.sqrt(spread), 0.0) ** 3 for sign in (-1.0, 1.0))
    return low, high


def fix_json(fix: FixOutcome) -> dict[str, Any]:
    """A fix on the map."""
    return {
        "source": fix.source,
        "north_m": _rounded(fix.north_m, 2),
        "east_m": _rounded(fix.east_m, 2),
        "std_m": _rounded(fix.std_m, 2),
        "accepted": fix.accepted,
    }


def _origin(origin_deg: tuple[float, float] | None) -> dict[str, Any]:
    latitude_deg, longitude_deg = origin_deg or (None, None)
    return {"latitude_deg": _rounded(latitude_deg, 8), "longitude_deg": _rounded(longitude_deg, 8)}


def _position(state: NavState, position_deg: tuple[float, float] | None) -> dict[str, Any]:
    north_m, east_m, _ = state.position_ned_m or (None, None, None)
    latitude_deg, longitude_deg = position_deg or (None, None)
    return {
        "north_m": _rounded(north_m, 3),
        "east_m": _rounded(east_m, 3),
        "depth_m": _rounded(state.depth_m, 3),
        "latitude_deg": _rounded(latitude_deg, 8),
        "longitude_deg": _rounded(longitude_deg, 8),
    }


def _attitude(quaternion: tuple[float, float, float, float] | None) -> dict[str, Any]:
    if quaternion is None:
        return dict.fromkeys(("roll_deg", "pitch_deg", "heading_deg"))
    roll, pitch, heading = euler_angles_rad(quaternion)
    return {
        "roll_deg": _rounded(math.degrees(roll), 2),
        "pitch_deg": _rounded(math.degrees(pitch), 2),
        "heading_deg": _rounded(math.degrees(heading), 2),
    }


def _std(state: NavState) -> dict[str, Any]:
    pose, velocity = state.pose_covariance, state.velocity_covariance_m2ps2
    heading = None if pose is None else _root(float(pose[5, 5]))
    tilt = None if pose is None else _root(_larger_eigenvalue(float(pose[3, 3]), float(pose[4, 4]), float(pose[3, 4])))
    return {
        "heading_deg": None if heading is None else _rounded(math.degrees(heading), 2),
        "tilt_deg": None if tilt is None else _rounded(math.degrees(tilt), 2),
        "depth_m": _rounded(state.depth_std_m, 3),
        "speed_mps": None if velocity is None else _rounded(_speed_std_mps(velocity), 3),
    }


def _velocity(state: NavState) -> dict[str, Any]:
    if state.velocity_ned_mps is None:
        return dict.fromkeys(("north_mps", "east_mps", "down_mps", "speed_mps", "course_deg"))
    north_mps, east_mps, down_mps = state.velocity_ned_mps
    speed_mps = math.hypot(north_mps, east_mps)
    covariance = state.velocity_covariance_m2ps2
    std_mps = None if covariance is None else _speed_std_mps(covariance)
    known = math.isfinite(speed_mps) and speed_mps > max(SLOWEST_COURSE_MPS, std_mps or 0.0)
    course_deg = math.degrees(math.atan2(east_mps, north_mps)) % 360.0 if known else None
    return {
        "north_mps": _rounded(north_mps, 3),
        "east_mps": _rounded(east_mps, 3),
        "down_mps": _rounded(down_mps, 3),
        "speed_mps": _rounded(speed_mps, 3),
        "course_deg": _rounded(course_deg, 1),
    }


def _current(state: NavState) -> dict[str, Any]:
    north_mps, east_mps = state.current_ne_mps or (None, None)
    std_mps = None if state.current_std_mps is None else max(state.current_std_mps)
    return {
        "north_mps": _rounded(north_mps, 3),
        "east_mps": _rounded(east_mps, 3),
        "std_mps": _rounded(std_mps, 3),
    }


def _sensor(sensor: NavSensor, at_s: float) -> dict[str, Any]:
    band = nis_band(sensor.nis_count)
    return {
        "id": sensor.name,
        "label": LABELS.get(sensor.name, sensor.name),
        "trust": sensor.trust.value,
        "reason": sensor.reason,
        "accepted": sensor.accepted,
        "rejected": sensor.rejected,
        "age_s": _age(at_s, sensor.last_used_s),
        "nis_ratio": _rounded(sensor.nis_ratio, 3),
        "nis_count": sensor.nis_count,
        "nis_band": None if band is None else [round(value, 3) for value in band],
    }


def _speed_std_mps(covariance: NDArray[np.float64]) -> float | None:
    """The larger standard deviation of the horizontal velocity."""
    return _root(_larger_eigenvalue(float(covariance[0, 0]), float(covariance[1, 1]), float(covariance[0, 1])))


def _larger_eigenvalue(a: float, b: float, c: float) -> float:
    """Of the symmetric matrix ((a, c), (c, b))."""
    return (a + b) / 2.0 + math.hypot((a - b) / 2.0, c)


def _root(variance: float) -> float | None:
    return math.sqrt(variance) if math.isfinite(variance) and variance >= 0.0 else None


def _age(now_s: float, at_s: float | None) -> float | None:
    return None if at_s is None else round(max(0.0, now_s - at_s), 2)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)


def _metres(value_m: float) -> str:
    return f"{value_m:.1f} m" if value_m < 10.0 else f"{value_m:.0f} m"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"
