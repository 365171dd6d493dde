"""Real tracks as records, with errors put in and found again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.evaluation.snapir_case import snapir_figures
from bluerov_slam.evaluation.snapir_tracks import (
    InjectedErrors,
    SnapirTrack,
    as_measured,
    plain_integration,
    snapir_track,
)
from bluerov_slam.evaluation.trajectory import end_error_percent
from bluerov_slam.records import PositionFix, VehicleAttitude, VehicleMotionDelta
from real_data import recording

pytestmark = pytest.mark.data
NONE = InjectedErrors(0.0, 0.0)


def track(number: int) -> SnapirTrack:
    tables = [
        recording("auv_dvl_gt_snapir", f"{kind}_trajectory{number}.csv").read_text(encoding="utf-8")
        for kind in ("DVL", "GT")
    ]
    return snapir_track(number, *tables)


def test_plain_integration_is_as_good_as_the_set_allows() -> None:
    errors = []
    for number in range(1, 11):
        each = track(number)
        assert 660.0 < each.distance_m < 900.0
        errors.append(end_error_percent(plain_integration(each, NONE), each.position_ned_m[:, :2]))
    assert np.median(errors) < 0.46  # what is published without the lever arm and the clock


def test_the_records_carry_the_errors_that_were_put_in() -> None:
    each = track(7)
    rng = np.random.default_rng(0)
    clean = list(as_measured(each, NONE, 0.5, np.random.default_rng(0)))
    wrong = list(as_measured(each, InjectedErrors(0.1, 0.05), 0.5, rng))
    assert [type(record) for record in clean] == [type(record) for record in wrong]
    assert sum(isinstance(record, PositionFix) for record in clean) == 3
    for true, seen in zip(clean, wrong, strict=True):
        if isinstance(true, VehicleAttitude) and isinstance(seen, VehicleAttitude):
            assert math.remainder(seen.yaw_rad - true.yaw_rad, math.tau) == pytest.approx(0.1)
        if isinstance(true, VehicleMotionDelta) and isinstance(seen, VehicleMotionDelta):
            assert seen.displacement_frd_m == pytest.approx([1.05 * moved for moved in true.displacement_frd_m])
    times = [record.arrived_s for record in clean]
    assert times == sorted(times)


def test_three_fixes_show_both_errors() -> None:
    found = snapir_figures(track(7), seed=0)
    assert abs(found.heading_error_rad) < 2.5 * found.heading_std_rad
    assert abs(found.scale_error) < 2.5 * found.scale_std
    assert found.heading_std_rad < math.radians(1.0)
    assert found.end_percent < found.plain_percent
    assert found.after_percent < found.end_percent
