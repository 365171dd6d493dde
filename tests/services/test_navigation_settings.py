import pytest

from bluerov_slam.config import Settings
from bluerov_slam.errors import ConfigError
from bluerov_slam.navigation.vehicle_model import BLUEROV2, BLUEROV2_HEAVY
from bluerov_slam.pipeline.navigator import NavigatorOptions
from bluerov_slam.services.navigation_settings import changes_estimator, navigator_options
from bluerov_slam.services.settings_store import SettingsStore


def options(**navigation):
    return navigator_options(Settings.model_validate({"navigation": navigation}))


def test_the_defaults_of_the_settings_are_the_navigators_own():
    assert navigator_options(Settings()) == NavigatorOptions()


def test_each_setting_reaches_the_navigator():
    made = options(
        imu_mounting_rpy_deg=(180.0, 0.0, 90.0), imu_latency_ms=15.0, gps_lever_arm_frd_m=(0.1, 0.2, -0.3),
        gps_latency_ms=250.0, dvl_lever_arm_frd_m=(0.0, 0.0, 0.2), position_lever_arm_frd_m=(-0.1, 0.0, 0.0),
        position_latency_ms=1500.0, origin="54.5, -10.25", thruster_frame="heavy",
    )  # fmt: skip
    assert made.imu.mounting_rpy_deg == (180.0, 0.0, 90.0)
    assert made.imu.latency_s == pytest.approx(0.015)
    assert (made.gps.lever_arm_frd_m, made.gps.latency_s) == ((0.1, 0.2, -0.3), 0.25)
    assert made.dvl.lever_arm_frd_m == (0.0, 0.0, 0.2)
    assert (made.fix.lever_arm_frd_m, made.fix.latency_s) == ((-0.1, 0.0, 0.0), 1.5)
    assert made.origin_deg == (54.5, -10.25)
    assert made.thrust.layout == BLUEROV2_HEAVY


def test_another_vehicles_thrusters_tell_nothing_and_directions_turn_ours():
    assert options(thruster_frame="off").thrust.layout is None
    turned = options(thruster_directions=(1, -1, 1, 1, -1, 1)).thrust.layout
    assert turned == BLUEROV2.with_directions((1, -1, 1, 1, -1, 1))


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("thruster_directions", [1, -1], "as many directions"),
        ("thruster_directions", [1, 2, 1, 1, 1, 1], "1 and -1"),
        ("odometry_rate_hz", 1.0, "4 to 20"),
        ("origin", "54.5", "latitude and longitude"),
        ("imu_mounting_rpy_deg", [1.0, 2.0], "three numbers from -360 to 360"),
    ],
)
def test_what_cannot_be_is_refused_in_words(tmp_path, key, value, word):
    store = SettingsStore.open(None, {"paths.state": str(tmp_path)}, {})
    with pytest.raises(ConfigError, match=word):
        store.change({f"navigation.{key}": value})


@pytest.mark.parametrize(
    ("key", "anew"),
    [
        ("navigation.gps_lever_arm_frd_m", True),
        ("navigation.origin", True),
        ("navigation.odometry_enabled", False),
        ("navigation.odometry_heading", False),
        ("navigation.external_position", False),
        ("mavlink.enabled", False),
    ],
)
def test_only_what_the_estimator_rests_on_makes_it_anew(key, anew):
    assert changes_estimator(frozenset({key})) is anew
