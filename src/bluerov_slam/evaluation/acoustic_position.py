"""I2, I3, I5: position from one pulse at a known depth, against the least error possible. Simulated.

The thesis's bench: depth is the array's x axis, the position's error is that across it, both axes together. Sources lie
+-20 degrees to the side and +-8 up and down, the attitude is exact. "Thesis" is argmax and Hooke-Jeeves as published.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.absorption import sea_absorption_db_per_m
from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.bounds import position_covariance, record_delay_covariance
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses, estimate_responses
from bluerov_slam.acoustics.hooke_jeeves import hooke_jeeves_2d
from bluerov_slam.acoustics.position import solve_source
from bluerov_slam.acoustics.position_batch import solve_batch
from bluerov_slam.acoustics.time_differences import TimeDifferences, estimate_delays
from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob, ratio_row, rms_row, share_row
from bluerov_slam.evaluation.acoustic_timing import SLIP_S, sources_ahead
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.statistics import bootstrap, ratio_of_rms
from bluerov_slam.simulation.acoustic_paths import Medium
from bluerov_slam.simulation.acoustic_record import AcousticSetup, SimulatedRecords, Tolerances, simulate_records

Array = NDArray[np.float64]

AIR_MPS, WATER_MPS = 343.0, 1500.0
DEPTH_STD_M = 0.5e-3
EXACT_STD_M = 1e-6
FORWARD = (1.0, 0.0, 0.0)
CALIBRATION_RECORDS = 40

_AIR_CELLS = ("1.4 m 0 dB", "2.6 m 0 dB", "3.9 m 0 dB", "1.4 m 20 dB", "2.6 m 20 dB", "3.9 m 20 dB")
_AIR_MUST_MM = (0.25, 0.4, 0.6, 0.15, 0.15, 0.15)
_WATER_CELLS = ("10 m 20 dB", "50 m 20 dB", "100 m 20 dB")
_WATER_MUST_MM = (0.6, 3.0, 6.0)
_OVER_BOUND = 1.1
_MISMATCH_CELLS = ("1.4 m", "2.6 m", "3.9 m")
_MISMATCH_SNR_DB = 20.0
_MISMATCH_MUST_MM, _MISMATCH_MUST_SLIPS = 0.3, 0.1


@dataclass(frozen=True, eq=False)
class PositionOutcome:
    """Errors (draws, 2) m and slips (draws,) by chain; least standard deviations (draws, 2) m where asked for."""

    errors_m: dict[str, Array]
    slipped: dict[str, NDArray[np.bool_]]
    bound_m: Array | None = None


def thesis_array() -> ReceiverArray:
    """The thesis's cross with its rank skew."""
    return ReceiverArray.cross(sample_skew_s=[0.0, THESIS_RANK_SKEW_S, 0.0, THESIS_RANK_SKEW_S])


def run_identical(job: AcousticJob, material: Mapping[str, bytes]) -> PositionOutcome:
    """I2 in air, and I5 in water with exact depth."""
    range_m, snr_db = (float(part.split()[0]) for part in (job.cell, job.cell.split(" m ")[1]))
    water = job.case == "I5"
    sound_mps = WATER_MPS if water else AIR_MPS
    medium = Medium(sound_mps, sea_absorption_db_per_m(40e3) if water else 1.3)
    depth_std_m = EXACT_STD_M if water else DEPTH_STD_M
    array = thesis_array()
    sources = sources_ahead(job.seed, job.draws, range_m)
    records = simulate_records(AcousticSetup(array, medium=medium, snr_db=snr_db), sources, job.seed)
    quiet = AcousticSetup(array, medium=medium, snr_db=300.0, quantised=False)
    clean = simulate_records(quiet, sources, job.seed).samples
    depths = sources[:, 0] + depth_std_m * np.random.default_rng([job.seed, 0xDE9]).standard_normal(job.draws)
    responses = ReceiverResponses.identical(len(array))
    joint = [
        estimate_delays(each, records.sample_rate_hz, array, sound_mps, responses=responses) for each in records.samples
    ]
    published = [estimate_delays(each, records.sample_rate_hz, array, sound_mps, "thesis") for each in records.samples]
    bound = [
        _bound(draw, arrivals, source, array, sound_mps, snr_db, depth_std_m, records.sample_rate_hz)
        for draw, arrivals, source in zip(clean, records.toa_s, sources, strict=True)
    ]
    return PositionOutcome(
        {
            "joint": _solved(joint, depths, depth_std_m, array, sound_mps) - sources[:, 1:],
            "thesis": _searched(published, depths, array, sound_mps) - sources[:, 1:],
        },
        {"joint": _slipped(joint, records), "thesis": _slipped(published, records)},
        np.array(bound),
    )


