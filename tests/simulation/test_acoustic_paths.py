"""Delay and loss of every path against geometry done by hand."""

import math

import numpy as np
import pytest

from bluerov_slam.acoustics.absorption import air_absorption_db_per_m
from bluerov_slam.simulation.acoustic_paths import (
    BACK_LEAK,
    Medium,
    Reflector,
    beam,
    floor_below,
    surface_above,
    trace_paths,
)

CENTRE = np.zeros((1, 3))


def test_the_cone_of_half_power_is_55_degrees_wide():
    assert beam(np.array([0.0]))[0] == 1.0
    assert beam(np.radians([27.5, -27.5])) ** 2 == pytest.approx([0.5, 0.5], abs=1e-4)
    falling = beam(np.radians(np.arange(0.0, 60.0)))
    assert (np.diff(falling) < 0.0).all()


def test_behind_a_transducer_little_is_left():
    assert beam(np.radians([100.0, 180.0])).tolist() == [BACK_LEAK, BACK_LEAK]
    assert beam(np.radians(np.arange(0.0, 181.0))).min() >= BACK_LEAK


def test_the_beam_is_that_of_a_piston():
    # J1 by its integral: J1(x) = 1/pi integral of cos(t - x sin t) over 0..pi.
    t = (np.arange(2000) + 0.5) * math.pi / 2000
    angles = np.radians([5.0, 20.0, 40.0])
    x = 1.61634 / math.sin(math.radians(27.5)) * np.sin(angles)
    bessel = np.cos(t[None] - x[:, None] * np.sin(t)[None]).mean(axis=1)
    assert beam(angles) == pytest.approx(2.0 * bessel / x, abs=1e-6)


def test_sound_spreads_and_is_swallowed():
    medium = Medium(343.0, air_absorption_db_per_m(40_000.0))
    paths = trace_paths(CENTRE, np.array([[1.0, 0.0, 0.0], [4.0, 0.0, 0.0]]), medium)
    near, far = paths.amplitude[:, 0, 0]
    assert near == pytest.approx(1.0)
    assert 20.0 * math.log10(far) == pytest.approx(-20.0 * math.log10(4.0) - 3.0 * medium.absorption_db_per_m)
    assert paths.delay_s[:, 0, 0] == pytest.approx([1.0 / 343.0, 4.0 / 343.0])
    still = trace_paths(CENTRE, np.array([[4.0, 0.0, 0.0]]), Medium(343.0, 0.0, spreading=False), directivity=False)
    assert still.amplitude[0, 0, 0] == 1.0


@pytest.mark.parametrize(("range_m", "late_ms"), [(1.3, 1.5), (2.55, 0.93), (3.8, 0.65)])
def test_the_floor_echo_is_as_late_as_published(range_m, late_ms):
    paths = trace_paths(CENTRE, np.array([[range_m, 0.0, 0.0]]), Medium(), (floor_below(0.66, 0.5),), directivity=False)
    direct_s, echo_s = paths.delay_s[0, :, 0]
    assert 1e3 * (echo_s - direct_s) == pytest.approx(late_ms, rel=0.08)
    way_m = 343.0 * echo_s
    assert paths.amplitude[0, 1, 0] == pytest.approx(0.5 / way_m)


def test_the_surface_turns_the_phase():
    paths = trace_paths(CENTRE, np.array([[30.0, 0.0, 3.0]]), Medium(1500.0), (surface_above(8.0),), directivity=False)
    assert paths.amplitude[0, 1, 0] < 0.0
    assert 1500.0 * paths.delay_s[0, 1, 0] == pytest.approx(math.hypot(30.0, 8.0 + 11.0))


def test_an_image_lies_behind_its_plane():
    mirror = Reflector((0.0, 3.0, 4.0), 2.0, 1.0)  # the normal need not be of unit length
    point = np.array([1.0, 2.0, -3.0])
    image = mirror.image(point)
    middle = 0.5 * (point + image)
    assert middle @ (0.0, 0.6, 0.8) == pytest.approx(2.0)
    assert np.cross(image - point, (0.0, 0.6, 0.8)) == pytest.approx(np.zeros(3))
    assert mirror.image(image) == pytest.approx(point)


def test_an_echo_leaves_and_arrives_off_axis():
    source_m, height_m = 2.0, 0.66
    medium = Medium(343.0, 0.0, spreading=False)
    direct, echo = trace_paths(
        CENTRE, np.array([[source_m, 0.0, 0.0]]), medium, (floor_below(height_m, 1.0),)
    ).amplitude[0, :, 0]
    off_rad = math.atan2(2.0 * height_m, source_m)
    assert direct == pytest.approx(1.0)
    # The transmitter points at the array, the array at it: the echo is off both axes by the same angle.
    assert echo == pytest.approx(beam(np.array([off_rad]))[0] ** 2)
