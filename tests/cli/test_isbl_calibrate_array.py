import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bluerov_slam.cli.main import cli


def simulated(tmp_path: Path) -> tuple[Path, np.ndarray]:
    file = tmp_path / "pulses.npz"
    arguments = ["--source", "2.2,0.1,0.1", "--scatter", "0.6", "--records", "40", "--mismatch", "0.01", "--onset"]
    result = CliRunner().invoke(cli, ["isbl", "simulate", str(file), *arguments])
    assert result.exit_code == 0, result.output
    with np.load(file) as content:
        truth = next(content[name] for name in content.files if name.startswith("true_") and "source" in name)
    return file, truth


def calibrate(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(cli, ["isbl", "calibrate-array", *map(str, arguments)])
    return result.exit_code, result.output + (str(result.exception) if result.exit_code else "")


def test_known_places_tell_the_sound_speed(tmp_path: Path) -> None:
    file, truth = simulated(tmp_path)
    places, output = tmp_path / "places.csv", tmp_path / "array.json"
    rows = "\n".join(",".join(f"{value:.6f}" for value in row) for row in truth)
    places.write_text("forward,right,down\n" + rows + "\n")
    code, said = calibrate(
        file, "--places", places, "--sound-speed", 346.0, "--thesis-skew", "--json", output, "--position-std", 0.2
    )
    assert code == 0, said
    found = json.loads(output.read_text())
    assert found["sound_speed_mps"] == pytest.approx(343.0, abs=0.8)
    assert found["pulses"] >= 36
    assert len(found["resonance_hz"]) == 4
    assert "not told by these data" in said
    again, refused = calibrate(file, "--json", output)
    assert again != 0
    assert "exists" in refused


def test_without_places_the_mounting_stays(tmp_path: Path) -> None:
    file, _ = simulated(tmp_path)
    output = tmp_path / "array.json"
    code, said = calibrate(file, "--sound-speed", 343.0, "--thesis-skew", "--json", output)
    assert code == 0, said
    assert json.loads(output.read_text())["mounting_rad"] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("text", "what"),
    [("1,2\n", "not three numbers"), ("a,b,c\n", "no place"), ("1,2,3\nx,y,z\n", "row 2"), ("1,2,3\n", "1 places")],
)
def test_places_that_are_none_are_said(tmp_path: Path, text: str, what: str) -> None:
    file, _ = simulated(tmp_path)
    places = tmp_path / "places.csv"
    places.write_text(text)
    code, said = calibrate(file, "--places", places, "--thesis-skew")
    assert code != 0
    assert what in said


def test_the_report_says_what_was_told_and_what_was_not(tmp_path: Path) -> None:
    file, _ = simulated(tmp_path)
    report = tmp_path / "report.html"
    code, said = calibrate(file, "--sound-speed", 343.0, "--thesis-skew", "--report", report)
    assert code == 0, said
    page = report.read_text()
    assert page.count("<svg") == 3
    assert "Not told by these data" in page
    assert "40.0" in page
    again, refused = calibrate(file, "--report", report)
    assert again != 0
    assert "--force" in refused


def test_records_without_a_whole_pulse_are_refused_with_the_reason(tmp_path: Path) -> None:
    file, _ = simulated(tmp_path)
    with np.load(file) as content:
        held = dict(content)
    dead = held["samples"].copy()
    dead[:, 2] = 5
    for change, what in (
        ({"samples": dead}, "receiver 2 left out: dead: stands still at 5 counts (40 records)"),
        ({"sample_rate_hz": np.float64(50e3)}, "50000 samples a second cannot hold a carrier"),
        ({"samples": held["samples"][:, :, :200]}, "short: the record lasts"),
    ):
        np.savez(file, **(held | change))
        code, said = calibrate(file, "--thesis-skew")
        assert code != 0
        assert what in said
