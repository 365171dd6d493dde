"""What is wrong with each instrument of one vehicle on one day: drawn once by seed, or wandering.

Figures: a consumer MEMS unit of the HWT905's class, MS5837-30BA, a standalone GPS with its antenna near the water, as
found in makers' papers and on logs of a real BlueROV2. White noise is added where the instruments are read
(`sensors.py`). All times are virtual seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation.conditions import Conditions
from bluerov_slam.simulation.noise_processes import GaussMarkov

FloatArray = NDArray[np.float64]

MILLI_G_MPS2 = 9.80665e-3
_DEGREE = math.radians(1.0)

GYRO_WHITE_RADPS = 0.010 * _DEGREE * math.sqrt(10.0)  # 0.010 deg/s per root hertz in the 10 Hz that 20 Hz can show
ACCELERATION_WHITE_MPS2 = 400e-6 * 9.80665 * math.sqrt(10.0)
MAGNETIC_WHITE_NT = 60.0
PRESSURE_WHITE_PA = 20.0
ANGLE_WHITE_RAD = 0.03 * _DEGREE

_GYRO_BIAS_RADPS, _RAW_GYRO_BIAS_RADPS = 0.15 * _DEGREE, 0.5 * _DEGREE
_GYRO_INSTABILITY_RADPS, _GYRO_INSTABILITY_S = 15.0 * _DEGREE / 3600.0, 300.0
_ACCELERATION_BIAS_MPS2, _RAW_ACCELERATION_BIAS_MPS2 = 4.0 * MILLI_G_MPS2, 25.0 * MILLI_G_MPS2
_ACCELERATION_INSTABILITY_MPS2, _ACCELERATION_INSTABILITY_S = 0.08 * MILLI_G_MPS2, 300.0
_SCALE, _RAW_SCALE = 0.002, 0.012
_MISALIGNED_RAD = 0.1 * _DEGREE
_COMPASS_WANDER_S = 300.0
_RAW_HARD_IRON_NT, _RAW_SOFT_IRON = 4500.0, 0.05
_VERTICAL_IRON_NT = 250.0
_TILT_RAD, _TILT_S = 0.3 * _DEGREE, 8.0
_PRESSURE_OFFSET_PA, _PRESSURE_DRIFT_PA, _PRESSURE_DRIFT_S = 1500.0, 30.0, 1800.0
GPS_WANDER_M, GPS_WHITE_M, _GPS_WANDER_S = 1.3, 0.7, 60.0


@dataclass(frozen=True, slots=True)
class CompassDeviation:
    """Compass = true + a + b cos(heading) + c sin(heading) + wander, in rad, for a level vehicle without load."""

    a_rad: float
    b_rad: float
    c_rad: float

    def at(self, heading_rad: float) -> float:
        """Without the wander."""
        return self.a_rad + self.b_rad * math.cos(heading_rad) + self.c_rad * math.sin(heading_rad)


class InstrumentErrors:
    """One set of instruments. `raw`: as delivered, before anybody calibrated IMU and compass."""

    def __init__(self, conditions: Conditions, seed: int, field_ned_nt: FloatArray, raw: bool = False) -> None:
        self.field_ned_nt = field_ned_nt
        rng = np.random.default_rng([seed, 0xE44])
        size = conditions.instruments

        def draw(count: int = 1) -> FloatArray:
            return size * rng.standard_normal(count)

        self._gyro_bias = (_RAW_GYRO_BIAS_RADPS if raw else _GYRO_BIAS_RADPS) * draw(3)
        self._acceleration_bias = (_RAW_ACCELERATION_BIAS_MPS2 if raw else _ACCELERATION_BIAS_MPS2) * draw(3)
        scale = _RAW_SCALE if raw else _SCALE
        self.gyro_matrix = _crooked(draw, scale)
        self.acceleration_matrix = _crooked(draw, scale)
        each_rad = conditions.compass_total_rad / math.sqrt(3.0)
        a, b, c = np.clip(draw(3), -2.5, 2.5) * each_rad
        level_nt = float(np.hypot(field_ned_nt[0], field_ned_nt[1]))
        # Iron turns with the vehicle, against a field that A and the declination have turned.
        turned = float(a) - math.atan2(field_ned_nt[1], field_ned_nt[0])
        cos_t, sin_t = math.cos(turned), math.sin(turned)
        vertical_nt = _VERTICAL_IRON_NT * float(draw()[0])
        self.hard_iron_nt = np.array(
            (-level_nt * (b * sin_t + c * cos_t), -level_nt * (b * cos_t - c * sin_t), vertical_nt)
        )
        self.soft_iron = np.eye(3)
        if conditions.heavy_tails:
            self.soft_iron = self.soft_iron + _symmetric(draw, 0.008)
        if raw:
            self.hard_iron_nt = _RAW_HARD_IRON_NT * draw(3)
            self.soft_iron = np.eye(3) + _symmetric(draw, _RAW_SOFT_IRON)
        ahead, aside = (self.hard_iron_nt[:2] / level_nt).tolist()
        self.deviation = CompassDeviation(float(a), -aside * cos_t - ahead * sin_t, aside * sin_t - ahead * cos_t)
        self.field_per_ampere_nt = conditions.thruster_field_nt_per_a * draw(3)
        self._wander = GaussMarkov(rng, (conditions.compass_wander_rad,), _COMPASS_WANDER_S)
        self._gyro_instability = GaussMarkov(rng, (size * _GYRO_INSTABILITY_RADPS,) * 3, _GYRO_INSTABILITY_S)
        self._acceleration_instability = GaussMarkov(
            rng, (size * _ACCELERATION_INSTABILITY_MPS2,) * 3, _ACCELERATION_INSTABILITY_S
        )
        self._tilt = GaussMarkov(rng, (size * _TILT_RAD,) * 2, _TILT_S)
        self.pressure_offset_pa = _PRESSURE_OFFSET_PA * float(np.clip(draw()[0], -2.5, 2.5))
        self._pressure_drift = GaussMarkov(rng, (size * _PRESSURE_DRIFT_PA,), _PRESSURE_DRIFT_S, first=(0.0,))
        self._gps_wander = GaussMarkov(rng, (GPS_WANDER_M, GPS_WANDER_M, 2.0 * GPS_WANDER_M), _GPS_WANDER_S)

    def gyro_bias_radps(self, times_s: FloatArray) -> FloatArray:
        """(n, 3)."""
        return self._gyro_bias + self._gyro_instability.many(times_s)

    def acceleration_bias_mps2(self, times_s: FloatArray) -> FloatArray:
        """(n, 3)."""
        return self._acceleration_bias + self._acceleration_instability.many(times_s)

    def compass_wander_rad(self, times_s: FloatArray) -> FloatArray:
        """(n,)."""
        wander: FloatArray = self._wander.many(times_s)[:, 0]
        return wander

    def tilt_error_rad(self, times_s: FloatArray) -> FloatArray:
        """Roll and pitch error of the sensor's own angles: (n, 2)."""
        return self._tilt.many(times_s)

    def pressure_error_pa(self, at_s: float) -> float:
        """Offset and drift."""
        return self.pressure_offset_pa + float(self._pressure_drift.at(at_s)[0])

    def gps_wander_m(self, at_s: float) -> tuple[float, float, float]:
        """North, east, up."""
        north, east, up = self._gps_wander.at(at_s).tolist()
        return north, east, up

    def magnetic_field_nt(self, times_s: FloatArray, rotation_ned_frd: FloatArray, amperes: FloatArray) -> FloatArray:
        """What the magnetometer feels, without noise: (n, 3) FRD."""
        turned = self.deviation.a_rad + self.compass_wander_rad(times_s)
        north, east, down = self.field_ned_nt
        # The field turned by -angle about the vertical makes the compass show angle too much.
        cos_t, sin_t = np.cos(turned), -np.sin(turned)
        field = np.column_stack(
            (cos_t * north - sin_t * east, sin_t * north + cos_t * east, np.full(len(turned), down))
        )
        body = np.einsum("nji,nj->ni", rotation_ned_frd, field)
        felt: FloatArray = body @ self.soft_iron.T + self.hard_iron_nt + amperes[:, None] * self.field_per_ampere_nt
        return felt

    def compass_error_rad(self, times_s: FloatArray, rotation_ned_frd: FloatArray, amperes: FloatArray) -> FloatArray:
        """Heading that this field shows to who knows roll, pitch and declination exactly, less the true heading."""
        field = self.magnetic_field_nt(times_s, rotation_ned_frd, amperes)
        level = np.einsum("nij,nj->ni", rotation_ned_frd, field)
        declination = math.atan2(self.field_ned_nt[1], self.field_ned_nt[0])
        error: FloatArray = declination - np.arctan2(level[:, 1], level[:, 0])
        return np.asarray((error + math.pi) % (2.0 * math.pi) - math.pi, np.float64)


def _crooked(draw: Callable[[int], FloatArray], scale: float) -> FloatArray:
    """Scale errors on the diagonal, axes that are not quite square beside it."""
    matrix = _MISALIGNED_RAD * draw(9).reshape(3, 3)
    matrix[np.diag_indices(3)] = 1.0 + scale * draw(3)
    return matrix


def _symmetric(draw: Callable[[int], FloatArray], size: float) -> FloatArray:
    matrix = size * draw(9).reshape(3, 3)
    result: FloatArray = 0.5 * (matrix + matrix.T)
    return result
