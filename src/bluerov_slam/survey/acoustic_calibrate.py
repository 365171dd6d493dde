"""An array calibrated from records of its own pulses: responses, then geometry, with or without known places."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.calibration.geometry import (
    GeometryCalibration,
    GeometryPriors,
    calibrate_geometry,
    self_calibrate,
)
from bluerov_slam.acoustics.calibration.responses import ResponseEstimate, estimate_responses
from bluerov_slam.acoustics.time_differences.estimate import estimate_delays
from bluerov_slam.errors import RecordingError
from bluerov_slam.records import AcousticRecord
from bluerov_slam.survey.acoustic_solve import remarks_of

Array = NDArray[np.float64]

LEAST_TIMING_S = 0.05e-6


@dataclass(frozen=True, eq=False)
class ArrayCalibration:
    """Both parts. `notes`: what was left out or assumed, in words."""

    responses: ResponseEstimate
    geometry: GeometryCalibration
    timing_std_s: float
    notes: tuple[str, ...]


def calibrate_array(
    records: Sequence[AcousticRecord],
    array: ReceiverArray,
    sound_speed_mps: float,
    places_m: Array | None,
    priors: GeometryPriors,
) -> ArrayCalibration:
    """From records with all receivers; `places_m` (records, 3) of the source in the array's frame where known."""
    count = len(array)
    for number, record in enumerate(records):
        if len(record.samples) != count:
            raise RecordingError(f"record {number} has {len(record.samples)} receivers, the array has {count}")
    if places_m is not None and len(places_m) != len(records):
        raise RecordingError(f"{len(places_m)} places for {len(records)} records")
    rate_hz = records[0].sample_rate_hz
    same = [index for index, record in enumerate(records) if record.sample_rate_hz == rate_hz]
    notes = [] if len(same) == len(records) else [f"{len(records) - len(same)} records of another sample rate left out"]
    samples = [records[index].samples.astype(np.float64) for index in same]
    responses = estimate_responses(samples, rate_hz, array, sound_speed_mps)
    usable = responses.responses if not responses.reason else None
    if responses.reason:
        notes.append(f"responses of the receivers taken as nominal: {responses.reason}")
    delays, timings = [], []
    troubles: Counter[str] = Counter()
    for each in samples:
        found = estimate_delays(each, rate_hz, array, sound_speed_mps, responses=usable)
        arrivals = np.full(count, np.nan)
        if len(found.receivers) == count:
            arrivals[found.receivers[0]] = 0.0
            arrivals[found.receivers[1:]] = -found.delays_s
            timings.append(math.sqrt(0.5 * float(np.median(found.covariance_s2.diagonal()))))
        else:
            troubles.update(remarks_of(found) or [reason for _, reason in found.excluded] or ["no pulse was found"])
        delays.append(arrivals[0] - arrivals[1:])
    if not timings:
        worst = ", ".join(f"{trouble} ({count} records)" for trouble, count in troubles.most_common(3))
        raise RecordingError(f"no record in which all receivers heard a pulse: {worst}")
    timing_s = max(float(np.median(timings)), LEAST_TIMING_S)
    if places_m is None:
        geometry = self_calibrate(array, np.array(delays), timing_s, sound_speed_mps, priors)
    else:
        geometry = calibrate_geometry(array, np.array(delays), places_m[same], timing_s, sound_speed_mps, priors)
    return ArrayCalibration(responses, geometry, timing_s, tuple(notes))


def calibration_json(calibration: ArrayCalibration) -> dict[str, Any]:
    """Plain numbers in SI units."""
    geometry, responses = calibration.geometry, calibration.responses
    return {
        "receivers_m": geometry.array.positions_m.tolist(),
        "sound_speed_mps": geometry.sound_speed_mps,
        "mounting_rad": geometry.mounting_rad.tolist(),
        "offsets_s": geometry.offsets_s.tolist(),
        "learned": [
            {"name": each.name, "value": each.value, "std": each.std, "prior_std": each.prior_std}
            for each in geometry.learned
        ],
        "singular_values": geometry.singular_values.tolist(),
        "not_told": list(geometry.weak),
        "pulses": geometry.pulses,
        "excluded": list(geometry.excluded),
        "rms_residual_s": geometry.rms_residual_s,
        "nis_per_dof": geometry.nis / geometry.dof if geometry.dof else None,
        "timing_std_s": calibration.timing_std_s,
        "converged": geometry.converged,
        "resonance_hz": responses.responses.resonance_hz.tolist(),
        "quality": responses.responses.quality.tolist(),
        "notes": list(calibration.notes),
    }
