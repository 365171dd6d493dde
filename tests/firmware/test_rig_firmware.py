"""The rig's firmware, run natively on models of its servo boards, against the Python kinematics through a real pty."""

import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bluerov_slam.protocol.rig_link import (
    IMUS,
    LINK_SILENCE_S,
    RigAck,
    RigFrameDecoder,
    RigImu,
    RigMessage,
    RigMode,
    RigResult,
    RigState,
    StopCause,
    encode_move,
    encode_read_imu,
    encode_rig_frame,
    encode_servos,
    encode_stop,
    pack_ack,
)
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM, FO_SHIP_SERVOS, AxisLimits, ServoCalibration
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.servos import counts_of
from rig_process import RigProcess

KINEMATICS = Path(__file__).parents[2] / "firmware/lib/rig_core/src/rig/kinematics.cpp"
MAX_ERROR_RAD = np.radians(0.01)
HOME = np.zeros((4, 6))
LIMITS = AxisLimits().array()
RAISED = np.tile([0.0, 0.0, 10.0, 0.0, 0.0, 0.0], (4, 1))


@pytest.fixture
def rig() -> Iterator[RigProcess]:
    with RigProcess() as process:
        yield process


def move(rig: RigProcess, set_points: np.ndarray, steps: int = 1, platforms: int = 15) -> RigAck:
    answer = rig.ask(encode_move(rig.sequence(), set_points, steps, platforms))
    assert isinstance(answer, RigAck)
    return answer


def arrived(state: RigState) -> bool:
    return state.mode == RigMode.READY


def reachable_set_points(count: int, seed: int) -> np.ndarray:
    """Within the axis limits and the servos' range by the Python kinematics, (count, 4, 6)."""
    rng = np.random.default_rng(seed)
    candidates = rng.uniform(-LIMITS, LIMITS, (12 * count, 4, 6))
    counts = counts_of(servo_angles_rad(candidates, FO_SHIP_PLATFORM), FO_SHIP_SERVOS)
    good = candidates[np.isfinite(counts).all(axis=(1, 2))]
    assert len(good) >= count
    return good[:count]


def test_angles_and_counts_are_those_of_the_python_kinematics(rig: RigProcess) -> None:
    rig.start()
    corners = np.array(
        [np.tile(sign * LIMITS * (np.arange(6) == axis), (4, 1)) for axis in range(6) for sign in (-1, 1)]
    )
    corners = corners[np.isfinite(servo_angles_rad(corners, FO_SHIP_PLATFORM)).all(axis=(1, 2))]
    for set_points in np.concatenate([corners, reachable_set_points(90, seed=1)]):
        assert move(rig, set_points).result == RigResult.OK
        state = rig.wait_for(arrived, poll_s=0.01)
        np.testing.assert_allclose(state.set_points, set_points, atol=2e-6)
        angles = servo_angles_rad(set_points, FO_SHIP_PLATFORM)
        np.testing.assert_allclose(state.servo_angles_rad, angles, rtol=0.0, atol=MAX_ERROR_RAD)
        # An angle that lies on the middle between two counts may become either.
        exact = state.counts - counts_of(angles, FO_SHIP_SERVOS)
        fraction = np.abs(angles * FO_SHIP_SERVOS.counts_per_rad % 1.0 - 0.5)
        assert np.all((exact == 0.0) | ((np.abs(exact) == 1.0) & (fraction < 0.03)))


def test_the_firmware_has_the_dimensions_of_the_python_kinematics() -> None:
    source = KINEMATICS.read_text()
    table = re.search(r"kLegs\[kServos\] = \{(.*?)\n\};", source, re.DOTALL)
    assert table is not None
    legs = np.array([float(number) for number in re.findall(r"(-?\d+\.\d+)f", table[1])]).reshape(6, 6)
    np.testing.assert_allclose(legs[:, :2], FO_SHIP_PLATFORM.base_joints_mm[:, :2], atol=6e-6)
    np.testing.assert_allclose(legs[:, 2:4], FO_SHIP_PLATFORM.plate_joints_mm[:, :2], atol=6e-6)
    bearing = FO_SHIP_PLATFORM.arm_bearings_rad
    np.testing.assert_allclose(legs[:, 4:], np.column_stack([np.cos(bearing), np.sin(bearing)]), atol=1e-8)
    for name, value in (
        ("kRodMm", FO_SHIP_PLATFORM.rod_mm[0]),
        ("kArmMm", FO_SHIP_PLATFORM.arm_mm[0]),
        ("kHomeHeightMm", FO_SHIP_PLATFORM.home_height_mm),
    ):
        found = re.search(rf"{name} = ([\d.]+)f", source)
        assert found is not None
        assert float(found[1]) == value