def run_mismatched(job: AcousticJob, material: Mapping[str, bytes]) -> PositionOutcome:
    """I3: one set of receivers per seed, its responses learnt from other records of the same set."""
    range_m = float(job.cell.split()[0])
    array = thesis_array()
    setup = AcousticSetup(
        array, snr_db=_MISMATCH_SNR_DB, tolerances=Tolerances(receiver_resonance=0.01), receiver_set=job.seed
    )
    # Learnt from pulses out of other directions at another range, whose places nobody knows.
    lessons = simulate_records(setup, sources_ahead(job.seed + 500_000, CALIBRATION_RECORDS, 2.0), job.seed + 500_000)
    learnt = estimate_responses(lessons.samples, lessons.sample_rate_hz, array, AIR_MPS).responses
    sources = sources_ahead(job.seed, job.draws, range_m)
    records = simulate_records(setup, sources, job.seed)
    depths = sources[:, 0] + DEPTH_STD_M * np.random.default_rng([job.seed, 0xDE9]).standard_normal(job.draws)
    known = ReceiverResponses(records.receiver_hz[0], np.full(len(array), setup.chain.receiver_q), 0.0)
    errors: dict[str, Array] = {}
    slipped: dict[str, NDArray[np.bool_]] = {}
    for name, responses in (("calibrated", learnt), ("oracle", known), ("uncalibrated", None)):
        found = [
            estimate_delays(each, records.sample_rate_hz, array, AIR_MPS, responses=responses)
            for each in records.samples
        ]
        errors[name] = _solved(found, depths, DEPTH_STD_M, array, AIR_MPS) - sources[:, 1:]
        slipped[name] = _slipped(found, records)
    published = [estimate_delays(each, records.sample_rate_hz, array, AIR_MPS, "thesis") for each in records.samples]
    errors["thesis"] = _searched(published, depths, array, AIR_MPS) - sources[:, 1:]
    slipped["thesis"] = _slipped(published, records)
    return PositionOutcome(errors, slipped)


def _solved(
    found: Sequence[TimeDifferences], depths: Array, depth_std_m: float, array: ReceiverArray, sound_mps: float
) -> Array:
    """Y and z (draws, 2) by weighted least squares.

    The solver withholds one right fix in a thousand because depth and angles seem to contradict each other; then the
    plain least squares at the given depth is taken, so that no draw drops out of the figures.
    """
    places = []
    for each, depth in zip(found, depths, strict=True):
        solution = solve_source(
            array.subset(each.receivers.tolist()),
            each.delays_s,
            each.covariance_s2,
            sound_mps,
            depth=(float(depth), depth_std_m),
            down=FORWARD,
        )
        place = solution.position_m
        if place is None:
            receivers = array.subset(each.receivers.tolist())
            place = solve_batch(receivers, each.delays_s[None], sound_mps, float(depth), down=FORWARD)[0]
        places.append(place[1:])
    return np.array(places)


def _searched(found: Sequence[TimeDifferences], depths: Array, array: ReceiverArray, sound_mps: float) -> Array:
    return np.array(
        [
            hooke_jeeves_2d(array.positions_m, each.delays_s, sound_mps, float(depth)).position_m[1:]
            for each, depth in zip(found, depths, strict=True)
        ]
    )


def _slipped(found: Sequence[TimeDifferences], records: SimulatedRecords) -> NDArray[np.bool_]:
    delays = np.array([each.delays_s for each in found])
    far: NDArray[np.bool_] = np.any(np.abs(delays - records.delays_s) > SLIP_S, axis=1)
    return far


