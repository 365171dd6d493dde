"""`bluerov-slam rig check`: faults built into simulated rigs are named, good rigs not accused, a real one is held."""

import json

import numpy as np
import pytest

from bluerov_slam.cli.rig_check import FAULT_STATUS, UNKNOWN_STATUS, command
from bluerov_slam.errors import ConfigError, LinkError, RecordingError
from bluerov_slam.protocol.rig_link import RigMode
from bluerov_slam.services import rig as service
from rig_bench import rig_and_receiver, run_command

SEED = ("--seed", 3)


def run(*arguments):
    return run_command(command, arguments)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A good rig's first run: what it said, and its file."""
    path = tmp_path_factory.mktemp("check") / "good.json"
    return run(*SEED, "--json", path), path


def test_a_good_rig_is_not_accused_and_what_would_show_is_said(good):
    result, path = good
    assert result.exit_code == 0
    assert "Verdict: no fault found" in result.output
    least = float(result.output.split("a zero off by ")[1].split(" degrees")[0])
    assert 10.0 <= least < 12.0  # R13 misses 3 of 100 at 10 degrees, 39 at 7
    again = run(*SEED, "--compare", path)
    assert again.exit_code == 0
    assert "Verdict: no fault found" in again.output
    assert 5.0 <= float(again.output.split("a zero off by ")[1].split(" degrees")[0]) < 7.0


def test_a_stuck_servo_is_named_with_its_cure_and_the_rig_is_not_sent_all_over(tmp_path):
    path = tmp_path / "stuck.json"
    result = run(*SEED, "--fault", "stuck 2 3", "--json", path)
    assert result.exit_code == FAULT_STATUS
    assert "Verdict: fault found" in result.output
    assert "Servo 4 of platform 3 does not move\n  Cure: look at its plug" in result.output
    assert "zeros: not tested" in result.output
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["verdict"]["servo_faults"] == [{"platform": 3, "servo": 4, "fault": "stuck"}]
    assert all(place["attitude_deg"] is None for place in content["zero_test"])
    assert all(len(place["attitude_deg"]) == 3 for place in content["servo_test"])
    with pytest.raises(ConfigError, match="found a fault"):
        run(*SEED, "--compare", path)


def test_a_wrong_zero_is_named_with_its_size_and_uncertainty(tmp_path):
    path = tmp_path / "off.json"
    result = run(*SEED, "--fault", "offset 1 4 -16", "--json", path)
    assert result.exit_code == FAULT_STATUS
    assert "Servo 5 of platform 2 stands -" in result.output
    assert "degrees (95 %) off its zero" in result.output
    assert "go/no-go gauge" in result.output
    found = json.loads(path.read_text(encoding="utf-8"))["verdict"]["wrong_zero"]
    assert (found["platform"], found["servo"]) == (2, 5)
    assert abs(found["off_deg"] + 16.0) < 3.0 * found["std_deg"]
    assert 0.5 < found["std_deg"] < 3.0


def test_against_an_earlier_run_a_smaller_one_is_named(good):
    _, path = good
    result = run(*SEED, "--compare", path, "--fault", "offset 3 1 7")
    assert result.exit_code == FAULT_STATUS
    assert "Servo 2 of platform 4 stands +" in result.output


def damaged(path, change):
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    made = path.with_name("changed.json")
    made.write_text(json.dumps(content), encoding="utf-8")
    return made


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.update(format="another"), "no check of a rig"),
        (lambda content: content.pop("zero_test"), "is damaged"),
        (lambda content: content["zero_test"].pop(), "its places are others"),
        (lambda content: content["zero_test"][3]["set_points_mm_deg"][0].__setitem__(0, 1.0), "its places are others"),
        (lambda content: content["servo_test"][3].update(attitude_deg=[1.0, 2.0]), "is damaged"),
        (lambda content: content["servo_test"][3].update(attitude_deg=[1.0, 2.0, 4e3]), "three angles"),
    ],
)
def test_an_earlier_file_that_is_none_is_said_in_a_line(good, change, message):
    with pytest.raises(RecordingError, match=message):
        run(*SEED, "--compare", damaged(good[1], change))


