"""Speed and course of a GPS receiver as a velocity over ground. It measures them by Doppler, apart from the position.

On a surface run they show current and thrusters' scale far sooner than the position, whose errors last for a minute.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.measurements import HorizontalVelocity
from bluerov_slam.pipeline.navigator_sensors import SensorStatus

if TYPE_CHECKING:
    from bluerov_slam.navigation.ekf import UpdateResult
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.records import GpsFix

# Not one of the page's sensors: its account serves the learning of its noise.
SENSOR = "gps_velocity"
# Slower than this a receiver's course is that of its noise, or it keeps the last one.
SLOWEST_MPS = 0.3
FASTEST_MPS = 20.0


class GpsVelocity:
    """Takes reports whose position has passed all checks."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._status = SensorStatus(SENSOR)

    def take(self, record: GpsFix, at_s: float) -> None:
        """Offer the velocity of a report, if it tells one."""
        speed, course, core = record.speed_mps, record.course_rad, self._core
        if speed is None or course is None or core.timeline is None:
            return
        if not (math.isfinite(course) and SLOWEST_MPS <= speed <= FASTEST_MPS):
            return
        options = core.options.gps
        std_mps = options.velocity_std_mps * self._status.noise_scale
        rate = core.angular_rate_frd_radps
        measurement = HorizontalVelocity(
            at_s,
            speed * math.cos(course),
            speed * math.sin(course),
            std_mps**2 * np.eye(2),
            SENSOR,
            options.lever_arm_frd_m if rate is not None else (0.0, 0.0, 0.0),
            (0.0, 0.0, 0.0) if rate is None else rate,
        )
        core.timeline.offer(measurement, self._done)

    def _done(self, result: UpdateResult) -> None:
        self._core.account(result)
        if result.accepted:
            self._core.velocity_aid_s = max(self._core.velocity_aid_s, result.at_s)
            self._status.use(result.at_s, result.nis, result.dof)
        else:
            self._status.reject(result.nis, result.dof)
