import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bluerov_slam.acoustics.ray_tracing import (
    SoundProfile,
    bend_rad,
    corrected_position_m,
    direct_ray,
    eigenrays,
    reach_of_depth,
)
from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater.profile import ColumnNodes, WaterColumn

SUMMER = SoundProfile(
    np.array((0.0, 4.0, 9.0, 14.0, 30.0, 60.0)), np.array((1522.0, 1520.0, 1505.0, 1496.0, 1492.0, 1493.0))
)


def linear(surface_mps: float, gradient: float, bottom_m: float) -> SoundProfile:
    return SoundProfile(np.array((0.0, bottom_m)), np.array((surface_mps, surface_mps + gradient * bottom_m)))


@pytest.mark.parametrize("gradient", [-2.0, -0.5, -1e-3, 1e-6, 0.016, 1.0, 2.0])
@pytest.mark.parametrize(("source", "receiver", "range_m"), [(5.0, 30.0, 80.0), (40.0, 3.0, 20.0), (10.0, 12.0, 100.0)])
def test_in_one_gradient_the_ray_is_the_analytic_circle(
    gradient: float, source: float, receiver: float, range_m: float
) -> None:
    profile = linear(1500.0, gradient, 60.0)
    ray = direct_ray(profile, source, receiver, range_m)
    if ray is None:
        assert abs(gradient) >= 1.0  # the circle leaves the water: a shadow of the surface or the bottom
        return
    first, last = profile.at_mps(source), profile.at_mps(receiver)
    square = range_m**2 + (receiver - source) ** 2
    time_s = math.acosh(1.0 + gradient**2 * square / (2.0 * first * last)) / abs(gradient)
    if abs(gradient) < 1e-2:  # arcosh near 1 has no digits left
        time_s = math.sqrt(square) / (0.5 * (first + last))
    assert ray.travel_time_s == pytest.approx(time_s, rel=1e-7)
    # Centre of the circle: where the straight continuation of the speed is zero.
    depth_of_zero = -1500.0 / gradient
    along = range_m / 2.0 + (receiver - source) / (2.0 * range_m) * (receiver + source - 2.0 * depth_of_zero)
    launch = math.atan2(along, depth_of_zero - source) - (0.0 if gradient < 0.0 else math.pi)
    # The tangent stands square on the radius.
    expected = math.atan(along / (source - depth_of_zero))
    assert ray.launch_rad == pytest.approx(expected, abs=1e-6), launch


def test_an_even_sea_has_straight_rays_and_mirror_images() -> None:
    speed, bottom = 1490.0, 20.0
    source, receiver, range_m = 6.0, 15.0, 35.0
    rays = eigenrays(SoundProfile.constant(speed, bottom), source, receiver, range_m, most_bounces=2)
    images = {
        (0, 0): receiver - source,
        (1, 0): receiver + source,
        (0, 1): 2.0 * bottom - receiver - source,
        (1, 1): None,
    }
    found = {
        (ray.surface_bounces, ray.bottom_bounces): ray for ray in rays if ray.surface_bounces + ray.bottom_bounces < 2
    }
    for (surface, below), rise in images.items():
        if rise is None:
            continue
        assert found[surface, below].travel_time_s == pytest.approx(math.hypot(range_m, rise) / speed, rel=1e-10)
        assert abs(found[surface, below].launch_rad) == pytest.approx(math.atan2(rise, range_m), abs=1e-9)
    twice = sorted(ray.travel_time_s for ray in rays if ray.surface_bounces + ray.bottom_bounces == 2)
    rises = (2.0 * bottom + receiver - source, 2.0 * bottom - receiver + source)
    assert twice == pytest.approx(sorted(math.hypot(range_m, rise) / speed for rise in rises), rel=1e-10)
    assert all(ray.turns == 0 for ray in rays)


depths = st.floats(0.2, 59.0)


@settings(max_examples=12, deadline=None)
@given(depths, depths, st.floats(2.0, 300.0))
def test_source_and_receiver_can_change_places(source: float, receiver: float, range_m: float) -> None:
    there = eigenrays(SUMMER, source, receiver, range_m, most_bounces=1)
    back = eigenrays(SUMMER, receiver, source, range_m, most_bounces=1)
    assert len(there) == len(back)
    for ray, other in zip(there, back, strict=True):
        assert ray.travel_time_s == pytest.approx(other.travel_time_s, rel=1e-9)
        assert (ray.surface_bounces, ray.bottom_bounces) == (other.surface_bounces, other.bottom_bounces)
    by_time = {round(1e9 * ray.travel_time_s): ray for ray in there}
    for other in back:
        ray = by_time.get(round(1e9 * other.travel_time_s))
        if ray is not None:
            assert abs(ray.launch_rad) == pytest.approx(abs(other.arrival_rad), abs=1e-5)


