import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.errors import BugError
from bluerov_slam.protocol.acoustic_messages import (
    MessageFields,
    RecordChunk,
    TdoaFields,
    pack_message,
    pack_record_chunk,
    pack_tdoa,
    record_chunks,
    tdoa_fields,
    time_difference_reading,
    unpack_message,
    unpack_record_chunk,
    unpack_tdoa,
)
from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType
from bluerov_slam.records import AcousticRecord

U32 = st.integers(0, 2**32 - 1)
I32 = st.integers(-(2**31), 2**31 - 1)
U16 = st.integers(0, 0xFFFF)


def record(receivers: int = 4, samples: int = 2048) -> AcousticRecord:
    counts = np.random.default_rng(7).integers(-2048, 2048, (receivers, samples)).astype(np.int16)
    return AcousticRecord(1.0, 2.0, 77, 851_393.0, counts, 12, 128)


MESSAGES = json.loads((Path(__file__).parents[1] / "vectors" / "esp32.json").read_text())["messages"]


def golden(kind: MessageType) -> list[tuple[dict[str, Any], bytes]]:
    """Fields and payload of each golden frame of a kind; the firmware's tests read the same frames."""
    found = []
    for message in MESSAGES:
        if message["type"] == kind:
            [(frame_type, payload)] = Esp32FrameDecoder().feed(bytes.fromhex(message["frame"]))
            assert frame_type == kind
            found.append((message["fields"], payload))
    assert len(found) == 2
    return found


def test_golden_time_differences() -> None:
    for expected, payload in golden(MessageType.ACOUSTIC_TDOA):
        fields = TdoaFields(**{key: tuple(v) if isinstance(v, list) else v for key, v in expected.items()})
        assert unpack_tdoa(payload) == fields
        assert pack_tdoa(fields) == payload


def test_golden_record_chunks() -> None:
    for expected, payload in golden(MessageType.ACOUSTIC_RECORD):
        chunk = unpack_record_chunk(payload)
        assert chunk is not None
        for key, value in expected.items():
            np.testing.assert_array_equal(getattr(chunk, key), value)
        assert pack_record_chunk(chunk) == payload


def test_golden_messages() -> None:
    for expected, payload in golden(MessageType.ACOUSTIC_MESSAGE):
        fields = MessageFields(expected["t_us"], expected["corrected_errors"], bytes.fromhex(expected["payload"]))
        assert unpack_message(payload) == fields
        assert pack_message(fields) == payload


def test_tdoa_bytes_as_documented() -> None:
    payload = bytes.fromhex("01020304 04 00 10270000 f0d8ffff 00000080 6400 0500 ffff 0000 c53c")
    fields = TdoaFields(0x04030201, 0, (10_000, -10_000, -(2**31)), (100, 5, 65535, 0), 0b11110011000101)
    assert unpack_tdoa(payload) == fields
    assert pack_tdoa(fields) == payload
    reading = time_difference_reading(fields, 3.0, 4.0)
    np.testing.assert_array_equal(reading.delays_s, [10e-6, -10e-6, math.nan])
    np.testing.assert_array_equal(reading.signal_std_counts, [100, 5, 65535, 0])
    assert (reading.measured_s, reading.arrived_s, reading.frame_bits) == (3.0, 4.0, 0b11110011000101)


@given(t_us=U32, reference=st.integers(0, 4), delays=st.lists(I32, min_size=4, max_size=4), data=st.data())
def test_tdoa_there_and_back(t_us: int, reference: int, delays: list[int], data: st.DataObject) -> None:
    std = tuple(data.draw(st.lists(U16, min_size=5, max_size=5)))
    bits = data.draw(st.one_of(st.just(0xFFFF), st.integers(0, 0x3FFF)))
    fields = TdoaFields(t_us, reference, tuple(delays), std, bits)
    assert unpack_tdoa(pack_tdoa(fields)) == fields
    reading = time_difference_reading(fields, 0.0, 0.0)
    again = tdoa_fields(t_us, reading.reference, reading.delays_s, reading.signal_std_counts, reading.frame_bits)
    assert again == fields


def test_what_does_not_fit_saturates_and_what_was_not_measured_stays_unmeasured() -> None:
    fields = tdoa_fields(2**32 + 5, 1, np.array([3.0, -3.0, math.nan]), np.array([1e6, -4.0, 1.5, 2.4]), None)
    assert fields == TdoaFields(5, 1, (2**31 - 1, -(2**31) + 1, -(2**31)), (0xFFFF, 0, 2, 2), 0xFFFF)


