"""Frames between a computer and the rig's firmware: round trips, every byte damaged, what is never sent."""

import math

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.protocol.rig_link import (
    TRIES,
    CommandExchange,
    CommandOutcome,
    RigAck,
    RigFrameDecoder,
    RigImu,
    RigMessage,
    RigMode,
    RigMove,
    RigRecord,
    RigResult,
    RigServos,
    RigState,
    StopCause,
    encode_move,
    encode_read_imu,
    encode_rig_frame,
    encode_servos,
    encode_stop,
    encode_where,
    pack_ack,
    pack_imu,
    pack_state,
    unpack,
)

RNG = np.random.default_rng(3)
SET_POINTS = RNG.uniform(-1, 1, (4, 6)) * [5, 5, 16, 0.26, 0.26, 0.08]
ANGLES = RNG.uniform(-1, 1, (4, 6))
COUNTS = RNG.integers(100, 501, (4, 6)).astype(float)


def state(**changes: object) -> RigState:
    values: dict[str, object] = {
        "sequence": 7, "mode": RigMode.MOVING, "stopped_by": StopCause.BUTTON, "moving_platforms": 5, "steps_done": 3,
        "steps": 16, "t_ms": 123_456, "set_points": SET_POINTS, "servo_angles_rad": ANGLES, "counts": COUNTS,
        "bad_frames": 1, "refused": 2, "i2c_errors": 3, "servo_board_restarts": 4, "presses": 65_535,
    }  # fmt: skip
    return RigState(**(values | changes))  # type: ignore[arg-type]


def come_back(frame: bytes) -> RigRecord:
    [(kind, body)] = RigFrameDecoder().feed(frame)
    record = unpack(kind, body)
    assert record is not None
    return record


def test_move_keeps_set_points_to_half_a_nanometre_and_nanoradian() -> None:
    record = come_back(encode_move(9, SET_POINTS, 16, 0b0110))
    assert isinstance(record, RigMove)
    assert (record.sequence, record.platforms, record.steps) == (9, 6, 16)
    np.testing.assert_allclose(record.set_points[:, :3], SET_POINTS[:, :3], atol=0.51e-6)
    np.testing.assert_allclose(record.set_points[:, 3:], SET_POINTS[:, 3:], atol=0.51e-9)


def test_move_is_laid_out_as_documented() -> None:
    set_points = np.zeros((4, 6))
    set_points[1, 2], set_points[3, 3] = -16.0, 0.25
    frame = encode_move(1, set_points, 6)
    assert frame[:5] == bytes.fromhex("aa5530 0066")
    body = frame[5:-3]
    assert body[:4] == bytes([1, 15, 6, 0])
    numbers = np.frombuffer(body[4:], "<i4")
    assert numbers[6 + 2] == -16_000_000
    assert numbers[18 + 3] == 250_000_000
    assert np.count_nonzero(numbers) == 2


@pytest.mark.parametrize(
    "frame",
    [encode_stop(200), encode_where(255), encode_read_imu(3, 4, 64), encode_move(1, SET_POINTS, 1200)],
    ids=["stop", "where", "read imu", "move"],
)
def test_every_damaged_byte_and_every_cut_gives_no_frame(frame: bytes) -> None:
    for at in range(len(frame)):
        for bit in range(8):
            damaged = bytearray(frame)
            damaged[at] ^= 1 << bit
            assert RigFrameDecoder().feed(bytes(damaged) + bytes(400)) == []
        decoder = RigFrameDecoder()
        assert decoder.feed(frame[:at]) + decoder.feed(frame[at:]) == RigFrameDecoder().feed(frame)


def test_damage_that_the_frames_own_check_does_not_see_is_seen() -> None:
    frame = bytearray(encode_move(1, SET_POINTS, 6))
    frame[20] ^= 0x40
    frame[30] ^= 0x40
    decoder = RigFrameDecoder()
    assert decoder.feed(bytes(frame)) == []
    assert decoder.counters.checksum_errors == 1


def test_other_links_frames_are_skipped_and_a_good_one_behind_garbage_is_found() -> None:
    decoder = RigFrameDecoder()
    vehicle = encode_frame(MessageType.COMMAND_ACK, b"\1\2\3")
    assert decoder.feed(b"\xaa" + vehicle + b"\xaa\x55\x30\xff\xff" + encode_where(4)) == [(RigMessage.WHERE, b"\4")]
    assert decoder.counters.length_errors == 2
    assert decoder.counters.bytes_skipped == 1 + len(vehicle) + 5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((0, 0, math.nan), "x of platform 1"),
        ((3, 3, 15.0), "degrees given as radians"),
        ((1, 5, -5.0), "yaw of platform 2.*degrees given as radians"),
        ((2, 2, 16_000.0), "z of platform 3: 16000.0 mm"),
        ((2, 1, -math.inf), "y of platform 3"),
    ],
)
def test_what_is_no_set_point_is_never_sent(change: tuple[int, int, float], words: str) -> None:
    platform, axis, value = change
    set_points = SET_POINTS.copy()
    set_points[platform, axis] = value
    with pytest.raises(OutOfValidityError, match=words):
        encode_move(1, set_points, 16)


