import math
from dataclasses import replace

import numpy as np
import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.protocol.navigation_json import (
    FixOutcome,
    ellipse_json,
    error_ellipse,
    euler_angles_rad,
    navigation_json,
    nis_band,
    nothing_json,
    short_text,
    state_text,
)
from bluerov_slam.records import NavMode, NavSensor, NavState, SensorTrust


def covariance_2d(major: float, minor: float, bearing_rad: float) -> np.ndarray:
    """6 x 6 with this horizontal ellipse (standard deviations)."""
    c, s = math.cos(bearing_rad), math.sin(bearing_rad)
    turn = np.array([[c, -s], [s, c]])
    pose = np.diag([0.0, 0.0, 0.01, 4e-4, 1e-4, 9e-4])
    pose[:2, :2] = turn @ np.diag([major**2, minor**2]) @ turn.T
    return pose


STATE = NavState(
    measured_s=100.0, arrived_s=100.01, mode=NavMode.DEAD_RECKONING, origin_deg=(54.0, 10.0),
    position_ned_m=(12.3456, -7.0, 3.0), velocity_ned_mps=(0.0, 0.4, 0.1), quaternion_ned_frd=(0.5, 0.5, 0.5, 0.5),
    angular_rate_frd_radps=None, pose_covariance=covariance_2d(3.0, 2.0, 0.5),
    velocity_covariance_m2ps2=np.diag([0.01, 0.04, 0.01]), depth_m=2.9, depth_std_m=0.06, altitude_m=None,
    current_ne_mps=(0.1, -0.2), current_std_mps=(0.03, 0.05), last_fix_s=58.0, distance_m=123.45, reset_counter=4,
    sensors=(
        NavSensor("gps", SensorTrust.REJECTED, "jumped 1 km", 20, 3, 58.0, 1.1, 20),
        NavSensor("compass", SensorTrust.USED, "", 90, 0, 99.9, 0.9, 50),
    ),
)  # fmt: skip


def test_every_value_is_in_the_pages_units():
    data = navigation_json(STATE, (54.0001, 9.9999))
    assert data["position"] == {
        "north_m": 12.346, "east_m": -7.0, "depth_m": 2.9, "latitude_deg": 54.0001, "longitude_deg": 9.9999
    }  # fmt: skip
    assert data["velocity"] == {
        "north_mps": 0.0, "east_mps": 0.4, "down_mps": 0.1, "speed_mps": 0.4, "course_deg": 90.0
    }  # fmt: skip
    assert data["std"] == {"heading_deg": 1.72, "tilt_deg": 1.15, "depth_m": 0.06, "speed_mps": 0.2}
    assert data["current"] == {"north_mps": 0.1, "east_mps": -0.2, "std_mps": 0.05}
    assert (data["since_fix_s"], data["distance_m"], data["reset_counter"]) == (42.0, 123.5, 4)
    assert data["ellipse"]["bearing_deg"] == pytest.approx(math.degrees(0.5), abs=0.05)
    gps, compass = data["sensors"]
    assert (gps["trust"], gps["reason"], gps["age_s"], gps["label"]) == ("rejected", "jumped 1 km", 42.0, "GPS")
    assert compass["reason"] == "", "a sensor in use needs no excuse"


def test_what_is_odd_about_a_sensor_in_use_is_told():
    odd = NavSensor("thrust", SensorTrust.USED, "half as fast as usual", 90, 0, 99.9, 0.9, 50)
    (thrust,) = navigation_json(replace(STATE, sensors=(odd,)))["sensors"]
    assert (thrust["trust"], thrust["reason"]) == ("used", "half as fast as usual")


def test_ages_count_to_now_where_now_is_given():
    assert navigation_json(STATE, now_s=110.0)["since_fix_s"] == 52.0


def test_the_texts_say_mode_and_certainty_in_words():
    assert state_text(STATE) == "Dead reckoning, within 7.3 m, 42 s since the last fix"
    assert short_text(STATE) == "Dead reckoning within 7.3 m"
    aided = replace(STATE, mode=NavMode.AIDED)
    assert state_text(aided) == "Position is held by fixes, within 7.3 m"
    lost = replace(STATE, mode=NavMode.ATTITUDE, pose_covariance=None)
    assert "no position fix" in state_text(lost)
    assert state_text(replace(STATE, last_fix_s=-500.0)).endswith("10 min since the last fix")


