"""`bluerov-slam rig collect`: files of a simulated collection and of one on a rig behind a pty, and what is refused."""

import json
from collections import Counter

import numpy as np
import pytest
from click.testing import CliRunner

from bluerov_slam.cli.main import cli
from bluerov_slam.cli.rig_collect import command
from bluerov_slam.errors import ConfigError, LinkError, RecordingError
from bluerov_slam.protocol.rig_link import RigMode
from bluerov_slam.sources.acoustic_records import read_acoustic_records
from bluerov_slam.sources.isbl_thesis_log import LineKind, parse_thesis_log
from bluerov_slam.sources.recording_reader import open_recording
from full_disk import largest_file
from rig_bench import rig_and_receiver, run_command

NAME = "test_x1426_y0_z-694_s"


def run(*arguments):
    return run_command(command, arguments)


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


def points_of(path):
    return [json.loads(message.data) for message in open_recording(path).messages(("/rig/point",))]


def test_the_recording_holds_points_and_what_the_receiver_heard(folder):
    path = folder / f"{NAME}.mcap"
    lines = [json.loads(line) for line in (folder / f"{NAME}.jsonl").read_text(encoding="utf-8").splitlines()]
    points = points_of(path)
    assert points == [
        {key: value for key, value in line.items() if key not in ("source", "t_unix")}
        for line in lines
        if line["type"] == "rig_point"
    ]
    records = {record.record_id: record for record in read_acoustic_records(path)}
    heard = [point["record_id"] for point in points]
    assert heard == sorted(records)[-4:]
    assert len(records) > 50  # and those at home, from which our chain calibrates itself
    assert all(np.abs(records[number].samples).max() > 100 for number in heard)


def test_the_recording_is_solved_as_any_arrays(folder):
    solved = CliRunner().invoke(
        cli, ["isbl", "solve", str(folder / f"{NAME}.mcap"), "--sound-speed", "343", "--thesis-skew"]
    )
    assert solved.exit_code == 0, solved.output
    # The transmitter stands 1.3 m ahead, nearly level with the array.
    assert "azimuth -0." in solved.output.splitlines()[-1] or "azimuth 0." in solved.output.splitlines()[-1]


@pytest.fixture
def bench(monkeypatch):
    """A rig that may move, its receiver, and the options that name them."""
    with rig_and_receiver(monkeypatch) as (process, receiver, port):
        ports = ("--port", port, "--receiver-port", receiver.path)
        yield process, receiver, (*ports, "--move-for-real", "--tests", "1", "--motion", "stationary")


def test_a_rig_that_leans_at_home_is_collected_from(bench, tmp_path):
    _, receiver, options = bench
    receiver.attitude_deg = (0.0, -10.0, 0.0)
    output = run(tmp_path / "out", *options, "--fixes", 2, "--tilt-at-home", "0,-3").output
    assert "1: A 0: collected" in output
    path = tmp_path / "out" / f"{NAME}.mcap"
    recording = open_recording(path)
    assert not recording.simulated
    assert [point["missing"] for point in points_of(path)] == [None, None]
    links = dict.fromkeys(("/rig/link", "/rig/link_down", "/receiver/link", "/receiver/link_down"), 0)
    for message in recording.messages(links):
        links[message.topic] += len(message.data)
    assert all(links.values())
    assert "Measured with the rig" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_the_same_lean_untold_ends_the_collection(bench, tmp_path):
    _, receiver, options = bench
    receiver.attitude_deg = (0.0, -10.0, 0.0)
    with pytest.raises(ConfigError, match="no point was collected"):
        run(tmp_path / "out", *options, "--fixes", 5)
    assert "pitch is 10.0 degrees" in points_of(tmp_path / "out" / f"{NAME}.mcap")[0]["missing"]


def test_a_disk_that_takes_no_more_ends_it_with_the_rig_held(bench, tmp_path):
    process, _, options = bench
    with largest_file(3000), pytest.raises(RecordingError, match=r"Free space, .* The rig holds where it is"):
        run(tmp_path / "out", *options, "--fixes", 9)
    assert process.where().mode == RigMode.READY
    assert list((tmp_path / "out").glob("*.log"))


def test_a_port_that_goes_away_leaves_a_report_of_what_there_is(bench, tmp_path):
    process, receiver, options = bench
    receiver.on_told = lambda: len(receiver.told) == 3 and process.process.kill()
    output = run(tmp_path / "out", *options, "--fixes", 9).output
    assert "Ended early:" in output
    assert len(points_of(tmp_path / "out" / f"{NAME}.mcap")) >= 2
    assert (tmp_path / "out" / "report.html").exists()


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
        (("--transmitter", "nan,0,0"), "three numbers"),
        (("--transmitter", "1.4,0,-0.7"), "not in metres"),
        (("--transmitter", "1400,0,-700", "--transmitter", "1400.2,0,-700"), "the same to the millimetre"),
        (("--fault", "offset 0 0 nan"), "no fault of a servo"),
        (("--fault", "offset 0 0 5000"), "degrees -180 to 180"),
        (("--transmitter", "1,2,3", "--tests", "1"), "give one of them"),
        (("--fault", "stuck 9 9"), "no fault of a servo"),
        (("--move-for-real",), "give its --port"),
        (("--port", "/dev/null", "--fault", "stuck 0 0"), "for a simulated rig"),
        (("--port", "/dev/null", "--move-for-real"), "--receiver-port"),
        (("--port", "/dev/null", "--receiver-port", "/dev/null", "--move-for-real"), "each has its own"),
        (("--tilt-at-home", "0,-3"), "for a real rig"),
        (("--port", "/dev/null", "--tilt-at-home", "1"), "two numbers with a comma"),
        (("--port", "/dev/null", "--tilt-at-home", "0,nan"), "within 8"),
        (("--port", "/dev/null", "--tilt-at-home", "0,-30"), "within 8"),
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


def test_a_port_that_is_none_is_said_and_the_folder_can_be_used_again(tmp_path):
    ports = ("--port", tmp_path / "ttyUSB0", "--receiver-port", tmp_path / "ttyUSB1")
    for _ in range(2):
        with pytest.raises(LinkError, match="does not exist"):
            run(tmp_path / "out", *ports, "--move-for-real", "--tests", "1")
