"""I6 range by a fifth receiver, I7 the thesis's set-up from end to end, I8 start yaw and a whole dive. Simulated.

I7: receivers of 1 % spread, arms off by half a millimetre, a rank skew of 0.42 us, 1 % of sound speed, a compass that
wobbles by 0.36 to 0.56 deg over 40 to 80 s. After forty pulses at places that are known (one in-place calibration) the
platform moves on in steps of 2 deg, one fix in 3 s, and only what a vehicle has is used: pulses, depth, compass, gyro.
The thesis's chain runs on the same records beside it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.calibration.geometry import GeometryPriors, calibrate_geometry
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses, estimate_responses
from bluerov_slam.acoustics.calibration.start_yaw import YawHold, average_yaw
from bluerov_slam.acoustics.hooke_jeeves import hooke_jeeves_2d
from bluerov_slam.acoustics.position import solve_source
from bluerov_slam.acoustics.time_differences import TimeDifferences, estimate_delays
from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob, JudgedRow, rms_row, share_row
from bluerov_slam.evaluation.acoustic_dive import AcousticDiveOutcome, acoustic_dive
from bluerov_slam.evaluation.acoustic_timing import sources_ahead
from bluerov_slam.evaluation.navigation_table import Row, Target
from bluerov_slam.evaluation.statistics import bootstrap, ratio_of_rms
from bluerov_slam.navigation.rotation import rotation_from_euler
from bluerov_slam.simulation.acoustic_paths import Medium
from bluerov_slam.simulation.acoustic_record import AcousticSetup, SimulatedRecords, Tolerances, simulate_records
from bluerov_slam.simulation.yaw_wobble import yaw_session

Array = NDArray[np.float64]

NOMINAL_MPS = 343.0
TIMING_S = 0.1e-6
DEPTH_STD_M = 0.5e-3
SNR_DB = 20.0
CALIBRATION_FIXES = 40
EVERY_S = 3.04
REST_S = 240.0
RANGES = ("1.4 m", "2.6 m", "3.9 m")
_RADIAL_MUST_MM = dict(zip(RANGES, (2.0, 6.0, 14.0), strict=True))
_RADIAL_BOUND_MM = dict(zip(RANGES, (1.7, 5.7, 13.0), strict=True))
_END_MUST_MM = dict(zip(RANGES, (3.0, 6.0, 9.0), strict=True))
_ATE_MUST_M, _ATE_AIM_M = 3.5, 2.5
_YAW_MUST_DEG = 0.3
SLIP_S = 8e-6


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors by name, first axis = draws."""

    by_name: dict[str, Array]


def run_range(job: AcousticJob, material: Mapping[str, bytes]) -> Errors:
    """Radial errors of single fixes with five receivers: no depth, no clock."""
    range_m = float(job.cell.split()[0])
    array = ReceiverArray.cross(centre=True)
    covariance = TIMING_S**2 * (np.eye(4) + 1.0)
    random = np.random.default_rng([job.seed, 0x3D])
    radial, stds = [], []
    for source in sources_ahead(job.seed, job.draws, range_m):
        arrivals = TIMING_S * random.standard_normal(5)
        delays = array.delays_s(source, NOMINAL_MPS) + arrivals[0] - arrivals[1:]
        solution = solve_source(array.positions_m, delays, covariance, NOMINAL_MPS)
        toward = source / range_m
        if solution.position_m is None or solution.covariance_m2 is None:
            radial.append(range_m)  # no fix: as wrong as its whole range
            stds.append(math.nan)
            continue
        radial.append(float((solution.position_m - source) @ toward))
        stds.append(math.sqrt(float(toward @ solution.covariance_m2 @ toward)))
    return Errors({"radial": np.array(radial), "std": np.array(stds)})


def range_rows(cells: Mapping[str, Sequence[Errors]]) -> list[Row]:
    """Medians beside their bound, and how honest the stated range is."""
    made: list[Row] = []
    for cell, outcomes in cells.items():
        if not outcomes:
            continue
        radial = np.concatenate([each.by_name["radial"] for each in outcomes])
        std = np.concatenate([each.by_name["std"] for each in outcomes])
        place = f"I6.{cell.replace(' ', '')}"
        median = bootstrap(1e3 * np.abs(radial))
        must = Target(high=_RADIAL_MUST_MM[cell])
        ratio = median.value / _RADIAL_BOUND_MM[cell]
        made.append(JudgedRow(place, f"{cell}: five receivers, radial error, median", median, "mm", must, None, ratio))
        outside = ~(np.abs(radial) <= 1.959964 * std)
        made.append(share_row(f"{place}.outside", f"{cell}: outside the stated 95 % interval", outside, 8.0))
    return made


