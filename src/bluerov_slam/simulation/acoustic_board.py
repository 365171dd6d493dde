"""The acoustic receiver board on the vehicle: it hears the beacon, and says so in AA55 frames.

Every pulse goes the whole way: the beacon sends by its own clock, the sound takes the bent ray to where the vehicle is
when it arrives, the receivers' waves are made with their own resonances, echoes and noise, the recorder trips or does
not, and the board computes the delays that it sends from the samples, by the chain that the plan names.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.absorption import sea_absorption_db_per_m
from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.message.demodulation import DemodulatedFrame, demodulate
from bluerov_slam.acoustics.message.frame import message_frame_bits
from bluerov_slam.acoustics.message.report import HOUR_US, BeaconReport
from bluerov_slam.acoustics.pulse_train import FRAME_BITS, REAL_CARRIER_HZ, frame_bits
from bluerov_slam.acoustics.recording import TriggerSettings
from bluerov_slam.acoustics.time_differences import estimate_delays
from bluerov_slam.protocol.acoustic_messages import (
    MessageFields,
    pack_message,
    pack_record_chunk,
    pack_tdoa,
    record_chunks,
    tdoa_fields,
)
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import AcousticRecord
from bluerov_slam.simulation.acoustic_paths import Medium, Reflector
from bluerov_slam.simulation.acoustic_plan import AcousticPlan, parse_receiver_fault
from bluerov_slam.simulation.acoustic_rays import WaterColumn
from bluerov_slam.simulation.acoustic_record import (
    SAMPLE_RATE_HZ,
    AcousticSetup,
    SimulatedRecord,
    Tolerances,
    Window,
    simulate_record,
)
from bluerov_slam.simulation.noise_processes import GaussMarkov
from bluerov_slam.simulation.place import metres_per_degree
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.scene import Scene
from bluerov_slam.simulation.water import WaterProfile

FIRST_PULSE_S = 0.37
_RECORD_SAMPLES = 2048
_COMPUTE_S, _COMPUTE_JITTER_S = 0.045, 0.010
_CHUNK_S = 0.004
_MESSAGE_S = 0.25  # the frame's 0.16 s and the decoder
_MESSAGE_DECIMATION, _MESSAGE_SAMPLES = 8, 19_200
_REMEMBERED = 10_000
_LEAST_RECEIVERS = 3
_SECOND_FASTER = 0.004  # no two clocks agree
_OVERDRIVE, _STUCK_COUNTS = 200.0, -2048.0

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TruePulse:
    """What really happened at one pulse. `delays_s`: of the sound itself, receiver 0 minus the others.

    Times are virtual; `reason` says why the board sent nothing, empty if it did.
    """

    beacon: int
    sent_s: float
    arrived_s: float
    range_m: float
    delays_s: FloatArray
    beacon_ned_m: FloatArray
    array_ned_m: FloatArray
    direction_frd: FloatArray
    snr_db: float
    shadowed: bool
    reason: str


class VirtualAcousticBoard:
    """Beacon and array of a plan. `advance` gives the frames that have left the board, each with its instant.

    `mission_start_s` is the scene's time at virtual time zero, `utc_start_unix_s` the UTC of virtual time zero (the
    beacon's GPS receiver knows it). `clock_us` stamps the frames: by default the board's own timer.
    """

    def __init__(
        self,
        plan: AcousticPlan,
        scene: Scene,
        water: WaterProfile,
        water_depth_m: float,
        seed: int,
        *,
        mission_start_s: float = 0.0,
        utc_start_unix_s: float = 0.0,
        clock_us: Callable[[float], int] | None = None,
    ) -> None:
        self.plan = plan
        self.pulses: list[TruePulse] = []
        errors = plan.error_figures
        self._errors = errors
        self._scene = scene
        self._mission_start_s = mission_start_s
        self._water_depth_m = water_depth_m
        self._column = WaterColumn(water, max(water_depth_m, plan.beacon_depth_m) + 1.0)
        self._absorption_db_per_m = sea_absorption_db_per_m(
            sum(REAL_CARRIER_HZ) / 2.0, water.temperature_degc(5.0), water.salinity_psu(5.0)
        )
        self._utc_start_unix_s = utc_start_unix_s
        rng = np.random.default_rng([seed, 0xAC05])
        self._rng = rng
        self._seed = seed
        self._clock_rate = 1.0 + 1e-6 * errors.board_clock_ppm * _drawn(rng)
        self._booted_before_s = float(rng.uniform(20.0, 500.0))
        self._clock_us = clock_us or self._own_clock_us
        self._period_s = plan.pulse_period_s * (1.0 + errors.beacon_clock * (1.0 + 0.5 * _drawn(rng)))
        self._carrier_hz = float(rng.uniform(*REAL_CARRIER_HZ))
        self._watch_rad = float(rng.uniform(0.0, 2.0 * math.pi))
        self.nominal_array = fitted_array(plan)
        places = self.nominal_array.positions_m
        self.true_array = ReceiverArray(
            places + errors.receiver_place_m * np.clip(rng.standard_normal(places.shape), -2.5, 2.5),
            self.nominal_array.sample_skew_s,
            "as built",
        )
        mounting_rad = errors.mounting_rad * np.clip(rng.standard_normal(3), -2.5, 2.5)
        self.rotation_frd_array = _rotation(mounting_rad) @ rotation_frd_array(plan)
        self._wander = GaussMarkov(rng, (errors.wander_rad, errors.wander_rad), errors.wander_correlation_s)
        self._gps = GaussMarkov(rng, (errors.beacon_gps_m, errors.beacon_gps_m), errors.beacon_gps_correlation_s)
        self._sent = 0
        self._record_wanted = False
        self._records = 0
        self._counter = int(rng.integers(0, 256))
        self._faults = [parse_receiver_fault(fault, len(places)) for fault in plan.faults]
        self._due: list[tuple[float, int]] = [(FIRST_PULSE_S, 0)]
        if plan.second_beacon_ned_m is not None:
            self._due.append((FIRST_PULSE_S + 0.43 * self._period_s, 1))
        self._free_s = 0.0
        self._waiting: list[tuple[float, int, bytes]] = []
        self._order = 0

    def request_record(self) -> None:
        """Send the record of the next pulse that is heard."""
        self._record_wanted = True

    def beacon_ned_m(self, at_s: float, beacon: int = 0) -> FloatArray:
        """Where the beacon is: at its place, or on the circle of its mooring; 1 is the second one, which is fixed."""
        plan, errors = self.plan, self._errors
        if beacon == 1:
            return np.array(plan.second_beacon_ned_m)
        angle = self._watch_rad + 2.0 * math.pi * at_s / errors.beacon_watch_s
        swing_m = errors.beacon_watch_m
        return np.array(
            [
                plan.beacon_north_m + swing_m * math.cos(angle),
                plan.beacon_east_m + swing_m * math.sin(angle),
                plan.beacon_depth_m,
            ]
        )

    def advance(self, until_s: float) -> list[tuple[float, bytes]]:
        """Every frame that has left the board by this virtual time and was not given yet, in order."""
        while self._due[0][0] <= until_s:
            sent_s, beacon = heapq.heappop(self._due)
            self._pulse(sent_s, beacon)
            heapq.heappush(self._due, (sent_s + self._period_s * (1.0 - _SECOND_FASTER * beacon), beacon))
        gone: list[tuple[float, bytes]] = []
        while self._waiting and self._waiting[0][0] <= until_s:
            at_s, _, frame = heapq.heappop(self._waiting)
            gone.append((at_s, frame))
        return gone

    def _pulse(self, sent_s: float, beacon: int) -> None:
        """One pulse from a beacon to the frames."""
        plan = self.plan
        self._sent += 1
        self._counter = (self._counter + 1) % 256
        with_message = plan.message_every > 0 and self._sent % plan.message_every == 0
        report = self._beacon_report(sent_s, beacon).pack() if with_message else None
        setup, truth, source_m = self._hear(sent_s, beacon, report)
        record = self._taken(setup, source_m)
        truth = replace(
            truth, delays_s=record.delays_s, snr_db=float(record.snr_db.mean()), reason=self._refusal(record, truth)
        )
        self.pulses.append(truth)
        del self.pulses[:-_REMEMBERED]
        if truth.reason:
            return
        begin_s = truth.arrived_s - float(record.toa_s.mean())
        t_us = self._clock_us(begin_s)
        done_s = (
            begin_s + _RECORD_SAMPLES / SAMPLE_RATE_HZ + _COMPUTE_S + _COMPUTE_JITTER_S * float(self._rng.uniform())
        )
        heard = self._message(setup, source_m) if with_message else None
        if heard is not None and heard.payload is not None:
            done_s += _MESSAGE_S
            fields = MessageFields(t_us & 0xFFFFFFFF, min(heard.corrected_errors, 255), heard.payload)
            self._send(MessageType.ACOUSTIC_MESSAGE, pack_message(fields), done_s)
        self._send(MessageType.ACOUSTIC_TDOA, self._time_differences(record, t_us, heard), done_s)
        if self._record_wanted or (plan.record_every and self._sent % plan.record_every == 0):
            self._record_wanted = False
            done_s = self._send_record(record, t_us, done_s)
        self._free_s = done_s

    def _beacon_report(self, sent_s: float, beacon: int) -> BeaconReport:
        """What a beacon says of itself: the position its own GPS receiver has, and when it began to send."""
        place_m = self.beacon_ned_m(sent_s, beacon) + np.append(self._gps.at(sent_s), 0.0)
        north_m, east_m = metres_per_degree(self._scene.origin_latitude_deg)
        return BeaconReport(
            self._scene.origin_latitude_deg + float(place_m[0]) / north_m,
            self._scene.origin_longitude_deg + float(place_m[1]) / east_m,
            1.5 * self._errors.beacon_gps_m,
            int(round((self._utc_start_unix_s + sent_s) * 1e6) % HOUR_US),
            float(place_m[2]),
        )

    def _message(self, setup: AcousticSetup, source_m: FloatArray) -> DemodulatedFrame | None:
        """What the board reads out of the whole frame, which it records at an eighth of the rate."""
        slower = replace(
            setup,
            sample_rate_hz=setup.sample_rate_hz / _MESSAGE_DECIMATION,
            noise_counts=setup.noise_counts / math.sqrt(_MESSAGE_DECIMATION),
            window=Window("onset", _MESSAGE_SAMPLES, 64),
        )
        return demodulate(self._taken(slower, source_m).samples, SAMPLE_RATE_HZ / _MESSAGE_DECIMATION)

    def _taken(self, setup: AcousticSetup, source_m: FloatArray) -> SimulatedRecord:
        """The record that the board takes, with what is wrong with its receivers."""
        record = simulate_record(setup, source_m, int(self._rng.integers(1 << 62)))
        samples = record.samples
        half = 1 << (setup.bits_per_sample - 1)
        for kind, who in self._faults:
            if kind == "swapped":
                samples[list(who)] = samples[list(reversed(who))]
            elif kind == "clipped":
                samples[who[0]] = np.clip(_OVERDRIVE * samples[who[0]], -half, half - 1)
            elif kind == "silent":
                samples[who[0]] = np.rint(self.plan.noise_counts * self._rng.standard_normal(samples.shape[1]))
            else:
                samples[who[0]] = _STUCK_COUNTS
        return record

    def _hear(self, sent_s: float, beacon: int, report: bytes | None) -> tuple[AcousticSetup, TruePulse, FloatArray]:
        """Bring one pulse to the array: how it is received, what is true, the apparent source in the array's frame."""
        rng, errors = self._rng, self._errors
        beacon_ned_m = self.beacon_ned_m(sent_s, beacon)
        arrived_s = sent_s
        for _ in range(3):  # the vehicle moves millimetres while the sound travels: this converges at once
            motion = self._scene.motion(np.array([arrived_s + self._mission_start_s]))
            rotation_ned_frd = motion.rotation_ned_frd[0]
            centre_m = motion.position_ned_m[0] + rotation_ned_frd @ np.array(self.plan.lever_arm_frd_m)
            way_m = beacon_ned_m - centre_m
            horizontal_m = math.hypot(way_m[0], way_m[1])
            ray = self._column.direct_ray(float(beacon_ned_m[2]), float(centre_m[2]), horizontal_m)
            arrived_s = sent_s + ray.travel_s
        wander_rad = self._wander.at(arrived_s) + rng.laplace(0.0, 1.0, 2) * errors.jitter_rad
        azimuth_rad = math.atan2(way_m[1], way_m[0]) + float(wander_rad[0])
        elevation_rad = ray.elevation_rad + float(wander_rad[1])
        direction_ned = np.array(
            [
                math.cos(elevation_rad) * math.cos(azimuth_rad),
                math.cos(elevation_rad) * math.sin(azimuth_rad),
                math.sin(elevation_rad),
            ]
        )
        rotation_ned_array = rotation_ned_frd @ self.rotation_frd_array
        distance_m = ray.travel_s * ray.sound_speed_mps
        closing_mps = float(motion.velocity_ned_mps[0] @ direction_ned)
        shadowed = bool(rng.uniform() < errors.shadowed_share)
        setup = AcousticSetup(
            array=self.true_array,
            sample_rate_hz=SAMPLE_RATE_HZ * self._clock_rate,
            medium=Medium(ray.sound_speed_mps, self._absorption_db_per_m),
            reflectors=self._reflectors(rotation_ned_array, float(centre_m[2]), shadowed),
            bits=message_frame_bits(self._counter, report) if report is not None else frame_bits(self._counter),
            carrier_hz=(self._carrier_hz * (1.0 + closing_mps / ray.sound_speed_mps),) * 2,
            tolerances=Tolerances(errors.resonance, 0.0, errors.filter_corner, errors.gain),
            receiver_set=self._seed,
            snr_db=None,
            noise_counts=self.plan.noise_counts * (1.0 + errors.thruster_noise * float(motion.amperes[0])),
            peak_counts=None,
            peak_counts_at_1m=self.plan.peak_counts_at_1m,
            direct_gain=errors.shadowed_gain if shadowed else 1.0,
            window=Window("ring" if self.plan.pre_trigger_samples else "blocks", _RECORD_SAMPLES,
                          self.plan.pre_trigger_samples),
            trigger=TriggerSettings(),
        )  # fmt: skip
        truth = TruePulse(
            beacon=beacon,
            sent_s=sent_s,
            arrived_s=arrived_s,
            range_m=float(np.linalg.norm(way_m)),
            delays_s=np.zeros(0),
            beacon_ned_m=beacon_ned_m,
            array_ned_m=centre_m,
            direction_frd=rotation_ned_frd.T @ (way_m / np.linalg.norm(way_m)),
            snr_db=-math.inf,
            shadowed=shadowed,
            reason="",
        )
        return setup, truth, rotation_ned_array.T @ direction_ned * distance_m

    def _refusal(self, record: SimulatedRecord, truth: TruePulse) -> str:
        if truth.arrived_s < self._free_s:
            return "the board was still busy"
        if not record.triggered:
            return "too weak to trip the trigger"
        # Our board is content with three receivers; the thesis's wants all four.
        enough = (record.samples.std(axis=1, ddof=1) > self.plan.accept_std_counts).sum()
        if enough < (len(record.samples) if self.plan.chain == "thesis" else _LEAST_RECEIVERS):
            return "a receiver hears too little"
        return ""

    def _reflectors(self, rotation_ned_array: FloatArray, depth_m: float, shadowed: bool) -> tuple[Reflector, ...]:
        """Surface and bottom as planes of the array's frame, each as strong as it happens to be for this pulse."""
        errors, rng = self._errors, self._rng
        surface, bottom = rng.rayleigh(1.0, 2) * (errors.surface_echo, errors.bottom_echo)
        if shadowed:
            surface, bottom = max(surface, 0.5), max(bottom, 0.3)
        down = rotation_ned_array.T @ np.array([0.0, 0.0, 1.0])
        found: list[Reflector] = []
        if surface > 0.0 and depth_m > 0.05:
            found.append(Reflector(_tuple(-down), depth_m, -min(0.95, float(surface))))
        height_m = self._water_depth_m - depth_m
        if bottom > 0.0 and height_m > 0.05:
            found.append(Reflector(_tuple(down), height_m, min(0.8, float(bottom))))
        return tuple(found)

    def _time_differences(self, record: SimulatedRecord, t_us: int, heard: DemodulatedFrame | None) -> bytes:
        """Payload of 0x08, computed from the samples by the plan's chain.

        The positioning record holds five of the frame's 14 bits: only a message record beside it tells all of them.
        """
        array = self.nominal_array
        speed_mps = self._column.speed_mps(self.plan.beacon_depth_m)  # only limits how far to look
        found = estimate_delays(record.samples, SAMPLE_RATE_HZ, array, speed_mps, self.plan.chain)
        delays_s = np.full(len(array), math.nan)
        delays_s[found.receivers[1:]] = found.delays_s
        std_counts = record.samples.std(axis=1, ddof=1)
        others = np.delete(delays_s, found.reference)
        bits: int | None = None
        if heard is not None:
            bits = int("".join(str(bit) for bit in heard.hard_bits[:FRAME_BITS].tolist()), 2)
        return pack_tdoa(tdoa_fields(t_us, found.reference, others, std_counts, bits))

    def _send_record(self, record: SimulatedRecord, t_us: int, at_s: float) -> float:
        """Queue a record's chunks from this instant on; when the last one has left."""
        self._records += 1
        whole = AcousticRecord(
            measured_s=0.0,
            arrived_s=0.0,
            record_id=self._records,
            sample_rate_hz=SAMPLE_RATE_HZ,
            samples=np.rint(record.samples).astype(np.int16),
            bits=12,
            trigger_index=record.trigger_index,
        )
        for chunk in record_chunks(whole, t_us):
            at_s += _CHUNK_S
            self._send(MessageType.ACOUSTIC_RECORD, pack_record_chunk(chunk), at_s)
        return at_s

    def _send(self, frame_type: MessageType, payload: bytes, at_s: float) -> None:
        heapq.heappush(self._waiting, (at_s, self._order, encode_frame(frame_type, payload)))
        self._order += 1

    def _own_clock_us(self, at_s: float) -> int:
        return math.floor((at_s + self._booted_before_s) * self._clock_rate * 1e6)


