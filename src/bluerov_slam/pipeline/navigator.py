"""Records in, NavState and Event out: the one estimator of live operation, replay and batch.

Nothing here reads a clock: all time is that of the records, so that the same records give the same numbers, bit for
bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.navigation.attitude.calibration import Calibration, CalibrationError
from bluerov_slam.navigation.measurements import Depth
from bluerov_slam.navigation.smoother import StepRecorder, smooth
from bluerov_slam.pipeline.navigator_acoustics import AcousticIntake
from bluerov_slam.pipeline.navigator_actions import Actions
from bluerov_slam.pipeline.navigator_aids import VELOCITY_MISSED_AFTER_S, Aids
from bluerov_slam.pipeline.navigator_commands import (
    CalibrationProgress,
    NavigatorAction,
    NavigatorCommand,
    SavedNavigation,
)
from bluerov_slam.pipeline.navigator_compass import CompassIntake
from bluerov_slam.pipeline.navigator_core import Core
from bluerov_slam.pipeline.navigator_depth import DepthIntake, DepthReading
from bluerov_slam.pipeline.navigator_fix import DvlIntake
from bluerov_slam.pipeline.navigator_imu import ImuIntake
from bluerov_slam.pipeline.navigator_options import NavigatorOptions
from bluerov_slam.pipeline.navigator_output import Output, TrustEvents
from bluerov_slam.pipeline.navigator_position import Positions
from bluerov_slam.pipeline.navigator_resume import age_of, resume, save
from bluerov_slam.pipeline.navigator_start import Start, StartUp, make_filter
from bluerov_slam.pipeline.navigator_thrust import ThrustIntake
from bluerov_slam.pipeline.navigator_time import VehicleClocks
from bluerov_slam.pipeline.navigator_words import Wait
from bluerov_slam.pipeline.smoothed_poses import SmoothedPoses
from bluerov_slam.records import (
    AcousticFix,
    CtdSample,
    Event,
    EventLevel,
    GpsFix,
    ImuBurst,
    NavState,
    PositionFix,
    Record,
    SensorSample,
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleMotionDelta,
    VehicleRange,
    VehicleServoOutput,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from bluerov_slam.navigation.ekf import UpdateResult
    from bluerov_slam.navigation.measurements import SensorAngles
    from bluerov_slam.navigation.seawater import WaterColumn

    Array = NDArray[np.float64]

__all__ = [
    "CalibrationProgress",
    "Navigator",
    "NavigatorAction",
    "NavigatorCommand",
    "NavigatorOptions",
    "SavedNavigation",
]

# The IMU's own angles, or the autopilot's, are taken once the better source has been silent for so long.
BURSTS_GONE_S = 2.0
LINK_IMU_GONE_S = 5.0
# Positions alone begin a track when no attitude has come for so long.
FIXES_ALONE_AFTER_S = 10.0
# After a longer silence the attitude is found anew from gravity and field.
REALIGN_AFTER_S = 5.0


class Navigator:
    """Takes records in order of arrival."""

    def __init__(
        self,
        options: NavigatorOptions | None = None,
        saved: SavedNavigation | Mapping[str, Any] | None = None,
        saved_age_s: float | None = None,
    ) -> None:
        self.options = options or NavigatorOptions()
        self._saved_age_s = saved_age_s
        self._first_s: float | None = None
        self._recorders: list[StepRecorder] | None = None
        self._begin_anew(Core(self.options))
        self._saved = self._read(saved)

    @property
    def on_update(self) -> Callable[[UpdateResult], None] | None:
        """Hears what became of every measurement."""
        return self._core.on_update

    @on_update.setter
    def on_update(self, listener: Callable[[UpdateResult], None] | None) -> None:
        self._core.on_update = listener

    @property
    def statistics(self) -> dict[str, Any]:
        """Counters by sensor, and those of the filter."""
        sensors = {
            status.name: {
                "accepted": status.accepted,
                "rejected": status.rejected,
                "refused": status.refused,
                "faults": {fault.value: count for fault, count in status.faults.items()},
            }
            for status in self._core.book
        }
        timeline = self._core.timeline
        counts = {"resets": self._core.reset_counter}
        if timeline is not None:
            counts |= {
                "too_old": timeline.too_old + timeline.buffer.too_old,
                "too_early": timeline.buffer.too_early,
                "replayed_slots": timeline.buffer.replayed_slots,
                "refused_samples": timeline.filter.refused_samples,
                "refused_measurements": timeline.filter.refused_measurements,
            }
        return {"sensors": sensors, "filter": counts}

    def feed(self, record: Record) -> list[NavState | Event]:
        """Take one record; states and events in the order in which they came about."""
        handler = self._handlers.get(type(record))
        if handler is None:
            return []
        core = self._core
        arrived_s: float = record.arrived_s  # type: ignore[union-attr]  # every handled record has one
        if not math.isfinite(arrived_s):
            return []
        if self._first_s is None:
            self._first_s = arrived_s
        core.now_s = max(core.now_s, arrived_s) if core.now_s else arrived_s
        shows = handler(record)
        results: list[NavState | Event] = []
        if shows:
            state = self._output.state(arrived_s)
            self._trust.look(state.sensors)
            results.append(state)
        events, core.events = core.events, []
        return [*events, *results]

    def command(self, command: NavigatorCommand) -> list[NavState | Event]:
        """Do what the user asked; what came of it is an event, above INFO where it was refused."""
        if command.action is NavigatorAction.RESET:
            before, core = self._core, Core(self.options)
            core.calibration, core.now_s, core.on_update = before.calibration, before.now_s, before.on_update
            self._begin_anew(core)
            self._saved = None
            core.say("The navigation starts anew")
        else:
            self._actions.do(command)
        events, self._core.events = self._core.events, []
        return list(events)

    def calibrations(self) -> list[CalibrationProgress]:
        """How far each guided routine is."""
        return self._actions.calibrations.progress()

    def water_column(self) -> WaterColumn | None:
        """The water as the vehicle's own CTD found it; None while it has not been under water with one."""
        return self._depth.water.column

    def whole_water_column(self) -> WaterColumn | None:
        """The same with the last samples in it, which takes some milliseconds."""
        return self._depth.water.make_now()

    def save(self) -> SavedNavigation:
        """What a restart needs. Before the first attitude it is what was saved before."""
        if self._core.timeline is None and self._saved is not None:
            return self._saved
        return save(self._core, self._depth.surface_pressure_pa, self._output.distance_m)

    def expire(self, now_s: float) -> list[NavState | Event]:
        """Live only, when records stay away: says when nothing is known any more. Changes nothing in the estimate."""
        core = self._core
        if core.now_s == 0.0 or now_s - core.now_s <= self.options.unknown_after_s:
            return []
        before_s, core.now_s = core.now_s, now_s
        state = self._output.state(now_s)
        core.now_s = before_s
        return [state]

    def keep_for_smoothing(self, first_pass: Sequence[NavState] = ()) -> None:
        """Offline: remember every step for `smoothed`. Before the first record. With the smoothed states of a first
        pass over the same records, acoustic pulses are taken as they are seen from there.
        """
        self._recorders = []
        if first_pass and self._acoustics is not None:
            self._acoustics.poses = SmoothedPoses(first_pass)

    def smoothed(self) -> list[NavState]:
        """All steps again, each with what came after it."""
        return [
            self._output.of(step.estimate, step.covariance, step.at_s, ())
            for recorder in self._recorders or []
            for step in smooth(recorder.steps)
        ]

    def _begin_anew(self, core: Core) -> None:
        options = self.options
        self._core = core
        self._clocks = VehicleClocks()
        self._start = StartUp()
        self._imu = ImuIntake(options.imu, core.book["imu"])
        self._compass = CompassIntake(options.compass, core.book["compass"])
        self._depth_bias_std_m = math.inf
        self._depth = DepthIntake(options.depth, core.book["depth"])
        self._thrust = ThrustIntake(options.thrust, core.book["thrust"])
        self._dvl = DvlIntake(options.dvl, core.book["dvl"])
        self._positions = Positions(core)
        self._aids = Aids(core)
        self._output = Output(core, self._depth)
        self._trust = TrustEvents(core)
        self._actions = Actions(core, self._depth)
        self._burst_s = -math.inf
        self._heading_s = -math.inf
        self._angles_s = -math.inf
        self._autopilot_s = -math.inf
        self._handlers: dict[type, Callable[[Any], bool]] = {
            ImuBurst: self._on_burst,
            SensorSample: self._on_sample,
            CtdSample: self._on_ctd,
            GpsFix: self._on_gps,
            PositionFix: self._on_fix,
            VehicleAttitude: self._on_attitude,
            VehicleServoOutput: self._on_servos,
            VehicleBattery: self._on_battery,
            VehicleMotionDelta: self._on_motion,
            VehicleDepth: self._on_depth,
            VehicleRange: self._on_range,
        }
        self._acoustics: AcousticIntake | None = None
        if options.acoustics is not None:
            self._acoustics = AcousticIntake(core, self._positions, options.acoustics, self._depth)
            self._handlers[AcousticFix] = self._on_acoustics

    def _read(self, saved: SavedNavigation | Mapping[str, Any] | None) -> SavedNavigation | None:
        """What was saved, with what does not age (the calibrations) taken up at once."""
        if saved is None:
            return None
        read = saved if isinstance(saved, SavedNavigation) else SavedNavigation.from_json(saved)
        if read is None:
            self._core.say("The saved navigation is damaged: starting anew", EventLevel.WARNING)
            return None
        if read.calibration:
            try:
                self._core.calibration = Calibration.from_json(read.calibration)
            except CalibrationError as error:
                self._core.say(str(error), EventLevel.WARNING)
        return read

    def _on_burst(self, record: ImuBurst) -> bool:
        core = self._core
        self._burst_s = record.arrived_s
        samples = self._imu.burst(record, core.calibration)
        field_raw = self._imu.mounted(record.magnetic_field_raw.astype(np.float64))
        effort = self._thrust.effort(record.measured_s)
        self._actions.calibrations.feed(record, self._imu, field_raw, effort)
        self._compass.expected_dip_rad = core.place.dip_rad
        heading = self._compass.burst(
            record, field_raw, core.calibration, effort, core.down_frd(), core.place.declination_rad
        )
        self._actions.calibrations.feed_heading(heading)
        if not samples:
            return core.timeline is None or self._without_imu(record.arrived_s, None)
        field = None if heading is None else np.asarray(heading.field_frd)
        if core.timeline is None:
            for sample in samples:
                start = self._start.add(sample, field, core.place.declination_rad)
                if start is not None:
                    self._begin(start)
                    break
            if core.timeline is None:
                if self._start.fault is not None:
                    core.book["imu"].refuse(self._start.fault, record.arrived_s)
                return True
        elif samples[0].at_s - core.motion_s > REALIGN_AFTER_S:
            self._realign(samples, field)
            return True
        if heading is not None and heading.at_s - self._heading_s > self.options.compass.filter_period_s - 1e-3:
            self._heading_s = heading.at_s
            core.offer(heading)
        core.motion_measured = True
        core.pace.hold()
        for sample in samples:
            core.timeline.strapdown(sample)
        core.motion_s = max(core.motion_s, samples[-1].at_s)
        core.angular_rate_frd_radps = samples[-1].angular_rate_frd_radps
        core.book["imu"].wait_for(None, record.arrived_s)
        core.book["imu"].use(samples[-1].at_s)
        self._aids.after_samples(samples)
        return True

    def _on_sample(self, record: SensorSample) -> bool:
        core = self._core
        reading = self._depth.sample(record)
        bursts_come = record.arrived_s - max(self._burst_s, self._first_s or 0.0) < BURSTS_GONE_S
        angles = None if bursts_come else self._imu.angles(record, core.place.declination_rad)
        if not bursts_come and record.imu_alive and record.roll_rad is not None:
            self._angles_s = record.arrived_s
        self._offer_depth(reading)
        self._positions.gps_sample(record, self._output.distance_m)
        if bursts_come:
            return False
        return self._without_imu(record.measured_s, angles)

    def _on_attitude(self, record: VehicleAttitude) -> bool:
        if record.arrived_s - max(self._burst_s, self._angles_s) < LINK_IMU_GONE_S:
            return False
        measured_s = self._clocks.measured_s(record)
        if self._autopilot_s < max(self._burst_s, self._angles_s):
            self._core.say("The IMU is silent: the autopilot's attitude is used instead", EventLevel.WARNING)
        self._autopilot_s = record.arrived_s
        return self._without_imu(measured_s, self._imu.autopilot(record, measured_s))

    def _on_ctd(self, record: CtdSample) -> bool:
        self._depth.water.latitude_deg = self._core.place.latitude_deg
        self._depth.water.take(record, self._depth.surface_pressure_pa)
        self._aids.water(record)
        if self._acoustics is not None:
            self._acoustics.water(record)
        return False

    def _on_gps(self, record: GpsFix) -> bool:
        self._positions.gps_frame(record, self._output.distance_m)
        self._actions.calibrations.feed_course(record, self._thrust.ahead_mps(record.measured_s))
        return self._catch_up(record.measured_s, record.arrived_s)

    def _on_fix(self, record: PositionFix) -> bool:
        assert self._first_s is not None
        if self._core.timeline is None and record.arrived_s - self._first_s > FIXES_ALONE_AFTER_S:
            # Nobody tells an attitude; the fixes alone make a track all the same.
            self._begin(Start.upright(record.measured_s))
        self._positions.fix(record)
        return self._catch_up(record.measured_s, record.arrived_s)

    def _on_acoustics(self, record: AcousticFix) -> bool:
        assert self._acoustics is not None
        self._acoustics.take(record)
        return self._catch_up(record.measured_s, record.arrived_s)

    def _on_servos(self, record: VehicleServoOutput) -> bool:
        core = self._core
        measured_s = self._clocks.measured_s(record)
        if self.options.thrust.layout is None:
            return self._catch_up(measured_s, record.arrived_s) and False
        velocity = self._thrust.servos(record, measured_s, core.depth_m(), core.rate_frd_radps())
        if velocity is not None and core.heading_known():
            core.thrust_s = core.velocity_aid_s = measured_s
            core.offer(velocity)
            self._aids.watch_thrust_scale(measured_s)
        return self._catch_up(measured_s, record.arrived_s) and False

    def _on_battery(self, record: VehicleBattery) -> bool:
        self._thrust.battery(record)
        return False

    def _on_depth(self, record: VehicleDepth) -> bool:
        reading = self._depth.vehicle(record, self._clocks.measured_s(record))
        self._offer_depth(reading)
        return False

    def _on_range(self, record: VehicleRange) -> bool:
        self._output.take_altitude(self._clocks.measured_s(record), record)
        return False

    def _on_motion(self, record: VehicleMotionDelta) -> bool:
        core = self._core
        measured_s = self._clocks.measured_s(record)
        velocity = self._dvl.take(record, measured_s, core.angular_rate_frd_radps)
        if velocity is not None and core.heading_known():
            core.velocity_aid_s = measured_s
            core.offer(velocity)
        return self._catch_up(measured_s, record.arrived_s) and False

    def _offer_depth(self, reading: DepthReading | None) -> None:
        """Into the filter; a zero found after the filter began is as good as its own standard deviation."""
        timeline = self._core.timeline
        if reading is None or timeline is None:
            return
        if self._depth.bias_std_m < self._depth_bias_std_m:
            self._depth_bias_std_m = self._depth.bias_std_m
            timeline.buffer.reset_block("depth_bias", 0.0, self._depth_bias_std_m)
        std_m = self.options.depth.std_m * self._core.book["depth"].noise_scale
        self._core.offer(Depth(reading.at_s, reading.depth_m, std_m))

    def _catch_up(self, to_s: float, arrived_s: float) -> bool:
        """Move on to a record's instant where the IMU is silent; whether that was so."""
        core = self._core
        if core.timeline is None or arrived_s - core.motion_s < self.options.imu.silent_after_s:
            return False
        return self._without_imu(to_s, None)

    def _without_imu(self, to_s: float, angles: SensorAngles | None) -> bool:
        """A step without strapdown: on angles, or on nothing at all."""
        core, options = self._core, self.options.imu
        if core.timeline is None:
            if angles is None:
                return True
            self._begin(Start.of_angles(angles))
        assert core.timeline is not None
        to_s = min(to_s, core.now_s)
        if angles is None and to_s - core.motion_s < options.silent_after_s:
            return False
        self._move_without_imu(to_s)
        if angles is not None:
            core.motion_s = max(core.motion_s, to_s)
            core.angular_rate_frd_radps = None
            core.book["compass"].wait_for(Wait.INSTEAD_OF_ANGLES, core.now_s)
            core.book["imu"].wait_for(None, core.now_s)
            core.offer(angles)
        self._aids.without_imu(core.timeline.at_s, angles is not None)
        return True

    def _move_without_imu(self, to_s: float) -> None:
        """On a measured velocity, on the habits of an ROV, or adrift."""
        core, options = self._core, self.options.imu
        assert core.timeline is not None
        walk, time_s = options.kinematic_velocity_walk_mps, math.inf
        core.motion_measured = to_s - core.velocity_aid_s < VELOCITY_MISSED_AFTER_S
        adrift = to_s - (core.last_fix_s or -math.inf) > options.adrift_after_s
        if core.motion_measured or adrift:
            core.pace.hold()
        if not core.motion_measured:
            walk, time_s = core.pace.walk_mps, options.kinematic_velocity_time_s
            if adrift:
                walk, time_s = options.adrift_velocity_walk_mps, options.adrift_velocity_time_s
            self._aids.wander_off(to_s)
        core.timeline.kinematic(to_s, options.kinematic_attitude_walk_rad, walk, time_s)

    def _begin(self, start: Start) -> None:
        """The first attitude is there."""
        core = self._core
        saved, self._saved = self._saved, None
        age_s = None
        if saved is not None:
            assert self._first_s is not None
            age_s = age_of(saved, self._saved_age_s, self._first_s, start.at_s)
        recent = age_s is not None and age_s <= self.options.save_limit_s
        if saved is not None and recent and saved.surface_pressure_pa is not None:
            self._depth.resume_zero(saved.surface_pressure_pa)
        depth_m = self._depth.newest_m or 0.0
        self._depth_bias_std_m = self._depth.bias_std_m
        place = core.place
        filter_ = make_filter(
            start, self.options, core.calibration, depth_m, self._depth.bias_std_m, place.latitude_deg
        )
        if saved is not None:
            if saved.origin_deg is not None and recent:
                place.settle(*saved.origin_deg)
            if resume(core, filter_, saved, age_s, start):
                self._output.distance_m = saved.distance_m
        if self._recorders is not None:
            filter_.recorder = recorder = StepRecorder()
            self._recorders.append(recorder)
            recorder.predicted(filter_.estimate, filter_.covariance, None, None)
        core.begin(filter_)
        core.motion_s = start.at_s

    def _realign(self, samples: list[Any], field: Array | None) -> None:
        """The IMU is back after a long silence: gravity and field say again where down and north are."""
        core = self._core
        assert core.timeline is not None
        for sample in samples:
            start = self._start.add(sample, field, core.place.declination_rad)
            if start is None:
                continue
            core.timeline.kinematic(
                start.at_s, self.options.imu.kinematic_attitude_walk_rad, self.options.imu.kinematic_velocity_walk_mps
            )
            core.timeline.buffer.reset_block("attitude", start.rotation_ned_frd, start.std_rad)
            core.motion_s = start.at_s
            core.reset_counter += 1
            core.say("The IMU is back: the attitude was found anew")
            self._start.clear()
            return
        if self._start.fault is not None:
            core.book["imu"].refuse(self._start.fault, core.now_s)
