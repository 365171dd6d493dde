import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bluerov_slam.cli import firmware_choice
from bluerov_slam.cli.simulate import command
from bluerov_slam.errors import ConfigError, ExpectedError, LinkError


def run(*arguments: str) -> Result:
    return CliRunner().invoke(command, list(arguments))


def test_says_what_it_simulates_and_where(tmp_path: Path) -> None:
    link = tmp_path / "esp32"
    result = run("--link", str(link), "--seed", "7", "--duration", "0.05", "--fault", "at=9 kind=silent sensor=imu")
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0] == "SIMULATED: scenario survey, seed 7, 115200 baud"
    assert lines[1] == "SIMULATED: fault: silent imu at 9 s for 5 s"
    assert lines[2].startswith("SIMULATED: board: ")
    assert lines[3].startswith(f"SIMULATED: serial port {link} -> /dev/pts/")
    assert not link.is_symlink()


def test_takes_a_scenario_from_toml_or_json(tmp_path: Path) -> None:
    toml, as_json = tmp_path / "mine.toml", tmp_path / "mine.json"
    toml.write_text('name = "mine"\nsamples = 400\n[[faults]]\nkind = "reset"\nat = 3\n')
    as_json.write_text(json.dumps({"name": "mine", "samples": 400, "faults": [{"kind": "reset", "at": 3}]}))
    outputs = [
        run("--scenario", str(f), "--link", str(tmp_path / "p"), "--duration", "0.02").output for f in (toml, as_json)
    ]
    for output in outputs:
        assert "scenario mine" in output
        assert "fault: reset at 3 s" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--scenario", "nowhere"), "neither a file nor one of survey"),
        (("--fault", "kind=garbage"), "at is missing"),
        (("--seed", "-4"), "seed must be"),
        (("--xtf", "/no/such.xtf"), "No such file"),
        (("--tlog", "/no/such.tlog"), "No such file"),
        (("--tlog-only",), "needs --tlog"),
        (("--autopilot", "127.0.0.1:14402", "--xtf", "any.xtf"), "goes neither with --xtf"),
        (("--autopilot", "nowhere"), "--autopilot 'nowhere': expected HOST:PORT"),
    ],
)
def test_a_wrong_argument_is_named(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    result = run("--link", str(tmp_path / "p"), "--duration", "0.05", *arguments)
    assert isinstance(result.exception, ExpectedError)
    assert message in str(result.exception)


def test_without_a_native_firmware_the_reference_runs_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(firmware_choice, "_BUILT_PROGRAM", tmp_path / "brov-firmware")
    monkeypatch.delenv("BLUEROV_SLAM_FIRMWARE", raising=False)
    result = run("--link", str(tmp_path / "p"), "--duration", "0.05")
    assert "board: Python reference (no native firmware is built: `make firmware`)" in result.output
    with pytest.raises(LinkError, match="make firmware"):
        raise run("--link", str(tmp_path / "p"), "--firmware", "native").exception or AssertionError
    assert (
        "board: Python reference\n"
        in run("--link", str(tmp_path / "p"), "--firmware", "reference", "--duration", "0.05").output
    )


def test_a_native_firmware_that_was_named_must_be_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BLUEROV_SLAM_FIRMWARE", str(tmp_path / "nothing"))
    result = run("--link", str(tmp_path / "p"), "--duration", "0.05")
    assert isinstance(result.exception, LinkError)
    assert f"BLUEROV_SLAM_FIRMWARE={tmp_path / 'nothing'}" in str(result.exception)


def test_the_old_firmware_is_played_by_the_reference(tmp_path: Path) -> None:
    result = run("--link", str(tmp_path / "p"), "--legacy", "--duration", "0.05")
    assert "board: Python reference, as the old firmware" in result.output
    refused = run("--link", str(tmp_path / "p"), "--legacy", "--firmware", "native")
    assert isinstance(refused.exception, ConfigError)


def test_a_bad_scenario_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text("samples = 1000000\n")
    result = run("--scenario", str(path))
    assert isinstance(result.exception, ConfigError)
    assert str(result.exception) == f"{path}: scenario: samples must be 1..5000, not 1000000"


def test_lists_its_scenarios() -> None:
    assert {"survey", "deep", "legacy", "faulty"} <= set(run("--list-scenarios").output.split())