@settings(max_examples=12, deadline=None)
@given(depths, depths, st.floats(2.0, 200.0))
def test_rays_keep_snells_invariant_and_are_no_faster_than_the_fastest_water(
    source: float, receiver: float, range_m: float
) -> None:
    for ray in eigenrays(SUMMER, source, receiver, range_m, most_bounces=2):
        start = math.cos(ray.launch_rad) / SUMMER.at_mps(source)
        end = math.cos(ray.arrival_rad) / SUMMER.at_mps(receiver)
        assert start == pytest.approx(end, rel=1e-9)
        assert ray.travel_time_s >= math.hypot(range_m, receiver - source) / 1522.0 * (1.0 - 1e-12)


def integrated(profile: SoundProfile, depth: float, angle: float, range_m: float) -> tuple[float, float]:
    """The ray's own differential equations in steps of a centimetre: depth and time at a range."""
    step = 0.01
    x = time_s = 0.0
    invariant = math.cos(angle) / profile.at_mps(depth)
    while x < range_m - 1e-9:
        dx = min(step, range_m - x)

        def slope(at: float, pitch: float) -> tuple[float, float]:
            speed = profile.at_mps(at)
            gradient = (profile.at_mps(at + 1e-4) - profile.at_mps(at - 1e-4)) / 2e-4
            return math.tan(pitch), -gradient / speed

        k1 = slope(depth, angle)
        k2 = slope(depth + 0.5 * dx * k1[0], angle + 0.5 * dx * k1[1])
        depth, angle = depth + dx * k2[0], angle + dx * k2[1]
        time_s += dx / (math.cos(angle - 0.5 * dx * k2[1]) * profile.at_mps(depth - 0.5 * dx * k2[0]))
        x += dx
    assert math.cos(angle) / profile.at_mps(depth) == pytest.approx(invariant, rel=1e-4)
    return depth, time_s


@pytest.mark.parametrize(("source", "receiver", "range_m"), [(2.0, 25.0, 90.0), (20.0, 7.0, 60.0), (12.0, 40.0, 150.0)])
def test_a_direct_ray_through_layers_is_that_of_the_differential_equations(
    source: float, receiver: float, range_m: float
) -> None:
    ray = direct_ray(SUMMER, source, receiver, range_m)
    assert ray is not None
    depth, time_s = integrated(SUMMER, source, ray.launch_rad, range_m)
    assert depth == pytest.approx(receiver, abs=0.02)
    assert time_s == pytest.approx(ray.travel_time_s, rel=5e-6)


def test_sound_that_grows_faster_with_depth_turns_a_ray_back_up() -> None:
    profile = linear(1480.0, 1.0, 100.0)
    ray = direct_ray(profile, 10.0, 10.0, 120.0)
    assert ray is not None
    assert ray.turns == 1
    assert ray.launch_rad > 0.0 > ray.arrival_rad
    assert ray.launch_rad == pytest.approx(-ray.arrival_rad, abs=1e-9)
    # Half the chord over the circle's radius.
    assert math.tan(ray.launch_rad) == pytest.approx(60.0 / 1490.0, rel=1e-9)


def test_no_direct_ray_reaches_the_shadow() -> None:
    profile = linear(1520.0, -2.0, 60.0)
    assert direct_ray(profile, 1.0, 1.0, 400.0) is None
    assert any(ray.bottom_bounces for ray in eigenrays(profile, 1.0, 1.0, 400.0, most_bounces=2))


def test_the_range_of_an_elevation_is_that_of_the_eigenray() -> None:
    source, receiver, range_m = 30.0, 6.0, 90.0
    ray = direct_ray(SUMMER, source, receiver, range_m)
    assert ray is not None
    reach = reach_of_depth(SUMMER, receiver, ray.seen_at_rad, source)
    assert reach is not None
    assert reach.range_m == pytest.approx(range_m, rel=1e-7)
    assert reach.travel_time_s == pytest.approx(ray.travel_time_s, rel=1e-7)
    bend = bend_rad(SUMMER, source, receiver, range_m)
    straight_m = (source - receiver) / math.tan(ray.seen_at_rad)
    assert bend == pytest.approx(ray.seen_at_rad - math.atan2(source - receiver, range_m), abs=1e-12)
    assert abs(straight_m - range_m) > 1.0  # what the correction is for
    fixed = corrected_position_m(SUMMER, receiver, source, np.array((0.6, 0.8, 0.0)) * straight_m + (0, 0, 24.0))
    assert fixed == pytest.approx(np.array((0.6 * range_m, 0.8 * range_m, 24.0)), rel=1e-6)