def test_steps_platforms_shapes_and_calibrations_are_checked() -> None:
    with pytest.raises(OutOfValidityError, match="0 steps"):
        encode_move(1, SET_POINTS, 0)
    with pytest.raises(OutOfValidityError, match="platforms 0b10000"):
        encode_move(1, SET_POINTS, 16, 16)
    with pytest.raises(OutOfValidityError, match=r"shape \(6,\)"):
        encode_move(1, SET_POINTS[0], 16)
    with pytest.raises(OutOfValidityError, match="65 readings"):
        encode_read_imu(1, 0, 65)
    with pytest.raises(OutOfValidityError, match="below 1000"):
        encode_servos(1, 0, [127.0] * 5 + [math.nan], [0.0] * 6)
    with pytest.raises(OutOfValidityError, match="platform 4"):
        encode_servos(1, 4, [127.0] * 6, [0.0] * 6)


def test_servos_keep_sign_and_fraction() -> None:
    gains = np.array([-127.324, 127.324, -126.9, 127.0, -128.5, 127.324])
    record = come_back(encode_servos(3, 2, gains.tolist(), [2.25, -1, 0, -19, -4, 1]))
    assert isinstance(record, RigServos)
    assert (record.sequence, record.platform) == (3, 2)
    np.testing.assert_allclose(record.gain_counts_per_rad, gains, atol=1e-6)
    assert record.offset_counts[0] == 2.25


def test_state_comes_back_whole() -> None:
    record = come_back(encode_rig_frame(RigMessage.STATE, pack_state(state())))
    assert isinstance(record, RigState)
    np.testing.assert_allclose(record.set_points, SET_POINTS, atol=1e-6)
    np.testing.assert_allclose(record.servo_angles_rad, ANGLES, atol=1e-9)
    np.testing.assert_array_equal(record.counts, COUNTS)
    assert (record.sequence, record.mode, record.stopped_by, record.moving_platforms) == (7, 3, 3, 5)
    assert (record.steps_done, record.steps, record.t_ms) == (3, 16, 123_456)
    assert (record.bad_frames, record.refused, record.i2c_errors) == (1, 2, 3)
    assert (record.servo_board_restarts, record.presses) == (4, 65_535)


def test_an_unknown_place_stays_unknown() -> None:
    nothing = np.full((4, 6), math.nan)
    unknown = state(set_points=nothing, servo_angles_rad=nothing, counts=nothing)
    record = come_back(encode_rig_frame(RigMessage.STATE, pack_state(unknown)))
    assert isinstance(record, RigState)
    for array in (record.set_points, record.servo_angles_rad, record.counts):
        assert np.isnan(array).all()


def test_acknowledgement_and_imu_come_back() -> None:
    for ack in (RigAck(0x30, 4, RigResult.UNREACHABLE, 3, 5), RigAck(0x31, 255, RigResult.OK)):
        assert come_back(encode_rig_frame(RigMessage.ACK, pack_ack(ack))) == ack
    imu = RigImu(8, 2, 16, np.array([0.1, -0.2, -9.80665]), np.array([1e-3, math.nan, 0.0]), 24.99)
    record = come_back(encode_rig_frame(RigMessage.IMU, pack_imu(imu)))
    assert isinstance(record, RigImu)
    np.testing.assert_allclose(record.acceleration_mps2, imu.acceleration_mps2, atol=1e-6)
    np.testing.assert_allclose(record.rate_radps, imu.rate_radps, atol=1e-6)
    assert record.temperature_degc == 24.99
    silent = RigImu(8, 2, 0, np.full(3, math.nan), np.full(3, math.nan), math.nan)
    record = come_back(encode_rig_frame(RigMessage.IMU, pack_imu(silent)))
    assert isinstance(record, RigImu)
    assert math.isnan(record.temperature_degc)


def test_a_body_of_another_length_is_no_record() -> None:
    assert unpack(RigMessage.STOP, b"\1\2") is None
    assert unpack(0x99, b"\1") is None


def test_a_command_is_said_three_times_and_then_the_link_is_silent() -> None:
    frame = encode_stop(5)
    exchange = CommandExchange(frame)
    assert [exchange.begin(), exchange.timed_out(), exchange.timed_out()] == [frame] * TRIES
    assert exchange.outcome is None
    assert exchange.timed_out() == b""
    assert exchange.outcome is CommandOutcome.SILENT
    assert exchange.answer is None


@pytest.mark.parametrize(
    ("frame", "others", "answer"),
    [
        (encode_stop(5), [RigAck(0x31, 4, 0), RigAck(0x30, 5, 0), state(sequence=5)], RigAck(0x31, 5, 0)),
        (encode_where(5), [state(sequence=0), RigAck(0x31, 5, 0)], state(sequence=5)),
        (encode_read_imu(5, 1), [None, RigImu(4, 1, 0, np.zeros(3), np.zeros(3), 0.0)], RigAck(0x33, 5, 1)),
    ],
    ids=["stop", "where", "read imu"],
)
def test_only_its_own_answer_ends_a_command(
    frame: bytes, others: list[RigRecord | None], answer: RigAck | RigState
) -> None:
    exchange = CommandExchange(frame)
    exchange.begin()
    assert not any(map(exchange.heard, others))
    assert exchange.heard(answer)
    assert exchange.answer is answer
    assert exchange.outcome is CommandOutcome.ANSWERED
