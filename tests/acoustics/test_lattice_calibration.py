import numpy as np
import pytest

from acoustics.slip_samples import CELLS_MM, RANGE_MM, SD_MM, as_fixes, cell_probability, slipped_fixes
from bluerov_slam.acoustics.lattice_calibration import attitude_terms, calibrate_session, prior_probability
from bluerov_slam.acoustics.noise_tuning import tune
from bluerov_slam.acoustics.slip_lattice import LatticeSettings, run_lattice

COEFFICIENTS_MM = np.array(
    [[20.0, 8.0], [-60.0, 2.0], [10.0, -3.0], [-80.0, 4.0], [-15.0, 0.0], [5.0, 1.0], [9.0, 2.0]]
)


@pytest.fixture
def session():
    """Fixes less truth, attitudes and the cells' true probabilities."""
    rng = np.random.default_rng(4)
    attitude = rng.uniform(-1.0, 1.0, (900, 3)) * (25.0, 12.0, 12.0)
    bias = attitude_terms(attitude, 2) @ COEFFICIENTS_MM
    probability = cell_probability([0.5, 0.15, 0.1, 0.1, 0.05, 0.05, 0.05])
    return slipped_fixes(bias, probability, rng), attitude, bias, probability


def test_finds_bias_cells_and_noise_of_a_session(session):
    error, attitude, bias, probability = session
    found = calibrate_session(error, attitude, CELLS_MM, RANGE_MM, level=2)
    assert np.sqrt(np.mean((found.bias_mm(attitude) - bias) ** 2)) < 1.5
    np.testing.assert_allclose(found.probability[:7], probability[:7], atol=0.05)
    np.testing.assert_allclose(found.sd_mm, SD_MM, rtol=0.2)


def test_each_level_holds_more_of_the_bias(session):
    error, attitude, bias, _ = session
    found = [calibrate_session(error, attitude, CELLS_MM, RANGE_MM, level) for level in (0, 1, 2)]
    assert [len(each.coefficients_mm) for each in found] == [1, 4, 7]
    constant, linear, square = (np.sqrt(np.mean((each.bias_mm(attitude) - bias) ** 2)) for each in found)
    assert constant > 2.0 * linear > 4.0 * square


def test_nearer_cells_are_thought_likelier():
    prior = prior_probability(CELLS_MM)
    assert prior.sum() == pytest.approx(1.0)
    assert np.all(np.diff(prior) <= 1e-15)


def test_the_likelihood_of_innovations_finds_the_noise_that_made_them():
    rng = np.random.default_rng(8)
    probability = cell_probability([0.6, 0.1, 0.1, 0.1, 0.1])
    tracks = [np.cumsum(rng.normal(0.0, np.sqrt(3.0 * np.array([10.0, 1.0])), (500, 2)), axis=0) for _ in range(4)]
    fixes = [as_fixes(slipped_fixes(track, probability, rng), probability) for track in tracks]
    grids = {
        "walk_y": (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0),
        "walk_z": (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0),
        "noise_y": (0.25, 0.5, 1.0, 2.0, 4.0),
        "noise_z": (0.25, 0.5, 1.0, 2.0, 4.0),
    }

    def minus_log_likelihood(settings):
        return -float(np.sum(run_lattice(fixes, settings).log_likelihood))

    start = LatticeSettings(0.1, 30.0, noise_y=4.0, noise_z=0.25, outlier_share=0.01)
    found, cost = tune(minus_log_likelihood, start, grids)
    assert (found.walk_y, found.walk_z, found.noise_y, found.noise_z) == (10.0, 1.0, 1.0, 1.0)
    assert cost == minus_log_likelihood(found) < minus_log_likelihood(start)
