"""Acoustic records in, AcousticFix out: the one path of live operation, replay and batch.

Every pulse gives one fix, good or not. Nothing here reads a clock: the same records and states give the same fixes,
bit for bit.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.message.demodulation import demodulate
from bluerov_slam.acoustics.receiver_faults import LEAST_RATE_HZ, SwapWatch
from bluerov_slam.acoustics.time_differences.estimate import estimate_delays
from bluerov_slam.pipeline.acoustic_beacon import Beacons
from bluerov_slam.pipeline.acoustic_callers import LARGEST_STD_RAD, TWO_TEXT, Callers
from bluerov_slam.pipeline.acoustic_delays import (
    count_mismatch,
    differences_of,
    with_model_errors,
    with_slips,
)
from bluerov_slam.pipeline.acoustic_options import AcousticOptions
from bluerov_slam.pipeline.acoustic_order import OrderWatch
from bluerov_slam.pipeline.acoustic_position import Poses, direction_of, expected_of, place, solve_direction
from bluerov_slam.records import (
    AcousticFix,
    AcousticMessage,
    AcousticRecord,
    CtdSample,
    Event,
    NavState,
    TimeDifferenceReading,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any, Protocol

    from numpy.typing import NDArray

    from bluerov_slam.acoustics.time_differences.result import TimeDifferences
    from bluerov_slam.pipeline.acoustic_callers import Expected
    from bluerov_slam.pipeline.acoustic_position import Pose
    from bluerov_slam.records import Record

    Array = NDArray[np.float64]

    class NavigatorLike(Protocol):
        """What of `pipeline.navigator.Navigator` is used here."""

        def feed(self, record: Record) -> list[NavState | Event]: ...


# The board's own delays and the record of one pulse carry the stamp of the same sample.
SAME_PULSE_S: Final = 0.05
PULSES_KEPT: Final = 64
# A record of a whole message is long, and sampled too slowly for the delays.
MESSAGE_RECORD_S: Final = 0.1
# Below the first the carrier is not in the samples, above the second no converter of such a board samples.
SAMPLE_RATES_HZ: Final = (LEAST_RATE_HZ, 20e6)
# With more than this share of a record lost, what is left of it may mislead.
LARGEST_LOSS: Final = 0.1
# A wrong carrier cell more likely than this, and nobody may rely on the direction.
AMBIGUOUS: Final = 0.2
# A CTD that was silent for longer may have been in other water.
SOUND_SPEED_KEPT_S: Final = 600.0
SOUND_SPEEDS_MPS: Final = (300.0, 1700.0)
# Sea water has 1450 to 1550 m/s: what a setting that nobody measures may be off by, relative, one sigma.
UNMEASURED_SPEED_STD: Final = 0.01
AMBIGUOUS_TEXT: Final = "a receiver may be wrong by one period of the carrier, and nothing tells which"
EXCHANGED_CURE: Final = "check the order of their plugs and of acoustics.places_m"

Heard = AcousticFix | AcousticMessage


class AcousticPipeline:
    """Takes records in order of arrival, and the navigator's states between them."""

    def __init__(self, options: AcousticOptions | None = None) -> None:
        self.options = options or AcousticOptions()
        self._poses = Poses()
        self._beacons = Beacons(self.options)
        self._sound_speed: tuple[float, float] | None = None
        self._swaps = SwapWatch(self.options.array)
        self._order = OrderWatch(self.options.array)
        self._callers = Callers()
        self._message: AcousticMessage | None = None
        self._judged_s: deque[float] = deque(maxlen=PULSES_KEPT)

    def observe(self, state: NavState) -> None:
        """Take a state of the navigator: attitude and depth."""
        self._poses.observe(state)

    def feed(self, record: Record) -> list[Heard]:
        """Take one record; other types than its own are passed over. A message comes out that a raw record held."""
        if isinstance(record, TimeDifferenceReading):
            return self._new(self._safely(self._of_reading, record))
        if isinstance(record, AcousticRecord):
            if record.samples.shape[1] / record.sample_rate_hz > MESSAGE_RECORD_S:
                return self._messages_of(record)
            return [] if self._is_judged(record.measured_s) else self._new(self._safely(self._of_record, record))
        if isinstance(record, CtdSample):
            self._on_ctd(record)
        elif isinstance(record, AcousticMessage):
            self._hear(record)
        return []

    def _safely(
        self, judge: Callable[[Any], AcousticFix], record: TimeDifferenceReading | AcousticRecord
    ) -> AcousticFix:
        """Numbers that nobody thought of must not end the navigation that runs beside this."""
        try:
            return judge(record)
        except (ArithmeticError, LookupError, ValueError, np.linalg.LinAlgError) as error:
            base = self._nothing(record.measured_s, record.arrived_s)
            return replace(base, reason=f"this pulse cannot be evaluated ({error})")

    def _new(self, fix: AcousticFix) -> list[Heard]:
        held = self._held_back(fix)
        if held:
            # Its alternatives go, too: the navigator would try them.
            fix = replace(
                fix,
                accepted=False,
                reason=held,
                alternatives=(),
                range_m=None,
                range_std_m=None,
                position_deg=None,
                covariance_ned_m2=None,
            )
        if fix.accepted:
            self._judged_s.append(fix.measured_s)
        return [fix]

    def _held_back(self, fix: AcousticFix) -> str:
        """Why a pulse that may be sound in itself is not ours to use; empty: it is."""
        if fix.azimuth_rad is None or fix.elevation_rad is None:
            return TWO_TEXT if self._callers.two and fix.alternatives else ""
        options, pose = self.options, self._poses.at(fix.measured_s)
        level = math.cos(fix.elevation_rad)
        direction = np.array(
            (level * math.cos(fix.azimuth_rad), level * math.sin(fix.azimuth_rad), math.sin(fix.elevation_rad))
        )
        expected = None
        if pose is not None:
            direction = pose.rotation_ned_frd @ direction
            expected = expected_of(pose, self._beacons.at(fix.arrived_s), options)
            if exchanged := self._exchanged(fix, pose, expected):
                return f"{exchanged}; {EXCHANGED_CURE}"
        message = self._message
        if message is not None and abs(message.measured_s - fix.measured_s) > SAME_PULSE_S:
            message = None
        callers = self._callers
        was = callers.ours
        held = callers.hear(fix.measured_s, direction, pose is not None, fix.range_m, expected, message)
        if callers.ours is not None and (callers.ours is not was or message is not None):
            self._beacons.forget()
            if callers.ours.message is not None:
                self._beacons.hear(callers.ours.message)
        return held

    def _exchanged(self, fix: AcousticFix, pose: Pose, expected: Expected | None) -> str:
        """Receivers in another order, whom the directions betray."""
        array = self.options.array
        if len(fix.receivers) != len(array) or self._callers.two:
            return ""
        arrivals_s = np.zeros(len(array))
        arrivals_s[list(fix.receivers[1:])] = -np.array(fix.delays_s)
        return self._order.hear(
            fix.measured_s,
            arrivals_s * fix.sound_speed_mps,
            pose.rotation_ned_frd @ self.options.mounting.rotation_frd_array,
            expected if expected is not None and expected.std_rad < LARGEST_STD_RAD else None,
        )

    def _hear(self, message: AcousticMessage) -> None:
        """Whose message this is, its pulse will tell where there are two."""
        self._message = message
        if not self._callers.two:
            self._beacons.hear(message)

    def _is_judged(self, measured_s: float) -> bool:
        """Whether delays of this pulse were taken already: its record would only say the same once more."""
        return any(abs(measured_s - judged_s) < SAME_PULSE_S for judged_s in self._judged_s)

    def _on_ctd(self, sample: CtdSample) -> None:
        speed = sample.sound_speed_mps
        if speed is not None and SOUND_SPEEDS_MPS[0] <= speed <= SOUND_SPEEDS_MPS[1]:
            self._sound_speed = (speed, sample.arrived_s)

    def _of_reading(self, reading: TimeDifferenceReading) -> AcousticFix:
        base = replace(
            self._nothing(reading.measured_s, reading.arrived_s),
            signal_std_counts=_known(reading.signal_std_counts),
            frame_bits=reading.frame_bits,
        )
        arrivals_s = np.insert(-reading.delays_s, reading.reference, 0.0)
        swapped = self._swaps.hear(arrivals_s, base.sound_speed_mps)
        if swapped is not None:
            what, _, _ = swapped.text.partition(":")  # its figures change with every pulse
            return replace(base, reason=f"{what}; {EXCHANGED_CURE}")
        found = differences_of(reading, self.options, base.sound_speed_mps)
        return replace(base, reason=found) if isinstance(found, str) else self._judged(base, found)

    def _of_record(self, record: AcousticRecord) -> AcousticFix:
        samples = record.samples.astype(np.float64)
        base = replace(
            self._nothing(record.measured_s, record.arrived_s),
            signal_std_counts=_known(samples.std(axis=1)),
            record_id=record.record_id,
        )
        array = self.options.array
        if len(samples) != len(array):
            return replace(base, reason=count_mismatch(len(samples), len(array)))
        low_hz, high_hz = SAMPLE_RATES_HZ
        if not low_hz <= record.sample_rate_hz <= high_hz:
            return replace(
                base, reason=f"a sample rate of {record.sample_rate_hz:.0f} Hz, expected {low_hz:.0f} to {high_hz:.0f}"
            )
        lost = record.missing_samples / samples.shape[1]
        if lost > LARGEST_LOSS:
            return replace(base, reason=f"{100.0 * lost:.0f} % of the record did not arrive; see the link's load")
        found = estimate_delays(
            samples, record.sample_rate_hz, array, base.sound_speed_mps, responses=self.options.responses
        )
        return self._judged(base, found)

    def _messages_of(self, record: AcousticRecord) -> list[Heard]:
        try:
            frame = demodulate(record.samples.astype(np.float64), record.sample_rate_hz)
        except ValueError:  # sampled too slowly
            return []
        if frame is None or frame.payload is None:
            return []
        measured_s = record.measured_s + frame.start_s
        message = AcousticMessage(measured_s, record.arrived_s, min(frame.corrected_errors, 255), frame.payload)
        self._hear(message)
        return [message]

    def _nothing(self, measured_s: float, arrived_s: float) -> AcousticFix:
        beacon = self._beacons.at(arrived_s)
        return AcousticFix(
            measured_s=measured_s,
            arrived_s=arrived_s,
            accepted=False,
            reason="",
            sound_speed_mps=self._speed(arrived_s),
            beacon_deg_m=None if beacon is None else beacon.deg_m,
            beacon_std_m=None if beacon is None else beacon.std_m,
            beacon_source=None if beacon is None else beacon.source,
        )

    def _measured_speed(self, now_s: float) -> float | None:
        """What the CTD told of late."""
        if not self.options.sound_speed_fixed and self._sound_speed is not None:
            speed, heard_s = self._sound_speed
            if now_s - heard_s <= SOUND_SPEED_KEPT_S:
                return speed
        return None

    def _speed(self, now_s: float) -> float:
        speed = self._measured_speed(now_s)
        return self.options.sound_speed_mps if speed is None else speed

    def _speed_std(self, now_s: float) -> float:
        """Relative."""
        return UNMEASURED_SPEED_STD if self._measured_speed(now_s) is None else self.options.sound_speed_std

    def _judged(self, base: AcousticFix, differences: TimeDifferences) -> AcousticFix:
        options, speed = self.options, base.sound_speed_mps
        base = replace(base, snr_db=_known(differences.snr_db), excluded=differences.excluded)
        if len(differences.receivers) < 3:
            return replace(base, reason=_too_few(differences))
        timing_s2 = differences.covariance_s2
        differences = with_model_errors(differences, options, speed, self._speed_std(base.arrived_s))
        if math.isnan(differences.slip_probability):
            differences = with_slips(differences, options, speed)
        slip = differences.slip_probability
        solution = solve_direction(differences, options, speed)
        fix = replace(
            base,
            reason=solution.reason,
            receivers=tuple(differences.receivers.tolist()),
            delays_s=tuple(differences.delays_s.tolist()),
            delay_covariance_s2=_rows(timing_s2),  # the filter has states of its own for the rest
            slip_probability=None if math.isnan(slip) else slip,
            alternatives=tuple((tuple(delays.tolist()), share) for delays, share in differences.alternatives),
        )
        if not solution.good:
            return fix
        direction = direction_of(solution, options)
        (a, b), (_, d) = _rows(direction.covariance_rad2)
        fix = replace(
            fix,
            residuals_s=tuple(solution.residuals_s.tolist()),
            azimuth_rad=direction.azimuth_rad,
            elevation_rad=direction.elevation_rad,
            direction_covariance_rad2=((a, b), (b, d)),
        )
        if not math.isnan(slip) and slip > AMBIGUOUS:
            return replace(fix, reason=AMBIGUOUS_TEXT)
        beacon, pose = self._beacons.at(fix.arrived_s), self._poses.at(fix.measured_s)
        placed = place(differences, solution, pose, beacon, options, speed)
        return replace(
            fix,
            accepted=True,
            reason=placed.reason,
            range_m=placed.range_m,
            range_std_m=placed.range_std_m,
            position_deg=placed.position_deg,
            covariance_ned_m2=None if placed.covariance_ned_m2 is None else _rows(placed.covariance_ned_m2),
        )


