import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.cli.main import cli
from bluerov_slam.records import AcousticRecord
from bluerov_slam.simulation.acoustic_paths import Medium
from bluerov_slam.simulation.acoustic_record import AcousticSetup, simulate_record
from bluerov_slam.survey.acoustic_solve import SolveOptions, solve_record, steered_surface

SOURCE = (20.0, 5.0, -8.0)


def simulated(tmp_path: Path, *options: str, name: str = "pulses.npz") -> Path:
    file = tmp_path / name
    arguments = ["isbl", "simulate", str(file), "--medium", "sea", "--source", "20,5,-8", "--onset", *options]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    return file


def solve(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(cli, ["isbl", "solve", *map(str, arguments)])
    return result.exit_code, result.output + (str(result.exception) if result.exit_code else "")


@pytest.mark.parametrize("name", ["pulses.npz", "pulse.wav", "pulse.mcap"])
def test_every_format_gives_direction_and_position(tmp_path: Path, name: str) -> None:
    file = simulated(tmp_path, name=name)
    output = tmp_path / "out.json"
    code, said = solve(file, "--depth", "-8,0.02", "--thesis-skew", "--json", output)
    assert code == 0, said
    assert "azimuth 14.0" in said
    [record] = json.loads(output.read_text())["records"]
    assert record["position"]["forward_right_down_m"] == pytest.approx(SOURCE, abs=0.15)
    assert record["direction"]["azimuth_deg"] == pytest.approx(14.04, abs=0.05)
    assert record["delays"]["slip_probability"] < 0.01
    assert record["delays"]["used"] == [0, 1, 2, 3]
    assert all(snr == pytest.approx(20.0, abs=2.0) for snr in record["delays"]["snr_db"])


def test_without_a_depth_there_is_a_direction_only(tmp_path: Path) -> None:
    output = tmp_path / "out.json"
    code, said = solve(simulated(tmp_path, "--records", "2"), "--thesis-skew", "--json", output)
    assert code == 0
    assert said.count("record ") == 2
    assert all(record["position"] is None for record in json.loads(output.read_text())["records"])


def test_the_report_stands_alone(tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    file = simulated(tmp_path, "--records", "2")
    code, said = solve(file, "--report", report, "--depth", "-8", "--thesis-skew")
    assert code == 0, said
    page = report.read_text()
    assert page.count("<svg") == 2
    assert 'src="http' not in page
    assert "Agreement by direction" in page
    code, said = solve(file, "--report", report)
    assert code != 0
    assert "--force" in said


def test_a_message_record_is_decoded(tmp_path: Path) -> None:
    output = tmp_path / "out.json"
    code, said = solve(simulated(tmp_path, "--message", "54.3,10.1,2.5"), "--json", output)
    assert code == 0, said
    [record] = json.loads(output.read_text())["records"]
    assert record["message"]["latitude_deg"] == pytest.approx(54.3)
    assert record["message"]["depth_m"] == 2.5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nothing.npz",), "does not exist"),
        (("pulses.npz", "--depth", "deep"), "expected metres"),
        (("pulses.npz", "--depth", "2,-1"), "above 0"),
        (("pulses.npz", "--receiver", "0,0,0"), "expected 3 or more"),
        (("pulses.npz", "--receiver", "a,0,0"), "--receiver"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    simulated(tmp_path)
    name, *options = arguments
    code, said = solve(tmp_path / name, *options)
    assert code != 0
    assert words in said


def test_another_array_than_the_records_is_said_and_no_crash(tmp_path: Path) -> None:
    code, said = solve(simulated(tmp_path), "--fifth")
    assert code == 0
    assert "4 receivers, the array has 5" in said


def test_a_dead_receiver_is_left_out_with_its_reason() -> None:
    array = ReceiverArray.cross()
    made = simulate_record(AcousticSetup(array, medium=Medium(1500.0), snr_db=25.0), SOURCE, 4)
    samples = np.array(made.samples, np.int16)
    samples[2] = 0
    record = AcousticRecord(0.0, 0.0, 1, made.sample_rate_hz, samples, 12, 0)
    solved = solve_record(record, SolveOptions(array, 1500.0))
    assert solved.differences is not None
    assert solved.differences.receivers.tolist() == [0, 1, 3]
    assert solved.differences.excluded[0][0] == 2
    assert solved.solution is not None
    assert solved.solution.direction == pytest.approx(np.array(SOURCE) / np.linalg.norm(SOURCE), abs=0.02)


def test_the_surface_is_highest_where_the_source_is() -> None:
    array = ReceiverArray.cross()
    made = simulate_record(AcousticSetup(array, medium=Medium(1500.0), snr_db=25.0), SOURCE, 4)
    record = AcousticRecord(0.0, 0.0, 1, made.sample_rate_hz, np.array(made.samples, np.int16), 12, 0)
    options = SolveOptions(array, 1500.0)
    solved = solve_record(record, options)
    surface = steered_surface(solved, options, steps=201)
    assert surface is not None
    row, column = np.unravel_index(np.nanargmax(surface.agreement), surface.agreement.shape)
    expected = np.array(SOURCE) / np.linalg.norm(SOURCE)
    assert (surface.right[column], surface.down[row]) == pytest.approx(expected[1:], abs=0.02)
    assert 0.85 < np.nanmax(surface.agreement) <= 1.0 + 1e-9
    near = steered_surface(solved, options, 81, (expected[1], expected[2]), 0.05)
    assert near is not None
    row, column = np.unravel_index(np.nanargmax(near.agreement), near.agreement.shape)
    assert (near.right[column], near.down[row]) == pytest.approx(expected[1:], abs=0.004)
    # A coarse map misses no peak: its cells hold the best within them.
    assert np.nanmax(surface.agreement) == pytest.approx(np.nanmax(near.agreement), abs=0.02)


def spoilt(tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], **others: object) -> Path:
    """Two records of five receivers, 25 m away in the sea, with their samples changed."""
    file = simulated(tmp_path, "--records", "2", "--fifth", "--source", "20,5,8")
    with np.load(file) as content:
        held = dict(content)
    held["samples"] = np.round(change(held["samples"].astype(float))).astype(np.int16)
    np.savez(file, **(held | others))
    return file


def muted(samples: np.ndarray, *receivers: int) -> np.ndarray:
    samples[:, receivers] = 5.0
    return samples


@pytest.mark.parametrize(
    ("change", "others", "words"),
    [
        (lambda s: muted(s, 2), {}, ["receiver 2 left out: dead", "azimuth 1"]),
        (lambda s: muted(s, 2, 3, 4), {}, ["receivers 2, 3 and 4 left out: dead", "fewer than three receivers"]),
        (lambda s: np.clip(30.0 * s, -2048, 2047), {}, ["used in spite of this: clipped", "azimuth 1"]),
        (lambda s: s[:, [1, 0, 2, 3, 4]], {}, ["receivers 0 and 1 or 2 and 3 seem exchanged", "fewer than three"]),
        (lambda s: s, {"sample_rate_hz": np.float64(50e3)}, ["sample rate: 50000 samples a second cannot hold"]),
        (lambda s: s, {"sample_rate_hz": np.float64(425_700.0)}, ["not sampled at 425700 Hz, more like 84"]),
        (lambda s: s[:, :, :200], {}, ["short: the record lasts 0.23 ms"]),
        (
            lambda s: np.random.default_rng(0).normal(0.0, 30.0, s.shape),
            {},
            ["receivers 0, 1, 2, 3 and 4 left out: silent", "fewer than two receivers heard a pulse"],
        ),
    ],
    ids=["dead", "three dead", "clipped", "exchanged", "no rate", "half the rate", "short", "out of range"],
)
def test_what_cannot_be_used_is_named_with_its_reason(
    tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], others: dict[str, object], words: list[str]
) -> None:
    code, said = solve(spoilt(tmp_path, change, **others), "--fifth", "--sound-speed", 1500.0)
    assert code == 0, said
    for line in [each for each in said.splitlines() if each.startswith("record ")]:
        assert all(word in line for word in words), line


def test_a_depth_or_a_range_that_contradicts_the_angles_leaves_the_direction(tmp_path: Path) -> None:
    file = spoilt(tmp_path, lambda samples: samples)
    for option, what in (("--depth", "depth"), ("--range", "range")):
        code, said = solve(file, "--fifth", option, "3,0.01" if what == "range" else "-40,0.05")
        assert code == 0, said
        assert said.count(f"the {what} contradicts the angles") == 2
        assert said.count("azimuth 1") == 2
        assert " at " not in said