def test_starts_paused_at_home_and_a_press_lets_it_go(rig: RigProcess) -> None:
    waiting = rig.wait_for(lambda state: state.mode == RigMode.WAITING)
    np.testing.assert_array_equal(waiting.set_points, HOME)
    np.testing.assert_allclose(waiting.servo_angles_rad, np.radians(23.0), atol=np.radians(0.05))
    assert move(rig, RAISED).result == RigResult.NOT_NOW
    assert rig.start().presses == 1
    assert move(rig, RAISED).result == RigResult.OK
    state = rig.wait_for(arrived)
    assert (state.stopped_by, state.refused) == (StopCause.ARRIVED, 1)
    np.testing.assert_allclose(state.set_points, RAISED, atol=1e-6)


def test_a_motion_is_linear_in_the_set_points_and_takes_its_steps(rig: RigProcess) -> None:
    rig.start()
    begin = time.monotonic()
    assert move(rig, RAISED, steps=16).result == RigResult.OK
    seen = []
    while not arrived(state := rig.where()):
        seen.append(state)
        np.testing.assert_allclose(state.set_points, RAISED * state.steps_done / 16, atol=1e-5)
        assert (state.mode, state.steps, state.moving_platforms) == (RigMode.MOVING, 16, 15)
        time.sleep(0.02)
    assert len({state.steps_done for state in seen}) > 3
    assert time.monotonic() - begin >= 16 * 0.05 - 0.02


def test_the_button_stops_goes_home_and_waits_for_the_next_press(rig: RigProcess) -> None:
    rig.start()
    move(rig, RAISED)
    rig.wait_for(arrived)
    move(rig, -RAISED, steps=200)
    rig.press()
    rig.wait_for(lambda state: state.mode == RigMode.HOMING, poll_s=0.02)
    assert move(rig, RAISED).result == RigResult.NOT_NOW
    waiting = rig.wait_for(lambda state: state.mode == RigMode.WAITING)
    assert waiting.stopped_by == StopCause.BUTTON
    assert waiting.steps == 20
    np.testing.assert_array_equal(waiting.set_points, HOME)
    rig.press()
    rig.wait_for(arrived)
    assert move(rig, RAISED).result == RigResult.OK


def test_a_silent_link_stops_the_motion_where_it_is(rig: RigProcess) -> None:
    rig.start()
    frame = encode_move(rig.sequence(), RAISED, 100)
    assert isinstance(rig.ask(frame), RigAck)
    time.sleep(LINK_SILENCE_S + 2.0)  # asking would end the silence; a busy machine starves the rig meanwhile
    state = rig.where()
    assert (state.mode, state.stopped_by) == (RigMode.READY, StopCause.LINK_SILENT)
    assert 0 < state.steps_done < 100
    np.testing.assert_allclose(state.set_points, RAISED * state.steps_done / 100, atol=1e-5)
    # The same frame once more is a new command: nothing is left of the old one.
    assert isinstance(rig.ask(frame), RigAck)
    assert rig.where().mode == RigMode.MOVING


def test_stop_holds_the_step_and_platforms_not_named_stay(rig: RigProcess) -> None:
    rig.start()
    move(rig, RAISED, steps=100, platforms=0b0101)
    rig.wait_for(lambda state: state.steps_done >= 2, poll_s=0.02)
    answer = rig.ask(encode_stop(rig.sequence()))
    assert isinstance(answer, RigAck)
    assert answer.result == RigResult.OK
    state = rig.where()
    assert (state.mode, state.stopped_by) == (RigMode.READY, StopCause.COMMAND)
    np.testing.assert_array_equal(state.set_points[[1, 3]], HOME[[1, 3]])
    assert np.all(state.set_points[[0, 2], 2] > 0.1)


def test_a_repeated_move_is_obeyed_once(rig: RigProcess) -> None:
    rig.start()
    frame = encode_move(rig.sequence(), RAISED, 20)
    rig.ask(frame)
    before = rig.wait_for(lambda state: state.steps_done >= 3, poll_s=0.02)
    rig.ask(frame)
    assert rig.where().steps_done >= before.steps_done


@pytest.mark.parametrize(
    ("axis", "value", "result"),
    [
        (0, 5.1, RigResult.LIMIT),
        (2, -16.2, RigResult.LIMIT),
        (4, np.radians(15.1), RigResult.LIMIT),
        (5, -0.5, RigResult.LIMIT),
    ],
)
def test_what_is_beyond_a_limit_is_refused_with_its_platform(
    rig: RigProcess, axis: int, value: float, result: RigResult
) -> None:
    rig.start()
    set_points = HOME.copy()
    set_points[2, axis] = value
    answer = move(rig, set_points)
    assert (answer.result, answer.platform) == (result, 2)
    np.testing.assert_array_equal(rig.where().set_points, HOME)


