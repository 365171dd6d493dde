"""`bluerov-slam rig demo` with a rig: nothing moves without the switch, and what moves is the firmware behind a pty."""

import os
import threading

import numpy as np
import pytest

from bluerov_slam.cli.rig_demo import command
from bluerov_slam.errors import CommandError, ConfigError, LinkError
from bluerov_slam.rig.demo import track_transmitter
from rig_bench import run_command
from rig_process import RigProcess

TRACKING = ("tracking", "--transmitter", "2203,762,-726")


def run(*arguments):
    return run_command(command, arguments)


def test_without_the_switch_a_port_is_not_even_opened(tmp_path):
    output = run("circle", "--port", tmp_path / "ttyUSB0").output
    assert "Nothing moves yet. With --move-for-real:" in output
    assert "circle: 51 set points, 7.3 s" in output


def test_a_port_slows_the_way_down_and_speed_sets_it():
    fast, slow = run("circle").output, run("circle", "--speed", 0.5).output
    assert "1.5 s" in fast
    assert "2.9 s" in slow


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("circle", "--move-for-real"), ConfigError, "give its --port"),
        (("circle", "--move-for-real", "--port", "/dev/ttyNONE9"), LinkError, "does not exist"),
        (("circle", "--move-for-real", "--port", "/dev/null"), LinkError, "no serial port"),
    ],
)
def test_what_is_missing_is_said_in_a_line(arguments, error, message):
    with pytest.raises(error, match=message):
        run(*arguments)


def test_a_demonstration_moves_the_rig_and_says_where_it_stays():
    with RigProcess() as rig:
        rig.start()
        output = run(*TRACKING, "--move-for-real", "--port", os.ttyname(rig._fd)).output
        assert "The rig will move like this:" in output
        assert "Keep clear of it." in output
        assert "Done: the rig stays there. Its button sends it home" in output
        expected = track_transmitter(np.array([2203.0, 762.0, -726.0])).set_points
        np.testing.assert_allclose(rig.where().set_points, expected, atol=2e-6)


def test_the_rig_waits_for_its_button_and_the_button_ends_it():
    with RigProcess() as rig:
        for seconds in (1.0, 2.5):
            threading.Timer(seconds, rig.press).start()
        with pytest.raises(CommandError, match="its button was pressed"):
            run("circle", "--move-for-real", "--port", os.ttyname(rig._fd))
