"""What a position from time differences costs: many at once, one with its covariance, and the published search.

Time is the processor time of this thread, so that other programs do not count; the best of several rounds.
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
from bluerov_slam.acoustics.ray_tracing import SoundProfile, direct_ray
from bluerov_slam.navigation.rotation import rotation_from_euler

SOUND_MPS = 343.0
FIXES, SINGLE, ROUNDS = 50_000, 300, 7
BATCH_MUST = "<= 2"
PUBLISHED_MS = "0.37 to 0.50 ms in the re-analysis of the thesis"


def rows() -> list[dict[str, object]]:
    """acoustic_batch, acoustic_batch_attitude, acoustic_solve, acoustic_hooke_jeeves, acoustic_ray."""
    random = np.random.default_rng(0)
    array = ReceiverArray.cross()
    sources = np.column_stack(
        (random.uniform(1.3, 3.9, FIXES), random.uniform(-1.0, 1.0, FIXES), random.uniform(-0.5, 0.5, FIXES))
    )
    ways = np.linalg.norm(sources[:, None] - array.positions_m, axis=2)
    delays = (ways[:, :1] - ways[:, 1:]) / SOUND_MPS + 1e-7 * random.standard_normal((FIXES, 3))
    covariance = 1e-14 * (np.eye(3) + 1.0)
    forward = (1.0, 0.0, 0.0)
    turns = np.array([rotation_from_euler(*angles) for angles in random.uniform(-0.3, 0.3, (FIXES, 3))])
    depths = np.einsum("fj,fj->f", turns[:, 0], sources)
    batch_us = (
        1e6 / FIXES * _best(lambda: solve_batch(array.positions_m, delays, SOUND_MPS, sources[:, 0], down=forward))
    )
    turned_us = (
        1e6
        / FIXES
        * _best(lambda: solve_batch(array.positions_m, delays, SOUND_MPS, depths, down=forward, rotations=turns))
    )

    def singly() -> None:
        for index in range(SINGLE):
            depth = (float(sources[index, 0]), 5e-4)
            solve_source(array.positions_m, delays[index], covariance, SOUND_MPS, depth=depth, down=forward)

    def published() -> None:
        for index in range(SINGLE):
            hooke_jeeves_2d(array.positions_m, delays[index], SOUND_MPS, float(sources[index, 0]))

    search_ms = 1e3 / SINGLE * _best(published)
    solve_ms = 1e3 / SINGLE * _best(singly)
    beside = f"Hooke-Jeeves as published, same run: {1e3 * search_ms:.0f} us"
    profile = SoundProfile(np.linspace(0.0, 40.0, 41), 1520.0 - 15.0 * np.tanh(np.linspace(-2.0, 2.0, 41)))
    ray_ms = 1e3 * _best(lambda: direct_ray(profile, 5.0, 30.0, 60.0))
    return [
        row("acoustic_batch", "position at a known depth, many at once, per fix", batch_us, "us", BATCH_MUST, beside),
        row("acoustic_batch_attitude", "the same, each fix with its attitude", turned_us, "us", "", beside),
        row("acoustic_solve", "position with covariance, both sides of the array", solve_ms, "ms", "", beside),
        row("acoustic_hooke_jeeves", "Hooke-Jeeves as published", search_ms, "ms", "", PUBLISHED_MS),
        row("acoustic_ray", "direct ray through 40 layers", ray_ms, "ms"),
    ]


def _best(work: Callable[[], object]) -> float:
    took = []
    for _ in range(ROUNDS):
        begin = time.thread_time()
        work()
        took.append(time.thread_time() - begin)
    return min(took)