def acoustic_board(
    scenario: Scenario, scene: Scene, clock_us: Callable[[float], int] | None = None
) -> VirtualAcousticBoard:
    """The board of a scenario, with the default plan where the scenario has none."""
    return VirtualAcousticBoard(
        scenario.acoustics or AcousticPlan(),
        scene,
        scenario.water,
        scenario.water_depth_m,
        scenario.seed,
        mission_start_s=scenario.mission_start_s,
        utc_start_unix_s=scenario.utc_start_unix_s,
        clock_us=clock_us,
    )


def rotation_frd_array(plan: AcousticPlan) -> FloatArray:
    """The mounting that the plan states: v_frd = rotation @ v_array."""
    roll, pitch, yaw = (math.radians(angle) for angle in plan.mounting_rpy_deg)
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


def fitted_array(plan: AcousticPlan) -> ReceiverArray:
    """The array that the plan states, sampled as the thesis's board does."""
    places_m = ReceiverArray.cross(plan.arm_m, centre=plan.array == "cross_with_centre").positions_m
    if plan.array == "cross_with_stalk":
        places_m = np.vstack((places_m, (plan.arm_m, 0.0, 0.0)))
    skew_s = np.array([THESIS_RANK_SKEW_S * (receiver % 2) for receiver in range(len(places_m))])
    return ReceiverArray(places_m, skew_s, plan.array)


def _rotation(vector_rad: FloatArray) -> FloatArray:
    """Rotation matrix of a rotation vector."""
    angle = float(np.linalg.norm(vector_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = (vector_rad / angle).tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: FloatArray = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return turned


def _drawn(rng: np.random.Generator) -> float:
    return float(np.clip(rng.standard_normal(), -2.5, 2.5))


def _tuple(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
