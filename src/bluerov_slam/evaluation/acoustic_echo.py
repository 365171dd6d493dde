"""I4: fixes in a wrong carrier cell where the floor echoes and receivers differ. Simulated.

The array 0.66 m above a floor, level with the source, pitched by up to 8 degrees and turned by up to 20; receivers of
1 % resonance and filters of 10 % corner tolerance, one set per seed, not calibrated; 15 dB. Ours records before the
trigger (448 samples); the thesis's board, taken as it is, does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.time_differences import Method, estimate_delays
from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob, share_row
from bluerov_slam.evaluation.acoustic_position import AIR_MPS, thesis_array
from bluerov_slam.evaluation.acoustic_timing import SLIP_S
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.simulation.acoustic_paths import Reflector
from bluerov_slam.simulation.acoustic_record import AcousticSetup, Tolerances, Window, simulate_records

FLOOR_M = 0.66
SNR_DB = 15.0
PITCH_DEG, ASIDE_DEG = 8.0, 20.0
PRE_TRIGGER = 448
MUST_PERCENT = 5.0
_CELLS = tuple(f"{range_m} m {echo}" for range_m in (1.3, 2.55, 3.8) for echo in (0.0, 0.3, 0.6))


@dataclass(frozen=True, eq=False)
class EchoOutcome:
    """Which draws (draws,) ended in a wrong cell, by chain; and in which only the beginning was trusted."""

    off_cell: dict[str, NDArray[np.bool_]]
    onset_only: NDArray[np.bool_]


def run(job: AcousticJob, material: Mapping[str, bytes]) -> EchoOutcome:
    """One receiver set under one pitch."""
    range_m, echo = (float(part) for part in job.cell.split(" m "))
    rng = np.random.default_rng([job.seed, 0xEC0])
    pitch = np.radians(rng.uniform(-PITCH_DEG, PITCH_DEG))
    aside = np.radians(rng.uniform(-ASIDE_DEG, ASIDE_DEG, job.draws))
    level = range_m * np.column_stack((np.cos(aside), np.sin(aside), np.zeros(job.draws)))
    rotation_ned_array = np.array(
        [[np.cos(pitch), 0.0, np.sin(pitch)], [0.0, 1.0, 0.0], [-np.sin(pitch), 0.0, np.cos(pitch)]]
    )
    sources = level @ rotation_ned_array
    down = rotation_ned_array[2]
    floor = Reflector((float(down[0]), float(down[1]), float(down[2])), FLOOR_M, echo)
    off_cell: dict[str, NDArray[np.bool_]] = {}
    onset_only = np.zeros(job.draws, dtype=bool)
    chains: tuple[tuple[str, Method, Window], ...] = (
        ("joint with onset", "joint", Window("ring", 2048, PRE_TRIGGER)),
        ("joint without onset", "joint", Window("blocks")),
        ("thesis", "thesis", Window("blocks")),
    )
    for name, method, window in chains:
        setup = AcousticSetup(
            thesis_array(),
            reflectors=(floor,),
            tolerances=Tolerances(receiver_resonance=0.01, filter_corner=0.1),
            receiver_set=job.seed,
            snr_db=SNR_DB,
            window=window,
        )
        records = simulate_records(setup, sources, job.seed)
        found = [
            estimate_delays(each, records.sample_rate_hz, setup.array, AIR_MPS, method) for each in records.samples
        ]
        # A missing answer is no right one.
        far = [
            not each.usable or bool(np.any(np.abs(each.delays_s - truth) > SLIP_S))
            for each, truth in zip(found, records.delays_s, strict=True)
        ]
        off_cell[name] = np.array(far)
        if name == "joint with onset":
            onset_only = np.array([each.onset_only for each in found])
    return EchoOutcome(off_cell, onset_only)


def rows(cells: Mapping[str, Sequence[EchoOutcome]]) -> list[Row]:
    """Shares of fixes in a wrong cell."""
    made: list[Row] = []
    for cell, outcomes in cells.items():
        if not outcomes:
            continue
        range_m, echo = cell.split(" m ")
        for chain in outcomes[0].off_cell:
            happened = np.concatenate([each.off_cell[chain] for each in outcomes])
            must = MUST_PERCENT if chain == "joint with onset" else None
            name = f"{range_m} m, echo {echo}: {chain}, fixes in a wrong cell"
            made.append(share_row(f"I4.{range_m}m.{echo}.{chain.replace(' ', '_')}", name, happened, must))
        early = np.concatenate([each.onset_only for each in outcomes])
        made.append(share_row(f"I4.{range_m}m.{echo}.onset_only", f"{range_m} m, echo {echo}: echo noticed", early))
    return made


CASES = (AcousticCase("I4", "Floor echo, 1 % receivers, 10 % filters (simulated)", _CELLS, run, rows),)
