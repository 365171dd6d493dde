"""What every guided calibration has in common.

A routine is made, fed with samples, and says in words what to do next and how far it is. `finish` gives the result or
raises `CalibrationError`, whose text says what was wrong and how to do it better: it never gives a result that it does
not believe.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.attitude.calibration import (
    AccelerometerCalibration,
    GyroCalibration,
    MagnetometerCalibration,
)
from bluerov_slam.navigation.attitude.quaternion import Vector


class RoutineState(StrEnum):
    """Where a routine stands."""

    RUNNING = "running"
    READY = "ready"  # enough for a result; more makes it better


class InertialSample(NamedTuple):
    """One nine-axis sample as the sensor gave it, body FRD; the field in raw units, None where there is none."""

    at_s: float
    angular_rate_radps: Vector
    specific_force_mps2: Vector
    magnetic_field_raw: Vector | None


class Routine(Protocol):
    """What a page needs of any of them."""

    kind: str

    @property
    def state(self) -> RoutineState:
        """Whether `finish` may be tried."""
        ...

    @property
    def progress(self) -> float:
        """0..1."""
        ...

    @property
    def instruction(self) -> str:
        """One or two sentences: what the user does now."""
        ...


class InertialRoutine(Routine, Protocol):
    """One that lives on inertial samples alone: gyro, accelerometer, magnetometer."""

    def feed(self, sample: InertialSample) -> None:
        """Take one sample; what is not finite is left out."""
        ...

    def finish(
        self, made_unix_s: float | None = None
    ) -> GyroCalibration | AccelerometerCalibration | MagnetometerCalibration:
        """The result, dated. Raises CalibrationError."""
        ...


class JudgedRoutine:
    """Progress that is worked out from all samples, now and then, because at each one it would cost too much."""

    LEAST_SAMPLES: ClassVar[int]
    JUDGED_EVERY: ClassVar[int]

    def __init__(self) -> None:
        self._progress = 0.0
        self._since = 0

    @property
    def state(self) -> RoutineState:
        """READY when enough is known."""
        return RoutineState.READY if self._progress >= 1.0 else RoutineState.RUNNING

    @property
    def progress(self) -> float:
        """How near the result is to being good enough, 0..1."""
        return self._progress

    def _is_due(self, samples: int) -> bool:
        """Whether to judge anew, now that one more sample makes so many: the more there are, the more rarely."""
        self._since += 1
        if samples < self.LEAST_SAMPLES or self._since < max(self.JUDGED_EVERY, samples // 8):
            return False
        self._since = 0
        return True


class Window(NamedTuple):
    """Mean of the samples of about a second. `still` is False where the sensor moved in it, None where it is frozen."""

    still: bool | None
    rate_radps: NDArray[np.float64]
    force_mps2: NDArray[np.float64]
    field_raw: NDArray[np.float64] | None
    samples: int


class StillWindows:
    """Cuts samples into windows and tells rest from motion.

    The limits are some five times what autopilots of BlueROV2s measure on the bench (0.09 deg/s, 0.03 m/s2 rms).
    """

    LENGTH_S = 1.0
    GAP_S = 0.5
    RATE_STD_RADPS = math.radians(0.4)
    FORCE_STD_MPS2 = 0.15
    LEAST_SAMPLES = 4

    def __init__(self) -> None:
        self._samples: list[InertialSample] = []

    def feed(self, sample: InertialSample) -> Window | None:
        """A window when one is full. A gap, or time going backwards, begins a new one."""
        if not _finite(sample):
            return None
        if self._samples and not 0.0 < sample.at_s - self._samples[-1].at_s <= self.GAP_S:
            self._samples = []
        self._samples.append(sample)
        if sample.at_s - self._samples[0].at_s < self.LENGTH_S or len(self._samples) < self.LEAST_SAMPLES:
            return None
        samples, self._samples = self._samples, []
        rates = np.array([s.angular_rate_radps for s in samples])
        forces = np.array([s.specific_force_mps2 for s in samples])
        fields = [s.magnetic_field_raw for s in samples if s.magnetic_field_raw is not None]
        rate_std, force_std = float(rates.std(axis=0).max()), float(forces.std(axis=0).max())
        still: bool | None = rate_std < self.RATE_STD_RADPS and force_std < self.FORCE_STD_MPS2
        if not np.ptp(rates, axis=0).any() and not np.ptp(forces, axis=0).any():
            still = None  # no sensor is that quiet
        return Window(
            still=still,
            rate_radps=rates.mean(axis=0),
            force_mps2=forces.mean(axis=0),
            field_raw=np.mean(fields, axis=0) if fields else None,
            samples=len(samples),
        )


def angle_rad(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Angle between two vectors."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def _finite(sample: InertialSample) -> bool:
    field = sample.magnetic_field_raw or (0.0, 0.0, 0.0)
    return math.isfinite(sample.at_s + sum(sample.angular_rate_radps) + sum(sample.specific_force_mps2) + sum(field))
