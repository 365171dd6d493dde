"""Time differences on simulated records: every method on a clean one, and what the joint estimate adds."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses
from bluerov_slam.acoustics.time_differences import METHODS, Method, estimate_delays
from bluerov_slam.simulation.acoustic_record import AcousticSetup, simulate_records

ARRAY = ReceiverArray.cross(sample_skew_s=[0.0, THESIS_RANK_SKEW_S, 0.0, THESIS_RANK_SKEW_S])
SOUND_MPS = 343.0
SOURCES = np.array([[2.5, 0.4, -0.2], [1.3, -0.3, 0.1], [3.7, 0.9, 0.4]])


@pytest.mark.parametrize("method", [each for each in METHODS if each not in ("matched", "phat")])
def test_a_clear_record_gives_the_true_delays(method: Method) -> None:
    many = simulate_records(AcousticSetup(ARRAY, snr_db=30.0), SOURCES, 3)
    tolerance = {"joint": 0.05e-6, "band_limited": 0.1e-6, "envelope": 20e-6}.get(method, 1.1e-6)
    for samples, truth in zip(many.samples, many.delays_s, strict=True):
        found = estimate_delays(samples, many.sample_rate_hz, ARRAY, SOUND_MPS, method)
        assert found.reference == 0
        assert np.abs(found.delays_s - truth).max() < tolerance


def test_the_joint_estimate_is_sure_of_its_cell_and_honest_about_its_spread() -> None:
    sources = np.tile(SOURCES, (20, 1))
    many = simulate_records(AcousticSetup(ARRAY, snr_db=10.0), sources, 5)
    squared = []
    for samples, truth in zip(many.samples, many.delays_s, strict=True):
        found = estimate_delays(
            samples, many.sample_rate_hz, ARRAY, SOUND_MPS, responses=ReceiverResponses.identical(4)
        )
        error = found.delays_s - truth
        assert found.slip_probability < 0.01
        assert abs(found.snr_db.mean() - 10.0) < 1.5
        squared.append(error @ np.linalg.solve(found.covariance_s2, error) / 3.0)
    assert 0.7 < np.mean(squared) < 1.5
