"""`bluerov-slam rig pose`, `workspace`, `plan`, `demo`: figures for a person, tables for a program, reasons."""

import csv
import re

import numpy as np
import pytest
from click.testing import CliRunner

from bluerov_slam.cli import rig_demo, rig_plan, rig_pose, rig_workspace
from bluerov_slam.cli.rig_numbers import pose_of, six_numbers, stack_of
from bluerov_slam.errors import ConfigError, ExpectedError
from bluerov_slam.geometry.platform_stack import stack_tip_mm
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.stack import stack_pose
from bluerov_slam.rig.workspace import PlatformWorkspace


def run(module, *arguments):
    result = CliRunner().invoke(module.command, [str(each) for each in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def tool_line(output):
    line = next(line for line in output.splitlines() if line.startswith("Tool:"))
    return [float(number) for number in re.findall(r"-?\d+\.\d+", line)]


def read(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_pose_tells_the_tool_of_set_points_and_how_well_it_is_known():
    output = run(rig_pose, "--set-point", "0,0,0,4,0,0")
    expected = stack_tip_mm(np.zeros((1, 3)), np.radians([[16.0, 0.0, 0.0]]))[0]
    assert tool_line(output)[:3] == pytest.approx(expected, abs=0.006)
    assert "1 sigma" in output


def test_a_measured_attitude_moves_the_tool_and_narrows_it():
    plain, mended = (
        run(rig_pose, "--set-point", "0,0,0,2,0,0"),
        run(rig_pose, "--set-point", "0,0,0,2,0,0", "--attitude", "9.2,0,0"),
    )
    sigma = [float(re.search(r"1 sigma: x [\d.]+, y ([\d.]+)", each)[1]) for each in (plain, mended)]
    assert tool_line(mended)[3] == pytest.approx(9.2, abs=0.1)
    assert sigma[1] < sigma[0]


def test_four_set_points_are_base_to_top_and_three_are_none():
    points = stack_of(["0,0,0,1,0,0", "0,0,0,0,2,0", "0,0,0,0,0,0", "0,0,0,0,0,1"], "--set-point")
    np.testing.assert_allclose(np.degrees(points[1, 4]), 2.0)
    with pytest.raises(ConfigError, match="3 times"):
        stack_of(["0,0,0,0,0,0"] * 3, "--set-point")


def test_a_pose_comes_back_from_the_set_points_planned_for_it():
    wanted = "100,20,-650,5,3,2"
    output = run(rig_pose, "--tool", wanted)
    assert tool_line(output) == pytest.approx([100, 20, -650, 5, 3, 2], abs=0.01)


def test_out_of_reach_is_an_error_with_the_nearest(capsys):
    result = CliRunner().invoke(rig_pose.command, ["--tool", "110,20,-650,5,3,80"])
    assert isinstance(result.exception, ExpectedError)
    assert "The nearest that can be" in result.output
    result = CliRunner().invoke(rig_pose.command, ["--set-point", "0,0,5,20,3,1"])
    assert isinstance(result.exception, ExpectedError)
    assert "cannot be reached" in str(result.exception)


@pytest.mark.parametrize("text", ["1,2,3", "a,b,c,d,e,f", "0,0,0,nan,0,0", "0,0,0,inf,0,0", ""])
def test_what_are_no_six_numbers_is_said(text):
    with pytest.raises(ConfigError, match="six numbers"):
        six_numbers(text, "--tool")


def test_workspace_says_what_is_in_the_way_and_what_is_left():
    assert "Largest margin" in run(rig_workspace, "--tool", "110,0,-648,4,3,0")
    output = run(rig_workspace, "--tool", "110,0,-648,40,30,0")
    assert "cannot be reached" in output
    assert "Nearest:" in output


def test_samples_of_the_workspace_can_be_reached(tmp_path):
    run(rig_workspace, "--sample", 20, "--csv", tmp_path / "s.csv", "--seed", 3)
    rows = read(tmp_path / "s.csv")
    assert len(rows) == 20
    text = ",".join(rows[0][key] for key in ("x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg"))
    assert "can be reached" in run(rig_workspace, "--tool", text)


def test_a_plan_ends_at_its_last_pose_within_every_limit(tmp_path):
    run(rig_plan, "--tool", "110,20,-650,5,3,2", "--tool", "110,-20,-640,-5,3,2", "--csv", tmp_path / "p.csv")
    rows = read(tmp_path / "p.csv")
    table = np.array([[float(value) for value in row.values()] for row in rows])
    points = table[:, 1:].reshape(-1, 4, 6)
    points[..., 3:] = np.radians(points[..., 3:])
    end = pose_of("110,-20,-640,-5,3,2")
    np.testing.assert_allclose(stack_pose(points[-1], FO_SHIP).position_mm, end.position_mm, atol=0.01)
    np.testing.assert_allclose(points[0], 0.0)
    assert np.all(np.diff(table[:, 0]) > 0.0)
    assert all(PlatformWorkspace().reaches(point) for point in points[:: len(points) // 6].reshape(-1, 6))


def test_a_plan_through_a_pose_out_of_reach_names_it():
    with pytest.raises(ExpectedError, match="pose 2"):
        run(rig_plan, "--tool", "110,20,-650,5,3,2", "--tool", "900,0,-650,0,0,0")


@pytest.mark.parametrize("name", ["axis-limits", "inverted-pairs", "circle"])
def test_a_demonstration_begins_and_ends_at_home(tmp_path, name):
    run(rig_demo, name, "--csv", tmp_path / "d.csv")
    rows = read(tmp_path / "d.csv")
    for row in (rows[0], rows[-1]):
        assert [float(value) for key, value in row.items() if key != "t_s"] == pytest.approx([0.0] * 24, abs=1e-6)


def test_tracking_looks_at_the_transmitter_or_says_what_is_left():
    assert "to 0.0000 degrees" in run(rig_demo, "tracking", "--transmitter", "2203,762,-726")
    assert "degrees are left" in run(rig_demo, "tracking", "--transmitter", "500,2000,-700")
    with pytest.raises(ConfigError, match="goes with tracking"):
        run(rig_demo, "tracking")


@pytest.mark.parametrize(
    ("module", "arguments", "message"),
    [
        (rig_pose, ("--set-point", "0,0,0,400,0,0"), "angles are in degrees, -180 to 180"),
        (rig_pose, ("--tool", "0.11,0,-0.648,0,0,0"), "in millimetres, not in metres"),
        (rig_pose, ("--tool", "1e300,0,0,0,0,0"), "too far, expected at most 100000 mm"),
        (rig_pose, ("--set-point", "0,0,0,0,0,0", "--attitude", "nan,0,0"), "not three numbers"),
        (rig_pose, ("--set-point", "0,0,0,0,0,0", "--attitude", "1,2"), "not three numbers"),
        (rig_pose, ("--set-point", "0,0,0,0,0,0", "--attitude", "900,0,0"), "angles are in degrees"),
        (rig_workspace, ("--tool", "0.1,0,-0.6,0,0,0"), "not in metres"),
        (rig_workspace, ("--sample", "2", "--csv", "/dev/full"), "No space left on device; give --csv another place"),
        (rig_plan, ("--tool", "110,20,-650,5,3,2", "--csv", "/none/x.csv"), "give --csv another place"),
        (rig_demo, ("circle", "--radius", "20"), "more than the rig can do: .*; give a smaller one"),
        (rig_demo, ("tracking", "--transmitter", "nan,0,0"), "not three numbers"),
        (rig_demo, ("tracking", "--transmitter", "1.4,0,-0.7"), "not in metres"),
        (rig_demo, ("circle", "--csv", "/dev/full"), "give --csv another place"),
    ],
)
def test_what_is_wrong_is_said_with_its_cure(module, arguments, message):
    with pytest.raises(ConfigError, match=message):
        run(module, *arguments)


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        (rig_plan, ("--tool", "110,20,-650,5,3,2", "--servo-speed", "nan")),
        (rig_demo, ("circle", "--speed", "nan")),
        (rig_demo, ("circle", "--radius", "nan")),
        (rig_demo, ("circle", "--radius", "0")),
        (rig_demo, ("circle", "--radius", "inf")),
    ],
)
def test_an_option_that_is_no_number_is_a_wrong_option(module, arguments):
    result = CliRunner().invoke(module.command, arguments)
    assert result.exit_code == 2
    assert "range" in result.output
