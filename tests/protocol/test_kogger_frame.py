from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bluerov_slam.protocol.checksums import kogger_mod255, kogger_mod256
from bluerov_slam.protocol.kogger import (
    FrameType,
    KoggerFrame,
    KoggerFrameDecoder,
    KoggerId,
    build_frame,
    build_v2_frame,
    reroute,
)
from bluerov_slam.protocol.kogger_frame import FRAMES_TO_LEARN


def payload(size: int, seed: int = 0) -> bytes:
    return np.random.default_rng(seed).integers(0, 256, size, np.uint8).tobytes()


def chart(seed: int = 0) -> bytes:
    """A chart frame large enough that the two checksums cannot agree by chance."""
    return build_frame(KoggerId.CHART, bytes((0, 0, 20, 0, 0, 0)) + payload(200, seed))


def with_mod255(frame: bytes) -> bytes:
    return frame[:-2] + kogger_mod255(frame[2:-2])


def decoded(data: bytes) -> KoggerFrame:
    (frame,) = KoggerFrameDecoder("mod256").feed(data)
    return frame


@pytest.mark.parametrize("frame_type", list(FrameType))
@pytest.mark.parametrize("version", [0, 1, 2, 7])
@pytest.mark.parametrize("mark", [False, True])
@pytest.mark.parametrize("response", [False, True])
@pytest.mark.parametrize("build", [build_frame, build_v2_frame])
def test_every_mode_bit_survives_a_round_trip(
    build: Callable[..., bytes], frame_type: FrameType, version: int, mark: bool, response: bool
) -> None:
    data = build(0x15, b"\x01\x02", frame_type=frame_type, version=version, route=9, mark=mark, response=response)

    frame = decoded(data)

    assert (frame.route, frame.frame_id, frame.payload) == (9, 0x15, b"\x01\x02")
    assert (frame.frame_type, frame.version, frame.mark, frame.response) == (frame_type, version, mark, response)
    assert frame.raw == data


@pytest.mark.parametrize(
    ("mode", "options"),
    [
        (0x01, {}),
        (0x09, {"version": 1}),
        (0x39, {"version": 7}),
        (0x41, {"mark": True}),
        (0xC1, {"mark": True, "response": True}),
        (0x82, {"frame_type": FrameType.SETTING, "response": True}),
        (0x93, {"frame_type": FrameType.GETTING, "version": 2, "response": True}),
    ],
)
def test_mode_byte_values_of_the_reference(mode: int, options: dict[str, Any]) -> None:
    assert build_frame(3, **options)[3] == mode


@pytest.mark.parametrize("data", [chart(), build_frame(0x20), build_v2_frame(3, payload(300))])
def test_every_split_point_gives_the_same_frame(data: bytes) -> None:
    for split in range(len(data) + 1):
        decoder = KoggerFrameDecoder("mod256")
        assert [f.raw for f in decoder.feed(data[:split]) + decoder.feed(data[split:])] == [data]


def test_every_corrupted_byte_is_noticed_and_the_next_frame_is_kept() -> None:
    bad, good = build_frame(KoggerId.CHART, payload(40, 1)), build_frame(KoggerId.CHART, payload(40, 2))
    for position in range(len(bad)):
        damaged = bytearray(bad)
        damaged[position] ^= 0x10
        decoder = KoggerFrameDecoder("mod256")
        # Zeros let a candidate whose length grew come to its end.
        assert [f.raw for f in decoder.feed(bytes(damaged) + good + bytes(300))] == [good]


def test_bytes_wanted_counts_down_to_the_end_of_the_frame() -> None:
    decoder = KoggerFrameDecoder()
    data = chart()

    assert decoder.bytes_wanted == 0
    decoder.feed(data[:10])
    assert decoder.bytes_wanted == len(data) - 10
    decoder.feed(data[10:])
    assert decoder.bytes_wanted == 0


def test_flush_gives_up_the_open_frame_and_returns_those_inside_it() -> None:
    decoder = KoggerFrameDecoder("mod256")
    inner = build_frame(1, b"\x01\x02\x03\x04")
    assert decoder.feed(b"\xbb\x55\x00\x01\x03\xff" + inner) == []

    assert [frame.raw for frame in decoder.flush()] == [inner]
    assert [frame.raw for frame in decoder.feed(inner)] == [inner]


def test_counters_tell_what_was_lost() -> None:
    decoder = KoggerFrameDecoder("mod256")
    bad = bytearray(chart())
    bad[50] ^= 1

    decoder.feed(b"noise" + chart() + bytes(bad) + chart())

    counters = decoder.counters
    assert (counters.frames_ok, counters.checksum_errors, counters.resyncs) == (2, 1, 2)
    assert counters.bytes_skipped == len(b"noise") + len(bad)
    assert counters.frames_by_type == {KoggerId.CHART: 2}


def test_strict_never_accepts_the_other_checksum() -> None:
    decoder = KoggerFrameDecoder("mod256")

    assert [f for seed in range(30) for f in decoder.feed(with_mod255(chart(seed)))] == []
    assert decoder.checksum_in_use == "mod256"
    assert (decoder.other_checksum_frames, decoder.checksum_switches) == (30, 0)


