"""Table 2.4: its own arithmetic, the attitudes behind it, and how our predictions and their regions stand to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import real_data
from bluerov_slam.navigation.rotation import exp_so3, log_so3
from bluerov_slam.rig.dimensions import FO_SHIP, ManufacturingSpread
from bluerov_slam.rig.stack import equal_platforms_pose, stack_pose
from bluerov_slam.rig.tool_truth import tool_truth
from bluerov_slam.rig.uncertainty import pose_covariance, sample_poses
from bluerov_slam.rig.validation import (
    LOGGED_GAIN,
    LOGGED_GAIN_STD,
    LOGGED_LEAN_RAD,
    LOGGED_LEAN_STD_RAD,
    LOGGED_PLAY_RAD,
    PUBLISHED_ERRORS_MM,
    TABLE_2_4,
    logged_spread,
    predict,
    published_error_mm,
    stated_spread,
    told_attitude,
)
from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs


def test_the_errors_of_the_table_are_those_printed() -> None:
    errors = [published_error_mm(place) for place in TABLE_2_4]
    assert errors == pytest.approx(PUBLISHED_ERRORS_MM, abs=0.006)
    assert np.mean(errors) == pytest.approx(7.35, abs=0.006)


@pytest.mark.parametrize("place", TABLE_2_4, ids=lambda place: place.name)
def test_some_attitude_gives_each_published_estimate_to_its_rounding(place) -> None:
    told = told_attitude(place)
    assert told.residual_mm <= np.sqrt(3.0) * 0.5
    again = equal_platforms_pose(4.0 * np.array(place.set_point[:3]), told.attitude_rad).position_mm
    assert again == pytest.approx(place.estimated_mm, abs=0.6)


def test_the_rig_leant_at_home_and_tilted_more_than_it_was_told() -> None:
    told = {place.name: np.degrees(told_attitude(place).attitude_rad) for place in TABLE_2_4}
    assert told["Zero"][1] == pytest.approx(-2.9, abs=0.1)
    assert told["Max Roll"][0] == pytest.approx(70.9, abs=0.5)
    assert told["Min Pitch"][1] == pytest.approx(-66.0, abs=0.1)
    for name, axis, commanded in (("Med Roll", 0, 30.0), ("Med Pitch", 1, -30.0)):  # the share seen in the logs
        assert 1.05 < (told[name] - told["Zero"])[axis] / commanded < 1.18


def test_the_stated_tolerances_do_not_explain_the_measured_places() -> None:
    open_loop = [predict(place, stated_spread(), with_attitude=False) for place in TABLE_2_4]
    assert sum(each.inside for each in open_loop) == 0
    with_imu = [predict(place, stated_spread()) for place in TABLE_2_4]
    assert [each.place.name for each in with_imu if each.inside] == ["Zero", "Max Y"]
    assert np.mean([each.distance_mm for each in with_imu]) < 0.6 * np.mean([each.distance_mm for each in open_loop])


def test_gains_as_uncertain_as_the_logs_show_explain_what_set_points_alone_tell() -> None:
    found = [predict(place, logged_spread(), with_attitude=False) for place in TABLE_2_4]
    assert all(each.inside for each in found)
    assert 0.5 < np.mean([each.squared for each in found]) / 3.0 < 2.0


def test_the_gains_of_the_logs_halve_the_miss_of_the_table_that_they_never_saw() -> None:
    commanded = [predict(place, logged_spread(), with_attitude=False) for place in TABLE_2_4]
    logged = [
        predict(place, logged_spread(about_logged=True), with_attitude=False, as_logged=True) for place in TABLE_2_4
    ]
    assert np.mean([each.distance_mm for each in logged]) < 0.6 * np.mean([each.distance_mm for each in commanded])
    assert [each.place.name for each in logged if not each.inside] == ["Max Roll"]


def test_with_the_attitude_all_but_one_are_inside() -> None:
    found = [predict(place, logged_spread()) for place in TABLE_2_4]
    assert [each.place.name for each in found if not each.inside] == ["Max Roll"]


def test_gain_lean_and_play_are_those_of_the_real_logs() -> None:
    logs = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs
    gains: dict[str, list[float]] = {"A": [], "B": [], "C": []}
    level, left = [], []
    for log in logs:
        rows = log.rows.where(log.rows.whole & ~log.rows.after_discard)
        still = rows.where(np.isin(rows.axis, list("XYZ")) | (log.motion == "stationary"))
        level.append(np.mean(still.attitude_deg[:, :2], axis=0))
        for k, axis in enumerate("ABC"):
            of_axis = rows.where(rows.axis == axis)
            if log.motion == "stationary" or len(of_axis) < 5:
                continue
            line = np.polyfit(of_axis.setpoint, of_axis.attitude_deg[:, k], 1)
            gains[axis].append(line[0])
            if axis != "C":
                left.append(np.std(of_axis.attitude_deg[:, k] - np.polyval(line, of_axis.setpoint)))
    assert [np.mean(gains["A"]), np.mean(gains["B"])] == pytest.approx(LOGGED_GAIN[3:5], abs=0.006)
    assert [np.std(gains["A"], ddof=1), np.std(gains["B"], ddof=1)] == pytest.approx(LOGGED_GAIN_STD[3:5], abs=0.006)
    assert np.mean(gains["C"]) == pytest.approx(0.72, abs=0.01)
    assert np.mean(level, axis=0) == pytest.approx(np.degrees(LOGGED_LEAN_RAD), abs=0.01)
    assert np.std(level, axis=0, ddof=1) == pytest.approx(np.degrees(LOGGED_LEAN_STD_RAD), abs=0.01)
    assert np.sqrt(np.mean(np.square(left))) == pytest.approx(np.degrees(LOGGED_PLAY_RAD), abs=0.02)


def test_play_is_as_large_as_logged_and_the_build_as_the_home_leans() -> None:
    home = np.zeros((4, 6))
    spread = logged_spread()
    play = pose_covariance(home, FO_SHIP, ManufacturingSpread(slop_rad=spread.slop_rad))
    assert np.sqrt(play[3, 3]) == pytest.approx(LOGGED_PLAY_RAD, rel=1e-6)
    build = pose_covariance(home, FO_SHIP, replace(spread, slop_rad=0.0))
    wanted = np.sqrt(np.mean(LOGGED_LEAN_STD_RAD**2 + LOGGED_LEAN_RAD**2))
    assert np.sqrt(np.mean(np.diag(build)[3:5])) == pytest.approx(wanted, rel=0.02)


def bent() -> np.ndarray:
    return np.array(
        [[2.0, 1.0, -6.0, 0.1, -0.05, 0.02], [0, 0, -4, 0.1, 0, 0], [1, 0, 0, 0.05, 0.1, 0], [0] * 6], dtype=float
    )


def test_truth_with_the_attitude_is_right_on_average_and_as_certain_as_it_says() -> None:
    spread = ManufacturingSpread(servo_rad=0.01, rod_mm=0.1, arm_mm=0.1, joint_mm=0.1, stacking_mm=0.3)
    std = np.radians([0.3, 0.3, 0.8])
    rigs = sample_poses(bent(), FO_SHIP, spread, 150, seed=5)
    random = np.random.default_rng(6)
    squares, gain = [], []
    alone = pose_covariance(bent(), FO_SHIP, spread)
    for position, rotation in zip(rigs.position_mm, rigs.rotation, strict=True):
        measured = exp_so3(std * random.standard_normal(3)) @ rotation
        found = tool_truth(bent(), measured, std, FO_SHIP, spread)
        error = np.concatenate([position - found.position_mm, log_so3(rotation @ found.rotation.T)])
        squares.append(error @ np.linalg.solve(found.covariance, error))
        gain.append(np.trace(found.covariance[:3, :3]) / np.trace(alone[:3, :3]))
    assert 0.8 < np.mean(squares) / 6.0 < 1.2
    assert max(gain) < 0.7


def test_truth_without_trust_in_the_attitude_is_that_of_the_set_points() -> None:
    spread = stated_spread()
    found = tool_truth(bent(), np.eye(3), np.full(3, 1e6), FO_SHIP, spread)
    assert found.position_mm == pytest.approx(stack_pose(bent(), FO_SHIP).position_mm, abs=1e-6)
    assert found.covariance == pytest.approx(pose_covariance(bent(), FO_SHIP, spread), rel=1e-6, abs=1e-9)


def test_a_set_point_out_of_reach_has_no_truth() -> None:
    far = bent()
    far[2, 2] = 400.0
    found = tool_truth(far, np.eye(3), np.full(3, 0.01), FO_SHIP, stated_spread())
    assert np.all(np.isnan(found.position_mm))
    assert np.all(np.isnan(found.covariance))
