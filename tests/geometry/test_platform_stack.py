import numpy as np
import pytest

import real_data
from bluerov_slam.evaluation.thesis_checks import check_truth
from bluerov_slam.geometry.platform_stack import TIP_MM, stack_tip_mm
from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs

HOME_MM = (110.0, 0.0, -648.38)


def tip(translation_mm=(0.0, 0.0, 0.0), attitude_deg=(0.0, 0.0, 0.0), tip_mm=TIP_MM):
    return stack_tip_mm(np.array([translation_mm]), np.radians([attitude_deg]), tip_mm)[0]


def test_stands_at_home_and_moves_by_what_it_is_told():
    np.testing.assert_allclose(tip(), HOME_MM, atol=1e-9)
    np.testing.assert_allclose(tip((16.0, -8.0, 40.0)), np.add(HOME_MM, (16.0, -8.0, 40.0)), atol=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_the_uppermost_plate_has_the_whole_attitude_about_one_axis(axis):
    attitude = np.zeros(3)
    attitude[axis] = 28.0
    foot = tip(attitude_deg=attitude, tip_mm=np.zeros(3))
    columns = [tip(attitude_deg=attitude, tip_mm=row) - foot for row in np.eye(3)]
    angle = np.degrees(np.arccos((np.trace(columns) - 1.0) / 2.0))
    assert angle == pytest.approx(28.0)


def test_a_roll_to_the_right_leans_the_stack_to_the_right():
    """Positive roll is right side down: what stands above the foot (z down) goes right."""
    assert tip(attitude_deg=(25.0, 0.0, 0.0))[1] > 100.0


def test_the_logged_truth_is_this_kinematics():
    logs = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs
    found = check_truth(logs, tolerance_mm=0.0101)
    assert found.met / found.rows > 0.98
    assert found.rms_mm <= 0.005