def test_mod255_setting_takes_the_seeds_form_from_the_first_frame_and_only_that() -> None:
    decoder = KoggerFrameDecoder("mod255")

    assert len(decoder.feed(with_mod255(chart(1)) + chart(2) + with_mod255(chart(3)))) == 2
    assert decoder.checksum_in_use == "mod255"


def test_auto_learns_mod255_after_ten_frames_in_a_row() -> None:
    decoder = KoggerFrameDecoder()

    before = [f for seed in range(FRAMES_TO_LEARN) for f in decoder.feed(with_mod255(chart(seed)))]

    assert FRAMES_TO_LEARN == 10
    assert before == []
    assert (decoder.checksum_in_use, decoder.checksum_switches) == ("mod255", 1)
    assert len(decoder.feed(with_mod255(chart(50)))) == 1
    assert decoder.counters.checksum_errors == 10


def test_auto_does_not_learn_from_nine_with_a_good_frame_between() -> None:
    decoder = KoggerFrameDecoder()
    for _ in range(5):
        for seed in range(9):
            decoder.feed(with_mod255(chart(seed)))
        assert len(decoder.feed(chart())) == 1

    assert (decoder.checksum_in_use, decoder.checksum_switches) == ("mod256", 0)


def test_auto_does_not_learn_from_damaged_frames() -> None:
    decoder = KoggerFrameDecoder()
    damaged = bytearray(chart())
    damaged[100] ^= 0x40

    for _ in range(50):
        decoder.feed(bytes(damaged))

    assert decoder.checksum_in_use == "mod256"


def test_auto_finds_its_way_back_when_the_sender_is_corrected() -> None:
    decoder = KoggerFrameDecoder()
    for seed in range(10):
        decoder.feed(with_mod255(chart(seed)))
    for seed in range(10):
        decoder.feed(chart(seed))

    assert (decoder.checksum_in_use, decoder.checksum_switches) == ("mod256", 2)
    assert len(decoder.feed(chart())) == 1


@pytest.mark.parametrize("route", [0, 1, 2, 15, 255])
@pytest.mark.parametrize("size", [0, 1, 6, 206, 255])
def test_a_new_route_gets_the_checks_of_a_frame_built_with_it(route: int, size: int) -> None:
    data = build_frame(KoggerId.CHART, payload(size), route=3, mark=True)

    expected = build_frame(KoggerId.CHART, payload(size), route=route, mark=True)

    assert reroute(data, route) == expected
    assert decoded(data).to_bytes(route=route) == expected


def test_what_leaves_is_mod256_even_where_mod255_came_in() -> None:
    data = chart()
    (frame,) = KoggerFrameDecoder("mod255").feed(with_mod255(data))

    assert frame.raw == with_mod255(data)
    assert frame.to_bytes() == data
    assert frame.to_bytes(route=2) == reroute(data, 2)


def test_unchanged_frames_leave_as_they_came_reserved_bit_included() -> None:
    body = bytes((5, 0x05, 0x12, 1, 0xAA))
    data = b"\xbb\x55" + body + kogger_mod256(body)

    assert decoded(data).to_bytes() == data


def test_v2_frames_leave_as_bb55_where_they_fit() -> None:
    small, large = payload(255, 1), payload(300, 2)

    assert decoded(build_v2_frame(3, small, route=2)).to_bytes() == build_frame(3, small, route=2)
    assert decoded(build_v2_frame(3, large, route=2)).to_bytes(route=1) == build_v2_frame(3, large, route=1)
    assert decoded(build_v2_frame(0x123, b"x", route=2)).to_bytes() == build_v2_frame(0x123, b"x", route=2)


def v2(options: bytes, content: bytes) -> bytes:
    body = (7 + len(options) + len(content)).to_bytes(2, "little") + bytes((len(options) + 1,)) + options + content
    return b"\xcc\x55" + body + kogger_mod256(body)


def test_frames_inside_a_proxy_frame_come_out_by_themselves() -> None:
    first, second = build_frame(1, b"\x01\x02\x03\x04"), build_v2_frame(2, b"\x05")
    proxy = v2(b"\x01\x00", first + b"\x00" + second + b"\xbb\x55")

    decoder = KoggerFrameDecoder("mod256")

    assert [frame.raw for frame in decoder.feed(proxy + first)] == [first, second, first]


def test_proxies_within_proxies_come_to_an_end() -> None:
    data = build_frame(1, b"\x01\x02\x03\x04")
    for _ in range(3):
        data = v2(b"\x01\x00", data)
    too_deep = v2(b"\x01\x00", data)

    assert len(KoggerFrameDecoder("mod256").feed(data)) == 1
    assert KoggerFrameDecoder("mod256").feed(too_deep) == []


@pytest.mark.parametrize(
    "data",
    [v2(b"", b""), v2(b"", b"\x01\x18"), b"\xcc\x55\x0a\x00\x00" + bytes(5), b"\xcc\x55\x08\x00\x09" + bytes(20)],
    ids=["no content", "content of 2", "option length 0", "options longer than the frame"],
)
def test_v2_frames_that_say_nothing_give_nothing_and_cost_nothing(data: bytes) -> None:
    good = build_frame(1, b"\x01\x02\x03\x04")

    assert [frame.raw for frame in KoggerFrameDecoder("mod256").feed(data + good)] == [good]