def _bound(
    clean: Array,
    arrivals_s: Array,
    source_m: Array,
    array: ReceiverArray,
    sound_mps: float,
    snr_db: float,
    depth_std_m: float,
    rate_hz: float,
) -> Array:
    noise = float(np.sqrt(np.mean(clean**2))) * 10.0 ** (-snr_db / 20.0)
    covariance = record_delay_covariance(clean, arrivals_s, rate_hz, noise)
    least = position_covariance(array.positions_m, covariance, sound_mps, source_m, depth_std_m, FORWARD)
    bound: Array = np.sqrt(np.diag(least)[1:])
    return bound


def _joined(outcomes: Sequence[PositionOutcome], chain: str) -> tuple[Array, NDArray[np.bool_]]:
    return (
        np.concatenate([each.errors_m[chain] for each in outcomes]),
        np.concatenate([each.slipped[chain] for each in outcomes]),
    )


def _two_dimensional_mm(errors_m: Array) -> Array:
    error_mm: Array = 1e3 * np.linalg.norm(errors_m, axis=1)
    return error_mm


def _identical_rows(
    case: str, must_mm: Mapping[str, float], cells: Mapping[str, Sequence[PositionOutcome]]
) -> list[Row]:
    made: list[Row] = []
    for cell, outcomes in cells.items():
        if not outcomes:
            continue
        errors, slipped = _joined(outcomes, "joint")
        error_mm = _two_dimensional_mm(errors)
        least_mm = _two_dimensional_mm(np.concatenate([each.bound_m for each in outcomes if each.bound_m is not None]))
        ratio = bootstrap(np.column_stack((error_mm, least_mm)), ratio_of_rms)
        place = f"{case}.{cell.replace(' ', '')}"
        thesis, thesis_slipped = _joined(outcomes, "thesis")
        bound_mm = float(np.sqrt(np.mean(least_mm**2)))
        made += [
            rms_row(place, f"{cell}: joint, 2-D error, RMS", error_mm, "mm", must_mm[cell], None, bound_mm),
            ratio_row(f"{place}.ratio", f"{cell}: joint, RMS / RMS bound", ratio, _OVER_BOUND),
            share_row(f"{place}.slips", f"{cell}: joint, fixes with a slip", slipped),
            rms_row(
                f"{place}.thesis", f"{cell}: thesis's chain, RMS", _two_dimensional_mm(thesis), "mm", bound=bound_mm
            ),
            share_row(f"{place}.thesis_slips", f"{cell}: thesis's chain, fixes with a slip", thesis_slipped),
        ]
    return made


def _air_rows(cells: Mapping[str, Sequence[PositionOutcome]]) -> list[Row]:
    return _identical_rows("I2", dict(zip(_AIR_CELLS, _AIR_MUST_MM, strict=True)), cells)


def _water_rows(cells: Mapping[str, Sequence[PositionOutcome]]) -> list[Row]:
    return _identical_rows("I5", dict(zip(_WATER_CELLS, _WATER_MUST_MM, strict=True)), cells)


def _mismatch_rows(cells: Mapping[str, Sequence[PositionOutcome]]) -> list[Row]:
    made: list[Row] = []
    everything: list[NDArray[np.bool_]] = []
    for cell, outcomes in cells.items():
        if not outcomes:
            continue
        for chain in ("calibrated", "oracle", "uncalibrated", "thesis"):
            errors, slipped = _joined(outcomes, chain)
            place = f"I3.{cell.replace(' ', '')}.{chain}"
            must = _MISMATCH_MUST_MM if chain == "calibrated" else None
            made.append(rms_row(place, f"{cell}: {chain}, 2-D error, RMS", _two_dimensional_mm(errors), "mm", must))
            made.append(share_row(f"{place}.slips", f"{cell}: {chain}, fixes with a slip", slipped))
            if chain == "calibrated":
                everything.append(slipped)
    if everything:
        name = "all ranges: calibrated, fixes with a slip"
        made.append(share_row("I3.slips", name, np.concatenate(everything), _MISMATCH_MUST_SLIPS))
    return made


CASES = (
    AcousticCase("I2", "Position, identical receivers, air (simulated)", _AIR_CELLS, run_identical, _air_rows),
    AcousticCase("I3", "Position, 1 % receivers (simulated)", _MISMATCH_CELLS, run_mismatched, _mismatch_rows),
    AcousticCase("I5", "Position in water (simulated)", _WATER_CELLS, run_identical, _water_rows),
)
