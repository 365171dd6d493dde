"""Speed and course of the GPS: used at the surface, and only where they mean something."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.navigation.ekf import UpdateResult
from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.records import GpsFix, Record
from pipeline.navigator_records import Bench
from pipeline.navigator_runs import Run, run


def heard(bench: Bench, seconds: float, change=None) -> tuple[Run, list[UpdateResult]]:
    """A run with what came of every GPS velocity."""
    result, updates = Run(Navigator()), []
    result.navigator.on_update = lambda update: updates.append(update) if update.sensor == "gps_velocity" else None
    result.feed(bench.records(seconds), change)
    return result, updates


def moving(**more) -> Bench:
    return Bench(heading_rad=math.atan2(0.3, 0.5), north_mps=0.5, east_mps=0.3, **more)


def test_a_moving_vehicles_velocity_is_known_sooner_than_by_positions_alone() -> None:
    def mute(record: Record) -> Record:
        return replace(record, speed_mps=None, course_rad=None) if isinstance(record, GpsFix) else record

    told, updates = heard(moving(), 25.0)
    silent, none = heard(moving(), 25.0, mute)
    assert len(updates) > 15
    assert not none
    assert told.last.velocity_ned_mps[:2] == pytest.approx((0.5, 0.3), abs=0.08)
    trace = [np.trace(each.last.velocity_covariance_m2ps2[:2, :2]) for each in (told, silent)]
    assert trace[0] < 0.5 * trace[1]


@pytest.mark.parametrize(
    "changes",
    [
        {"speed_mps": 0.2, "course_rad": 1.0},  # a course of noise
        {"speed_mps": 0.6, "course_rad": None},
        {"speed_mps": math.nan, "course_rad": 1.0},
        {"speed_mps": 0.6, "course_rad": math.nan},
        {"speed_mps": 600.0, "course_rad": 1.0},
    ],
)
def test_what_tells_no_velocity_is_passed_over(changes: dict[str, float | None]) -> None:
    def changed(record: Record) -> Record:
        return replace(record, **changes) if isinstance(record, GpsFix) else record

    result, updates = heard(moving(), 20.0, changed)
    assert not updates
    assert result.sensor("gps").trust == "used"


def test_under_water_there_is_no_gps_velocity_either() -> None:
    _, updates = heard(moving(depth_m=2.0), 20.0)
    assert not updates


def test_one_wrong_velocity_is_refused_and_the_fixes_go_on() -> None:
    def wrong(record: Record) -> Record:
        if isinstance(record, GpsFix) and 119.0 < record.measured_s < 120.0:
            return replace(record, speed_mps=5.0, course_rad=4.0)
        return record

    result, updates = heard(moving(), 25.0, wrong)
    assert [update.accepted for update in updates].count(False) == 1
    assert result.last.velocity_ned_mps[:2] == pytest.approx((0.5, 0.3), abs=0.1)
    assert result.sensor("gps").trust == "used"
    assert result.sensor("gps").rejected == 0


def test_the_same_records_give_the_same_track() -> None:
    records = list(moving().records(20.0))
    assert run(records).last.position_ned_m == run(records).last.position_ned_m
