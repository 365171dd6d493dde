"""The acoustic frames through the link decoder."""

from typing import Any

import numpy as np

from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.acoustic_messages import (
    MessageFields,
    TdoaFields,
    pack_message,
    pack_record_chunk,
    pack_tdoa,
    record_chunks,
)
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import AcousticMessage, AcousticRecord, Record, TimeDifferenceReading

COUNTS = np.random.default_rng(1).integers(-2000, 2000, (4, 2048)).astype(np.int16)


def tdoa(t_us: int) -> bytes:
    return encode_frame(MessageType.ACOUSTIC_TDOA, pack_tdoa(TdoaFields(t_us, 0, (1, 2, 3), (9, 8, 7, 6), 5)))


def record_frames(t_us: int, record_id: int = 1) -> list[bytes]:
    record = AcousticRecord(0.0, 0.0, record_id, 851_393.0, COUNTS, 12, 128)
    chunks = record_chunks(record, t_us)
    return [encode_frame(MessageType.ACOUSTIC_RECORD, pack_record_chunk(chunk)) for chunk in chunks]


def message(t_us: int, said: bytes = b"hello") -> bytes:
    return encode_frame(MessageType.ACOUSTIC_MESSAGE, pack_message(MessageFields(t_us, 1, said)))


def only(records: list[Record], kind: type) -> list[Any]:
    return [record for record in records if isinstance(record, kind)]


def test_each_type_becomes_its_record() -> None:
    decoder = LinkDecoder()
    records = decoder.feed(tdoa(5_000_000) + b"".join(record_frames(5_000_000)) + message(5_000_000), 100.0)
    assert [type(record) for record in records] == [TimeDifferenceReading, AcousticRecord, AcousticMessage]
    assert all(record.measured_s == 100.0 for record in records)  # type: ignore[union-attr]
    [record] = only(records, AcousticRecord)
    np.testing.assert_array_equal(record.samples, COUNTS)
    assert only(records, AcousticMessage)[0].payload == b"hello"
    assert decoder.counters.acoustic_records.records == 1


def test_bad_content_is_counted() -> None:
    decoder = LinkDecoder()
    bad = encode_frame(0x08, bytes(16)) + encode_frame(0x09, bytes(30)) + encode_frame(0x0A, bytes(7))
    assert decoder.feed(bad, 1.0) == []
    assert decoder.counters.malformed == {0x08: 1, 0x09: 1, 0x0A: 1}


def test_a_record_that_waited_keeps_its_time_and_resets_no_clock() -> None:
    decoder = LinkDecoder()
    for k in range(100):
        [reading] = decoder.feed(tdoa(1_000_000 * (10 + k)), 500.0 + k)
        assert reading.measured_s == 500.0 + k  # type: ignore[union-attr]
        if k in (40, 90):  # 16 kB that waited 8 s for room on the link
            late = [*record_frames(1_000_000 * (2 + k), k), message(1_000_000 * k)]
            records = decoder.feed(b"".join(late), 500.5 + k)
            assert [record.measured_s for record in records] == [492.0 + k, 490.0 + k]  # type: ignore[union-attr]
    assert decoder.counters.device_resets == 0


def test_a_board_that_sends_records_alone_may_start_again() -> None:
    decoder = LinkDecoder()
    for k in range(30):
        [record] = decoder.feed(b"".join(record_frames(1_000_000 * (20 + k), k)), 100.0 + k)
        assert record.measured_s == 100.0 + k  # type: ignore[union-attr]
    times_s = []
    for k in range(4):
        [record] = decoder.feed(b"".join(record_frames(1_000_000 * (1 + k), k)), 140.0 + k)
        times_s.append(record.measured_s)  # type: ignore[union-attr]
    assert times_s == [140.0, 141.0, 142.0, 143.0]
    assert decoder.counters.device_resets == 1


def test_flushing_in_between_changes_nothing() -> None:
    frames = record_frames(1_000_000)
    blocks = [(frame, 10.0 + 0.01 * k) for k, frame in enumerate(frames[:-3])] + [(tdoa(4_000_000), 13.0)]
    plain, flushed = LinkDecoder(), LinkDecoder()
    expected = [record for data, at_s in blocks for record in plain.feed(data, at_s)]
    got = []
    for data, at_s in blocks:
        got += flushed.flush(at_s - 0.001)
        got += flushed.feed(data, at_s)
    assert [(type(r), r.measured_s, r.arrived_s) for r in got] == [  # type: ignore[union-attr]
        (type(r), r.measured_s, r.arrived_s)  # type: ignore[union-attr]
        for r in expected
    ]
    np.testing.assert_array_equal(only(got, AcousticRecord)[0].samples, only(expected, AcousticRecord)[0].samples)
    assert only(got, AcousticRecord)[0].missing_samples == 0  # nobody knows yet that more should have come
