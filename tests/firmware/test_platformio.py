"""The ESP32's project file pins everything, and builds with what the host's tests build with."""

import configparser
import json
import re
from pathlib import Path

import pytest

from bluerov_slam.pipeline import health_link

FIRMWARE = Path(__file__).parents[2] / "firmware"
EXACT = re.compile(r"[\w.-]+/[\w.-]+@\d+\.\d+\.\d+([+.][\w.+-]+)?")


RIG = "env:rig"


@pytest.fixture
def project() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None, inline_comment_prefixes=None)
    parser.read_string((FIRMWARE / "platformio.ini").read_text())
    return parser


def words(project: configparser.ConfigParser, section: str, key: str) -> list[str]:
    text = project[section].get(key, project["env"].get(key, ""))
    return text.replace("${env.build_flags}", project["env"]["build_flags"]).split()


def test_every_package_has_one_exact_version(project: configparser.ConfigParser) -> None:
    packages = [
        package for key in ("platform", "platform_packages", "lib_deps") for package in words(project, "env", key)
    ]
    assert len(packages) == 4
    for package in packages:
        assert EXACT.fullmatch(package), package


def test_one_environment_per_rate_of_the_link(project: configparser.ConfigParser) -> None:
    environments = [section for section in project.sections() if section.startswith("env:") and section != RIG]
    assert environments == ["env:esp32dev", "env:esp32dev-921600"]
    assert project["platformio"]["default_envs"] == "esp32dev"
    default = re.search(r"define BROV_LINK_BAUD (\d+)", (FIRMWARE / "src" / "application.h").read_text())
    assert default is not None
    for environment, baud in zip(environments, (default[1], "921600"), strict=True):
        flags = words(project, environment, "build_flags")
        assert ("-DBROV_LINK_BAUD=921600" in flags) == (baud == "921600")
        assert words(project, environment, "monitor_speed") == [baud]


def test_the_rig_is_a_target_of_its_own_that_shares_the_wires(project: configparser.ConfigParser) -> None:
    taken = words(project, RIG, "build_src_filter")
    assert taken == ["+<rig/>", "+<hardware_uart.cpp>"]
    assert (FIRMWARE / "src" / "hardware_uart.cpp").exists()
    assert "-<rig/>" in words(project, "env:esp32dev", "build_src_filter")
    assert words(project, RIG, "monitor_speed") == ["115200"]
    library = json.loads((FIRMWARE / "lib" / "rig_core" / "library.json").read_text())
    assert library["dependencies"] == {"brov_core": "*"}


def test_the_board_computes_as_the_host_does(project: configparser.ConfigParser) -> None:
    makefile = (FIRMWARE / "Makefile").read_text()
    library = json.loads((FIRMWARE / "lib" / "brov_core" / "library.json").read_text())
    assert "-std=c++17" in makefile
    for environment in ("env:esp32dev", "env:esp32dev-921600", RIG):
        flags = words(project, environment, "build_flags")
        assert "-std=gnu++17" in flags
        assert "-std=gnu++11" in words(project, environment, "build_unflags")
        assert "-ffp-contract=off" in flags
        assert "-ffp-contract=off" in makefile
    for flags in (words(project, "env", "build_src_flags"), library["build"]["flags"]):
        assert {"-Wall", "-Wextra", "-fno-exceptions"} <= set(flags)


def test_the_library_has_the_firmware_version() -> None:
    library = json.loads((FIRMWARE / "lib" / "brov_core" / "library.json").read_text())
    board = (FIRMWARE / "lib" / "brov_core" / "src" / "brov" / "board.h").read_text()
    version = re.search(r"kFirmwareVersion\[3\] = \{(\d+), (\d+), (\d+)\}", board)
    assert version is not None
    assert library["version"] == ".".join(version.groups())


def test_boot_message_and_dashboard_name_a_reset_alike() -> None:
    source = (FIRMWARE / "src" / "boot.cpp").read_text()
    table = re.search(r"kTexts\[\] = \{(.*?)\};", source, re.DOTALL)
    assert table is not None
    assert re.findall(r'"([^"]+)"', table[1]) == list(health_link._RESET_REASONS.values())
