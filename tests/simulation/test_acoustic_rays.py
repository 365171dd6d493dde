"""Rays against straight lines and against an independent integration of the ray equations."""

import math

import pytest

from bluerov_slam.simulation.acoustic_rays import WaterColumn
from bluerov_slam.simulation.water import WaterProfile, sound_speed_mps

UNIFORM = WaterProfile(15.0, 15.0, 35.0, 35.0)
LAYERED = WaterProfile()


def _speed(water, depth_m):
    return sound_speed_mps(water.temperature_degc(depth_m), water.salinity_psu(depth_m), depth_m)


@pytest.mark.parametrize(("source_m", "receiver_m"), [(2.0, 9.0), (9.0, 2.0)])
@pytest.mark.parametrize("horizontal_m", [0.0, 3.0, 40.0, 100.0])
def test_in_even_water_the_ray_is_straight(source_m, receiver_m, horizontal_m):
    arrival = WaterColumn(UNIFORM, 20.0).direct_ray(source_m, receiver_m, horizontal_m)
    way_m = math.hypot(horizontal_m, source_m - receiver_m)
    assert arrival.travel_s == pytest.approx(way_m / _speed(UNIFORM, 5.5), rel=1e-5)
    # Pressure alone bends it by R g / (2 c): half a milliradian over 100 m.
    assert arrival.elevation_rad == pytest.approx(math.atan2(source_m - receiver_m, horizontal_m), abs=6e-4)


def _shoot(water, source_m, receiver_m, grazing_rad, step_m=0.002):
    """Distance and time of a ray by marching down with Snell's law."""
    slowness = math.cos(grazing_rad) / _speed(water, source_m)
    steps = max(1, round(abs(receiver_m - source_m) / step_m))
    step_m = abs(receiver_m - source_m) / steps
    horizontal_m = travel_s = 0.0
    for number in range(steps):
        depth_m = source_m + math.copysign(step_m, receiver_m - source_m) * (number + 0.5)
        speed_mps = _speed(water, depth_m)
        cosine = slowness * speed_mps
        sine = math.sqrt(1.0 - cosine**2)
        horizontal_m += step_m * cosine / sine
        travel_s += step_m / (speed_mps * sine)
    return horizontal_m, travel_s, math.acos(slowness * _speed(water, receiver_m))


@pytest.mark.parametrize(("source_m", "receiver_m"), [(2.0, 9.0), (9.0, 2.0), (7.0, 30.0)])
@pytest.mark.parametrize("grazing_deg", [80.0, 45.0, 15.0])
def test_through_a_thermocline_it_is_the_marched_ray(source_m, receiver_m, grazing_deg):
    if source_m > receiver_m:
        grazing_deg += 5.0  # from slow into fast water a flatter ray would turn
    horizontal_m, travel_s, at_end_rad = _shoot(LAYERED, source_m, receiver_m, math.radians(grazing_deg))
    arrival = WaterColumn(LAYERED, 40.0).direct_ray(source_m, receiver_m, horizontal_m)
    assert arrival.travel_s == pytest.approx(travel_s, abs=1e-8)
    assert arrival.elevation_rad == pytest.approx(math.copysign(at_end_rad, source_m - receiver_m), abs=1e-4)


def test_a_thermocline_bends_flat_rays_by_degrees():
    arrival = WaterColumn(LAYERED, 20.0).direct_ray(2.0, 9.0, 90.0)
    straight_rad = math.atan2(-7.0, 90.0)
    assert math.degrees(abs(arrival.elevation_rad - straight_rad)) > 3.0


def test_at_one_depth_the_way_is_level():
    column = WaterColumn(LAYERED, 20.0)
    arrival = column.direct_ray(8.0, 8.0, 50.0)
    assert arrival.elevation_rad == 0.0
    assert arrival.travel_s == pytest.approx(50.0 / column.speed_mps(8.0))
