"""The thesis's receiver on top of a simulated rig: it hears each pulse and says the fifteen numbers its board says.

A pulse goes the whole way: from where the transmitter stands, through air and by the floor, into four receivers of
unequal resonance, through trigger and window into 2048 samples. The board then does what its firmware does: argmax of
correlations, the receivers turned by its attitude, Hooke and Jeeves at the x it was told, two Kalman filters, and a
dead reckoning that looks at the norm of the acceleration only. Its compass wobbles; its roll and pitch do a little.

`Heard` keeps what the board had to work with, so that another chain can be given the same.

All figures are the simulator's own. Source: thesis chapters 3 to 5, as corrected in docs/acoustics.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.hooke_jeeves import hooke_jeeves_2d
from bluerov_slam.acoustics.thesis_depth_noise import normal_sequence
from bluerov_slam.acoustics.thesis_filters import ThesisState, Triple, step, step_fused
from bluerov_slam.acoustics.time_differences.estimate import estimate_delays
from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.simulation.acoustic_paths import Medium, Reflector
from bluerov_slam.simulation.acoustic_record import AcousticSetup, SimulatedRecord, Tolerances, simulate_record
from bluerov_slam.simulation.noise_processes import GaussMarkov
from bluerov_slam.simulation.rig import Track

Array = NDArray[np.float64]

SOUND_SPEED_MPS = 343.0
ABSORPTION_DB_PER_M = 1.3
_MM = 1e3
_GRAVITY_MPS2 = 9.80665
_IMU_RATE_HZ = 208.0
_MOVING_SHARE = 0.04
"""The firmware counts as moving what changes the norm of the acceleration by this share of gravity."""
_ROUNDED_SAMPLES = 8
_DEPTH_NUMBERS = 1 << 14


@dataclass(frozen=True, slots=True)
class ReceiverFigures:
    """Of one board, its place of work and its transmitter; ranges are drawn from evenly, the rest are deviations."""

    resonance: float = 0.01
    filter_corner: float = 0.10
    gain: float = 0.10
    place_mm: float = 0.5  # of each receiver in the array
    noise_counts: tuple[float, float] = (6.0, 14.0)
    peak_counts_at_1m: float = 1800.0
    floor_echo: tuple[float, float] = (0.1, 0.4)
    transmitter_mm: float = 2.5  # of the surveyed place, each axis; 5 mm are stated as the most
    wobble_deg: tuple[float, float] = (0.36, 0.56)
    wobble_s: tuple[float, float] = (40.0, 80.0)
    compass_noise_deg: float = 0.05
    level_noise_deg: float = 0.04
    level_wander_deg: float = 0.10
    level_wander_s: float = 90.0
    gyro_noise_deg_per_rt_s: float = 0.005
    gyro_bias_deg_per_s: float = 0.003
    depth_noise_mm: float = 0.5
    pulse_period_s: tuple[float, float] = (1.0126, 1.0164)
    acceleration_noise_mps2: float = 0.02


@dataclass(frozen=True, eq=False)
class Heard:
    """One pulse: what the board had, what it made of it, and (`true_`) what was so.

    Attributes:
        samples: (4, n) counts, receiver 0 first.
        x_mm: The x it goes by: as told, less its made-up noise.
        attitude_rad: Roll, pitch and yaw by its compass.
        gyro_turn_rad: Yaw by the gyro since the pulse before.
        displacement_mm: Its dead reckoning since the pulse before, rig frame.
        acoustic_mm, fused_mm, raw_mm: The three positions it sends, (3,), rig frame.
    """

    at_s: float
    samples: Array
    sample_rate_hz: float
    x_mm: float
    attitude_rad: Array
    gyro_turn_rad: float
    interval_s: float
    displacement_mm: Array
    acoustic_mm: Array
    fused_mm: Array
    raw_mm: Array
    true_delays_s: Array
    true_source_mm: Array


class SimulatedReceiver:
    """A board of its own receivers; `transmitter_mm` is where the survey says that the transmitter stands."""

    def __init__(
        self,
        seed: int,
        transmitter_mm: tuple[float, float, float],
        figures: ReceiverFigures | None = None,
        start_yaw_rad: float = 0.0,
        set_seed: int | None = None,
    ) -> None:
        """`seed` is the session's; `set_seed` that of board and transmitter, the same for sessions with the same ones.

        `start_yaw_rad`: the array's true yaw when the board is started; it says zero there.
        """
        self._figures = drawn = figures or ReceiverFigures()
        self._seed = seed
        self._random = random = np.random.default_rng([seed, 0x4EC])
        self.surveyed_mm: Array = np.array(transmitter_mm, np.float64)
        parts = seed if set_seed is None else set_seed
        # The same transmitter is set up anew for each place, and stays there for all sessions of that place.
        there = np.random.default_rng([parts, *(int(value) + (1 << 20) for value in transmitter_mm)])
        self.true_transmitter_mm: Array = self.surveyed_mm + drawn.transmitter_mm * there.standard_normal(3)
        self.array = ReceiverArray.cross(sample_skew_s=[0.0, THESIS_RANK_SKEW_S, 0.0, THESIS_RANK_SKEW_S])
        off_m = drawn.place_mm / _MM * np.random.default_rng([parts, 0xA44]).standard_normal((4, 3))
        self._setup = AcousticSetup(
            ReceiverArray(self.array.positions_m + off_m, self.array.sample_skew_s),
            medium=Medium(SOUND_SPEED_MPS, ABSORPTION_DB_PER_M),
            directivity=True,
            tolerances=Tolerances(drawn.resonance, 0.0, drawn.filter_corner, drawn.gain, 0.0),
            receiver_set=parts,
            snr_db=None,
            noise_counts=random.uniform(*drawn.noise_counts),
            peak_counts=None,
            peak_counts_at_1m=drawn.peak_counts_at_1m,
        )
        self._echo = random.uniform(*drawn.floor_echo)
        self.period_s: float = random.uniform(*drawn.pulse_period_s)
        wobble = math.radians(random.uniform(*drawn.wobble_deg))
        self._wobble = GaussMarkov(random, [wobble], random.uniform(*drawn.wobble_s))
        level = math.radians(drawn.level_wander_deg)
        self._level = GaussMarkov(random, [level, level], drawn.level_wander_s)
        self._gyro_bias = math.radians(drawn.gyro_bias_deg_per_s) * random.standard_normal()
        # The firmware takes its yaw less one reading at the start: that reading's error stays with the session.
        self._start_yaw = start_yaw_rad + float(self._wobble.at(0.0)[0]) + self._compass_noise()
        self._depth_noise = iter(drawn.depth_noise_mm * normal_sequence(_DEPTH_NUMBERS))
        self._told_mm = math.nan
        self._acoustic = self._fused = ThesisState()
        self._last_s: float | None = None
        self._last_yaw = start_yaw_rad
        self._heard = 0

    def tell(self, x_m: float) -> None:
        """The x that the array will have."""
        self._told_mm = x_m * _MM

    def listen(
        self, at_s: float, place_mm: Array, rotation: Array, track: Track | None = None, *, starting: bool = False
    ) -> Heard | None:
        """The pulse of this instant at the array's true pose, `rotation` turning its axes into the rig's.

        `track`: how the rig moved since the pulse before. `starting`: the board waits for its attitude to settle, and
        its filters do not run yet. None where the trigger did not trip.
        """
        record = self._record(place_mm, rotation)
        if not record.triggered:
            return None
        interval = self.period_s if self._last_s is None else at_s - self._last_s
        attitude, turn = self._attitude(at_s, interval, rotation)
        displacement = self._dead_reckoning(track)
        x_mm = self._told_mm if starting else self._told_mm - next(self._depth_noise)
        raw = self._fix_mm(record, attitude, x_mm)
        if not starting:
            fix_m, moved_m = _triple(raw / _MM), _triple(displacement / _MM)
            self._acoustic = step(self._acoustic, fix_m, interval)
            self._fused = step_fused(self._fused, fix_m, moved_m, interval)
        self._last_s, self._heard = at_s, self._heard + 1
        return Heard(
            at_s,
            record.samples,
            record.sample_rate_hz,
            x_mm,
            attitude,
            turn,
            interval,
            displacement,
            _MM * np.array(self._acoustic.position_m),
            _MM * np.array(self._fused.position_m),
            raw,
            record.delays_s,
            _MM * record.source_m,
        )

    def _record(self, place_mm: Array, rotation: Array) -> SimulatedRecord:
        """The floor is the rig's foot: z = 0, seen from the turned array."""
        down = rotation.T @ np.array((0.0, 0.0, 1.0))
        floor = Reflector(_triple(down), -float(place_mm[2]) / _MM, self._echo)
        source_m = rotation.T @ (self.true_transmitter_mm - place_mm) / _MM
        setup = replace(self._setup, reflectors=(floor,))
        return simulate_record(setup, source_m, self._seed * _DEPTH_NUMBERS + self._heard)

    def _attitude(self, at_s: float, interval_s: float, rotation: Array) -> tuple[Array, float]:
        """What the board says, and the gyro's turn since the pulse before."""
        true = euler_rad(rotation)
        noise = math.radians(self._figures.level_noise_deg) * self._random.standard_normal(2)
        level = true[:2] + self._level.at(at_s) + noise
        yaw = true[2] + float(self._wobble.at(at_s)[0]) + self._compass_noise() - self._start_yaw
        spread = math.radians(self._figures.gyro_noise_deg_per_rt_s) * math.sqrt(max(interval_s, 0.0))
        turn = true[2] - self._last_yaw + self._gyro_bias * interval_s + spread * self._random.standard_normal()
        self._last_yaw = float(true[2])
        return np.array((level[0], level[1], yaw)), float(turn)

    def _compass_noise(self) -> float:
        return math.radians(self._figures.compass_noise_deg) * float(self._random.standard_normal())

    def _fix_mm(self, record: SimulatedRecord, attitude: Array, x_mm: float) -> Array:
        """As published: 343 m/s, no skew, receivers as drawn."""
        found = estimate_delays(record.samples, record.sample_rate_hz, self.array, SOUND_SPEED_MPS, "thesis")
        turned = self.array.subset(found.receivers.tolist()) @ rotations(attitude[None])[0].T
        depth_m = (self.surveyed_mm[0] - x_mm) / _MM
        source = hooke_jeeves_2d(turned, found.delays_s, SOUND_SPEED_MPS, depth_m).position_m
        fix: Array = self.surveyed_mm - _MM * source
        fix[0] = x_mm
        return fix

    def _dead_reckoning(self, track: Track | None) -> Array:
        """Displacement (3,) mm as the firmware finds it: counts only while the acceleration's norm is not gravity's."""
        if track is None or len(track.times_s) < 2:
            return np.zeros(3)
        times = np.arange(track.times_s[0] - 0.2, track.times_s[-1] + 0.5, 1.0 / _IMU_RATE_HZ)
        places = np.array([np.interp(times, track.times_s, axis) for axis in track.places_mm.T]).T / _MM
        # Plates and tool have inertia: it rounds every corner over some samples.
        places = _rounded(places, _ROUNDED_SAMPLES)
        acceleration = np.gradient(np.gradient(places, axis=0), axis=0) * _IMU_RATE_HZ**2
        acceleration += self._figures.acceleration_noise_mps2 * self._random.standard_normal(acceleration.shape)
        force = acceleration - np.array((0.0, 0.0, _GRAVITY_MPS2))
        moving = np.abs(np.linalg.norm(force, axis=1) / _GRAVITY_MPS2 - 1.0) > _MOVING_SHARE
        if not moving.any():
            return np.zeros(3)
        first, last = int(np.argmax(moving)), len(moving) - int(np.argmax(moving[::-1]))
        counted = np.where(moving[first:last, None], acceleration[first:last], 0.0)
        velocity = np.cumsum(counted, axis=0) / _IMU_RATE_HZ
        # What is left of the velocity at rest is taken for a drift that grew evenly.
        velocity -= np.linspace(0.0, 1.0, len(velocity))[:, None] * velocity[-1]
        moved: Array = _MM * velocity.sum(axis=0) / _IMU_RATE_HZ
        return moved


def euler_rad(rotation: Array) -> Array:
    """Roll, pitch, yaw (3,) of Rz(yaw) Ry(pitch) Rx(roll)."""
    return np.array(
        (
            math.atan2(rotation[2, 1], rotation[2, 2]),
            -math.asin(max(-1.0, min(1.0, rotation[2, 0]))),
            math.atan2(rotation[1, 0], rotation[0, 0]),
        )
    )


def _rounded(places: Array, samples: int) -> Array:
    """Twice the moving mean over `samples`."""
    kernel = np.convolve(np.ones(samples), np.ones(samples)) / samples**2
    padded = np.pad(places, ((len(kernel) // 2, len(kernel) // 2), (0, 0)), mode="edge")
    return np.array([np.convolve(axis, kernel, mode="valid") for axis in padded.T]).T


def _triple(values: Array) -> Triple:
    return float(values[0]), float(values[1]), float(values[2])
