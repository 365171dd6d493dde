"""Servo angles and the pulse widths that make them, each servo with a gain and an offset of its own.

counts = middle + offset +- gain counts_per_rad angle; minus for a servo that is built in mirrored. Angle 0 is a level
arm. Pulses beyond the servo's range become NaN: such a servo would press against its stop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, ServoCalibration


def counts_of(angles_rad: Floats, calibration: ServoCalibration) -> Floats:
    """Counts (..., 6), whole numbers, of servo angles (..., 6); NaN where the servo cannot go or the angle is NaN."""
    exact = calibration.middle_counts + calibration.offset_counts + _slope(calibration) * angles_rad
    counts: Floats = np.rint(exact)
    return np.where(in_range(counts, calibration), counts, np.nan)


def angles_of(counts: Floats, calibration: ServoCalibration) -> Floats:
    """Servo angles (..., 6) that counts (..., 6) make; NaN for counts that no servo may get."""
    angles = (counts - calibration.middle_counts - calibration.offset_counts) / _slope(calibration)
    return np.where(in_range(counts, calibration), angles, np.nan)


def in_range(counts: Floats, calibration: ServoCalibration) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Whether a servo may get these counts; never for NaN."""
    return (counts >= calibration.lowest_counts) & (counts <= calibration.highest_counts)


def angle_range_rad(calibration: ServoCalibration) -> tuple[Floats, Floats]:
    """Lowest and highest angle of each servo, (..., 6)."""
    level = calibration.middle_counts + calibration.offset_counts
    ends = [(end - level) / _slope(calibration) for end in (calibration.lowest_counts, calibration.highest_counts)]
    return np.minimum(*ends), np.maximum(*ends)


def resolution_rad(calibration: ServoCalibration) -> Floats:
    """Step of one count, (..., 6)."""
    return np.abs(1.0 / _slope(calibration))


def _slope(calibration: ServoCalibration) -> Floats:
    return np.where(calibration.reversed_, -1.0, 1.0) * calibration.gain * calibration.counts_per_rad
