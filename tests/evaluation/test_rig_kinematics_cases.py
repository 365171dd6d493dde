"""The cases at a small share of their draws: every target is met, and a wrong rig would miss it."""

from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.evaluation import rig_kinematics_cases
from bluerov_slam.evaluation.rig_cases import RigRun, all_cases
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM


@pytest.mark.parametrize("case", ["R1", "R2", "R4"])
def test_every_target_is_met(case):
    rows = all_cases()[case].run(RigRun(seed=1000, effort=0.02))
    assert rows
    assert [row.id for row in rows if row.met is False] == []
    assert any(row.met for row in rows)


def test_a_rig_of_other_dimensions_misses_the_round_trip(monkeypatch):
    longer = replace(FO_SHIP_PLATFORM, rod_mm=FO_SHIP_PLATFORM.rod_mm + 1e-6)
    told = rig_kinematics_cases.servo_angles_rad
    monkeypatch.setattr(rig_kinematics_cases, "servo_angles_rad", lambda points, _: told(points, longer))
    rows = {row.id: row for row in rig_kinematics_cases.round_trip(RigRun(effort=0.01))}
    assert rows["R1"].met is False


def test_a_spread_told_too_small_is_seen(monkeypatch):
    told = rig_kinematics_cases.pose_covariance
    monkeypatch.setattr(rig_kinematics_cases, "pose_covariance", lambda *each: 0.5 * np.asarray(told(*each)))
    rows = {row.id: row for row in rig_kinematics_cases.covariance(RigRun(effort=0.1))}
    assert rows["R4.most"].met is False