def test_an_elevation_that_never_comes_to_a_depth_has_no_range() -> None:
    assert reach_of_depth(SUMMER, 10.0, -0.2, 40.0) is None
    warm = linear(1480.0, 1.0, 100.0)
    assert reach_of_depth(warm, 10.0, 0.01, 60.0) is None
    assert corrected_position_m(warm, 10.0, 60.0, (3000.0, 0.0, 30.0)) is None


def test_straight_up_and_down() -> None:
    rays = eigenrays(SUMMER, 10.0, 50.0, 0.0, most_bounces=1)
    assert rays[0].direct
    depth = np.linspace(10.0, 50.0, 40_001)
    slowness = 1.0 / np.interp(depth, SUMMER.depth_m, SUMMER.sound_speed_mps)
    assert rays[0].travel_time_s == pytest.approx(float(np.trapezoid(slowness, depth)), rel=1e-7)
    assert rays[0].arrival_rad == pytest.approx(math.pi / 2.0)


def test_samples_with_nans_and_holes_make_a_profile_that_says_where_it_guesses() -> None:
    depth = np.array((12.0, 1.0, 2.0, 2.0, np.nan, 30.0, 31.0))
    speed = np.array((1505.0, 1520.0, 1519.0, 1521.0, 1400.0, np.nan, 1494.0))
    profile = SoundProfile.of_samples(depth, speed, bottom_m=40.0)
    assert profile.at_mps(2.0) == pytest.approx(1520.0)
    assert profile.at_mps(0.0) == pytest.approx(1520.0)
    assert profile.bridged == ((2.0, 12.0), (12.0, 31.0), (31.0, 40.0))
    assert profile.guessed(0.0, 2.0) == 0.0
    assert profile.guessed(0.0, 12.0) == pytest.approx(10.0 / 12.0)
    assert direct_ray(profile, 5.0, 35.0, 50.0) is not None


def column(depths_m: list[float]) -> WaterColumn:
    pressure = 1.0e4 * np.array(depths_m) * 1.008
    count = len(depths_m)
    return WaterColumn(
        ColumnNodes(
            pressure,
            np.interp(depths_m, (0.0, 10.0, 20.0), (20.0, 12.0, 11.0)),
            np.full(count, 34.0),
            np.full(count, 0.02),
            np.full(count, 0.05),
            np.full(count, 5),
            np.ones(count, dtype=bool),
            float(pressure[0]),
            float(pressure[-1]),
        ),
        47.0,
    )


def test_a_column_with_a_hole_is_bridged_and_says_so() -> None:
    whole = SoundProfile.of_column(column([0.5, *range(1, 21)]), 20.0)
    assert not whole.bridged or whole.bridged[-1][1] == 20.0
    holed = SoundProfile.of_column(column([0.5, 1, 2, 3, 12, 13, 14, 15]), 25.0)
    assert any(
        upper == pytest.approx(3.0, abs=0.1) and lower == pytest.approx(12.0, abs=0.2) for upper, lower in holed.bridged
    )
    assert holed.bridged[-1][1] == 25.0
    assert holed.guessed(4.0, 10.0) == 1.0
    ray = direct_ray(holed, 2.0, 20.0, 40.0)
    assert ray is not None


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: SoundProfile(np.array((0.0, 5.0, 5.0)), np.array((1500.0, 1500.0, 1500.0))), "must increase"),
        (lambda: SoundProfile(np.array((0.0, 5.0)), np.array((1500.0, 15.0))), "sound speeds"),
        (lambda: SoundProfile(np.array((0.0,)), np.array((1500.0,))), "1 depths"),
        (lambda: SoundProfile.of_samples([np.nan], [1500.0], 20.0), "no sample"),
        (lambda: eigenrays(SUMMER, 70.0, 5.0, 10.0), "depth 70.0 m"),
        (lambda: eigenrays(SUMMER, 7.0, 5.0, -1.0), "range -1.0 m"),
    ],
)
def test_what_is_no_profile_is_said(make: object, what: str) -> None:
    with pytest.raises(OutOfValidityError, match=what):
        make()  # type: ignore[operator]
