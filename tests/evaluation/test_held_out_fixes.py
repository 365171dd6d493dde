"""Which fixes are held out, what they are compared with, and that a copy of the navigator is asked."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.evaluation import held_out_fixes
from bluerov_slam.evaluation.held_out_fixes import inside_ellipse, predict_held_out
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.records import PositionFix, VehicleAttitude
from bluerov_slam.sources.log_import import read_log
from real_data import recording

FRAME = LocalFrame(47.6, -122.4)


def straight_dive(seconds: int, wild_at: int | None = None) -> list[PositionFix | VehicleAttitude]:
    """Half a metre per second to the north-east, a fix a second with 0.3 m of noise, one of them 40 m off if wanted."""
    rng = np.random.default_rng(3)
    records: list[PositionFix | VehicleAttitude] = []
    for second in range(seconds):
        north, east = 0.35 * second + rng.normal(0, 0.3), 0.35 * second + rng.normal(0, 0.3)
        north += 40.0 if second == wild_at else 0.0
        latitude, longitude, _ = FRAME.to_geodetic(north, east)
        roll = 0.01 * float(rng.normal())
        records.append(VehicleAttitude(second - 0.1, 1000 * second + 900, roll, 0.0, 0.8 + roll, (0.0, 0.0, 0.0)))
        records.append(PositionFix(float(second), float(second), "test", latitude, longitude, None))
    return records


def test_blocks_begin_a_minute_after_the_first_fix_and_repeat() -> None:
    held, given = predict_held_out(straight_dive(200), 10.0)
    # 60..69, 100..109, 140..149, 180..189 s are held out of 200 fixes.
    assert [sum(each.block == block for each in held) for block in range(4)] == [10, 10, 10, 10]
    assert given.outliers == 0
    assert given.others == 160
    assert max(each.since_fix_s for each in held) == pytest.approx(10.0)


def test_a_steady_course_is_predicted_better_than_by_the_last_two_fixes() -> None:
    held, _ = predict_held_out(straight_dive(300), 10.0)
    ours = np.array([each.ours_m for each in held])
    baseline = np.array([each.baseline_m for each in held])
    assert np.median(ours) < np.median(baseline)
    assert np.median(ours) < 2.0


def test_the_baseline_is_exact_for_exact_fixes() -> None:
    fixes = [record for record in straight_dive(100) if isinstance(record, PositionFix)]
    places = np.column_stack((np.arange(100.0), 2.0 * np.arange(100.0)))
    guess = held_out_fixes._constant_velocity(fixes, places, list(range(50)), 60.0)
    np.testing.assert_allclose(guess, (60.0, 120.0))


def test_a_wild_fix_judges_nobody_and_a_copy_is_asked() -> None:
    calm, _ = predict_held_out(straight_dive(130), 10.0)
    wild, _ = predict_held_out(straight_dive(130, wild_at=65), 10.0)
    assert [each.outlier for each in wild].count(True) == 1
    # Being asked about it changed nothing: later answers are the same.
    assert [each.ours_m for each in wild if each.block == 1] == [each.ours_m for each in calm if each.block == 1]


def outliers(moves: dict[int, float], count: int = 60) -> list[int]:
    """Which fixes are outliers of a vehicle under way at 0.5 m/s, some of them moved aside by so many metres."""
    at_s = np.arange(float(count))
    places = np.column_stack((0.5 * at_s, np.array([moves.get(second, 0.0) for second in range(count)])))
    return np.flatnonzero(held_out_fixes._outliers(at_s, places)).tolist()


def test_an_outlier_leaves_and_comes_back() -> None:
    assert outliers({30: 20.0}) == [30]
    assert outliers({30: -9.0}) == [30]
    assert outliers(dict.fromkeys(range(30, 37), 40.0)) == list(range(30, 37))
    # Of 4 m a vehicle and the noise of two fixes may be off.
    assert outliers({30: 4.0}) == []


def test_a_step_that_stays_is_no_outlier_nor_is_a_fix_after_a_long_gap() -> None:
    assert outliers(dict.fromkeys(range(30, 60), 20.0)) == []
    assert outliers({59: 20.0}) == []
    at_s, places = np.array([0.0, 1.0, 31.0, 61.0, 62.0]), np.zeros((5, 2))
    places[2] = 50.0
    assert not held_out_fixes._outliers(at_s, places).any()


def test_the_ellipse_is_that_of_95_percent() -> None:
    assert inside_ellipse(5.9)
    assert not inside_ellipse(6.1)


@pytest.mark.data
def test_the_real_dive_of_2022_is_predicted_through_24_seconds() -> None:
    log = read_log(recording("bluerov2_ugps_dive", "qgc_2022-08-15_09-56-00.csv"))
    held, given = predict_held_out(log.records, 24.0)
    judged = [each for each in held if not each.outlier]
    assert len({each.block for each in judged}) > 30
    ours, baseline = (np.median([getattr(each, name) for each in judged]) for name in ("ours_m", "baseline_m"))
    assert ours < 0.7 * baseline
    assert given.outliers_refused >= given.outliers - 1
