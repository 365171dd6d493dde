"""I1: how well each method times one pair, against the least variance possible. Simulated.

A pulse from 2.6 m, +-20 degrees to the side and +-8 up and down, random message bits, identical receivers, the record
taken as the thesis's board takes it. A slip is an error above a third of a carrier period; RMS is without slips.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.bounds import pair_timing_std_s
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses
from bluerov_slam.acoustics.pulse_train import REAL_CARRIER_HZ, PulseTrain, pulse_template
from bluerov_slam.acoustics.time_differences import METHODS, estimate_delays
from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob, rms_row, share_row
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.simulation.acoustic_record import AcousticSetup, simulate_records

Array = NDArray[np.float64]

SLIP_S = 8e-6
RANGE_M = 2.6
SOUND_MPS = 343.0
SNRS_DB = (0, 5, 10, 20, 40)
METHOD_NAMES = {
    "thesis": "argmax as published",
    "parabola": "argmax and parabola",
    "band_limited": "band-limited",
    "matched": "matched filter",
    "phat": "phase transform",
    "envelope": "envelope",
    "joint": "joint",
}
SLIP_CELL = "5 slips"
"""More draws of the joint method alone: without a slip in 3000 draws less than 0.1 % is no finding."""

_MUST_OVER_BOUND = {5: 1.15, 10: 1.15, 20: 1.2}
_MUST_SLIPS = {0: 1.0, 5: 0.1}


@dataclass(frozen=True, eq=False)
class TimingOutcome:
    """Errors by method (draws, pairs), s, and the least standard deviation of each draw's pairs (draws, pairs), s."""

    errors_s: dict[str, Array]
    bound_s: Array


def run(job: AcousticJob, material: Mapping[str, bytes]) -> TimingOutcome:
    """One block of draws at one signal-to-noise ratio."""
    array = ReceiverArray.cross(sample_skew_s=[0.0, THESIS_RANK_SKEW_S, 0.0, THESIS_RANK_SKEW_S])
    snr_db = float(job.cell.split()[0])
    sources = sources_ahead(job.seed, job.draws, RANGE_M)
    records = simulate_records(AcousticSetup(array, snr_db=snr_db), sources, job.seed)
    clean = simulate_records(AcousticSetup(array, snr_db=300.0, quantised=False), sources, job.seed).samples
    train = PulseTrain.at_carrier((1, 1, 1, 1, 0, 0), float(np.mean(REAL_CARRIER_HZ)))
    template = pulse_template(train, records.sample_rate_hz).samples
    responses = ReceiverResponses.identical(len(array))
    errors: dict[str, Array] = {}
    for method in METHODS if job.cell != SLIP_CELL else ("joint",):
        # What the published method leaves out, the rank skew, is put right here: it is no matter of timing.
        skew = array.sample_skew_s[0] - array.sample_skew_s[1:] if method == "thesis" else 0.0
        found = [
            estimate_delays(
                each, records.sample_rate_hz, array, SOUND_MPS, method, template=template, responses=responses
            ).delays_s
            for each in records.samples
        ]
        errors[method] = np.array(found) + skew - records.delays_s
    noise = np.sqrt(np.mean(clean**2, axis=(1, 2))) * 10.0 ** (-snr_db / 20.0)
    bound = [
        [_bound(draw, other, records.sample_rate_hz, std) for other in (1, 2, 3)]
        for draw, std in zip(clean, noise, strict=True)
    ]
    return TimingOutcome(errors, np.array(bound))


def sources_ahead(seed: int, draws: int, range_m: float, aside_deg: float = 20.0, up_deg: float = 8.0) -> Array:
    """Places (draws, 3) in the array's frame at one range, evenly spread over a field of directions."""
    rng = np.random.default_rng([seed, 0x50C])
    aside = np.radians(rng.uniform(-aside_deg, aside_deg, draws))
    down = np.radians(rng.uniform(-up_deg, up_deg, draws))
    return range_m * np.column_stack((np.cos(aside) * np.cos(down), np.sin(aside) * np.cos(down), np.sin(down)))


def _bound(clean: Array, other: int, sample_rate_hz: float, noise_std: float) -> float:
    """Of the pair (0, other), both of which hear the whole record: what a cut-off pulse costs is not in it."""
    pair = [pair_timing_std_s(clean[each], sample_rate_hz, noise_std) for each in (0, other)]
    return float(np.sqrt(0.5 * (pair[0] ** 2 + pair[1] ** 2)))


def rows(cells: Mapping[str, Sequence[TimingOutcome]]) -> list[Row]:
    """Per signal-to-noise ratio: RMS and slips of every method; the joint one is judged, slips of band-limited too."""
    made: list[Row] = []
    for cell, outcomes in cells.items():
        if not outcomes:
            continue
        snr = int(cell.split()[0])
        bound_us = 1e6 * float(np.sqrt(np.mean(np.concatenate([each.bound_s for each in outcomes]) ** 2)))
        if cell == SLIP_CELL:
            slipped = np.any(np.abs(np.concatenate([each.errors_s["joint"] for each in outcomes])) > SLIP_S, axis=1)
            made.append(share_row("I1.5dB.slips", "5 dB, joint: draws with a slip", slipped, _MUST_SLIPS[snr]))
            continue
        for method in METHODS:
            errors = np.concatenate([each.errors_s[method] for each in outcomes])
            slipped = np.any(np.abs(errors) > SLIP_S, axis=1)
            made += _method_rows(snr, method, errors, slipped, bound_us)
    return made


def _method_rows(snr: int, method: str, errors: Array, slipped: NDArray[np.bool_], bound_us: float) -> list[Row]:
    name = f"{snr} dB, {METHOD_NAMES[method]}"
    place = f"I1.{snr}dB.{method}"
    ours = method == "joint"
    over = _MUST_OVER_BOUND.get(snr)
    limit = over * bound_us if ours and over is not None else 0.01 if ours and snr == 40 else None
    kept = np.flatnonzero(~slipped)
    slip_limit = _MUST_SLIPS.get(snr) if ours and snr == 0 else None
    made: list[Row] = [share_row(f"{place}.slips", f"{name}: draws with a slip", slipped, slip_limit)]
    if len(kept) > 1 and method != "envelope":
        made.insert(
            0,
            rms_row(place, f"{name}: timing error, RMS without slips", 1e6 * errors[kept], "us", limit, None, bound_us),
        )
    return made


CASES = (
    AcousticCase(
        "I1",
        "Timing of one pair (simulated)",
        (*(str(snr) for snr in SNRS_DB), SLIP_CELL),
        run,
        rows,
        more={SLIP_CELL: 4},
    ),
)
