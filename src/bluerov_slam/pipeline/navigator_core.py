"""What the parts of the navigator share: the filter in time, what is known so far, and what there is to tell."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bluerov_slam.navigation.attitude.calibration import Calibration
from bluerov_slam.pipeline.navigator_pace import Pace
from bluerov_slam.pipeline.navigator_place import Place
from bluerov_slam.pipeline.navigator_sensors import SensorBook
from bluerov_slam.pipeline.navigator_timeline import Timeline
from bluerov_slam.records import Event, EventLevel

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from bluerov_slam.navigation.ekf import ErrorStateFilter, Measurement, UpdateResult
    from bluerov_slam.pipeline.navigator_options import NavigatorOptions

    Array = NDArray[np.float64]

# A body velocity means nothing in NED while the heading is this uncertain.
HEADING_KNOWN_RAD = 0.6
# The first fixes are averaged: what they move the position by is no jump yet.
SETTLING_S = 15.0
# A sensor that is rejected so many times in a row shows that the estimate was too sure: what it measures becomes
# uncertain again, and what it says next is weighed against that. Positions have a rule of their own.
STUBBORN: dict[str, tuple[int, tuple[tuple[str, float | tuple[float, ...]], ...]]] = {
    "imu": (50, (("attitude", 0.5),)),
    "compass": (20, (("attitude", (0.0, 0.0, 0.06)), ("compass_wander", 0.06))),
    "depth": (10, (("position", (0.0, 0.0, 10.0)),)),
    "thrust": (5, (("velocity", 0.3), ("current", 0.2))),
    "dvl": (25, (("velocity", 1.0),)),
    "acoustics": (10, (("position", (5.0, 5.0, 0.0)),)),
}


class Core:
    """Mutable state of one navigator."""

    def __init__(self, options: NavigatorOptions) -> None:
        self.options = options
        self.book = SensorBook()
        self.place = Place(options)
        self.pace = Pace(options.imu)
        self.motion_measured = True
        self.calibration = Calibration()
        self.timeline: Timeline | None = None
        self.position_known = False
        self.position_since_s = -math.inf
        self.last_fix_s: float | None = None
        self.motion_s = -math.inf
        self.velocity_aid_s = -math.inf
        self.thrust_s: float | None = None
        self.reset_counter = 0
        self.now_s = 0.0
        self.angular_rate_frd_radps: Array | None = None
        self.on_update: Callable[[UpdateResult], None] | None = None
        self.events: list[Event] = []

    def begin(self, filter_: ErrorStateFilter) -> Timeline:
        """Run this filter from now on."""
        options = self.options
        self.timeline = Timeline(
            filter_,
            options.gate_probability,
            options.jump_m,
            options.jump_share_of_std,
            options.jump_heading_rad,
            self._on_jump,
            options.imu.gyro_scale_std,
            options.imu.gyro_cross_axis_std,
        )
        return self.timeline

    def say(self, text: str, level: EventLevel = EventLevel.INFO) -> None:
        """Something a user should read."""
        self.events.append(Event(self.now_s, level, text))

    def offer(self, measurement: Measurement | None, *, gated: bool = True) -> None:
        """Into the filter, with the result in the sensor's account."""
        if measurement is not None and self.timeline is not None:
            self.timeline.offer(measurement, self.account, gated=gated)

    def account(self, result: UpdateResult) -> None:
        """Book one result."""
        if self.on_update is not None:
            self.on_update(result)
        status = self.book.get(result.sensor)
        if status is None:
            return
        if result.accepted:
            status.use(result.at_s, result.nis, result.dof)
            return
        status.reject(result.nis, result.dof)
        limit, blocks = STUBBORN.get(result.sensor, (0, ()))
        if limit and status.rejected_in_a_row % limit == 0 and self.timeline is not None:
            for name, std in blocks:
                self.timeline.buffer.add_uncertainty(name, std)

    def heading_known(self) -> bool:
        """Whether body velocities can be turned into NED."""
        if self.timeline is None:
            return False
        return float(self.timeline.filter.covariance[8, 8]) < HEADING_KNOWN_RAD**2

    def down_frd(self) -> Array | None:
        """The vertical in body axes, None before there is an attitude."""
        if self.timeline is None:
            return None
        down: Array = self.timeline.filter.estimate.rotation_ned_frd[2].copy()
        return down

    def depth_m(self) -> float | None:
        """Depth of the vehicle's origin as estimated."""
        return None if self.timeline is None else float(self.timeline.filter.estimate.values[2])

    def rate_frd_radps(self) -> Array | None:
        """The newest angular rate without the gyro's bias."""
        if self.angular_rate_frd_radps is None or self.timeline is None:
            return None
        rate: Array = self.angular_rate_frd_radps - self.timeline.filter.estimate.block("gyro_bias")
        return rate

    def _on_jump(self) -> None:
        if self.position_known and self.now_s - self.position_since_s > SETTLING_S:
            self.reset_counter += 1
