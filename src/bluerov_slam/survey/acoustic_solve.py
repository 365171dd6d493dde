"""Records of an array solved one by one: delays, direction, and a position where depth or range is given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.message.demodulation import DemodulatedFrame, demodulate
from bluerov_slam.acoustics.message.report import BeaconReport, MessageContentError
from bluerov_slam.acoustics.position import AcousticSolution, solve_source
from bluerov_slam.acoustics.time_differences.band import BandSpectra
from bluerov_slam.acoustics.time_differences.estimate import Method, estimate_delays
from bluerov_slam.acoustics.time_differences.result import TimeDifferences
from bluerov_slam.pipeline.acoustics import MESSAGE_RECORD_S
from bluerov_slam.records import AcousticRecord

Array = NDArray[np.float64]

_PER_LOBE, _MOST_FINER = 8, 12
"""Directions looked at in each lobe of the carrier, and the most of them in a cell of the map, along a side."""
_LAG_STEP_S = 0.2e-6
AXES = {"down": (0.0, 0.0, 1.0), "forward": (1.0, 0.0, 0.0)}


@dataclass(frozen=True, slots=True)
class SolveOptions:
    """The array, the water and what is known of the source, in the array's frame.

    `depth`: how far the source lies along `axis` from the array's centre, with its standard deviation, m.
    """

    array: ReceiverArray
    sound_speed_mps: float
    method: Method = "joint"
    depth: tuple[float, float] | None = None
    axis: str = "down"
    range_: tuple[float, float] | None = None


@dataclass(frozen=True)
class SolvedRecord:
    """One record and what it gave; `message` in place of all else where it holds a whole message."""

    record: AcousticRecord
    differences: TimeDifferences | None
    solution: AcousticSolution | None
    message: DemodulatedFrame | None
    reason: str


def solve_record(record: AcousticRecord, options: SolveOptions) -> SolvedRecord:
    """Whatever is wrong with the record is said in `reason`."""
    samples = record.samples.astype(np.float64)
    if samples.shape[1] / record.sample_rate_hz > MESSAGE_RECORD_S:
        return _message(record, samples)
    count = len(options.array)
    if len(samples) != count:
        return SolvedRecord(record, None, None, None, f"{len(samples)} receivers, the array has {count}")
    found = estimate_delays(
        samples, record.sample_rate_hz, options.array, options.sound_speed_mps, method=options.method
    )
    if len(found.receivers) < 3:
        whole = [reason for receiver, reason in found.excluded if receiver < 0]
        return SolvedRecord(record, found, None, None, ": ".join(["fewer than three receivers can be used", *whole]))
    solution = solve_source(
        options.array.subset(found.receivers.tolist()),
        found.delays_s,
        found.covariance_s2,
        options.sound_speed_mps,
        depth=options.depth,
        range_=options.range_,
        down=AXES[options.axis],
    )
    return SolvedRecord(record, found, solution, None, solution.reason)


def _message(record: AcousticRecord, samples: Array) -> SolvedRecord:
    try:
        frame = demodulate(samples, record.sample_rate_hz)
    except ValueError as error:
        return SolvedRecord(record, None, None, None, str(error))
    if frame is None:
        return SolvedRecord(record, None, None, None, "a long record in which no message frame was found")
    reason = "" if frame.payload is not None else "a message frame whose check does not agree"
    return SolvedRecord(record, None, None, frame, reason)


def solved_json(solved: SolvedRecord) -> dict[str, Any]:
    """Plain numbers in degrees and microseconds; null is unknown."""
    record, found, solution = solved.record, solved.differences, solved.solution
    content: dict[str, Any] = {
        "record_id": record.record_id,
        "measured_s": record.measured_s,
        "sample_rate_hz": record.sample_rate_hz,
        "receivers": record.samples.shape[0],
        "samples": record.samples.shape[1],
        "missing_samples": record.missing_samples,
        "reason": solved.reason,
        "delays": None,
        "direction": None,
        "position": None,
        "message": None,
    }
    if found is not None:
        content["delays"] = {
            "used": found.receivers.tolist(),
            "delays_us": _rounded(1e6 * found.delays_s, 4),
            "std_us": _rounded(1e6 * np.sqrt(np.diag(found.covariance_s2)), 4),
            "carrier_hz": _number(found.carrier_hz, 1),
            "snr_db": _rounded(found.snr_db, 1),
            "slip_probability": _number(found.slip_probability, 4),
            "alternatives": [
                {"delays_us": _rounded(1e6 * delays, 4), "probability": round(share, 4)}
                for delays, share in found.alternatives
            ],
            "excluded": [{"receiver": receiver, "reason": reason} for receiver, reason in found.excluded],
        }
    if solution is not None and np.isfinite(solution.direction).all():
        azimuth_deg, elevation_deg = angles_deg(solution.direction)
        spread = math.sqrt(max(0.0, float(np.linalg.eigvalsh(solution.direction_covariance)[-1])))
        content["direction"] = {
            "azimuth_deg": round(azimuth_deg, 4),
            "elevation_deg": round(elevation_deg, 4),
            "std_deg": round(math.degrees(spread), 4),
            "residuals_us": _rounded(1e6 * solution.residuals_s, 4),
            "mirror_deg": None
            if solution.mirror is None
            else [round(angle, 4) for angle in angles_deg(solution.mirror)],
        }
        if solution.position_m is not None and solution.covariance_m2 is not None:
            content["position"] = {
                "forward_right_down_m": _rounded(solution.position_m, 4),
                "std_m": _rounded(np.sqrt(np.diag(solution.covariance_m2)), 4),
                "range_m": round(float(np.linalg.norm(solution.position_m)), 4),
            }
    if solved.message is not None:
        content["message"] = _message_json(solved.message)
    return content


def _message_json(frame: DemodulatedFrame) -> dict[str, Any]:
    content: dict[str, Any] = {
        "counter": frame.counter,
        "corrected_errors": frame.corrected_errors,
        "carrier_hz": round(frame.carrier_hz, 1),
        "bytes": None if frame.payload is None else frame.payload.hex(),
        "latitude_deg": None,
        "longitude_deg": None,
        "depth_m": None,
    }
    if frame.payload is not None:
        try:
            report = BeaconReport.unpack(frame.payload)
        except MessageContentError:
            return content
        content |= {
            "latitude_deg": report.latitude_deg,
            "longitude_deg": report.longitude_deg,
            "depth_m": report.depth_m,
        }
    return content


def angles_deg(direction: Array) -> tuple[float, float]:
    """Azimuth right positive and elevation down positive, of forward, right, down."""
    x, y, z = direction.tolist()
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))


@dataclass(frozen=True)
class SteeredSurface:
    """How well all receivers agree for directions in front: `agreement` (down, right), NaN beyond the half sphere, over
    direction cosines; 1: as if all heard the very same pulse."""

    right: Array
    down: Array
    agreement: Array


def steered_surface(
    solved: SolvedRecord,
    options: SolveOptions,
    steps: int = 161,
    centre: tuple[float, float] = (0.0, 0.0),
    half_width: float = 1.0,
) -> SteeredSurface | None:
    """Around direction cosines (right, down) of `centre`, `steps` a side. None without usable receivers.

    The lobes of the carrier are much finer than such a map: each of its cells shows the best within it.
    """
    found, record = solved.differences, solved.record
    if found is None or len(found.receivers) < 2:
        return None
    used = found.receivers
    samples = record.samples[used].astype(np.float64)
    spectra = BandSpectra.of(samples - samples.mean(axis=1, keepdims=True), record.sample_rate_hz)
    values = spectra.values / np.sqrt((np.abs(spectra.values) ** 2).sum(axis=1, keepdims=True))
    places, skew = options.array.positions_m[used], options.array.sample_skew_s[used]
    aperture_m = float(np.linalg.norm(places[:, None] - places[None, :], axis=2).max())
    lobe = options.sound_speed_mps / (float(spectra.frequencies_hz.max()) * aperture_m)
    cell = 2.0 * half_width / steps
    finer = min(_MOST_FINER, math.ceil(cell * _PER_LOBE / lobe))
    offsets = half_width * ((2.0 * np.arange(steps * finer) + 1.0) / (steps * finer) - 1.0)
    right, down = np.meshgrid(centre[0] + offsets, centre[1] + offsets)
    ahead = np.sqrt(np.maximum(1.0 - right**2 - down**2, 0.0))
    # A receiver nearer to the source hears it earlier, and one sampled later shows it earlier in its record.
    arrivals = [
        -(ahead * x + right * y + down * z) / options.sound_speed_mps - late
        for (x, y, z), late in zip(places, skew, strict=True)
    ]
    agreement = np.full(right.shape, 1.0)  # of each receiver with itself, summed
    limit_s = aperture_m / options.sound_speed_mps + float(np.ptp(skew)) + _LAG_STEP_S
    lags_s = np.arange(-limit_s, limit_s + _LAG_STEP_S, _LAG_STEP_S)
    turns = np.exp(2j * np.pi * lags_s[:, None] * spectra.frequencies_hz)
    for i in range(len(used)):
        for j in range(i + 1, len(used)):
            correlation = (turns @ (values[i] * np.conj(values[j]))).real
            agreement += 2.0 / len(used) * np.interp(arrivals[i] - arrivals[j], lags_s, correlation)
    agreement[right**2 + down**2 > 1.0] = -np.inf
    best = (agreement / len(used)).reshape(steps, finer, steps, finer).max(axis=(1, 3))
    middles = half_width * ((2.0 * np.arange(steps) + 1.0) / steps - 1.0)
    return SteeredSurface(centre[0] + middles, centre[1] + middles, np.where(np.isfinite(best), best, np.nan))


def pair_correlations(solved: SolvedRecord, options: SolveOptions) -> list[tuple[int, int, Array, Array]]:
    """Of the reference with each other used receiver: lags in us within what the array allows, and correlation."""
    found, record = solved.differences, solved.record
    if found is None or len(found.receivers) < 2:
        return []
    samples = record.samples.astype(np.float64)
    samples -= samples.mean(axis=1, keepdims=True)
    spectra = BandSpectra.of(samples, record.sample_rate_hz)
    reference = int(found.receivers[0])
    curves = []
    for other in found.receivers[1:].tolist():
        apart = float(np.linalg.norm(options.array.positions_m[reference] - options.array.positions_m[other]))
        limit_s = 1.1 * apart / options.sound_speed_mps
        lags = np.linspace(-limit_s, limit_s, 801)
        cross = spectra.values[reference] * np.conj(spectra.values[other])
        scale = math.sqrt(
            float((np.abs(spectra.values[reference]) ** 2).sum() * (np.abs(spectra.values[other]) ** 2).sum())
        )
        skew = options.array.sample_skew_s[reference] - options.array.sample_skew_s[other]
        turned = np.exp(2j * np.pi * (lags[:, None] - skew) * spectra.frequencies_hz)
        curves.append((reference, other, 1e6 * lags, (turned @ cross).real / scale))
    return curves


def remarks_of(found: TimeDifferences) -> list[str]:
    """What is wrong with receivers, in words, those with the same trouble together; clipped ones may be used."""
    alike: dict[tuple[str, bool], list[str]] = {}
    for receiver, reason in found.excluded:
        if receiver >= 0:
            alike.setdefault((reason, receiver in found.receivers), []).append(str(receiver))
    remarks = []
    for (reason, used), numbers in alike.items():
        names = " and ".join((", ".join(numbers[:-1]), numbers[-1])) if len(numbers) > 1 else numbers[0]
        names = f"receiver{'s' if len(numbers) > 1 else ''} {names}"
        remarks.append(f"{names} used in spite of this: {reason}" if used else f"{names} left out: {reason}")
    return remarks


def _rounded(values: Array, digits: int) -> list[float | None]:
    return [_number(value, digits) for value in np.asarray(values, float).tolist()]


def _number(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
