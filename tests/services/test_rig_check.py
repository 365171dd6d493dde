"""The check on the rig's own firmware, run natively behind a pty; the receiver tells the attitude of its servos."""

import os
from pathlib import Path

import numpy as np
import pytest

from bluerov_slam.evaluation.rig_check_bench import SimulatedBench
from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.protocol.rig_link import RigMode, StopCause
from bluerov_slam.rig.check import Ended, Missing, RigCheck
from bluerov_slam.rig.check_words import FAULT, UNKNOWN, outcome, words
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.services import rig as service
from bluerov_slam.services.rig import Line, ReceiverLink, RigLink
from bluerov_slam.services.rig_check import RealBench, check_bench, steps_between
from bluerov_slam.services.rig_way import BUTTON
from bluerov_slam.simulation.rig_receiver import euler_rad
from receiver_thread import ReceiverThread
from rig_process import RigProcess

CHECK = RigCheck()


@pytest.fixture
def bench(monkeypatch):
    """A rig that may move, its receiver with the attitude of a rig as drawn, and the driver of both."""
    monkeypatch.setattr(service, "REPLY_WAIT_S", 1.0)
    receiver = ReceiverThread()
    receiver.stuck = None
    receiver.start()
    with RigProcess() as process:
        process.start()
        home = process.where().servo_angles_rad
        random = np.random.default_rng(5)

        def attitude():
            angles = process.where().servo_angles_rad
            if receiver.stuck is not None:
                angles[receiver.stuck] = home[receiver.stuck]
            reached = np.eye(3)
            for each in rotations(plate_pose(angles, FO_SHIP_PLATFORM).set_point[:, 3:]):
                reached = reached @ each
            receiver.attitude_deg = tuple(np.degrees(euler_rad(reached)) + 0.05 * random.standard_normal(3))

        receiver.on_told = attitude
        lines = [Line(Path(os.ttyname(process._fd)), service.RIG_BAUD), Line(receiver.path, service.RECEIVER_BAUD)]
        yield process, receiver, RealBench(RigLink(lines[0]), ReceiverLink(lines[1]), 1.0, result_timeout_s=1.5)
        for line in lines:
            line.close()
    receiver.end()


def test_the_attitude_is_that_of_the_place_it_was_sent_to(bench):
    process, _, rig = bench
    place = CHECK.servo_places[5]  # the second servo up
    seen = rig.attitude_at(place)
    expected = np.eye(3)
    for each in rotations(place[:, 3:]):
        expected = expected @ each
    np.testing.assert_allclose(seen, euler_rad(expected), atol=np.radians(0.3))
    np.testing.assert_allclose(process.where().set_points, place, atol=2e-6)
    rig.go_home()
    np.testing.assert_allclose(process.where().set_points, 0.0, atol=2e-6)


def test_what_is_silent_damaged_or_refused_is_missing_with_its_reason(bench):
    process, receiver, rig = bench
    stance = CHECK.servo_places[0]
    receiver.damaged = {1}
    with pytest.raises(Missing, match="damaged"):
        rig.attitude_at(stance)
    receiver.refusals = 3
    with pytest.raises(Missing, match="wrong checksum"):
        rig.attitude_at(stance)
    receiver.on_told = lambda: setattr(receiver, "attitude_deg", (float("nan"), 0.0, 0.0))
    with pytest.raises(Missing, match="its IMU is silent"):
        rig.attitude_at(stance)
    beyond = stance.copy()
    beyond[2, 4] = 0.5
    with pytest.raises(Missing, match="limit, platform 3"):
        rig.attitude_at(beyond)
    np.testing.assert_allclose(process.where().set_points, stance, atol=2e-6)


def test_the_button_ends_it_even_while_it_reads(bench):
    process, receiver, rig = bench
    receiver.on_told = process.press
    with pytest.raises(Ended, match=BUTTON):
        rig.attitude_at(CHECK.servo_places[0])


