"""R13: wrong zeros built into simulated rigs, small to large, found by attitudes at many stances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.acoustic_cases import share_row
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.rig_calibration_cases import IMU_RAD, SLOP_RAD, RealRig, drawn_rig
from bluerov_slam.evaluation.rig_cases import RigCase, RigRun
from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.navigation.rotation import exp_so3
from bluerov_slam.rig.dimensions import FO_SHIP, LEGS
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.zero_test import ZeroTest

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats

_RIGS = 144
_SIZES = ((0, 3.0, 3.0), (2, None, None), (3, None, None), (5, None, 20.0), (7, None, 5.0), (10, 15.0, 3.0),
          (15, 3.0, 3.0), (20, 3.0, 3.0))  # fmt: skip
"""Degrees, and of how many per cent a servo so far off may be missed: at the first run, and against an earlier one."""


def zero_test(run: RigRun) -> list[Row]:
    """One servo off its zero, up in every other rig and down in the others; each servo in turn."""
    first = ZeroTest()
    told = np.stack([servo_angles_rad(first.stances[:, i], each) for i, each in enumerate(FO_SHIP.platforms)], axis=1)
    count = run.count(_RIGS, 4)
    rows: list[Row] = []
    for size, *limits in _SIZES:
        missed: list[list[bool]] = [[], []]
        wrong: list[list[bool]] = [[], []]
        for k in range(count):
            random = np.random.default_rng((run.seed, 13, size, k))
            rig = drawn_rig(random)
            servo = (k // LEGS) % len(FO_SHIP.platforms), k % LEGS
            off = np.zeros(told.shape[1:])
            off[servo] = np.radians(size) * (-1.0) ** (k // 2)
            good, bad = (_seen(first, told + each, rig, random) for each in (0.0, off))
            for way, test in enumerate((first, first.against(good))):
                finding = test.judge(bad).finding
                named = finding is not None and servo in (finding.servo, *finding.others)
                missed[way].append(finding is not None if size == 0 else not named)
                wrong[way].append(size > 0 and finding is not None and not named)
        for way, beside in enumerate(("first run", "against an earlier run")):
            place = f"R13{'.again' if way else ''}.{size or 'none'}"
            if size == 0:
                rows.append(share_row(place, f"zero test (simulated), {beside}: good rigs accused",
                                      np.array(missed[way]), limits[way]))  # fmt: skip
                continue
            told_what = f"zero test (simulated), {beside}: servo off by {size} deg"
            rows.append(share_row(place, f"{told_what}, not named", np.array(missed[way]), limits[way]))
            rows.append(share_row(f"{place}.wrong", f"{told_what}, another named", np.array(wrong[way]), None))
    return rows


def _seen(test: ZeroTest, ideal: Floats, rig: RealRig, random: np.random.Generator) -> Floats:
    """The IMU's rotation at every stance (n, 3, 3) of a rig whose servos were to go to `ideal` (n, platforms, 6)."""
    real = rig.gain * ideal + rig.zero_rad + SLOP_RAD * random.standard_normal(ideal.shape)
    reached = np.eye(3)
    for i, platform in enumerate(rig.dimensions.platforms):
        reached = reached @ rotations(plate_pose(real[:, i], platform, test.stances[:, i]).set_point[:, 3:])
    noise = np.array([exp_so3(IMU_RAD * random.standard_normal(3)) for _ in reached])
    return np.asarray(noise @ exp_so3(rig.mount) @ reached)


CASES = (RigCase("R13", "zero test", zero_test),)
