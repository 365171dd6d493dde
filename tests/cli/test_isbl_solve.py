import json
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