def test_a_rig_that_falls_silent_ends_the_run_and_nothing_is_accused(bench):
    process, receiver, rig = bench
    attitude = receiver.on_told

    def killed():
        attitude()
        if len(receiver.told) == 4:
            process.process.kill()

    receiver.on_told = killed
    readings = CHECK.run(rig)
    assert readings.ended
    assert np.isfinite(readings.servos[:2]).all()
    assert np.isnan(readings.servos[3:]).all()
    assert np.isnan(readings.zeros).all()
    verdict = CHECK.judge(readings)
    assert outcome(verdict) == UNKNOWN
    assert verdict.servos is None
    assert verdict.zeros is None


def interrupted(port, receiver_port):
    places = np.stack([np.zeros((4, 6)), CHECK.servo_places[0]])
    with check_bench(port, receiver_port, 0.02, lambda _: None) as rig:
        rig._rig.begin(places[1], steps_between(*places, 0.02))
        raise KeyboardInterrupt


def test_an_interrupted_check_stops_the_rig():
    receiver = ReceiverThread()
    with RigProcess() as process:
        process.start()
        with pytest.raises(KeyboardInterrupt):
            interrupted(Path(os.ttyname(process._fd)), receiver.path)
        state = process.where()
        assert (state.mode, state.stopped_by) == (RigMode.READY, StopCause.COMMAND)
        assert np.abs(state.set_points[:, 3:]).max() < np.radians(8.0)
    receiver.end()


@pytest.mark.long
def test_a_stuck_servo_of_the_firmwares_rig_is_named(bench):
    _, receiver, rig = bench
    receiver.stuck = (1, 4)
    readings = CHECK.run(rig)
    assert not readings.ended
    assert readings.held
    assert "Servo 5 of platform 2 does not move" in words(CHECK.judge(readings))


class Failing:
    """A simulated rig whose readings at some places are missing, or turned."""

    def __init__(self, lost=(), ends=None, turned=None):
        self._bench, self._lost, self._ends, self._turned = SimulatedBench(3, 0), set(lost), ends, turned
        self.asked = 0

    def attitude_at(self, set_points):
        attitude = self._bench.attitude_at(set_points)
        self.asked += 1
        if self.asked == self._ends:
            raise Ended("gone")
        if self.asked in self._lost:
            raise Missing("lost")
        return attitude if self._turned is None else self._turned(attitude, self.asked)


def test_single_missing_readings_cost_little_and_are_told():
    readings = CHECK.run(Failing(lost=range(2, 170, 9)))
    verdict = CHECK.judge(readings)
    assert not readings.ended
    assert len(readings.missing) == 19
    assert verdict.zeros.finding is None
    assert verdict.zeros.untested == np.sum(np.isnan(readings.zeros[:, 0])) > 5
    assert outcome(verdict) == UNKNOWN  # a servo whose move was not read is not called good
    assert any("was not read" in line for line in words(verdict))


def test_three_missing_in_a_row_end_it_without_an_accusation():
    bench = Failing(lost=range(20, 500))
    readings = CHECK.run(bench)
    assert bench.asked == 22
    assert "3 readings in a row are missing" in readings.ended
    assert outcome(CHECK.judge(readings)) == UNKNOWN


def test_servos_without_supply_are_not_all_called_stuck():
    random = np.random.default_rng(1)
    readings = CHECK.run(Failing(turned=lambda *_: 1e-3 * random.standard_normal(3)))
    assert readings.held
    assert "servos seem wrong at once" in " ".join(CHECK.judge(readings).unknown)


def test_the_boards_own_zero_of_yaw_is_no_fault():
    far = CHECK.run(Failing(turned=lambda attitude, _: attitude + np.array([0.0, 0.0, 1.0])))
    assert outcome(CHECK.judge(far)) == outcome(CHECK.judge(CHECK.run(Failing()))) != FAULT


def test_a_compass_that_wanders_slowly_turns_no_servo():
    def wandering(attitude, number):
        return attitude + np.array([0.0, 0.0, np.radians(0.1) * number * (number < 99)])

    assert CHECK.judge(CHECK.run(Failing(turned=wandering))).servos.findings == ()


def test_a_stance_takes_the_time_of_its_fastest_servo():
    places = CHECK.servo_places
    whole, careful = (steps_between(places[0], places[1], share) for share in (1.0, 0.1))
    assert steps_between(places[0], places[0], 1.0) == 1
    assert whole <= 2  # ten degrees at 60 degrees in 0.17 s
    assert 5 <= careful <= 10
