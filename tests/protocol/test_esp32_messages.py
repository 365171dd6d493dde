import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bluerov_slam.errors import BugError
from bluerov_slam.protocol.esp32_messages import (
    MAX_PAYLOAD_BYTES,
    CommandAckFields,
    ConfigKey,
    Esp32FrameDecoder,
    GpsFields,
    ImuBurstFields,
    KoggerRawFields,
    MessageType,
    StatusFields,
    config_allowed,
    encode_config,
    encode_frame,
    encode_kogger_command,
    encode_time_sync,
    pack_command_ack,
    pack_gps,
    pack_imu_burst,
    pack_kogger_raw,
    pack_status,
    unpack_command_ack,
    unpack_config,
    unpack_gps,
    unpack_imu_burst,
    unpack_kogger_command,
    unpack_kogger_raw,
    unpack_status,
    unpack_time_sync,
)
from bluerov_slam.records import AckResult, Channel

VECTORS = json.loads((Path(__file__).parents[1] / "vectors" / "esp32.json").read_text())
MESSAGES = {message["name"]: message for message in VECTORS["messages"]}


def names(*types: int) -> list[str]:
    return [name for name, message in MESSAGES.items() if message["type"] in types]


def decode(stream: bytes) -> list[tuple[int, bytes]]:
    return Esp32FrameDecoder().feed(stream)


def payload_of(name: str) -> bytes:
    [(frame_type, payload)] = decode(bytes.fromhex(MESSAGES[name]["frame"]))
    assert frame_type == MESSAGES[name]["type"]
    return payload


@pytest.mark.parametrize("name", MESSAGES)
def test_golden_frames_are_found_and_rebuilt(name: str) -> None:
    frame = bytes.fromhex(MESSAGES[name]["frame"])
    [(frame_type, payload)] = decode(frame)
    assert encode_frame(frame_type, payload) == frame


@pytest.mark.parametrize("stream", VECTORS["streams"], ids=lambda stream: stream["name"])
@pytest.mark.parametrize("block", [1, 7, 100_000])
def test_golden_streams(stream: dict[str, Any], block: int) -> None:
    data = bytes.fromhex(stream["stream"])
    decoder = Esp32FrameDecoder()
    frames = [frame for at in range(0, len(data), block) for frame in decoder.feed(data[at : at + block])]
    frames += decoder.flush()
    assert [frame_type for frame_type, _ in frames] == stream["types"]
    counters = dataclasses.asdict(decoder.counters)
    for name in ("checksum_errors", "length_errors", "bytes_skipped", "resyncs"):
        if name in stream:
            assert counters[name] == stream[name]


@pytest.mark.parametrize("name", names(MessageType.KOGGER_RAW_A, MessageType.KOGGER_RAW_B))
def test_kogger_raw(name: str) -> None:
    expected, payload = MESSAGES[name]["fields"], payload_of(name)
    fields = unpack_kogger_raw(payload)
    assert fields == KoggerRawFields(expected["t_us"], bytes.fromhex(expected["frames"]))
    assert pack_kogger_raw(fields) == payload


def test_imu_burst() -> None:
    expected, payload = MESSAGES["imu_burst"]["fields"], payload_of("imu_burst")
    fields = unpack_imu_burst(payload)
    assert fields is not None
    assert (fields.t0_us, fields.dt_us, fields.scale) == (expected["t0_us"], expected["dt_us"], expected["scale"])
    np.testing.assert_array_equal(fields.samples, expected["samples"])
    assert pack_imu_burst(fields) == payload


@pytest.mark.parametrize("name", names(MessageType.STATUS))
def test_status(name: str) -> None:
    fields = StatusFields(**MESSAGES[name]["fields"])
    payload = payload_of(name)
    assert len(payload) == 62
    assert unpack_status(payload) == fields
    assert pack_status(fields) == payload


