"""What the user asks for: depth zero, origin, calibrations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bluerov_slam.errors import ExpectedError
from bluerov_slam.pipeline.navigator_calibrations import Calibrations
from bluerov_slam.pipeline.navigator_commands import NavigatorAction
from bluerov_slam.pipeline.navigator_position import align
from bluerov_slam.records import EventLevel

if TYPE_CHECKING:
    from bluerov_slam.pipeline.navigator_commands import NavigatorCommand
    from bluerov_slam.pipeline.navigator_core import Core
    from bluerov_slam.pipeline.navigator_depth import DepthIntake

# A user who says "here" on a map or by a landmark.
STATED_POSITION_STD_M = 5.0


class Actions:
    """Obeys, and answers with an event: INFO where it was done, WARNING where not."""

    def __init__(self, core: Core, depth: DepthIntake) -> None:
        self._core = core
        self._depth = depth
        self.calibrations = Calibrations(core)

    def do(self, command: NavigatorCommand) -> None:
        """One command."""
        try:
            self._core.say(self._do(command))
        except ExpectedError as error:
            self._core.say(_sentence(str(error)), EventLevel.WARNING)

    def _do(self, command: NavigatorCommand) -> str:
        kind = command.kind or ""
        match command.action:
            case NavigatorAction.ZERO_DEPTH:
                return self._zero_depth()
            case NavigatorAction.SET_ORIGIN:
                return self._set_origin(command.latitude_deg, command.longitude_deg)
            case NavigatorAction.START_CALIBRATION:
                return self.calibrations.start(kind)
            case NavigatorAction.FINISH_CALIBRATION:
                return self.calibrations.finish(kind, command.unix_s)
            case NavigatorAction.CANCEL_CALIBRATION:
                return self.calibrations.cancel(kind)
            case NavigatorAction.CLEAR_CALIBRATION:
                return self.calibrations.clear(kind)
        raise RefusedError(f"{command.action} is not for here")

    def _zero_depth(self) -> str:
        before_pa = self._depth.surface_pressure_pa
        if not self._depth.zero_here():
            raise RefusedError("no pressure has come yet: check the depth sensor")
        timeline = self._core.timeline
        if timeline is not None:
            # The newest reading is zero by definition; what the filter thought of the old zero is forgotten.
            timeline.buffer.reset_block("depth_bias", 0.0, self._depth.bias_std_m)
            timeline.buffer.add_uncertainty("position", (0.0, 0.0, 2.0))
        moved_m = 0.0 if before_pa is None else self._depth.depth_m(before_pa)
        return f"Depth is zero here (moved by {abs(moved_m):.2f} m)"

    def _set_origin(self, latitude_deg: float | None, longitude_deg: float | None) -> str:
        core = self._core
        if (latitude_deg is None) != (longitude_deg is None):
            raise RefusedError("an origin needs latitude and longitude")
        if latitude_deg is None or longitude_deg is None:
            return self._origin_here()
        if not (
            math.isfinite(latitude_deg + longitude_deg) and abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180
        ):
            raise RefusedError(f"{latitude_deg}, {longitude_deg} is no position on Earth")
        if core.position_known:
            self._move_origin(latitude_deg, longitude_deg)
            return "The origin was set; the vehicle's position on Earth stays"
        turn_rad = core.place.settle(latitude_deg, longitude_deg)
        align(core, turn_rad)
        if core.timeline is None:
            return "The origin was set; the vehicle's position follows with the first fix"
        timeline = core.timeline
        down = float(timeline.filter.estimate.values[2])
        std_m = STATED_POSITION_STD_M
        timeline.buffer.reset_block(
            "position", (0.0, 0.0, down), (std_m, std_m, float(timeline.filter.std("position")[2]))
        )
        core.position_known = True
        core.reset_counter += 1
        return f"The origin was set; the vehicle is taken to be there, within {STATED_POSITION_STD_M:.0f} m"

    def _origin_here(self) -> str:
        core = self._core
        if core.timeline is None or not core.position_known or core.place.frame is None:
            raise RefusedError("where the vehicle is, is not known yet: wait for GPS, or enter a position")
        north, east = core.timeline.filter.estimate.values[:2].tolist()
        latitude_deg, longitude_deg, _ = core.place.frame.to_geodetic(north, east)
        self._move_origin(latitude_deg, longitude_deg)
        return "The origin is where the vehicle is now"

    def _move_origin(self, latitude_deg: float, longitude_deg: float) -> None:
        """The vehicle stays where it is on Earth; its coordinates change."""
        core = self._core
        assert core.timeline is not None
        assert core.place.frame is not None
        filter_ = core.timeline.filter
        north, east = filter_.estimate.values[:2].tolist()
        here = core.place.frame.to_geodetic(north, east)
        core.place.settle(latitude_deg, longitude_deg)
        moved = core.place.offset_m(here[0], here[1])
        core.timeline.move(moved[0] - north, moved[1] - east)
        core.pace.hold()
        core.reset_counter += 1


class RefusedError(ExpectedError):
    """What was asked cannot be done now; says why."""


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