@pytest.mark.parametrize(
    "change",
    [
        {4: 1},  # one receiver: no difference
        {4: 17},
        {4: 5},  # more receivers than bytes
        {5: 4},  # the reference is none of them
        {27: 0x40},  # 15 frame bits
    ],
)
def test_tdoa_that_does_not_add_up(change: dict[int, int]) -> None:
    payload = bytearray(pack_tdoa(TdoaFields(1, 0, (1, 2, 3), (1, 2, 3, 4), 0)))
    assert unpack_tdoa(bytes(payload)) is not None
    for at, value in change.items():
        payload[at] = value
    assert unpack_tdoa(bytes(payload)) is None


def test_record_chunk_bytes_as_documented() -> None:
    payload = bytes.fromhex("2a000000 00000100 d1fd0c00 02 0c 0200 3d00 8000 0100 ffff 0080 ff7f")
    chunk = unpack_record_chunk(payload)
    assert chunk is not None
    assert (chunk.record_id, chunk.t_us, chunk.sample_rate_hz, chunk.bits) == (42, 65536, 851_409, 12)
    assert (chunk.first_sample, chunk.trigger_index) == (61, 128)
    np.testing.assert_array_equal(chunk.samples, [[1, -1], [-32768, 32767]])
    assert pack_record_chunk(chunk) == payload


@pytest.mark.parametrize(
    ("receivers", "bits", "rate_hz", "first", "count"),
    [(0, 12, 1, 0, 0), (17, 12, 1, 0, 1), (2, 0, 1, 0, 1), (2, 17, 1, 0, 1), (2, 12, 0, 0, 1), (3, 12, 1, 43690, 2)],
)
def test_record_chunks_that_do_not_add_up(receivers: int, bits: int, rate_hz: int, first: int, count: int) -> None:
    samples = np.zeros((count, receivers), np.int16)
    assert unpack_record_chunk(pack_record_chunk(RecordChunk(1, 2, rate_hz, bits, first, 0, samples))) is None


def test_a_chunk_with_a_wrong_count_is_refused() -> None:
    payload = pack_record_chunk(RecordChunk(1, 2, 3, 12, 0, 0, np.zeros((5, 4), np.int16)))
    assert unpack_record_chunk(payload) is not None
    assert unpack_record_chunk(payload[:-1]) is None
    assert unpack_record_chunk(payload + b"\0\0") is None


@pytest.mark.parametrize(("receivers", "samples"), [(1, 1), (4, 2048), (5, 2000), (16, 8192)])
def test_a_record_is_cut_into_chunks_that_fit(receivers: int, samples: int) -> None:
    whole = record(receivers, samples)
    chunks = list(record_chunks(whole, 5))
    assert max(len(pack_record_chunk(chunk)) for chunk in chunks) <= 512
    np.testing.assert_array_equal(np.concatenate([chunk.samples for chunk in chunks]).T, whole.samples)
    assert [chunk.first_sample for chunk in chunks] == list(range(0, samples, len(chunks[0].samples)))


def test_a_record_beyond_the_wire_is_a_bug() -> None:
    with pytest.raises(BugError):
        list(record_chunks(record(1, 65537), 0))


def test_message_bytes_as_documented() -> None:
    payload = bytes.fromhex("10000000 02 05") + b"hello"
    assert unpack_message(payload) == MessageFields(16, 2, b"hello")
    assert pack_message(MessageFields(16, 2, b"hello")) == payload


@pytest.mark.parametrize("payload", [bytes(6), b"\0\0\0\0\0\2a", b"\0\0\0\0\0\1ab", bytes(5)])
def test_messages_that_do_not_add_up(payload: bytes) -> None:
    assert unpack_message(payload) is None


def test_an_empty_message_cannot_be_sent() -> None:
    for said in (b"", bytes(256)):
        with pytest.raises(BugError):
            pack_message(MessageFields(0, 0, said))


@given(st.binary(max_size=120))
def test_any_payload_is_taken_or_refused(payload: bytes) -> None:
    tdoa, chunk, message = unpack_tdoa(payload), unpack_record_chunk(payload), unpack_message(payload)
    assert tdoa is None or pack_tdoa(tdoa) == payload
    assert chunk is None or pack_record_chunk(chunk) == payload
    assert message is None or pack_message(message) == payload
