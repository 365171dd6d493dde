import tomllib
from pathlib import Path

import pytest

from bluerov_slam.config import (
    InvalidSettingsError,
    Layer,
    Settings,
    combine,
    environment_layer,
    example_toml,
    flatten,
    setting_infos,
    toml_layer,
    values_of,
)
from bluerov_slam.errors import ConfigError

EXAMPLE = Path(__file__).parents[1] / "config" / "example.toml"
REGENERATE = "write it anew: python -c 'from bluerov_slam.config import *; print(example_toml(), end=\"\")'"


def fault_of(**values):
    with pytest.raises(InvalidSettingsError) as caught:
        combine([Layer("dive.toml", {key.replace("__", "."): value for key, value in values.items()})])
    return caught.value


def test_the_example_file_is_what_the_code_says():
    assert EXAMPLE.read_text(encoding="utf-8") == example_toml(), REGENERATE


def test_the_example_file_holds_every_setting_at_its_default():
    values = flatten(tomllib.loads(EXAMPLE.read_text(encoding="utf-8")))
    assert values == values_of(Settings())
    assert combine([toml_layer(EXAMPLE)]) == Settings()


def test_every_setting_has_a_reason_and_every_number_a_range():
    for info in setting_infos():
        assert len(info.reason) > 10, info.key
        if isinstance(info.default, (int, float)) and not isinstance(info.default, bool) and not info.choices:
            assert info.minimum is not None, info.key
            assert info.maximum is not None, info.key


def test_later_layers_win():
    settings = combine(
        [
            Layer("a.toml", {"serial.port": "/dev/a", "http.port": 1000, "mavlink.enabled": True}),
            Layer("settings.json", {"serial.port": "/dev/b", "http.port": 2000}),
            Layer("environment", {"http.port": 3000}),
        ]
    )
    assert (settings.serial.port, settings.http.port, settings.mavlink.enabled) == ("/dev/b", 3000, True)


def test_an_unknown_key_names_file_key_and_the_nearest_known_one():
    error = fault_of(serial__bauds=115200)
    assert error.lines == ("dive.toml: serial.bauds: unknown setting; did you mean serial.baud?",)


def test_an_unknown_group_is_refused_too():
    assert "dive.toml: sonars.swap: unknown setting" in fault_of(sonars__swap=True).lines[0]
    assert "dive.toml: serial: unknown setting" in fault_of(serial=3).lines[0]


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("recording.max_file_mb", "10 MB", "expected a whole number from 1 to 4096 in MB"),
        ("recording.max_file_mb", 10**9, "expected a whole number from 1 to 4096 in MB"),
        ("recording.max_file_mb", True, "expected a whole number from 1 to 4096 in MB"),
        ("sensors.surface_pressure_pa", 1013.25, "expected a number from 50000 to 110000 in Pa"),
        ("sensors.surface_pressure_pa", float("nan"), "expected a number from 50000 to 110000 in Pa"),
        ("serial.baud", 9600, "expected one of 115200, 921600 in baud"),
        ("mavlink.enabled", "maybe", "expected true or false"),
        ("mavlink.system_id", 255, "expected a whole number from 1 to 254"),
        ("forwarding.targets", ["a b"], "expected a list of at most 16 names or addresses"),
        ("mavlink.target_host", "a b", "expected a host name or an address"),
        ("mavlink.mavlink2rest_url", "http://x", "expected nothing, or an address that begins with ws:// or wss://"),
        ("serial.port", "", "expected text of 1 to 255 characters"),
        ("mavlink.component_id", 1, "expected another number: this is the autopilot's; ours is 197"),
        ("mavlink.component_id", 190, "expected another number: this is a ground station's; ours is 197"),
        ("sonar.a_position_frd_m", [0.0, 0.0], "expected a list of three numbers from -10 to 10 in m"),
    ],
)
def test_a_bad_value_names_file_key_value_and_allowed_range(key, value, expected):
    error = fault_of(**{key.replace(".", "__"): value})
    assert len(error.lines) == 1
    assert error.lines[0].startswith(f"dive.toml: {key} = ")
    assert expected in error.lines[0]
    assert error.keys == ((key, "dive.toml"),)


@pytest.mark.parametrize("more", [{}, {"mavlink.target_port": 14401}])
def test_mavlink_never_goes_to_the_nmea_port_of_the_surface_computer(more):
    with pytest.raises(InvalidSettingsError) as caught:
        combine([Layer("dive.toml", {"mavlink.target_host": "192.168.2.1", **more})])
    assert caught.value.keys == (("mavlink.target_host", "dive.toml"),)
    assert caught.value.lines[0].startswith(
        'dive.toml: mavlink.target_host = "192.168.2.1": expected an endpoint on the'
    )
    assert combine([Layer("x", {"mavlink.target_host": "192.168.2.1", "mavlink.target_port": 14550})])


def test_every_fault_gets_its_own_line():
    assert len(fault_of(serial__baud=1, http__port=-1, nonsense__key=0).lines) == 3


def test_one_port_cannot_serve_two_things():
    assert fault_of(http__port=8100).lines == ("http.port and viewer.port are both 8100; give each its own port",)


def test_free_ports_may_be_asked_for_everywhere():
    assert combine([Layer("x", {"http.port": 0, "viewer.port": 0})]).http.port == 0


def test_the_two_sonars_need_distinct_routes():
    assert "must differ" in fault_of(forwarding__route_a=2).lines[0]


def test_environment_variables_are_read_by_type():
    settings = combine(
        [
            environment_layer(
                {
                    "BLUEROV_SLAM_SERIAL__PORT": "123",
                    "BLUEROV_SLAM_HTTP__PORT": "8200",
                    "BLUEROV_SLAM_SONAR__SWAP_A_B": "yes",
                    "BLUEROV_SLAM_SONAR__A_POSITION_FRD_M": "[0.1, -0.2, 0.3]",
                    "BLUEROV_SLAM_FORWARDING__TARGETS": "127.0.0.1, boat.local",
                    "BLUEROV_SLAM_DATA": "/somewhere",
                    "MAV_SYSTEM_ID": "7",
                    "HOME": "/root",
                }
            )
        ]
    )
    assert settings.serial.port == "123"
    assert settings.http.port == 8200
    assert settings.sonar.swap_a_b is True
    assert settings.sonar.a_position_frd_m == (0.1, -0.2, 0.3)
    assert settings.forwarding.targets == ("127.0.0.1", "boat.local")
    assert settings.mavlink.system_id == 7


def test_a_wrong_environment_variable_is_named():
    with pytest.raises(InvalidSettingsError, match=r"environment: http.port = \"abc\": expected a whole number"):
        combine([environment_layer({"BLUEROV_SLAM_HTTP__PORT": "abc"})])


def test_a_file_that_is_not_toml_or_not_there_is_named_with_the_cause(tmp_path):
    broken = tmp_path / "broken.toml"
    broken.write_text("[serial\n")
    with pytest.raises(ConfigError, match=r"broken.toml: not valid TOML: .*line 1"):
        toml_layer(broken)
    with pytest.raises(ConfigError, match=r"absent.toml: cannot be read: No such file"):
        toml_layer(tmp_path / "absent.toml")


def test_folders_follow_the_state_folder_unless_set():
    assert combine([Layer("x", {"paths.state": "/data"})]).recordings_folder == Path("/data/recordings")
    assert combine([Layer("x", {"recording.folder": "/dives"})]).recordings_folder == Path("/dives")
