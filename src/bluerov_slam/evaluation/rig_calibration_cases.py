"""R8: the go/no-go gauge."""

from __future__ import annotations

import math

from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.rig_cases import RigCase, RigRun, figure
from bluerov_slam.rig.gauge import largest_misalignment_rad, misalignment_branches, servo_errors, worst_case

PUBLISHED_GAUGE_DEG = 3.7
_PUBLISHED_ROUNDING_DEG = 0.05


def gauge(run: RigRun) -> list[Row]:
    """The published angle again, and what it means for one servo."""
    published = math.degrees(largest_misalignment_rad())
    worst, _ = worst_case()
    errors = servo_errors()
    physical = sum(root.physical for root in misalignment_branches())
    return [
        figure("R8", "gauge: |angle between horns - published 3.7 deg|", abs(published - PUBLISHED_GAUGE_DEG), "deg",
               high=_PUBLISHED_ROUNDING_DEG),
        figure("R8.roots", "gauge: roots of the published equation that are physical", physical, "1", 1, 1),
        figure("R8.worst", "gauge: worst angle between horns over the stated ranges", math.degrees(worst), "deg"),
        figure("R8.servo", "gauge: worst error of one servo (gauge free to tilt)", math.degrees(errors.one_servo_rad),
               "deg"),
        figure("R8.opposite", "gauge: worst error of servos turned oppositely", math.degrees(errors.opposite_rad),
               "deg"),
        figure("R8.std", "gauge: standard deviation of one servo that passed",
               math.degrees(math.sqrt(errors.covariance_rad2[0, 0])), "deg"),
    ]  # fmt: skip


CASES = (RigCase("R8", "go/no-go gauge", gauge),)
