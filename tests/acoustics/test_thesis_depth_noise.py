import numpy as np
import pytest

import real_data
from bluerov_slam.acoustics.thesis_depth_noise import aligned, normal_sequence
from bluerov_slam.evaluation.thesis_checks import depth_noise_correlation
from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs


def test_the_sequence_begins_with_the_generators_own_numbers():
    """Worked by hand: 1664525 + 1013904223 = 1015568748, and again 1586005467, over 2^32."""
    u, v = 2.0 * np.array([1015568748, 1586005467]) / 2**32 - 1.0
    scale = np.sqrt(-2.0 * np.log(u * u + v * v) / (u * u + v * v))
    np.testing.assert_allclose(normal_sequence(2), [u * scale, v * scale])


def test_the_sequence_is_normal():
    numbers = normal_sequence(20000)
    assert numbers.mean() == pytest.approx(0.0, abs=0.02)
    assert numbers.std() == pytest.approx(1.0, abs=0.02)


def test_finds_the_numbers_behind_a_log_that_starts_late_and_lacks_rows():
    sequence = normal_sequence(5000)
    drawn = np.delete(sequence[700:1000], [50, 51, 120])
    noise = np.round(0.5 * drawn, 2)
    noise[20] += 2.0  # one row whose truth is not its own
    chosen, correlation = aligned(noise, sequence)
    assert np.mean(chosen == drawn) > 0.98
    assert correlation > 0.9


def test_the_stationary_logs_hold_this_sequence():
    logs = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs
    found = depth_noise_correlation(logs)
    assert len(found) == 7
    assert np.median(list(found.values())) >= 0.997
    assert min(found.values()) >= 0.99
