"""NavState: what the filter holds, with everything left out that is not known."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.rotation import quaternion_from_rotation
from bluerov_slam.pipeline.navigator_words import Fault
from bluerov_slam.records import EventLevel, NavMode, NavState, SensorTrust

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.navigation.state import NavEstimate
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.pipeline.navigator_depth import DepthIntake
    from bluerov_slam.records import NavSensor, VehicleRange

    Array = NDArray[np.float64]

# With a larger error than this an attitude says nothing.
ATTITUDE_KNOWN_RAD = 1.5
DISTANCE_STEP_S = 1.0
ALTITUDES_KEPT = 8
# An older height above the bottom is another place's.
ALTITUDE_AGE_S = 3.0
# An echo sounder that believes its own value less than this follows noise, or fish.
ALTITUDE_LEAST_PERCENT = 30
# Slower than this the path's length would be noise.
DISTANCE_LEAST_MPS = 0.05
POSE = np.array([0, 1, 2, 6, 7, 8])
# The same trouble with the same sensor is told once in so many seconds.
TELL_AGAIN_S = 30.0
TROUBLE = (SensorTrust.IGNORED, SensorTrust.REJECTED)


class Output:
    """Builds states and keeps the path's length."""

    def __init__(self, core: Core, depth: DepthIntake) -> None:
        self._core = core
        self._depth = depth
        self.distance_m = 0.0
        self._from: tuple[float, float, float] | None = None
        self._altitudes: deque[tuple[float, float]] = deque(maxlen=ALTITUDES_KEPT)

    def state(self, arrived_s: float) -> NavState:
        """The estimate as of now."""
        core = self._core
        timeline = core.timeline
        sensors = core.book.view(core.now_s)
        if timeline is None or self._is_lost(timeline.at_s):
            at_s = core.now_s if timeline is None else max(timeline.at_s, core.motion_s)
            return self._unknown(at_s, arrived_s, sensors)
        self._measure_path()
        return self.of(timeline.filter.estimate, timeline.filter.covariance, arrived_s, sensors)

    def of(
        self, estimate: NavEstimate, covariance: Array, arrived_s: float, sensors: tuple[NavSensor, ...]
    ) -> NavState:
        """Any estimate of this run, such as a smoothed one."""
        core = self._core
        pose = covariance[np.ix_(POSE, POSE)]
        position: tuple[float, float, float] | None = None
        if core.position_known:
            north, east, down = estimate.position_ned_m.tolist()
            position = (north, east, down)
        else:
            pose[:2, :] = pose[:, :2] = np.nan
        pose[3, 3] += core.options.imu.tilt_least_std_rad**2
        pose[4, 4] += core.options.imu.tilt_least_std_rad**2
        depth_m = float(estimate.values[2])
        depth_std_m: float | None = math.hypot(math.sqrt(pose[2, 2]), self._depth.scale_std_m(depth_m))
        pose[2, 2] = depth_std_m**2 if depth_std_m is not None else np.nan
        depth_known = self._depth.surface_pressure_pa is not None
        heading_known = float(max(pose[3, 3], pose[4, 4], pose[5, 5])) < ATTITUDE_KNOWN_RAD**2
        rate = core.rate_frd_radps()
        current, current_std = self._current(estimate, covariance)
        velocity = estimate.velocity_ned_mps.tolist()
        return NavState(
            measured_s=estimate.at_s,
            arrived_s=arrived_s,
            mode=self._mode(estimate.at_s),
            origin_deg=core.place.origin_deg,
            position_ned_m=position,
            velocity_ned_mps=(velocity[0], velocity[1], velocity[2]),
            quaternion_ned_frd=quaternion_from_rotation(estimate.rotation_ned_frd) if heading_known else None,
            angular_rate_frd_radps=None if rate is None else (float(rate[0]), float(rate[1]), float(rate[2])),
            pose_covariance=pose,
            velocity_covariance_m2ps2=covariance[3:6, 3:6].copy(),
            depth_m=depth_m if depth_known else None,
            depth_std_m=depth_std_m if depth_known else None,
            altitude_m=self._altitude(estimate.at_s),
            current_ne_mps=current,
            current_std_mps=current_std,
            last_fix_s=core.last_fix_s,
            distance_m=self.distance_m,
            reset_counter=core.reset_counter,
            sensors=sensors,
        )

    def take_altitude(self, measured_s: float, record: VehicleRange) -> None:
        """A height above the bottom, as an echo sounder says it: shown, not used for the estimate."""
        status, now_s = self._core.book["altitude"], self._core.now_s
        quality = record.quality_percent
        if not math.isfinite(record.distance_m):
            status.refuse(Fault.NOT_A_NUMBER, now_s)
        elif record.distance_m <= 0.0:
            status.refuse(Fault.IMPOSSIBLE, now_s)
        elif quality is not None and quality < ALTITUDE_LEAST_PERCENT:
            status.refuse(Fault.ECHO_WEAK, now_s)
        else:
            status.hear(now_s)
            status.use(measured_s)
            self._altitudes.append((measured_s, record.distance_m))

    def _altitude(self, at_s: float) -> float | None:
        """The newest that is not of another time."""
        near = [altitude_m for measured_s, altitude_m in self._altitudes if abs(at_s - measured_s) <= ALTITUDE_AGE_S]
        return near[-1] if near else None

    def _mode(self, at_s: float) -> NavMode:
        core = self._core
        if not core.position_known:
            return NavMode.ATTITUDE
        aided = core.last_fix_s is not None and at_s - core.last_fix_s <= core.options.aided_age_s
        return NavMode.AIDED if aided else NavMode.DEAD_RECKONING

    def _is_lost(self, at_s: float) -> bool:
        """Whether for so long nothing told of motion or place that nothing should be stated."""
        core = self._core
        newest_s = max(core.motion_s, core.velocity_aid_s, core.last_fix_s or -math.inf)
        return max(at_s, core.now_s) - newest_s > core.options.unknown_after_s

    def _unknown(self, at_s: float, arrived_s: float, sensors: tuple[NavSensor, ...]) -> NavState:
        core = self._core
        return NavState(
            measured_s=at_s,
            arrived_s=arrived_s,
            mode=NavMode.STARTING,
            origin_deg=core.place.origin_deg,
            position_ned_m=None,
            velocity_ned_mps=None,
            quaternion_ned_frd=None,
            angular_rate_frd_radps=None,
            pose_covariance=None,
            velocity_covariance_m2ps2=None,
            depth_m=None,
            depth_std_m=None,
            altitude_m=None,
            current_ne_mps=None,
            current_std_mps=None,
            last_fix_s=core.last_fix_s,
            distance_m=self.distance_m,
            reset_counter=core.reset_counter,
            sensors=sensors,
        )

    def _current(
        self, estimate: NavEstimate, covariance: Array
    ) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """The current is a guess until something measured velocity through water."""
        if self._core.thrust_s is None:
            return None, None
        place = estimate.layout["current"]
        north, east = estimate.values[place].tolist()
        std_north, std_east = np.sqrt(covariance.diagonal()[place]).tolist()
        return (north, east), (std_north, std_east)

    def _measure_path(self) -> None:
        core = self._core
        assert core.timeline is not None
        at_s = core.timeline.at_s
        north, east = core.timeline.filter.estimate.values[:2].tolist()
        north -= core.timeline.shift_ne_m[0]
        east -= core.timeline.shift_ne_m[1]
        if self._from is None or not core.position_known:
            self._from = (at_s, north, east)
            return
        since_s, from_north, from_east = self._from
        if at_s - since_s >= DISTANCE_STEP_S:
            moved_m = math.hypot(north - from_north, east - from_east)
            if moved_m > DISTANCE_LEAST_MPS * (at_s - since_s):
                self.distance_m += moved_m
            self._from = (at_s, north, east)