def test_status_of_a_later_layout_is_read_as_far_as_known() -> None:
    payload = b"\x02" + payload_of("status")[1:] + b"new fields"
    [(_, received)] = decode(encode_frame(MessageType.STATUS, payload))
    fields = unpack_status(received)
    assert fields is not None
    assert (fields.layout_version, fields.boot_count) == (2, 7)


@pytest.mark.parametrize("name", names(MessageType.COMMAND_ACK))
def test_command_ack(name: str) -> None:
    fields = CommandAckFields(**MESSAGES[name]["fields"])
    assert unpack_command_ack(payload_of(name)) == fields
    assert pack_command_ack(fields) == payload_of(name)


@pytest.mark.parametrize("name", names(MessageType.GPS))
def test_gps(name: str) -> None:
    fields = GpsFields(**MESSAGES[name]["fields"])
    assert unpack_gps(payload_of(name)) == fields
    assert pack_gps(fields) == payload_of(name)


@pytest.mark.parametrize("name", names(MessageType.KOGGER_COMMAND_A, MessageType.KOGGER_COMMAND_B))
def test_kogger_command(name: str) -> None:
    message = MESSAGES[name]
    expected = message["fields"]
    fields = unpack_kogger_command(message["type"], payload_of(name))
    assert fields is not None
    assert (fields.channel, fields.sequence, fields.frame.hex()) == tuple(expected.values())
    assert encode_kogger_command(Channel(fields.channel), fields.sequence, fields.frame).hex() == message["frame"]


def test_config() -> None:
    message = MESSAGES["config"]
    fields = unpack_config(payload_of("config"))
    assert fields is not None
    assert (fields.sequence, [list(pair) for pair in fields.pairs]) == (9, message["fields"]["pairs"])
    values = {ConfigKey.SENSORS_RATE_MHZ: 5000, ConfigKey.DECIMATION: 8}
    assert encode_config(9, values).hex() == message["frame"]


def test_time_sync() -> None:
    message = MESSAGES["time_sync"]
    fields = unpack_time_sync(payload_of("time_sync"))
    assert fields is not None
    assert dataclasses.asdict(fields) == message["fields"]
    assert encode_time_sync(fields.sequence, fields.host_us).hex() == message["frame"]


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        (ConfigKey.SENSORS_RATE_MHZ, 499, False),
        (ConfigKey.SENSORS_RATE_MHZ, 500, True),
        (ConfigKey.SENSORS_RATE_MHZ, 20_000, True),
        (ConfigKey.SENSORS_RATE_MHZ, 20_001, False),
        (ConfigKey.IMU_RATE_MHZ, 999, False),
        (ConfigKey.IMU_RATE_MHZ, 1000, True),
        (ConfigKey.DECIMATION, 0, False),
        (ConfigKey.DECIMATION, 1, True),
        (ConfigKey.DECIMATION, 8, True),
        (ConfigKey.DECIMATION, 9, False),
        (ConfigKey.BAUD, 115_200, True),
        (ConfigKey.BAUD, 921_600, True),
        (ConfigKey.BAUD, 9600, False),
        (0, 1, False),
        (5, 1, False),
    ],
)
def test_config_ranges(key: int, value: int, allowed: bool) -> None:
    assert config_allowed(key, value) is allowed


@pytest.mark.parametrize(
    ("unpack", "payload"),
    [
        (unpack_kogger_raw, b"\1\2\3"),
        (unpack_imu_burst, bytes(10)),
        (unpack_imu_burst, bytes(8) + b"\x02\x01" + bytes(18)),
        (unpack_status, bytes(61)),
        (unpack_status, bytes(62)),
        (unpack_command_ack, b"\x20\1\5"),
        (unpack_command_ack, b"\x20\1"),
        (unpack_gps, bytes(31)),
        (unpack_config, b"\1"),
        (unpack_config, bytes(7)),
        (unpack_time_sync, bytes(8)),
    ],
)
def test_content_that_does_not_add_up_gives_none(unpack: Any, payload: bytes) -> None:
    assert unpack(payload) is None


