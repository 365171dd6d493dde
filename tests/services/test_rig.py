"""A collection on the rig's own firmware, run natively behind a real pty, and a receiver behind another."""

import threading

import numpy as np
import pytest

from bluerov_slam.errors import LinkError, RecordingError
from bluerov_slam.protocol.rig_link import RigMode
from bluerov_slam.rig.collection import Collection, CollectionPlan, Keep, Motion, Move, Pressed, Session
from bluerov_slam.services import rig as service
from bluerov_slam.services.rig import Line, RealRig, ReceiverLink, RigLink, what_moves
from receiver_thread import PLACE
from rig_bench import rig_and_receiver


@pytest.fixture
def bench(monkeypatch):
    """A rig that may move, its receiver, and the driver of both."""
    with rig_and_receiver(monkeypatch) as (process, receiver, port):
        # The driver goes on where this side of the process's own pty left off.
        lines = [Line(port, service.RIG_BAUD), Line(receiver.path, service.RECEIVER_BAUD)]
        said = []
        yield process, receiver, RealRig(RigLink(lines[0]), ReceiverLink(lines[1]), said.append), said
        for line in lines:
            line.close()


def collection(**changes):
    fields = {
        "name": "s",
        "transmitter_mm": (1426.0, 0.0, -694.0),
        "motion": Motion.RAPID,
        "ranges": {"Z": (8.0, 0.0)},
        "order": "Z",
    }
    return Collection(CollectionPlan([Session(**(fields | changes))], result_timeout_s=2.0))


def points_of(actions):
    return [action.point for action in actions if isinstance(action, Keep)]


def test_a_session_moves_the_real_firmware_and_keeps_its_points(bench):
    process, receiver, rig, _ = bench
    actions = []
    rig.ready()
    assert rig.run(collection(), actions.append) == ""
    points = points_of(actions)
    assert [point.label for point in points] == [16.0, 8.0, 0.0]
    assert not any(point.missing for point in points)
    np.testing.assert_allclose(points[1].result.raw_mm, PLACE)
    assert len(receiver.told) == 3
    assert receiver.told[0] == pytest.approx(0.110, abs=1e-4)
    state = process.where()
    assert state.mode == RigMode.READY
    np.testing.assert_allclose(state.set_points, 0.0, atol=1e-6)


def test_a_receiver_that_falls_silent_stops_everything(bench, monkeypatch):
    monkeypatch.setattr(service, "REPLY_WAIT_S", 0.1)  # nothing comes however long it waits
    process, receiver, rig, said = bench
    receiver.deaf = True
    actions = []
    reason = rig.run(collection(), actions.append)
    assert "silent" in reason
    assert [point.missing for point in points_of(actions)] == ["the link to the receiver is silent"] * 3
    assert not any(isinstance(action, Move) for action in actions)
    assert said[0].startswith("Stopped:")
    np.testing.assert_allclose(process.where().set_points, 0.0, atol=1e-6)


def test_a_damaged_line_and_refused_checksums_cost_their_points_only(bench):
    _, receiver, rig, _ = bench
    receiver.damaged = {1}
    receiver.refusals = 2
    actions = []
    assert rig.run(collection(), actions.append) == ""
    points = points_of(actions)
    assert "damaged" in points[0].missing
    assert points[0].result is None
    assert [bool(point.missing) for point in points] == [True, False, False]


def test_a_tilt_that_was_not_set_ends_with_the_rig_held(bench):
    process, receiver, rig, _ = bench
    receiver.attitude_deg = (15.0, 0.0, 0.0)
    actions = []
    assert "one servo at a time" in rig.run(collection(), actions.append)
    assert process.where().set_points[0, 2] == pytest.approx(2.0, abs=1e-5)


def test_the_button_pauses_and_the_axes_begin_anew(bench):
    process, receiver, rig, said = bench

    def pressed_once():
        if len(receiver.told) == 2:
            process.press()
            threading.Timer(3.0, process.press).start()

    receiver.on_told = pressed_once
    actions = []
    assert rig.run(collection(), actions.append) == ""
    assert [action.place for action in actions if isinstance(action, Pressed)]
    points = points_of(actions)
    assert [point.label for point in points] == [16.0, 16.0, 8.0, 0.0]
    assert not any(point.missing for point in points)
    assert any("press its button" in line for line in said)


def test_a_rig_that_is_not_at_home_is_not_driven(bench):
    process, _, rig, _ = bench
    RigLink.move(rig._rig, np.tile([0.0, 0.0, 2.0, 0.0, 0.0, 0.0], (4, 1)), 1)
    process.wait_for(lambda state: state.mode == RigMode.READY)
    with pytest.raises(LinkError, match="not at home"):
        rig.ready()


def test_a_move_beyond_the_limits_is_refused_by_name(bench):
    _, _, rig, _ = bench
    answer = rig._rig.move(np.tile([0.0, 0.0, 0.0, 0.5, 0.0, 0.0], (4, 1)), 1)
    assert "limit, platform 1" in service.refusal(answer)


def test_a_port_that_is_none_is_said(tmp_path):
    with pytest.raises(LinkError, match="does not exist"):
        Line(tmp_path / "ttyUSB9", service.RIG_BAUD)


def test_what_will_move_is_said_before():
    still = Session("a", (0.0, 0.0, 0.0), Motion.STATIONARY, fixes=7)
    moving = Session("b", (0.0, 0.0, 0.0), Motion.GRADUAL, {"A": (24.0, -24.0), "Z": (64.0, -64.0)}, "AZ", passes=2)
    assert what_moves([still, moving]) == [
        "a: nothing moves, 7 points at home",
        "b: all four platforms move (gradual), 2 x: A 24 to -24 deg, Z 64 to -64 mm",
    ]


def test_a_log_that_cannot_be_written_stops_the_rig(bench):
    process, _, rig, _ = bench
    kept = []

    def full(action):
        kept.append(action)
        if len(points_of(kept)) == 2:
            raise RecordingError("the disk is full")

    with pytest.raises(RecordingError):
        rig.run(collection(), full)
    state = process.where()
    assert state.mode == RigMode.READY
    assert state.set_points[0, 2] == pytest.approx(2.0, abs=1e-5)
