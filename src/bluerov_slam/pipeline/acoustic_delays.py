"""The delays that a board measured itself, made into what the estimates from records look like.

A receiver that is silent or whose delay the array cannot have is left out with its reason; the reference, too: the
differences of the others do not need it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.time_differences.result import TimeDifferences

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.pipeline.acoustic_options import AcousticOptions
    from bluerov_slam.records import TimeDifferenceReading

    Array = NDArray[np.float64]

# Standard deviations below these are those of an input that nothing is connected to, or of a broken receiver.
DEAD_COUNTS: Final = 1.0
SILENT_COUNTS: Final = 4.0
SILENT_SHARE: Final = 0.1
# Sound speed and receiver positions are not known better than this share.
LIMIT_MARGIN: Final = 1.03

DEAD: Final = "dead: its input does not move at all; check its amplifier and its plug"
SILENT: Final = "silent: check its cable"
NOT_MEASURED: Final = "the board measured no arrival"


def differences_of(
    reading: TimeDifferenceReading, options: AcousticOptions, sound_speed_mps: float
) -> TimeDifferences | str:
    """Delays with the covariance of independent arrivals; in words, why there can be none."""
    array = options.array
    count = len(reading.signal_std_counts)
    if count != len(array):
        return count_mismatch(count, len(array))
    # Arrivals relative to the reference: -delay.
    arrivals = np.insert(-reading.delays_s, reading.reference, 0.0)
    excluded = _silent(reading)
    excluded |= {
        int(receiver): NOT_MEASURED for receiver in np.flatnonzero(np.isnan(arrivals)) if receiver not in excluded
    }
    used = [receiver for receiver in range(count) if receiver not in excluded]
    limits = np.linalg.norm(array.positions_m[:, None] - array.positions_m[None], axis=2) / sound_speed_mps
    slack = 4.0 * options.delay_std_s
    while len(used) > 2:
        apart = np.abs(arrivals[used][:, None] - arrivals[used][None])
        excess = apart - (limits[np.ix_(used, used)] * LIMIT_MARGIN + slack)
        bad = excess > 0.0
        if not bad.any():
            break
        worst = used[int(np.where(bad, excess, 0.0).sum(axis=1).argmax())]
        excluded[worst] = "its delay is longer than the array allows: an echo, noise or another sound"
        used.remove(worst)
    order = used
    delays = arrivals[order[0]] - arrivals[order[1:]] if order else np.zeros(0)
    variance = 0.5 * options.delay_std_s**2
    covariance = variance * (np.eye(len(delays)) + 1.0)
    return TimeDifferences(
        reference=order[0] if order else reading.reference,
        receivers=np.array(order, dtype=np.intp),
        delays_s=delays,
        covariance_s2=covariance,
        carrier_hz=options.carrier_hz,
        snr_db=np.full(count, math.nan),
        slip_probability=math.nan,
        excluded=tuple(sorted(excluded.items())),
    )


def count_mismatch(sent: int, described: int) -> str:
    """Why nothing can be made of another array than the one described."""
    return (
        f"the board sends {sent} receivers, the settings describe {described}; make acoustics.array and the board agree"
    )


def _silent(reading: TimeDifferenceReading) -> dict[int, str]:
    std = reading.signal_std_counts
    loudest = float(np.sort(std)[-2]) if len(std) > 2 else float(std.max())
    threshold = max(SILENT_COUNTS, SILENT_SHARE * loudest)
    return {
        receiver: DEAD if counts < DEAD_COUNTS else SILENT
        for receiver, counts in enumerate(std.tolist())
        if counts < threshold
    }


def with_model_errors(
    differences: TimeDifferences, options: AcousticOptions, sound_speed_mps: float, sound_speed_std: float
) -> TimeDifferences:
    """Delays that are as unsure as the sound speed (relative) and the receivers' places, too.

    Where the receivers stand in space, every direction has a vector of length one: half a percent of sound speed then
    contradicts good delays by several times their timing error.
    """
    delays = differences.delays_s
    place_s = options.place_std_m / sound_speed_mps
    covariance = (
        differences.covariance_s2
        + sound_speed_std**2 * np.outer(delays, delays)
        + place_s**2 * (np.eye(len(delays)) + 1.0)
    )
    return replace(differences, covariance_s2=covariance)


def with_slips(differences: TimeDifferences, options: AcousticOptions, sound_speed_mps: float) -> TimeDifferences:
    """Ask which receivers may be wrong by one period of the carrier: as far as one source contradicts it."""
    delays = differences.delays_s
    count = len(differences.receivers)
    shifts = np.zeros((1 + 2 * count, len(delays)))
    for receiver in range(count):
        shift = -np.eye(count)[receiver, 1:] if receiver else np.ones(count - 1)
        shifts[1 + 2 * receiver], shifts[2 + 2 * receiver] = shift, -shift
    candidates = delays + shifts / differences.carrier_hz
    misfit = np.array([_misfit(differences, each, options, sound_speed_mps) for each in candidates])
    if misfit.min() > _HOPELESS:
        return differences
    weights = np.exp(-0.5 * (misfit - misfit.min()))
    weights[1:] *= options.slip_prior
    weights /= weights.sum()
    best = int(weights.argmax())
    others = [k for k in np.argsort(-weights, kind="stable").tolist() if k != best and weights[k] > _LEAST_PROBABILITY]
    return replace(
        differences,
        delays_s=candidates[best],
        slip_probability=float(1.0 - weights[best]),
        alternatives=tuple((candidates[k], float(weights[k])) for k in others),
    )


def _misfit(differences: TimeDifferences, delays: Array, options: AcousticOptions, sound_speed_mps: float) -> float:
    """Squared normalised residual of the nearest source that is no nearer than one ever is; infinite without any."""
    places = options.array.subset(differences.receivers.tolist())
    baselines = places[1:] - places[0]
    whitener = np.linalg.inv(np.linalg.cholesky(differences.covariance_s2 * sound_speed_mps**2))
    measured = delays * sound_speed_mps
    u = np.linalg.lstsq(whitener @ baselines, whitener @ measured, rcond=1e-3)[0]
    length = float(np.linalg.norm(u))
    inside = min(length, 1.0)
    u = u * (inside / length) if length > 0.0 else u
    normal = np.linalg.svd(baselines)[2][2]
    u = u + normal * math.sqrt(max(0.0, 1.0 - float(u @ u)))
    along = places @ u
    curvature = 0.5 * ((places**2).sum(axis=1) - along**2)
    across = np.linalg.svd(u[None])[2][1:].T
    rows = np.column_stack((whitener @ baselines @ across, whitener @ (curvature[0] - curvature[1:])))
    rows = np.vstack((rows, (0.0, 0.0, options.nearest_m)))
    residual = np.append(whitener @ (measured - baselines @ u), 0.0)
    left = residual - rows @ np.linalg.lstsq(rows, residual, rcond=1e-9)[0]
    return float(left @ left)


_HOPELESS: Final = 40.0
_LEAST_PROBABILITY: Final = 1e-3