class AcousticNavigation:
    """The navigator with the array beside it: the navigator's states go to the pipeline, the fixes to the navigator."""

    def __init__(self, navigator: NavigatorLike, options: AcousticOptions | None = None) -> None:
        self.navigator = navigator
        self.pipeline = None if options is None else AcousticPipeline(options)

    def feed(self, record: Record) -> list[NavState | Event | Heard]:
        """Take one record; states, events and fixes in the order in which they came about."""
        results: list[NavState | Event | Heard] = list(self.navigator.feed(record))
        pipeline = self.pipeline
        if pipeline is None:
            return results
        for result in results:
            if isinstance(result, NavState):
                pipeline.observe(result)
        for heard in pipeline.feed(record):
            results.append(heard)
            if pipeline.options.use_for_navigation and isinstance(heard, AcousticFix):
                results += self.navigator.feed(heard)
        return results


def _too_few(differences: TimeDifferences) -> str:
    whole = next((reason for receiver, reason in differences.excluded if receiver < 0), None)
    if whole is not None:
        return whole
    used = len(differences.receivers)
    if used == 0:
        return "no receiver heard a pulse: the transmitter is off, or out of range"
    return f"only {used} of the receivers can be used, and a direction needs 3"


def _known(values: Array) -> tuple[float | None, ...]:
    return tuple(None if math.isnan(value) else value for value in np.asarray(values, float).tolist())


def _rows(matrix: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())
