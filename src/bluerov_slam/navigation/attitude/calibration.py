"""What is known about the sensors' systematic errors, how to take it out of their readings, and its JSON form.

Every correction is linear in the reading: corrected = matrix (raw - offset). The routines that find the numbers are in
`gyro_routine`, `accelerometer_routine`, `magnetometer_routine`, `swing_routine` and `thruster_field_routine`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import ExpectedError

FORMAT_VERSION = 1
Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class CalibrationError(ExpectedError):
    """A saved calibration that cannot be used; says why."""


def vector(values: NDArray[Any]) -> Vector:
    """Three plain floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def matrix(rows: NDArray[Any]) -> Matrix:
    """Three rows of three plain floats."""
    a, b, c = (vector(row) for row in rows)
    return a, b, c


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a calibration comes from: what is left after it (rms, in `unit`), when and from what it was made.

    `made_unix_s` is None where no wall clock was known.
    """

    residual: float
    unit: str
    source: str
    samples: int
    made_unix_s: float | None = None


@dataclass(frozen=True, slots=True)
class GyroCalibration:
    """Rate of a gyro at rest, and how well it is known (one sigma of the mean)."""

    bias_frd_radps: Vector
    std_radps: Vector
    made: Provenance

    def apply(self, angular_rate_radps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rates (..., 3) without the bias."""
        return np.subtract(angular_rate_radps, self.bias_frd_radps)


@dataclass(frozen=True, slots=True)
class AccelerometerCalibration:
    """Offset (m/s2) and scale (with misalignment where it was solved for)."""

    offset_frd_mps2: Vector
    matrix: Matrix
    made: Provenance

    def apply(self, specific_force_mps2: NDArray[np.float64]) -> NDArray[np.float64]:
        """Specific force (..., 3), corrected."""
        return _corrected(specific_force_mps2, self.offset_frd_mps2, self.matrix)


@dataclass(frozen=True, slots=True)
class MagnetometerCalibration:
    """Hard iron (offset, raw units) and soft iron (matrix, 1 / raw units): the Earth's field comes out with length 1.

    `raw_norm` is the field's length in raw units: what a later check of the magnetometer compares with.
    """

    offset_raw: Vector
    matrix: Matrix
    raw_norm: float
    made: Provenance

    def apply(self, field_raw: NDArray[Any]) -> NDArray[np.float64]:
        """Field (..., 3) in units of the local field."""
        return _corrected(field_raw, self.offset_raw, self.matrix)


