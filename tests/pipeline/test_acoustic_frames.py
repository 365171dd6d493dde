"""Datagrams of acoustic boards to records."""

import random

import numpy as np
import pytest

from acoustic_board import AcousticBoard
from bluerov_slam.pipeline.acoustic_frames import FORGOTTEN_AFTER_S, MOST_SOURCES, AcousticInput
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import AcousticMessage, AcousticRecord, TimeDifferenceReading

SOURCE = (20.0, 5.0, 8.0)
COUNTS = np.random.default_rng(2).integers(-800, 800, (4, 2048)).astype(np.int16)


def test_each_sender_has_a_clock_of_its_own() -> None:
    boards = AcousticInput()
    one, other = AcousticBoard(t_us=5_000_000), AcousticBoard(t_us=4_000_000_000)
    for k in range(20):
        for name, board in (("10.0.0.1:5", one), ("10.0.0.2:5", other)):
            [reading] = boards.feed(board.pulse(SOURCE), name, 100.0 + k)
            assert isinstance(reading, TimeDifferenceReading)
            assert reading.measured_s == pytest.approx(100.0 + k, abs=1e-3)
    assert boards.sources == ("10.0.0.1:5", "10.0.0.2:5")


def test_frames_of_one_datagram_and_records_over_many() -> None:
    boards, board = AcousticInput(), AcousticBoard()
    assert [type(r) for r in boards.feed(board.pulse(SOURCE) + board.message(b"hi"), "a:1", 1.0)] == [
        TimeDifferenceReading,
        AcousticMessage,
    ]
    records = [r for frame in board.record(COUNTS, 851_393.0, 9) for r in boards.feed(frame, "a:1", 1.1)]
    [record] = records
    assert isinstance(record, AcousticRecord)
    np.testing.assert_array_equal(record.samples, COUNTS)
    assert boards.records_counters().records == 1


def test_lost_datagrams_are_holes_and_the_silence_ends_the_record() -> None:
    boards, board = AcousticInput(), AcousticBoard()
    frames = board.record(COUNTS, 851_393.0, 9)
    for number, frame in enumerate(frames):
        if number not in (4, 5):
            assert boards.feed(frame, "a:1", 1.0 + 0.001 * number) == []
    assert boards.flush(1.5) == []
    [record] = boards.flush(2.5)
    assert isinstance(record, AcousticRecord)
    assert record.holes == ((4 * 61, 6 * 61),)


def test_only_acoustic_frames_pass() -> None:
    boards = AcousticInput()
    for kind in MessageType:
        if kind not in (MessageType.ACOUSTIC_TDOA, MessageType.ACOUSTIC_RECORD, MessageType.ACOUSTIC_MESSAGE):
            length = {0x01: 76, 0x02: 12, 0x03: 12, 0x05: 28, 0x06: 62, 0x07: 3, 0x0B: 32, 0x22: 6, 0x23: 9}.get(
                kind, 9
            )
            assert boards.feed(encode_frame(kind, bytes(length)), "a:1", 1.0) == []
    assert boards.counters.refused.total() == len(MessageType) - 3
    assert boards.counters.frames.total() == 0


def test_a_frame_cut_off_by_its_datagram_is_not_finished_by_the_next() -> None:
    boards, board = AcousticInput(), AcousticBoard()
    frame = board.pulse(SOURCE)
    assert boards.feed(frame[:20], "a:1", 1.0) == []
    assert boards.feed(frame[20:], "a:1", 1.0) == []
    assert len(boards.feed(board.pulse(SOURCE), "a:1", 2.0)) == 1


def test_more_senders_than_boards_are_kept_out_until_one_has_left() -> None:
    boards, board = AcousticInput(), AcousticBoard()
    for k in range(MOST_SOURCES):
        assert boards.feed(board.pulse(SOURCE), f"a:{k}", 1.0)
    assert boards.feed(board.pulse(SOURCE), "new:1", 2.0) == []
    assert boards.counters.crowded_out == 1
    assert len(boards.feed(board.pulse(SOURCE), "new:1", 2.0 + FORGOTTEN_AFTER_S)) == 1
    assert "a:0" not in boards.sources


def test_anything_is_taken_and_memory_stays_small() -> None:
    boards, board, rng = AcousticInput(), AcousticBoard(), random.Random(3)
    chunks = board.record(COUNTS, 851_393.0, 9)
    for k in range(3000):
        data = bytearray(rng.choice((board.pulse(SOURCE), board.message(b"x"), rng.choice(chunks))))
        for _ in range(rng.randrange(4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        boards.feed(bytes(data), f"a:{rng.randrange(6)}", 0.01 * k)
    counters = boards.counters
    assert counters.frames.total() > 500
    assert counters.checksum_errors > 100
    assert len(boards.sources) <= MOST_SOURCES
