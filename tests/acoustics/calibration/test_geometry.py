import math

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.calibration.geometry import (
    GeometryCalibration,
    GeometryPriors,
    calibrate_geometry,
    in_words,
    self_calibrate,
)
from bluerov_slam.errors import ArrayGeometryError
from bluerov_slam.navigation.rotation import exp_so3

NOMINAL_MPS, REAL_MPS = 343.0, 346.4
TIMING_S = 1e-7
DRAWN = ReceiverArray.cross(centre=True)


class Bench:
    """An array that is a little otherwise than drawn, turned by a mounting error."""

    def __init__(self, seed: int = 1, pulses: int = 120) -> None:
        rng = np.random.default_rng(seed)
        self.moved_m = 1e-3 * rng.standard_normal((5, 3))
        self.real = ReceiverArray(DRAWN.positions_m + self.moved_m)
        self.mounting = np.radians((0.5, -1.0, 2.0))
        self.sources = np.column_stack(
            (rng.uniform(1.0, 3.0, pulses), rng.uniform(-1.5, 1.5, pulses), rng.uniform(-1.5, 1.5, pulses))
        )
        turned = self.sources @ exp_so3(-self.mounting).T
        exact = np.array([self.real.delays_s(source, REAL_MPS) for source in turned])
        noise = TIMING_S * rng.standard_normal((pulses, 5))
        self.delays = exact + noise[:, :1] - noise[:, 1:]

    def calibrated(self, priors: GeometryPriors | None = None) -> GeometryCalibration:
        return calibrate_geometry(DRAWN, self.delays, self.sources, TIMING_S, NOMINAL_MPS, priors)


def test_known_places_tell_positions_sound_speed_and_mounting_within_their_covariance() -> None:
    bench = Bench()
    found = bench.calibrated()
    assert found.converged
    assert found.sound_speed_mps == pytest.approx(REAL_MPS, rel=2e-3)
    truth = np.concatenate((bench.moved_m.ravel(), [REAL_MPS / NOMINAL_MPS - 1.0], bench.mounting))
    estimate = np.array([each.value for each in found.learned])
    error = truth - estimate
    assert error @ np.linalg.solve(found.covariance[:19, :19], error) / 19.0 < 2.0
    assert found.nis / found.dof == pytest.approx(1.0, abs=0.2)


def test_calibrated_delays_predict_new_pulses() -> None:
    found, fresh = Bench().calibrated(), Bench(pulses=200)
    turn = exp_so3(-found.mounting_rad)
    predicted = np.array([found.array.delays_s(turn @ source, found.sound_speed_mps) for source in fresh.sources[-50:]])
    assert np.sqrt(np.mean((predicted - fresh.delays[-50:]) ** 2)) < 2.0 * TIMING_S
    drawn = np.array([DRAWN.delays_s(source, NOMINAL_MPS) for source in fresh.sources[-50:]])
    assert np.sqrt(np.mean((drawn - fresh.delays[-50:]) ** 2)) > 50.0 * TIMING_S


def test_what_the_data_cannot_tell_is_named_and_keeps_its_prior() -> None:
    """A turn of all receivers together is a mounting error: data see only their sum."""
    found = Bench().calibrated()
    assert found.weak
    assert any("receiver" in text for text in found.weak)
    assert (found.singular_values[-3:] < 1e-6).all()
    depth = next(each for each in found.learned if each.name == "receiver 0 x (m)")
    assert depth.share > 0.5
    assert "not told by these data" in in_words(found)


def test_pulses_from_one_direction_alone_leave_most_open() -> None:
    rng = np.random.default_rng(2)
    sources = np.array((2.0, 0.3, 0.1)) + 0.01 * rng.standard_normal((60, 3))
    delays = np.array([DRAWN.delays_s(source, NOMINAL_MPS) for source in sources])
    few = calibrate_geometry(DRAWN, delays, sources, TIMING_S, NOMINAL_MPS)
    many = Bench().calibrated()
    assert (few.singular_values > 1.0).sum() < (many.singular_values > 1.0).sum()


def test_slipped_pulses_and_echoes_are_left_out() -> None:
    bench = Bench()
    bench.delays[5, 1] += 25e-6
    bench.delays[17] += np.array((40e-6, -30e-6, 10e-6, 0.0))
    bench.delays[30, 2] = math.nan
    found = bench.calibrated()
    assert {5, 17, 30} <= set(found.excluded)
    assert len(found.excluded) <= 5
    assert found.sound_speed_mps == pytest.approx(REAL_MPS, rel=2e-3)


def test_constant_delays_are_told_from_places() -> None:
    bench = Bench(pulses=300)
    late = np.array((0.6e-6, -0.4e-6, 0.2e-6, 0.9e-6))
    bench.delays = bench.delays + late
    found = bench.calibrated(GeometryPriors(position_m=1e-3, offset_s=1e-6))
    std = np.sqrt(np.diag(found.covariance))[-4:]
    assert (np.abs(found.offsets_s - late) < 4.0 * std + 1e-9).all()
    assert found.corrected_delays_s(bench.delays[0]) == pytest.approx(bench.delays[0] - found.offsets_s)


def test_without_any_truth_shape_is_learnt_and_size_is_not() -> None:
    bench = Bench(pulses=200)
    found = self_calibrate(DRAWN, bench.delays, TIMING_S, NOMINAL_MPS)
    assert found.converged
    assert found.nis / found.dof == pytest.approx(1.0, abs=0.3)
    before = DRAWN.positions_m - DRAWN.positions_m.mean(axis=0)
    after = found.array.positions_m - found.array.positions_m.mean(axis=0)
    real = bench.real.positions_m - bench.real.positions_m.mean(axis=0)

    def misshapen(positions: np.ndarray) -> float:
        """What no turn and no size explains."""
        left, values, right = np.linalg.svd(positions.T @ real)
        turn = right.T @ np.diag((1.0, 1.0, np.sign(np.linalg.det(right.T @ left.T)))) @ left.T
        size = values.sum() / float((positions**2).sum())
        return float(np.linalg.norm(size * positions @ turn.T - real))

    # Along the normal of a flat array hardly anything is seen.
    assert misshapen(after) < 0.75 * misshapen(before)
    assert not np.any(found.mounting_rad)
    assert any("sound speed" in text for text in found.weak)


def test_what_is_no_data_is_said() -> None:
    bench = Bench(pulses=10)
    with pytest.raises(ArrayGeometryError, match="3 delays for 5 receivers"):
        calibrate_geometry(DRAWN, bench.delays[:, :3], bench.sources, TIMING_S, NOMINAL_MPS)
    with pytest.raises(ArrayGeometryError, match="9 places"):
        calibrate_geometry(DRAWN, bench.delays, bench.sources[:9], TIMING_S, NOMINAL_MPS)
    with pytest.raises(ArrayGeometryError, match="no pulse"):
        calibrate_geometry(DRAWN, np.full((4, 4), np.nan), bench.sources[:4], TIMING_S, NOMINAL_MPS)