def test_a_short_kogger_command_gives_none() -> None:
    assert unpack_kogger_command(MessageType.KOGGER_COMMAND_A, bytes(8)) is None


@pytest.mark.parametrize(
    ("frame_type", "possible", "impossible"),
    [
        (0x01, [76], [0, 75, 77]),
        (0x02, [12, 4096], [11]),
        (0x04, [1, 4096], [0]),
        (0x05, [28, 46, 10 + 64 * 18], [10, 27, 29, 10 + 65 * 18]),
        (0x06, [62, 126], [61, 127]),
        (0x07, [3], [2, 4]),
        (0x08, [16, 22, 100], [10, 17, 106]),
        (0x09, [22, 512], [21, 513]),
        (0x0A, [6, 261], [5, 262]),
        (0x0B, [32], [31, 33]),
        (0x20, [9, 264], [8, 265]),
        (0x21, [9, 264], [8, 265]),
        (0x22, [6, 11, 41], [1, 7, 46]),
        (0x23, [9], [8, 10]),
        (0x99, [0, 4096], []),
    ],
)
def test_lengths_a_type_can_have(frame_type: int, possible: list[int], impossible: list[int]) -> None:
    for length in possible:
        assert decode(encode_frame(frame_type, bytes(length))) == [(frame_type, bytes(length))]
    for length in impossible:
        decoder = Esp32FrameDecoder()
        assert decoder.feed(encode_frame(frame_type, bytes(length))) == []
        assert decoder.counters.length_errors == 1


def test_a_length_above_4096_is_impossible() -> None:
    decoder = Esp32FrameDecoder()
    assert decoder.feed(b"\xaa\x55\x99\x10\x01") == []
    assert decoder.counters.length_errors == 1
    with pytest.raises(BugError, match="4097"):
        encode_frame(0x99, bytes(MAX_PAYLOAD_BYTES + 1))


@pytest.mark.parametrize("name", MESSAGES)
def test_every_damaged_byte_is_noticed(name: str) -> None:
    frame = bytes.fromhex(MESSAGES[name]["frame"])
    for at in range(len(frame)):
        for flip in (0x01, 0x80, 0xFF):
            damaged = frame[:at] + bytes((frame[at] ^ flip,)) + frame[at + 1 :]
            assert (damaged[2], damaged[5:-1]) not in decode(damaged)
            found = decode(damaged + frame + bytes(4200))
            # What follows comes through, unless a damaged length makes a longer span that passes the check as well.
            assert (frame[2], frame[5:-1]) in found or any(frame in encode_frame(*other) for other in found)


@settings(max_examples=50)
@given(st.lists(st.sampled_from(sorted(MESSAGES)), min_size=1, max_size=6), st.data())
def test_every_split_gives_the_same_frames(chosen: list[str], data: st.DataObject) -> None:
    stream = b"".join(bytes.fromhex(MESSAGES[name]["frame"]) for name in chosen)
    whole = decode(stream)
    assert len(whole) == len(chosen)
    cut = data.draw(st.integers(0, len(stream)))
    decoder = Esp32FrameDecoder()
    assert decoder.feed(stream[:cut]) + decoder.feed(stream[cut:]) == whole


i16 = st.integers(-32768, 32767)


@given(
    st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.lists(st.lists(i16, min_size=9, max_size=9), min_size=1)
)
def test_imu_burst_round_trip(t0_us: int, dt_us: int, samples: list[list[int]]) -> None:
    sent = ImuBurstFields(t0_us, dt_us, 1, np.array(samples, np.int16))
    received = unpack_imu_burst(pack_imu_burst(sent))
    assert received is not None
    assert (received.t0_us, received.dt_us, received.scale) == (t0_us, dt_us, 1)
    np.testing.assert_array_equal(received.samples, sent.samples)


def test_ack_results_are_those_of_the_wire() -> None:
    assert [result.name for result in AckResult] == ["OK", "BAD_INNER_CHECKSUM", "UNKNOWN", "REJECTED", "BUSY"]