@given(
    major=st.floats(0.01, 1000.0),
    ratio=st.floats(0.0, 1.0),
    bearing=st.floats(0.0, math.pi, exclude_max=True),
)
def test_the_ellipse_holds_95_percent_in_whatever_direction(major, ratio, bearing):
    ellipse = error_ellipse(covariance_2d(major, major * ratio, bearing))
    assert ellipse is not None
    assert ellipse.major_m == pytest.approx(math.sqrt(5.991) * major, rel=1e-4)
    assert ellipse.minor_m == pytest.approx(math.sqrt(5.991) * major * ratio, rel=1e-3, abs=major * 1e-3)
    if ratio < 0.9:
        assert abs(math.remainder(ellipse.bearing_rad - bearing, math.pi)) < 1e-3


def test_drawn_positions_lie_inside_the_ellipse_as_often_as_it_says():
    pose = covariance_2d(3.0, 1.0, 0.7)
    ellipse = error_ellipse(pose)
    north, east = np.random.default_rng(5).multivariate_normal([0.0, 0.0], pose[:2, :2], 20_000).T
    along = north * math.cos(ellipse.bearing_rad) + east * math.sin(ellipse.bearing_rad)
    across = -north * math.sin(ellipse.bearing_rad) + east * math.cos(ellipse.bearing_rad)
    inside = (along / ellipse.major_m) ** 2 + (across / ellipse.minor_m) ** 2 < 1.0
    assert inside.mean() == pytest.approx(0.95, abs=0.006)


@pytest.mark.parametrize("hole", [(0, 0), (1, 1), (0, 1)])
def test_a_covariance_with_a_hole_draws_no_ellipse(hole):
    pose = covariance_2d(3.0, 1.0, 0.7)
    pose[hole] = math.nan
    assert error_ellipse(pose) is None
    assert ellipse_json(None)["major_m"] is None


def test_unknown_is_null_and_never_a_number():
    unknown = replace(
        STATE, origin_deg=None, position_ned_m=None, velocity_ned_mps=None, quaternion_ned_frd=None,
        pose_covariance=None, velocity_covariance_m2ps2=None, depth_m=None, depth_std_m=None, current_ne_mps=None,
        current_std_mps=None, last_fix_s=None, sensors=(),
    )  # fmt: skip
    data = navigation_json(unknown)
    for key in ("origin", "position", "attitude", "std", "velocity", "current"):
        assert set(data[key].values()) == {None}, key
    assert data["since_fix_s"] is None
    broken = replace(STATE, position_ned_m=(math.nan, math.inf, 0.0), velocity_ned_mps=(math.nan, 0.0, 0.0))
    data = navigation_json(broken)
    assert (data["position"]["north_m"], data["position"]["east_m"], data["velocity"]["speed_mps"]) == (
        None,
        None,
        None,
    )
    assert b"NaN" not in orjson.dumps(data)


def test_a_course_is_told_only_of_a_vehicle_that_moves_for_certain():
    slow = replace(STATE, velocity_ned_mps=(0.1, 0.0, 0.0))
    assert navigation_json(slow)["velocity"]["course_deg"] is None


def test_without_a_state_the_keys_are_the_same():
    nothing = nothing_json("off", "Navigation is switched off", simulated=True)
    full = navigation_json(STATE)
    assert nothing.keys() == full.keys()
    for key, value in full.items():
        if isinstance(value, dict):
            assert nothing[key].keys() == value.keys(), key
    assert (nothing["mode"], nothing["simulated"]) == ("off", True)


def test_a_fix_is_told_once_with_what_became_of_it():
    fix = FixOutcome(99.0, "gps", 54.0, 10.0, 1.234, 5.678, 1.5, False)
    told = navigation_json(STATE, fix=fix)["fix"]
    assert told == {"source": "gps", "north_m": 1.23, "east_m": 5.68, "std_m": 1.5, "accepted": False}


@pytest.mark.parametrize(
    ("angles", "quaternion"),
    [
        ((0.0, 0.0, math.pi / 2), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))),
        ((math.pi, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)),
        ((0.0, math.pi / 3, 0.0), (math.sqrt(0.75), 0.0, 0.5, 0.0)),
    ],
)
def test_angles_of_a_quaternion(angles, quaternion):
    assert euler_angles_rad(quaternion) == pytest.approx(angles, abs=1e-7)


# Quantiles of chi-square over its degrees of freedom, from published tables.
@pytest.mark.parametrize(("count", "low", "high"), [(10, 0.3247, 2.0483), (30, 0.5597, 1.5660), (100, 0.7422, 1.2956)])
def test_the_nis_band_is_chi_squares(count, low, high):
    assert nis_band(count) == pytest.approx((low, high), abs=0.004)
    assert nis_band(0) is None
