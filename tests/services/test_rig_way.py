"""A way in time on the rig's own firmware, run natively behind a real pty: how close it is followed, and every end."""

import os
import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bluerov_slam.errors import LinkError
from bluerov_slam.protocol.rig_link import RigFrameDecoder, RigMode, StopCause
from bluerov_slam.rig.demo import circle
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.trajectory import STEP_S, smooth_path
from bluerov_slam.services.rig import RIG_BAUD, Line, RigLink, wait_at_home
from bluerov_slam.services.rig_way import BUTTON, EARLY_STEPS, PIECE_STEPS, pieces, run_way
from rig_process import RigProcess

HOME = np.zeros((4, 6))
RAISED = np.tile([0.0, 0.0, 12.0, 0.0, 0.0, 0.0], (4, 1))
LONG = np.linspace(HOME, RAISED, 101)  # 5 s


@pytest.fixture
def bench():
    with RigProcess() as process:
        process.start()
        line = Line(Path(os.ttyname(process._fd)), RIG_BAUD)
        yield process, RigLink(line)
        line.close()


def test_pieces_end_at_every_stop_and_leave_nothing_out():
    assert pieces(8, [0, 4, 7]) == [(0, 3), (3, 4), (4, 7)]
    assert pieces(2, []) == [(0, 1)]
    assert pieces(1, [0]) == []


def test_a_way_is_followed_closely_and_ends_where_it_should(bench):
    _, rig = bench
    waypoints = circle(np.radians(5.0))
    way = smooth_path(waypoints, FO_SHIP, step_s=0.4 * STEP_S).set_points
    states = []
    began = time.monotonic()
    assert run_way(rig, way, waypoints, states.append) == ""
    assert time.monotonic() - began >= STEP_S * (len(way) - 1)  # never faster than planned
    fine = np.concatenate([np.linspace(a, b, 10) for a, b in pairwise(way)])
    planned = servo_angles_rad(fine, FO_SHIP_PLATFORM)
    held = np.array([state.servo_angles_rad for state in states])
    off = np.abs(held[:, None] - planned[None]).max(axis=(2, 3)).min(axis=1)
    assert len({state.steps_done for state in states}) > 3
    assert np.degrees(off.max()) < 3.0  # the chords of four steps; the servos turn by 25 degrees
    np.testing.assert_allclose(rig.where().set_points, HOME, atol=1e-6)


def test_a_stop_on_the_way_is_reached(bench):
    _, rig = bench
    waypoints = np.stack([HOME, RAISED, HOME])
    way = np.concatenate([np.linspace(HOME, RAISED, 8), np.linspace(RAISED, HOME, 8)[1:]])
    states = []
    assert run_way(rig, way, waypoints, states.append) == ""
    assert max(state.set_points[0, 2] for state in states) == pytest.approx(12.0, abs=1e-5)


def test_the_button_ends_the_way_and_the_rig_goes_home(bench):
    process, rig = bench
    threading.Timer(0.6, process.press).start()
    assert run_way(rig, LONG, LONG[[0, -1]]) == BUTTON
    until = time.monotonic() + 10.0
    while (state := rig.where()).mode != RigMode.WAITING:
        assert time.monotonic() < until
    np.testing.assert_array_equal(state.set_points, HOME)


def test_servo_boards_without_supply_end_the_way(bench):
    process, rig = bench
    threading.Timer(0.6, process.change_supply).start()
    assert "servo board" in run_way(rig, LONG, LONG[[0, -1]])


def test_a_place_out_of_reach_is_refused_by_name(bench):
    _, rig = bench
    beyond = RAISED.copy()
    beyond[2, 4] = 0.5
    assert run_way(rig, np.stack([HOME, beyond]), np.stack([HOME, beyond])) == "it refused to move: limit, platform 3"
    np.testing.assert_array_equal(rig.where().set_points, HOME)


def test_an_interrupted_computer_stops_the_rig(bench):
    _, rig = bench

    def interrupt(state):
        if state.steps_done >= 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_way(rig, LONG, LONG[[0, -1]], interrupt)
    state = rig.where()
    assert (state.mode, state.stopped_by) == (RigMode.READY, StopCause.COMMAND)
    assert 0.0 < state.set_points[0, 2] < 3.0


def test_what_a_computer_is_late_is_not_caught_up(bench):
    _, rig = bench
    heights = []

    def sleep(state):
        heights.append(state.set_points[0, 2])
        if len(heights) == 5:
            time.sleep(1.0)

    way = np.linspace(HOME, RAISED, 25)
    assert run_way(rig, way, way[[0, -1]], sleep) == ""
    slept = heights[5] - heights[4]
    assert slept <= (PIECE_STEPS + EARLY_STEPS) * RAISED[0, 2] / 24 + 1e-5
    assert heights[-1] == pytest.approx(12.0, abs=1e-5)


def test_an_end_that_falls_silent_is_a_link_error(bench, monkeypatch):
    process, rig = bench
    monkeypatch.setattr(RigFrameDecoder, "feed", lambda self, data: [])
    with pytest.raises(LinkError, match=r"does not answer: is it switched on.* has stopped by itself"):
        run_way(rig, LONG, LONG[[0, -1]])
    monkeypatch.undo()
    assert process.where().set_points[0, 2] < 1.0


def test_a_rig_that_goes_away_is_a_link_error(bench):
    process, rig = bench
    threading.Timer(0.6, process.process.kill).start()
    with pytest.raises(LinkError, match=r"is gone.*: plug it in again"):
        run_way(rig, LONG, LONG[[0, -1]])


def test_a_rig_that_is_not_at_home_is_not_driven(bench):
    process, rig = bench
    rig.begin(RAISED, 1)
    process.wait_for(lambda state: state.mode == RigMode.READY)
    with pytest.raises(LinkError, match="not at home: press its button"):
        wait_at_home(rig, lambda _: None)