def run_bench(job: AcousticJob, material: Mapping[str, bytes]) -> Errors:
    """One session: an in-place calibration, then the draws."""
    range_m = float(job.cell.split()[0])
    random = np.random.default_rng([job.seed, 0xE2E])
    skew = [0.0, THESIS_RANK_SKEW_S, 0.0, THESIS_RANK_SKEW_S]
    drawn = ReceiverArray.cross(sample_skew_s=skew)
    real = ReceiverArray(drawn.positions_m + 0.5e-3 * random.standard_normal((4, 3)), drawn.sample_skew_s)
    sound_mps = NOMINAL_MPS * (1.0 + 0.01 * random.standard_normal())
    setup = AcousticSetup(
        real,
        medium=Medium(sound_mps, 1.3),
        snr_db=SNR_DB,
        tolerances=Tolerances(receiver_resonance=0.01),
        receiver_set=job.seed,
    )
    count = CALIBRATION_FIXES + job.draws
    yaw = yaw_session(job.seed, count, EVERY_S, np.radians(2.0) * random.standard_normal(count))
    # The bench's x axis points where the session began: the start yaw is known there, as it is to the thesis.
    start = float(yaw.true_rad[0])
    true, compass = yaw.true_rad - start, yaw.compass_rad - start
    sources = np.vstack(
        (
            sources_ahead(job.seed + 500_000, CALIBRATION_FIXES, range_m),
            sources_ahead(job.seed, job.draws, range_m),
        )
    )
    records = simulate_records(setup, sources, job.seed)
    bench = _Bench(drawn, records, true, sources)
    calibrated = bench.calibrate()
    hold = YawHold(float(compass[0]))
    new, thesis, slips = [], [], []
    depths = bench.world_m[:, 0] + DEPTH_STD_M * random.standard_normal(count)
    for index in range(count):
        hold.turn(float(yaw.gyro_turn_rad[index]), EVERY_S)
        hold.compass(float(compass[index]))
        if index < CALIBRATION_FIXES:
            hold.reference(float(true[index]), math.radians(0.05))
            continue
        place, delays = calibrated.solve(records.samples[index], depths[index], hold.yaw_rad)
        new.append(place - bench.world_m[index, 1:])
        # A fix that the chain itself withholds is no error: it is counted as missing.
        slips.append(bool(np.isfinite(place).all() and np.abs(delays - records.delays_s[index]).max() > SLIP_S))
        published = bench.published(index, float(depths[index]), float(compass[index]))
        thesis.append(published - bench.world_m[index, 1:])
    return Errors({"new": np.array(new), "thesis": np.array(thesis), "slips": np.array(slips)})


class _Bench:
    """Records of one session in the frame of the bench: the array turned by its yaw."""

    def __init__(self, drawn: ReceiverArray, records: SimulatedRecords, yaw_rad: Array, sources_m: Array) -> None:
        self._drawn = drawn
        self._records = records
        self._sources = sources_m
        turns = np.array([rotation_from_euler(0.0, 0.0, float(each)) for each in yaw_rad])
        self.world_m: Array = np.einsum("fij,fj->fi", turns, sources_m)

    def calibrate(self) -> _Calibrated:
        """Receivers' responses without truth; positions, sound speed and constant delays with it."""
        first = self._records.samples[:CALIBRATION_FIXES]
        rate = self._records.sample_rate_hz
        responses = estimate_responses(first, rate, self._drawn, NOMINAL_MPS).responses
        found = [estimate_delays(each, rate, self._drawn, NOMINAL_MPS, responses=responses) for each in first]
        delays = np.array([_all_delays(each, len(self._drawn)) for each in found])
        geometry = calibrate_geometry(
            self._drawn,
            delays,
            self._sources[:CALIBRATION_FIXES],
            0.1e-6,
            NOMINAL_MPS,
            GeometryPriors(position_m=1e-3, sound_speed_share=0.01, mounting_rad=(0.0, 0.0, 0.0), offset_s=0.5e-6),
        )
        array = ReceiverArray(geometry.array.positions_m, self._drawn.sample_skew_s)
        return _Calibrated(array, geometry.sound_speed_mps, geometry.offsets_s, responses, rate)

    def published(self, index: int, depth_m: float, yaw_rad: float) -> Array:
        """Argmax, 343 m/s, no skew, the compass's yaw as it is, Hooke-Jeeves."""
        found = estimate_delays(
            self._records.samples[index], self._records.sample_rate_hz, self._drawn, NOMINAL_MPS, "thesis"
        )
        turned = self._drawn.positions_m @ rotation_from_euler(0.0, 0.0, yaw_rad).T
        return hooke_jeeves_2d(turned, found.delays_s, NOMINAL_MPS, depth_m).position_m[1:]


