"""The magnetometer: which readings are the Earth's field, and how far they can be trusted beside running thrusters."""

from __future__ import annotations

import math
from collections import deque
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.measurements import MagneticField
from bluerov_slam.pipeline.navigator_watch import FrozenWatch
from bluerov_slam.pipeline.navigator_words import Fault

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.navigation.attitude.calibration import Calibration
    from bluerov_slam.pipeline.navigator_options import CompassOptions
    from bluerov_slam.pipeline.navigator_sensors import SensorStatus
    from bluerov_slam.records import ImuBurst

    Array = NDArray[np.float64]

COUNTS_END = 32_700
FROZEN_AFTER_S = 20.0
FROZEN_AT_LEAST = 40
# A field that stays the same to the last count while the vehicle turns so far is no measurement.
FROZEN_TURN_RAD = math.radians(10.0)
# What a magnetometer that was never calibrated shows as its usual field is learned from so many readings.
REFERENCE_READINGS = 25
# Without a calibration hard iron changes strength and dip as the vehicle turns: only gross changes are faults.
UNCALIBRATED_TOLERANCE = 2.5


class CompassIntake:
    """Raw fields in, heading measurements out."""

    def __init__(self, options: CompassOptions, status: SensorStatus) -> None:
        self._options = options
        self._status = status
        self._frozen = FrozenWatch(FROZEN_AFTER_S, FROZEN_AT_LEAST)
        self._frozen_value: bytes | None = None
        self._turned_rad = np.zeros(3)
        self._taken_s = -math.inf
        self._norms: deque[float] = deque(maxlen=REFERENCE_READINGS)
        self._dips: deque[float] = deque(maxlen=REFERENCE_READINGS)
        self.expected_dip_rad: float | None = None

    def burst(
        self,
        record: ImuBurst,
        field_raw: Array,
        calibration: Calibration,
        effort: Array | None,
        down_frd: Array | None,
        declination_rad: float,
    ) -> MagneticField | None:
        """The heading of one burst. `field_raw` (n, 3) in the vehicle's axes; `down_frd`: the vertical, where known."""
        self._status.hear(record.arrived_s)
        fault = self._raw_fault(record)
        if fault is not None:
            self._status.refuse(fault, record.arrived_s)
            return None
        last = len(field_raw) - 1
        at_s = record.measured_s + last * record.interval_s
        if at_s - self._taken_s < self._options.period_s - 1e-3:
            return None
        field = calibration.magnetic_field(field_raw[last], effort)
        fault = self._field_fault(field, calibration.magnetometer is not None, down_frd)
        if fault is not None:
            self._status.refuse(fault, record.arrived_s)
            return None
        self._taken_s = at_s
        self._status.wait_for(None, record.arrived_s)
        std_rad = self._options.std_rad * self._status.noise_scale
        load = 0.0 if effort is None else float(np.mean(effort))
        return MagneticField(at_s, field, declination_rad, std_rad, thruster_load=load)

    def _raw_fault(self, record: ImuBurst) -> Fault | None:
        raw = record.magnetic_field_raw
        if not len(raw):
            return Fault.IMPOSSIBLE
        if np.abs(raw.astype(np.int32)).max() >= COUNTS_END:
            return Fault.SATURATED
        if not raw.any():
            return Fault.IMPOSSIBLE
        value = raw[-1].tobytes()
        if value == self._frozen_value:
            self._turned_rad = self._turned_rad + record.angular_rate_radps.sum(axis=0) * record.interval_s
        else:
            self._frozen_value, self._turned_rad = value, np.zeros(3)
        long_frozen = self._frozen.check(value, record.measured_s)
        turned = float(np.sqrt(self._turned_rad @ self._turned_rad))
        several = self._frozen.count >= 5
        return Fault.FROZEN if long_frozen or (several and turned > FROZEN_TURN_RAD) else None

    def _field_fault(self, field: Array, calibrated: bool, down_frd: Array | None) -> Fault | None:
        norm = float(np.sqrt(field @ field))
        if not (math.isfinite(norm) and norm > 0.0):
            return Fault.NOT_A_NUMBER
        options = self._options
        looser = 1.0 if calibrated or options.calibrated_in_sensor else UNCALIBRATED_TOLERANCE
        usual_norm = 1.0 if calibrated else self._usual(self._norms, norm)
        if abs(norm / usual_norm - 1.0) > options.norm_tolerance * looser:
            return Fault.MAGNETIC_STRENGTH
        if down_frd is None:
            return None
        dip = math.asin(max(-1.0, min(1.0, float(field @ down_frd) / norm)))
        expected = self.expected_dip_rad if looser == 1.0 else None
        usual_dip = self._usual(self._dips, dip) if expected is None else expected
        return Fault.MAGNETIC_DIP if abs(dip - usual_dip) > options.dip_tolerance_rad * looser else None

    @staticmethod
    def _usual(readings: deque[float], value: float) -> float:
        """Median of the first readings: what this vehicle's field is like."""
        if len(readings) < REFERENCE_READINGS:
            readings.append(value)
        return median(readings)
