import numpy as np
import pytest

from bluerov_slam.simulation.noise_processes import GaussMarkov, random_walk_time_constant_s


def test_spread_and_correlation_time_are_as_asked() -> None:
    process = GaussMarkov(np.random.default_rng(1), (0.5, 2.0), 20.0)
    values = process.many(np.arange(0.0, 40_000.0))
    assert values.std(axis=0) == pytest.approx((0.5, 2.0), rel=0.06)
    for lag in (5, 20, 40):
        correlation = (values[:-lag] * values[lag:]).mean(axis=0) / values.var(axis=0)
        assert correlation == pytest.approx(np.exp(-lag / 20.0), abs=0.05)
    assert abs(np.corrcoef(values.T)[0, 1]) < 0.06


def test_over_short_spans_it_walks_as_asked() -> None:
    std, walk = 0.2, 0.001
    process = GaussMarkov(np.random.default_rng(2), (std,) * 500, random_walk_time_constant_s(std, walk))
    moved = process.at(400.0) - process.at(0.0)
    assert moved.std() == pytest.approx(walk * 400.0**0.5, rel=0.1)
    assert process.at(0.0).std() == pytest.approx(std, rel=0.1)


def test_the_order_of_asking_changes_nothing() -> None:
    def fresh() -> GaussMarkov:
        return GaussMarkov(np.random.default_rng(3), (1.0,), 7.0, step_s=0.5)

    times = np.random.default_rng(0).uniform(-5.0, 3_000.0, 200)
    together = fresh().many(times)[:, 0]
    process = fresh()
    alone = np.array([process.at(t)[0] for t in times])
    assert together == pytest.approx(alone, abs=1e-15)
    assert process.at(12.3) + 0.1 * process.slope(12.3) == pytest.approx(process.at(12.4), abs=1e-12)