class TrustEvents:
    """Tells when a sensor is no longer used, and when it is used again."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._seen: tuple[NavSensor, ...] = ()
        self._told: dict[str, tuple[str, float]] = {}
        self._in_trouble: set[str] = set()

    def look(self, sensors: tuple[NavSensor, ...]) -> None:
        """Compare with the last look."""
        if sensors is self._seen:
            return
        self._seen = sensors
        for sensor in sensors:
            if sensor.trust in TROUBLE:
                self._trouble(sensor)
            elif sensor.trust is SensorTrust.USED and sensor.name in self._in_trouble:
                self._in_trouble.discard(sensor.name)
                self._core.say(f"{LABELS[sensor.name]} is used again")

    def _trouble(self, sensor: NavSensor) -> None:
        reason, told_s = self._told.get(sensor.name, ("", -math.inf))
        if sensor.name in self._in_trouble and reason == sensor.reason:
            return
        self._in_trouble.add(sensor.name)
        if reason == sensor.reason and self._core.now_s - told_s < TELL_AGAIN_S:
            return
        self._told[sensor.name] = (sensor.reason, self._core.now_s)
        self._core.say(f"{LABELS[sensor.name]} is not used. {sensor.reason}", EventLevel.WARNING)


LABELS = {
    "imu": "The IMU",
    "compass": "The compass",
    "depth": "The depth sensor",
    "gps": "GPS",
    "position": "The position system",
    "thrust": "The thruster model",
    "dvl": "The DVL",
    "altitude": "The altitude",
    "acoustics": "Acoustic positioning",
}