def test_what_has_no_servo_angles_is_refused_with_the_servo(rig: RigProcess) -> None:
    rig.start()
    corner = HOME.copy()
    corner[3] = LIMITS * [1, 1, -1, 1, 1, 1]
    expected = servo_angles_rad(corner[3], FO_SHIP_PLATFORM)
    assert np.isnan(expected).any()
    answer = move(rig, corner)
    assert (answer.result, answer.platform) == (RigResult.UNREACHABLE, 3)
    assert answer.servo == int(np.flatnonzero(np.isnan(expected))[0])


def test_servos_take_a_new_calibration_and_refuse_a_wrong_one(rig: RigProcess) -> None:
    rig.start()
    calibration = ServoCalibration(np.full(6, 0.97), np.arange(6.0) - 2.5, np.arange(6) % 2 == 0)
    gains = np.where(calibration.reversed_, -1.0, 1.0) * calibration.gain * calibration.counts_per_rad
    answer = rig.ask(encode_servos(rig.sequence(), 1, gains, calibration.offset_counts))
    assert isinstance(answer, RigAck)
    assert answer.result == RigResult.OK
    home = servo_angles_rad(np.zeros(6), FO_SHIP_PLATFORM)
    np.testing.assert_array_equal(rig.where().counts[1], counts_of(home, calibration))
    wrong = rig.ask(encode_servos(rig.sequence(), 1, 0.1 * gains, calibration.offset_counts))
    assert isinstance(wrong, RigAck)
    assert wrong.result == RigResult.BAD_CONTENT
    np.testing.assert_array_equal(rig.where().counts[1], counts_of(home, calibration))


def test_damaged_frames_and_garbage_are_counted_and_move_nothing(rig: RigProcess) -> None:
    rig.start()
    frame = encode_move(rig.sequence(), RAISED, 1)
    rng = np.random.default_rng(7)
    ours = RigFrameDecoder()
    for at in rng.integers(0, len(frame), 60):
        damaged = bytearray(frame)
        damaged[at] ^= 1 << int(rng.integers(8))
        noise = bytes(damaged) + rng.bytes(int(rng.integers(1, 20)))
        assert ours.feed(noise) == []
        rig.write(noise)
    rig.write(bytes(len(frame)))  # what looks like a frame's beginning ends
    ours.feed(bytes(len(frame)))
    state = rig.where()
    assert state.bad_frames == ours.counters.checksum_errors + ours.counters.length_errors > 50
    np.testing.assert_array_equal(state.set_points, HOME)
    assert (state.mode, state.refused) == (RigMode.READY, 0)


def test_imus_are_read_back_and_a_missing_one_is_unknown() -> None:
    with RigProcess("--imus", "18") as rig:
        for imu in range(IMUS):
            answer = rig.ask(encode_read_imu(rig.sequence(), imu, 8))
            assert isinstance(answer, RigImu)
            assert answer.imu == imu
            if imu in (1, 4):
                assert answer.readings == 8
                np.testing.assert_allclose(answer.acceleration_mps2, [0.0, 0.0, -9.80665], atol=1e-5)
                assert answer.temperature_degc == pytest.approx(25.0, abs=0.01)
            else:
                assert answer.readings == 0
                assert np.isnan(answer.acceleration_mps2).all()
                assert np.isnan(answer.rate_radps).all()
                assert np.isnan(answer.temperature_degc)


def test_servo_boards_that_lose_their_supply_stop_the_motion_and_come_back(rig: RigProcess) -> None:
    rig.start()
    move(rig, RAISED, steps=100)
    rig.change_supply()
    stopped = rig.wait_for(arrived, poll_s=0.02)
    assert stopped.stopped_by == StopCause.SERVO_BOARD
    assert stopped.i2c_errors > 0
    assert move(rig, RAISED).result == RigResult.SERVO_BOARD
    rig.change_supply()
    deadline = time.monotonic() + 5.0
    while move(rig, RAISED).result != RigResult.OK:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    assert rig.wait_for(arrived).servo_board_restarts == 1


def test_a_message_that_came_the_wrong_way_is_answered_as_unknown(rig: RigProcess) -> None:
    rig.wait_for(lambda state: state.mode == RigMode.WAITING)
    rig.write(encode_rig_frame(RigMessage.ACK, pack_ack(RigAck(0x30, 9, 0))))
    deadline = time.monotonic() + 5.0
    answers: list[RigAck] = []
    while not answers and time.monotonic() < deadline:
        answers = [record for record in rig.read(0.1) if isinstance(record, RigAck)]
    assert answers[0].result == RigResult.UNKNOWN
