from bluerov_slam.config import Settings
from bluerov_slam.pipeline.navigator import NavigatorOptions
from bluerov_slam.services.navigation_settings import navigator_options, recorded_options, recorded_settings


def test_recorded_settings_give_the_options_they_were():
    settings = Settings.model_validate(
        {"navigation": {"gps_lever_arm_frd_m": [0.1, 0.2, -0.3], "thruster_frame": "heavy", "imu_latency_ms": 12.0}}
    )
    recorded = recorded_settings(settings)
    assert all(key.startswith(("navigation.", "acoustics.")) for key in recorded)
    assert recorded_options(recorded, {}) == navigator_options(settings)
    assert recorded_options(recorded, {}) != NavigatorOptions()


def test_a_flag_goes_before_the_recording_and_unknown_keys_of_old_recordings_are_left_out():
    options = recorded_options(
        {"navigation.imu_latency_ms": 12.0, "navigation.gone": 1, "http.port": 1}, {"navigation.imu_latency_ms": 30.0}
    )
    assert options.imu.latency_s == 0.03
    assert recorded_options({}, {}) == navigator_options(Settings())
