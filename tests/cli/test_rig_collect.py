"""`bluerov-slam rig collect`: files of a simulated collection, and what is refused."""

import json
from collections import Counter

import pytest
from click.testing import CliRunner

from bluerov_slam.cli.rig_collect import command
from bluerov_slam.errors import ConfigError
from bluerov_slam.sources.isbl_thesis_log import LineKind, parse_thesis_log

NAME = "test_x1426_y0_z-694_s"


def run(*arguments):
    result = CliRunner().invoke(command, [str(each) for each in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("collected") / "data"
    run(made, "--tests", "1", "--motion", "stationary", "--fixes", 4, "--jobs", 1, "--seed", 3)
    return made


def test_both_logs_hold_the_same_points(folder):
    census = Counter()
    rows = parse_thesis_log(NAME, (folder / f"{NAME}.log").read_text(encoding="ascii"), census).rows
    lines = [json.loads(line) for line in (folder / f"{NAME}.jsonl").read_text(encoding="utf-8").splitlines()]
    points = [line for line in lines if line["type"] == "rig_point"]
    assert census[LineKind.WHOLE] == len(points) == 4
    assert rows.raw_mm[0, 1] == pytest.approx(points[0]["raw_mm"][1], abs=0.0051)
    assert rows.true_mm[0, 2] == pytest.approx(points[0]["published_truth_mm"][2], abs=0.0051)
    assert {line["source"] for line in lines} == {"simulated"}
    assert [line["type"] for line in lines][::5] == ["rig_session", "rig_end"]
    assert min(points[0]["truth_std_mm"]) > 0.0


def test_the_logs_and_the_report_say_that_they_are_simulated(folder):
    assert "SIMULATED" in (folder / f"{NAME}.log").read_text(encoding="ascii").splitlines()[0]
    report = (folder / "report.html").read_text(encoding="utf-8")
    assert "Everything here is simulated" in report
    assert "nothing removed" in report
    assert "NaN" not in report
    assert ">nan" not in report


def test_a_folder_with_something_in_it_is_left_alone(folder):
    before = sorted(folder.iterdir())
    with pytest.raises(ConfigError, match="not empty"):
        run(folder)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--tests", "0"), "none of 1 to 9"),
        (("--tests", "1,x"), "none of 1 to 9"),
        (("--transmitter", "1,2"), "three numbers"),
        (("--transmitter", "1,2,3", "--tests", "1"), "give one of them"),
        (("--fault", "stuck 9 9"), "no fault of a servo"),
        (("--move-for-real",), "give its --port"),
        (("--port", "/dev/null", "--fault", "stuck 0 0"), "for a simulated rig"),
        (("--port", "/dev/null", "--move-for-real"), "--receiver-port"),
    ],
)
def test_what_makes_no_sense_is_said_in_a_line(tmp_path, arguments, message):
    with pytest.raises(ConfigError, match=message):
        run(tmp_path / "out", *arguments)


def test_without_the_flag_a_real_rig_is_only_told_about(tmp_path):
    output = run(tmp_path / "out", "--port", tmp_path / "nothing", "--tests", "1").output
    assert "Nothing moves yet" in output
    assert "all four platforms move (gradual)" in output
    assert not (tmp_path / "out").exists()
