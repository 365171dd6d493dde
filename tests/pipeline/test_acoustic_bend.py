import math

import pytest

from bluerov_slam.acoustics.ray_tracing import SoundProfile, bend_rad
from bluerov_slam.pipeline.acoustic_bend import LARGEST_BEND_STD_RAD, AcousticBend
from bluerov_slam.records import CtdSample


def sample(depth_m: float | None, speed_mps: float | None) -> CtdSample:
    return CtdSample(1.0, 1.0, 12.0, 4.0, 2e5, depth_m, 35.0, speed_mps, 101_325.0)


def cast(to_m: float, speed_at: object) -> AcousticBend:
    bend = AcousticBend()
    for index in range(round(to_m / 0.1)):
        depth = 0.1 * index + 0.05
        bend.water(sample(depth, speed_at(depth)))  # type: ignore[operator]
    return bend


def test_through_sampled_water_the_ray_is_traced() -> None:
    def speed(depth: float) -> float:
        return 1515.0 - 1.0 * depth

    bend, std = cast(16.0, speed).of(4.0, 14.0, 80.0)
    profile = SoundProfile.of_samples([0.0, 20.0], [speed(0.0), speed(20.0)], 20.0, 50.0)
    exact = bend_rad(profile, 14.0, 4.0, 80.0)
    assert exact is not None
    assert bend == pytest.approx(exact, abs=1e-3)
    assert abs(bend) > math.radians(1.0)
    assert std < 1e-3


def test_water_that_was_not_sampled_makes_the_elevation_unsure_and_more_so_far_away() -> None:
    shallow = cast(5.0, lambda depth: 1500.0)
    near, far = shallow.of(5.0, 15.0, 20.0), shallow.of(5.0, 15.0, 80.0)
    assert near[0] == pytest.approx(0.0, abs=1e-6)
    assert 0.0 < near[1] < far[1] <= LARGEST_BEND_STD_RAD
    nothing = AcousticBend().of(5.0, 15.0, 80.0)
    assert nothing[1] >= far[1]


def test_in_a_shadow_the_elevation_says_nothing() -> None:
    bend, std = cast(20.0, lambda depth: 1530.0 - 3.0 * depth).of(1.0, 1.0, 400.0)
    assert bend == 0.0
    assert std == LARGEST_BEND_STD_RAD


def test_air_and_holes_in_the_record_say_nothing() -> None:
    bend = AcousticBend()
    for record in (sample(None, 1500.0), sample(3.0, None), sample(3.0, 343.0), sample(-0.2, 1500.0)):
        bend.water(record)
    assert bend.of(5.0, 15.0, 50.0) == AcousticBend().of(5.0, 15.0, 50.0)