@dataclass(frozen=True, slots=True)
class ThrusterFieldCalibration:
    """Field that each thruster's current adds at full effort, body FRD, in units of the local field; one row each."""

    field_per_effort_frd: tuple[Vector, ...]
    std_per_effort: tuple[float, ...]
    made: Provenance

    def apply(
        self, field_frd: NDArray[np.float64], effort: Sequence[float] | NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Field (..., 3) without what the thrusters add at an effort (..., n) of 0..1 each (`ThrustModel.effort`)."""
        return np.subtract(field_frd, np.matmul(effort, self.field_per_effort_frd))


@dataclass(frozen=True, slots=True)
class CompassCalibration:
    """Deviation of a compass: compass = true + a + b cos(true) + c sin(true), rad, with one sigma each."""

    a_rad: float
    b_rad: float
    c_rad: float
    std_rad: Vector
    made: Provenance

    def deviation_rad(self, heading_rad: float) -> float:
        """What the compass reads too much at a true heading."""
        return self.a_rad + self.b_rad * math.cos(heading_rad) + self.c_rad * math.sin(heading_rad)

    def apply(self, compass_rad: float) -> float:
        """True heading of a compass reading, in -pi..pi. Two fixed-point steps leave less than |B, C|^3."""
        heading_rad = compass_rad
        for _ in range(3):
            heading_rad = compass_rad - self.deviation_rad(heading_rad)
        return math.remainder(heading_rad, 2.0 * math.pi)


Part = (
    GyroCalibration | AccelerometerCalibration | MagnetometerCalibration | ThrusterFieldCalibration | CompassCalibration
)
_PARTS: dict[type[Any], str] = {
    GyroCalibration: "gyro",
    AccelerometerCalibration: "accelerometer",
    MagnetometerCalibration: "magnetometer",
    ThrusterFieldCalibration: "thruster_field",
    CompassCalibration: "compass",
}


@dataclass(frozen=True, slots=True)
class Calibration:
    """Everything known about one vehicle's sensors; None where it was never calibrated."""

    gyro: GyroCalibration | None = None
    accelerometer: AccelerometerCalibration | None = None
    magnetometer: MagnetometerCalibration | None = None
    thruster_field: ThrusterFieldCalibration | None = None
    compass: CompassCalibration | None = None

    def angular_rate(self, angular_rate_radps: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rates (..., 3); as they are where the gyro was never calibrated."""
        return angular_rate_radps if self.gyro is None else self.gyro.apply(angular_rate_radps)

    def specific_force(self, specific_force_mps2: NDArray[np.float64]) -> NDArray[np.float64]:
        """Specific force (..., 3); as it is where the accelerometer was never calibrated."""
        return specific_force_mps2 if self.accelerometer is None else self.accelerometer.apply(specific_force_mps2)

    def magnetic_field(
        self, field_raw: NDArray[Any], effort: Sequence[float] | NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Field (..., 3): in units of the local field, or raw where the magnetometer was never calibrated."""
        if self.magnetometer is None:
            return np.asarray(field_raw, np.float64)
        field = self.magnetometer.apply(field_raw)
        return field if effort is None or self.thruster_field is None else self.thruster_field.apply(field, effort)

    def with_part(self, part: Part) -> Calibration:
        """The same with one part new."""
        new: dict[str, Any] = {_PARTS[type(part)]: part}
        return replace(self, **new)

    def without(self, name: str) -> Calibration:
        """The same with one part forgotten: `gyro`, `accelerometer`, `magnetometer`, `thruster_field`, `compass`."""
        nothing: dict[str, Any] = {name: None}
        return replace(self, **nothing)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, lists and strings; what was never calibrated is null."""
        return {"version": FORMAT_VERSION, **asdict(self)}

    @staticmethod
    def from_json(saved: Mapping[str, Any]) -> Calibration:
        """The same calibration again. Raises CalibrationError for another version or for what makes no sense."""
        version = saved.get("version") if isinstance(saved, Mapping) else None
        if version != FORMAT_VERSION:
            raise CalibrationError(f"calibration of version {version!r}, expected {FORMAT_VERSION}: calibrate anew")
        try:
            return Calibration(**{name: _read(saved[name], name, kind) for kind, name in _PARTS.items()})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise CalibrationError(f"saved calibration cannot be read ({error}): calibrate anew") from error


def _corrected(raw: NDArray[Any], offset: Vector, matrix: Matrix) -> NDArray[np.float64]:
    corrected: NDArray[np.float64] = np.subtract(raw, offset) @ np.transpose(matrix)
    return corrected


def _read(fields: Mapping[str, Any] | None, name: str, kind: type[Any]) -> Any:
    if fields is None:
        return None
    values = {key: _frozen(value) for key, value in fields.items() if key != "made"}
    _check_shapes(name, values)
    return kind(**values, made=Provenance(**fields["made"]))


def _frozen(value: Any) -> Any:
    """Lists become tuples; every number must be finite."""
    if isinstance(value, list | tuple):
        return tuple(_frozen(item) for item in value)
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number} where a finite number is expected")
    return number


def _check_shapes(name: str, values: Mapping[str, Any]) -> None:
    vectors = {"bias_frd_radps", "std_radps", "offset_frd_mps2", "offset_raw", "std_rad"}
    for key, value in values.items():
        if key in vectors and np.shape(value) != (3,):
            raise ValueError(f"{name}.{key} must have 3 numbers")
        if key == "matrix" and np.shape(value) != (3, 3):
            raise ValueError(f"{name}.{key} must be 3 x 3")
        if key == "field_per_effort_frd" and (len(np.shape(value)) != 2 or np.shape(value)[1] != 3):
            raise ValueError(f"{name}.{key} must be n x 3")
