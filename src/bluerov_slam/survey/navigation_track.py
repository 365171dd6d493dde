"""A track as columns: what files and plots need of the navigator's states. Unknown is NaN."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.protocol.navigation_json import error_ellipse, euler_angles_rad
from bluerov_slam.records import NavMode, NavState
from bluerov_slam.sinks.state_thinning import StateThinning

FloatArray = NDArray[np.float64]

MODES = tuple(NavMode)
PERIOD_S = 0.2
TILT_KNOWN_RAD = math.radians(12.0)
HEADING_KNOWN_RAD = math.radians(40.0)

COLUMNS = (
    "at_s", "mode", "latitude_deg", "longitude_deg", "depth_m", "depth_std_m",
    "major_95_m", "minor_95_m", "bearing_rad",
    "north_mps", "east_mps", "down_mps", "speed_std_mps",
    "roll_rad", "pitch_rad", "heading_rad", "heading_std_rad", "altitude_m",
    "current_north_mps", "current_east_mps", "current_std_mps",
    "last_fix_s", "distance_m", "reset_counter",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class NavTrack:
    """`columns` are named as COLUMNS; `mode` is the place in MODES. Angles in radians, heading 0 to 2 pi."""

    columns: dict[str, FloatArray]

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["at_s"])

    @property
    def has_position(self) -> NDArray[np.bool_]:
        """Where a position is known."""
        return np.isfinite(self.columns["latitude_deg"])

    @property
    def speed_mps(self) -> FloatArray:
        """Over ground, horizontal."""
        speed: FloatArray = np.hypot(self.columns["north_mps"], self.columns["east_mps"])
        return speed

    def mode_at(self, row: int) -> NavMode:
        """The mode of a row."""
        return MODES[int(self.columns["mode"][row])]

    def local(self, frame: LocalFrame) -> tuple[FloatArray, FloatArray]:
        """Metres north and east of an origin."""
        latitude, longitude = self.columns["latitude_deg"], self.columns["longitude_deg"]
        north, east = np.full(len(self), np.nan), np.full(len(self), np.nan)
        for row in np.flatnonzero(self.has_position):
            north[row], east[row], _ = frame.to_ned_m(float(latitude[row]), float(longitude[row]))
        return north, east


class TrackBuilder:
    """Collects states, five a second."""

    def __init__(self) -> None:
        self.origin_deg: tuple[float, float] | None = None
        self._due = StateThinning(PERIOD_S)
        self._values = array("d")
        self._frame: LocalFrame | None = None

    def add(self, state: NavState) -> bool:
        """Take a state; whether it was kept."""
        if not self._due.wants(state):
            return False
        self._values.extend(self._row(state))
        return True

    def build(self) -> NavTrack:
        """What was collected."""
        table = np.frombuffer(self._values, dtype=np.float64) if self._values else np.empty(0)
        table = table.reshape(-1, len(COLUMNS)).copy()
        return NavTrack({name: np.ascontiguousarray(table[:, place]) for place, name in enumerate(COLUMNS)})

    def _row(self, state: NavState) -> list[float]:
        latitude_deg, longitude_deg = self._place(state)
        ellipse = error_ellipse(state.pose_covariance) if state.position_ned_m is not None else None
        heading_std_rad = _heading_std_rad(state)
        values: tuple[float | None, ...] = (
            state.measured_s,
            MODES.index(state.mode),
            latitude_deg,
            longitude_deg,
            state.depth_m,
            state.depth_std_m,
            *((ellipse.major_m, ellipse.minor_m, ellipse.bearing_rad) if ellipse else (None, None, None)),
            *(state.velocity_ned_mps or (None, None, None)),
            _speed_std_mps(state),
            *_angles_rad(state, heading_std_rad),
            heading_std_rad,
            state.altitude_m,
            *(state.current_ne_mps or (None, None)),
            max(state.current_std_mps) if state.current_std_mps else None,
            state.last_fix_s,
            state.distance_m,
            state.reset_counter,
        )
        return [math.nan if value is None else value for value in values]

    def _place(self, state: NavState) -> tuple[float | None, float | None]:
        if state.origin_deg is None or state.position_ned_m is None:
            return None, None
        if self._frame is None or state.origin_deg != self.origin_deg:
            self.origin_deg = state.origin_deg
            self._frame = LocalFrame(*state.origin_deg)
        latitude_deg, longitude_deg, _ = self._frame.to_geodetic(*state.position_ned_m)
        return latitude_deg, longitude_deg


def _speed_std_mps(state: NavState) -> float | None:
    """The larger of both axes: one number for a person."""
    covariance = state.velocity_covariance_m2ps2
    if covariance is None:
        return None
    largest = float(np.linalg.eigvalsh(covariance[:2, :2])[-1])
    return math.sqrt(largest) if largest >= 0.0 else None


def _angles_rad(state: NavState, heading_std_rad: float | None) -> tuple[float | None, float | None, float | None]:
    """Roll, pitch and heading; with a larger error than this an angle says nothing."""
    if state.quaternion_ned_frd is None or state.pose_covariance is None:
        return None, None, None
    roll, pitch, heading = euler_angles_rad(state.quaternion_ned_frd)
    tilt_std_rad = math.sqrt(max(float(state.pose_covariance[3, 3]), float(state.pose_covariance[4, 4]), 0.0))
    level_known = tilt_std_rad < TILT_KNOWN_RAD
    heading_known = heading_std_rad is not None and heading_std_rad < HEADING_KNOWN_RAD
    return roll if level_known else None, pitch if level_known else None, heading if heading_known else None


def _heading_std_rad(state: NavState) -> float | None:
    if state.pose_covariance is None:
        return None
    variance = float(state.pose_covariance[5, 5])
    return math.sqrt(variance) if math.isfinite(variance) and variance >= 0.0 else None
