from collections.abc import Mapping

import pytest

from bluerov_slam.errors import ConfigError
from bluerov_slam.simulation.faults import Fault, FaultKind, WireFaults, parse_fault
from bluerov_slam.simulation.scenario import SCENARIOS, scenario_from_mapping


def test_reads_a_fault_from_words() -> None:
    fault = parse_fault("at=10 kind=garbage duration=2 rate=7 size=12")
    assert fault == Fault(FaultKind.GARBAGE, 10.0, 2.0, 7.0, 12)
    assert fault.active(10.0)
    assert fault.active(11.99)
    assert not fault.active(12.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kind=garbage", "at is missing"),
        ("at=3", "kind is missing"),
        ("at=3 kind=meteor", "kinds are"),
        ("at=soon kind=reset", "soon"),
        ("at=-1 kind=reset", "seconds from 0 on"),
        ("at=1 kind=silent sensor=nose", "imu, gps, ec"),
        ("at=1 kind=drop rate=3", "probability"),
        ("at=1 kind=reset colour=red", "unknown key colour"),
        ("at=1 kind", "not key=value"),
        ("at=nan kind=reset", "seconds from 0 on"),
    ],
)
def test_a_bad_fault_is_named(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_fault(text)


def test_a_scenario_file_starts_from_a_base_and_adds_faults() -> None:
    scenario = scenario_from_mapping(
        {
            "base": "pool",
            "samples": 500,
            "clock_drift_ppm": 30,
            "water": {"surface_temperature_degc": 28},
            "faults": [{"kind": "reset", "at": 5}],
        }
    )
    assert (scenario.water_depth_m, scenario.samples, scenario.clock_drift_ppm) == (4.0, 500, 30.0)
    assert scenario.water.surface_temperature_degc == 28.0
    assert [fault.kind for fault in scenario.faults] == [FaultKind.RESET]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"base": "moon"}, "base 'moon'"),
        ({"sample": 3}, "unknown key 'sample'"),
        ({"samples": 10_000}, r"samples must be 1\.\.5000"),
        ({"samples": "many"}, "samples must be a int"),
        ({"legacy": 1}, "legacy must be a bool"),
        ({"checksum_a": "crc32"}, "mod256, mod255"),
        ({"faults": 3}, "list of tables"),
        ({"water": {"colour": 1}}, "water must be a table"),
        ({"survey_depth_m": 14.9}, "above the bottom"),
    ],
)
def test_a_bad_scenario_is_named(values: Mapping[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        scenario_from_mapping(values)


def test_a_scenario_says_how_hard_the_sea_is_and_what_flies() -> None:
    scenario = scenario_from_mapping({"conditions": "hard", "noise_family": "mismatched", "thrusters": 8, "dvl": True})
    assert (scenario.conditions, scenario.noise_family) == ("hard", "mismatched")
    assert (scenario.thrusters, scenario.dvl) == (8, True)
    for key, value in (("conditions", "wild"), ("noise_family", "own"), ("thrusters", 7)):
        with pytest.raises(ConfigError, match=f"{key} must be one of"):
            scenario_from_mapping({key: value})


def test_built_in_scenarios_stay_inside_the_allowed_ranges() -> None:
    for name, scenario in SCENARIOS.items():
        assert scenario_from_mapping({"base": name}) == scenario


def test_bit_errors_come_at_their_rate() -> None:
    faults = [parse_fault("kind=bit_errors at=0 duration=1 rate=0.01")]
    damaged = WireFaults(1).damage(bytes(10_000), 0.5, faults)
    flipped = sum(byte.bit_count() for byte in damaged)
    assert len(damaged) == 10_000
    assert 700 < flipped < 900


def test_lost_bytes_are_gone() -> None:
    lost = WireFaults(1).damage(bytes(10_000), 0.5, [parse_fault("kind=drop at=0 duration=1 rate=0.1")])
    assert 8_800 < len(lost) < 9_200


def noise_bytes(before: bytes, after: bytes) -> int:
    """Bytes that garbage has changed; one in 256 it only seems to leave alone."""
    assert len(after) == len(before)
    return sum(a != b for a, b in zip(before, after, strict=True))


def test_garbage_takes_the_place_of_what_is_sent() -> None:
    garbage = WireFaults(1)
    faults = [parse_fault("kind=garbage at=0 duration=1 rate=10 size=300")]
    hit = [noise_bytes(bytes(200), garbage.damage(bytes(200), at_s, faults)) for at_s in (0.0, 0.01, 0.05, 0.1, 1.5)]
    assert 195 <= hit[0] <= 200
    assert 95 <= hit[1] <= 100  # the rest of the burst
    assert hit[2] == 0
    assert hit[3] > 195
    assert hit[4] == 0


def test_a_short_burst_lies_inside_the_frame() -> None:
    faults = [parse_fault("kind=garbage at=0 duration=1 rate=10 size=30")]
    assert {noise_bytes(bytes(60), WireFaults(seed).damage(bytes(60), 0.0, faults)) for seed in range(20)} <= {29, 30}