@dataclass(frozen=True, eq=False)
class _Calibrated:
    array: ReceiverArray
    sound_mps: float
    offsets_s: Array
    responses: ReceiverResponses
    rate_hz: float

    def solve(self, samples: Array, depth_m: float, yaw_rad: float) -> tuple[Array, Array]:
        """Y and z (2,) in the bench's frame, NaN where there is no fix, and the delays."""
        found = estimate_delays(samples, self.rate_hz, self.array, self.sound_mps, responses=self.responses)
        delays = _all_delays(found, len(self.array)) - self.offsets_s
        turn = rotation_from_euler(0.0, 0.0, yaw_rad)
        solution = solve_source(
            self.array.positions_m,
            delays,
            found.covariance_s2 if len(found.delays_s) == len(delays) else 1e-12 * np.eye(len(delays)),
            self.sound_mps,
            depth=(depth_m, DEPTH_STD_M),
            down=turn.T @ np.array((1.0, 0.0, 0.0)),
        )
        place = np.full(2, np.nan) if solution.position_m is None else (turn @ solution.position_m)[1:]
        return place, delays


def _all_delays(found: TimeDifferences, count: int) -> Array:
    """Against receiver 0, NaN where a receiver was left out."""
    arrivals = np.full(count, np.nan)
    if found.usable:
        arrivals[found.receivers[0]] = 0.0
        arrivals[found.receivers[1:]] = -found.delays_s
    delays: Array = arrivals[0] - arrivals[1:]
    return delays


def bench_rows(cells: Mapping[str, Sequence[Errors]]) -> list[Row]:
    """Two-dimensional errors of both chains."""
    made: list[Row] = []
    for cell, outcomes in cells.items():
        if not outcomes:
            continue
        place = f"I7.{cell.replace(' ', '')}"
        new, thesis = (
            1e3 * np.linalg.norm(np.concatenate([each.by_name[chain] for each in outcomes]), axis=1)
            for chain in ("new", "thesis")
        )
        slips = np.concatenate([each.by_name["slips"] for each in outcomes]).astype(bool)
        name = f"{cell}: thesis's set-up end to end"
        missing = ~np.isfinite(new)
        made += [
            rms_row(place, f"{name}, our chain, RMS", new[~missing], "mm", _END_MUST_MM[cell]),
            share_row(f"{place}.missing", f"{name}, our chain, pulses without a fix", missing, 1.0),
            share_row(f"{place}.slips", f"{name}, our chain, fixes with a slip", slips),
            rms_row(f"{place}.thesis", f"{name}, thesis's chain, RMS", thesis, "mm"),
        ]
    return made


def run_attitude(job: AcousticJob, material: Mapping[str, bytes]) -> Errors | AcousticDiveOutcome:
    """Start yaws of many sessions, yaw held while moving, or one dive for each block of draws."""
    if job.cell == "dive":
        return acoustic_dive(job.seed, smooth=True)
    start, stated, moving = [], [], []
    for draw in range(job.draws):
        seed = 1000 * job.seed + draw
        rest = yaw_session(seed, round(REST_S), 1.0)
        found = average_yaw(rest.times_s, rest.compass_rad)
        start.append(math.remainder(found.yaw_rad - float(rest.true_rad[-1]), math.tau))
        stated.append(found.std_rad)
        moving.append(_held(seed))
    return Errors({"start": np.array(start), "stated": np.array(stated), "moving": np.array(moving)})


