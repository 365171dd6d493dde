"""What delays from a record cost: all receivers at once, pair by pair, and the thesis's chain in the same run.

Records of four receivers and 2048 samples at 15 dB. Time is the processor time of this thread; the best of several
rounds. The joint fix includes the examination of the record, cells, alternatives and covariance, and the position.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from bench.system import row
from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.hooke_jeeves import hooke_jeeves_2d
from bluerov_slam.acoustics.position import solve_source
from bluerov_slam.acoustics.position_batch import solve_batch
from bluerov_slam.acoustics.time_differences import estimate_delays, pairwise
from bluerov_slam.acoustics.time_differences.band import BandSpectra
from bluerov_slam.simulation.acoustic_record import AcousticSetup, Window, simulate_records

SOUND_MPS = 343.0
RECORDS, ROUNDS = 40, 7
JOINT_MUST, PAIR_MUST = "<= 3", "<= 0.25"
FORWARD = (1.0, 0.0, 0.0)


def rows() -> list[dict[str, object]]:
    """acoustic_joint, acoustic_joint_onset, acoustic_pairs, acoustic_thesis_chain."""
    rng = np.random.default_rng(0)
    array = ReceiverArray.cross()
    sources = np.column_stack(
        (rng.uniform(1.3, 3.9, RECORDS), rng.uniform(-0.8, 0.8, RECORDS), rng.uniform(-0.3, 0.3, RECORDS))
    )
    plain = simulate_records(AcousticSetup(array, snr_db=15.0), sources, 1)
    ring = simulate_records(AcousticSetup(array, snr_db=15.0, window=Window("ring", 2048, 448)), sources, 1)
    rate = plain.sample_rate_hz
    limits = array.largest_delay_s(SOUND_MPS)[:3] * pairwise.LAG_MARGIN

    def joint(samples: np.ndarray) -> None:
        for record, source in zip(samples, sources, strict=True):
            found = estimate_delays(record, rate, array, SOUND_MPS)
            depth = (float(source[0]), 5e-4)
            solve_source(array.positions_m, found.delays_s, found.covariance_s2, SOUND_MPS, depth=depth, down=FORWARD)

    def pairs() -> None:
        delays = [
            pairwise.band_limited(BandSpectra.of(record - record.mean(axis=1, keepdims=True), rate), limits)
            for record in plain.samples
        ]
        solve_batch(array.positions_m, np.array(delays), SOUND_MPS, sources[:, 0], down=FORWARD)

    def published() -> None:
        for record, source in zip(plain.samples, sources, strict=True):
            hooke_jeeves_2d(array.positions_m, pairwise.thesis(record, rate), SOUND_MPS, float(source[0]))

    thesis_ms = _best(published)
    beside = f"argmax and Hooke-Jeeves as published, same run: {thesis_ms:.2f} ms"
    whole, searched = _best(lambda: joint(plain.samples)), _best(lambda: joint(ring.samples))
    return [
        row("acoustic_joint", "joint fix, position included", whole, "ms", JOINT_MUST, beside),
        row(
            "acoustic_joint_onset",
            "the same of a record with its onset, searched for an echo",
            searched,
            "ms",
            JOINT_MUST,
            beside,
        ),
        row("acoustic_pairs", "fix from three band-limited pairs", _best(pairs), "ms", PAIR_MUST, beside),
        row("acoustic_thesis_chain", "argmax and Hooke-Jeeves as published", thesis_ms, "ms"),
    ]


def _best(work: Callable[[], object]) -> float:
    """Milliseconds per record."""
    took = []
    for _ in range(ROUNDS):
        begin = time.thread_time()
        work()
        took.append(time.thread_time() - begin)
    return 1e3 * min(took) / RECORDS
