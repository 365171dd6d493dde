"""Metres about an origin against the field's library and against plain facts about the earth."""

from __future__ import annotations

import math

import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation.local_frame import LocalFrame

origins = st.tuples(st.floats(-89.9, 89.9), st.floats(-180.0, 180.0))
metres = st.floats(-20_000.0, 20_000.0)


@given(origins, metres, metres, st.floats(-500.0, 6000.0))
def test_there_and_back(origin, north, east, down):
    frame = LocalFrame(*origin)
    assert frame.to_ned_m(*frame.to_geodetic(north, east, down)) == pytest.approx((north, east, down), abs=1e-7)


@given(origins, metres, metres, st.floats(-500.0, 6000.0))
def test_agrees_with_pymap3d(origin, north, east, down):
    frame = LocalFrame(*origin)
    latitude, longitude, height = frame.to_geodetic(north, east, down)
    expected = pymap3d.ned2geodetic(north, east, down, *origin, 0.0)
    assert latitude == pytest.approx(expected[0], abs=1e-12 * 111e3)
    assert math.cos(math.radians(longitude - expected[1])) == pytest.approx(1.0, abs=1e-14)
    assert height == pytest.approx(expected[2], abs=1e-6)
    assert frame.to_ned_m(latitude, longitude, height) == pytest.approx(
        pymap3d.geodetic2ned(latitude, longitude, height, *origin, 0.0), abs=1e-7
    )


def test_a_minute_of_latitude_is_a_nautical_mile():
    """1852 m is the definition's mean; at 45 deg the ellipsoid's minute is 1852.2 m."""
    north, east, down = LocalFrame(45.0, 10.0).to_ned_m(45.0 + 1.0 / 60.0, 10.0)
    assert north == pytest.approx(1852.3, abs=0.2)
    assert east == pytest.approx(0.0, abs=1e-9)
    assert down == pytest.approx(0.27, abs=0.01)


def test_across_the_date_line():
    north, east, _ = LocalFrame(0.0, 179.9999).to_ned_m(0.0, -179.9999)
    assert east == pytest.approx(0.0002 * math.radians(1.0) * 6_378_137.0, rel=1e-6)
    assert north == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("position", [(91.0, 0.0), (0.0, 181.0), (math.nan, 0.0), (0.0, math.inf)])
def test_an_origin_that_is_nowhere_is_refused(position):
    with pytest.raises(ValueError, match="no position on earth"):
        LocalFrame(*position)