def test_readings_missing_in_the_earlier_run_are_not_taken_for_zero(good):
    def without_stances(content):
        for place in content["zero_test"][:50]:
            place["attitude_deg"] = None

    result = run(*SEED, "--compare", damaged(good[1], without_stances))
    assert result.exit_code == UNKNOWN_STATUS
    assert "only 30 of 80 stances were read" in result.output

    def without_a_servo(content):
        content["servo_test"][2 * 16 + 1]["attitude_deg"] = None  # the ninth servo up

    result = run(*SEED, "--compare", damaged(good[1], without_a_servo))
    assert result.exit_code == UNKNOWN_STATUS
    assert "servo 3 of platform 2 was not read" in result.output


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("--move-for-real",), ConfigError, "give its --port"),
        (("--receiver-port", "/dev/null"), ConfigError, "give its --port"),
        (("--port", "/dev/null", "--fault", "stuck 0 0"), ConfigError, "for a simulated rig"),
        (("--port", "/dev/null", "--receiver-port", "/dev/null"), ConfigError, "each has its own"),
        (("--port", "/dev/null", "--move-for-real"), ConfigError, "--receiver-port"),
        (("--port", "/dev/ttyNO", "--receiver-port", "/dev/ttyN", "--move-for-real"), LinkError, "does not exist"),
        (("--fault", "stuck 9 9"), ConfigError, "no fault of a servo"),
        (("--compare", "/nowhere/a.json"), RecordingError, "cannot read"),
        (("--compare", "/dev/null"), RecordingError, "no JSON file"),
    ],
)
def test_what_makes_no_sense_is_said_in_a_line(arguments, error, message):
    with pytest.raises(error, match=message):
        run(*arguments)


def test_another_rigs_run_or_the_same_noise_is_no_comparison(good):
    with pytest.raises(ConfigError, match="of another rig"):
        run("--seed", 4, "--compare", good[1])
    with pytest.raises(ConfigError, match="give another --run"):
        run(*SEED, "--run", 0, "--compare", good[1])


def test_without_the_switch_a_port_is_not_even_opened(tmp_path):
    output = run("--port", tmp_path / "ttyUSB0").output
    assert "Nothing moves yet. With --move-for-real:" in output
    assert "each of 24 servos by itself" in output


@pytest.fixture
def bench(monkeypatch):
    """A rig that may move, its receiver, and the options that name them."""
    with rig_and_receiver(monkeypatch) as (process, receiver, port):
        ports = ("--port", port, "--receiver-port", receiver.path)
        yield process, receiver, (*ports, "--move-for-real", "--speed", 1)


def test_an_instrument_that_hangs_is_no_servos_fault(bench, tmp_path):
    process, receiver, options = bench
    receiver.attitude_deg = (0.5, -1.0, 3.0)  # whatever the rig does
    path = tmp_path / "hung.json"
    result = run(*options, "--json", path)
    assert result.exit_code == UNKNOWN_STATUS
    assert "Verdict: cannot tell" in result.output
    assert "servo test 1 of 97 is missing: the board repeats its attitude" in result.output
    assert "Ended early: 3 readings in a row are missing" in result.output
    assert "The rig holds where it is" in result.output
    assert process.where().mode == RigMode.READY
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["home_deg"] == pytest.approx([0.5, -1.0, 3.0])
    assert {str(place["attitude_deg"]) for place in content["servo_test"]} == {"None"}


def test_a_receiver_that_is_silent_leaves_the_rig_at_home(bench, monkeypatch):
    monkeypatch.setattr(service, "REPLY_WAIT_S", 0.1)  # nothing comes however long it waits
    process, receiver, options = bench
    receiver.deaf = True
    result = run(*options)
    assert result.exit_code == UNKNOWN_STATUS
    assert "the link to the receiver is silent" in result.output
    np.testing.assert_allclose(process.where().set_points, 0.0, atol=1e-6)