def _held(seed: int) -> float:
    """RMS yaw error over five minutes of moving after the start."""
    rest = round(REST_S)
    steps = np.radians(3.0) * np.random.default_rng([seed, 0x0DD]).standard_normal(rest + 300)
    steps[:rest] = 0.0
    session = yaw_session(seed + 7_000_000, rest + 300, 1.0, np.cumsum(steps))
    hold = YawHold(float(session.compass_rad[0]))
    errors = []
    for index, turned in enumerate(session.gyro_turn_rad.tolist()):
        if index < rest:
            hold.rest(turned, 1.0)
        else:
            hold.turn(turned, 1.0)
        hold.compass(float(session.compass_rad[index]))
        if index >= rest:
            errors.append(math.remainder(hold.yaw_rad - float(session.true_rad[index]), math.tau))
    return float(np.sqrt(np.mean(np.square(errors))))


def attitude_rows(cells: Mapping[str, Sequence[Errors | AcousticDiveOutcome]]) -> list[Row]:
    """Yaw at rest and moving; ATE of the dives against the target and their bound."""
    made: list[Row] = []
    yaws = [each for each in cells.get("yaw", ()) if isinstance(each, Errors)]
    if yaws:
        start, stated, moving = (
            np.concatenate([each.by_name[name] for each in yaws]) for name in ("start", "stated", "moving")
        )
        made += [
            rms_row(
                "I8.start", f"start yaw after {REST_S:.0f} s at rest, RMS", np.degrees(start), "deg", _YAW_MUST_DEG
            ),
            JudgedRow(
                "I8.start.ratio",
                "start yaw: RMS error over what was stated",
                bootstrap(np.column_stack((start, stated)), ratio_of_rms),
                "1",
                Target(high=1.15),
            ),
            share_row(
                "I8.start.outside", "start yaw: outside its 95 % interval", np.abs(start) > 1.959964 * stated, 8.0
            ),
            rms_row("I8.moving", "yaw while moving, RMS", np.degrees(moving), "deg", _YAW_MUST_DEG),
        ]
    dives = [each for each in cells.get("dive", ()) if isinstance(each, AcousticDiveOutcome)]
    if dives:
        made += _dive_rows(dives)
    return made


def _dive_rows(dives: Sequence[AcousticDiveOutcome]) -> list[Row]:
    """The smoothed track is judged against the target, both tracks for what they state of themselves."""
    bound = math.sqrt(float(np.mean([each.bound_m**2 for each in dives])))
    name = "1 km lawnmower within 100 m of a transmitter, 0.2 Hz"
    tracks = [
        ("", "smoothed", [each.smoothed for each in dives if each.smoothed is not None]),
        (".causal", "causal", [each.causal for each in dives]),
    ]
    made: list[Row] = []
    for place, kind, found in tracks:
        judged = kind == "smoothed"
        ate = bootstrap([each.ate_m for each in found])
        rms = math.sqrt(float(np.mean([each.ate_m**2 for each in found])))
        made += [
            JudgedRow(
                f"I8.dive{place}",
                f"{name}: ATE {kind}, median",
                ate,
                "m",
                Target(high=_ATE_MUST_M) if judged else None,
                Target(high=_ATE_AIM_M) if judged else None,
                rms / bound if judged else None,
            ),
            Row(
                f"I8.dive{place}.band",
                f"{name}: epochs with position NEES in the 95 % band, {kind}, mean of dives",
                bootstrap([100.0 * each.position_in_band for each in found], _mean),
                "%",
                Target(low=90.0),
            ),
            Row(
                f"I8.dive{place}.nees",
                f"{name}: mean position NEES / 2, {kind}, mean of dives",
                bootstrap([0.5 * each.position_nees for each in found], _mean),
                "1",
            ),
        ]
    made.append(
        Row(
            "I8.dive.nis",
            f"{name}: mean NIS / dof of the pulses",
            bootstrap([each.nis_ratio for each in dives]),
            "1",
            Target(0.7, 1.4),
        )
    )
    return made


def _mean(rows: Array) -> Array:
    """Along the last axis."""
    return np.asarray(rows.mean(axis=-1))


CASES = (
    AcousticCase(
        "I6",
        "Range by a fifth receiver (simulated)",
        RANGES,
        run_range,
        range_rows,
        more=dict.fromkeys(RANGES, 8),
    ),
    AcousticCase("I7", "The thesis's set-up from end to end (simulated)", RANGES, run_bench, bench_rows),
    AcousticCase("I8", "Yaw, and a dive with a transmitter (simulated)", ("yaw", "dive"), run_attitude, attitude_rows),
)
