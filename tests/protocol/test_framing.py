import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.protocol.framing import FrameFormat, FrameScanner

# A small protocol with the same shape as the real ones: AA 55, length of the payload (at most 60), payload, sum.
LIMIT = 60


def total_bytes(buffer: bytes, start: int) -> int | None:
    return buffer[start + 2] + 4 if buffer[start + 2] <= LIMIT else None


def is_intact(frame: bytes) -> bool:
    return sum(frame[2:-1]) & 0xFF == frame[-1]


FORMAT = FrameFormat((b"\xaa\x55",), 3, 2, total_bytes, is_intact)
TWO_SYNCS = FrameFormat((b"\xbb\x55", b"\xcc\x55"), 3, 2, total_bytes, is_intact)


def frame(payload: bytes, sync: bytes = b"\xaa\x55") -> bytes:
    body = bytes((len(payload),)) + payload
    return sync + body + bytes((sum(body) & 0xFF,))


def scan(blocks: list[bytes], frame_format: FrameFormat = FORMAT) -> tuple[list[bytes], FrameScanner]:
    scanner = FrameScanner(frame_format)
    frames = [found for block in blocks for found in scanner.feed(block)]
    return frames, scanner


A, B, C = frame(b"one"), frame(b""), frame(bytes(range(50)))


@pytest.mark.parametrize("cut", range(len(A + B + C) + 1))
def test_finds_frames_whatever_the_cut(cut: int) -> None:
    stream = A + B + C
    assert scan([stream[:cut], stream[cut:]])[0] == [A, B, C]


def test_counts_are_those_of_the_stream() -> None:
    frames, scanner = scan([b"noise" + A + b"\xaa\x55\xff" + B + B])
    assert frames == [A, B, B]
    counters = scanner.counters
    assert counters.bytes_received == 5 + len(A) + 3 + 2 * len(B)
    assert counters.bytes_skipped == 8
    assert counters.frames_ok == 3
    assert counters.frames_by_type == {3: 1, 0: 2}
    assert counters.length_errors == 1
    assert counters.checksum_errors == 0
    assert counters.resyncs == 2


def test_resumes_one_byte_behind_a_failed_sync() -> None:
    false_header = b"\xaa\x55" + bytes((len(A) + 4,))
    frames, scanner = scan([false_header + A + b"12345"])
    assert frames == [A]
    assert scanner.counters.checksum_errors == 1


def test_a_repeated_sync_byte_hides_nothing() -> None:
    assert scan([b"\xaa" + A + b"\xaa\xaa" + B])[0] == [A, B]


def test_bytes_wanted_follows_the_open_frame() -> None:
    scanner = FrameScanner(FORMAT)
    assert scanner.bytes_wanted == 0
    scanner.feed(b"junk\xaa")
    assert scanner.bytes_wanted == 2
    scanner.feed(b"\x55")
    assert scanner.bytes_wanted == 1
    scanner.feed(b"\x03")
    assert scanner.bytes_wanted == 4
    scanner.feed(b"o")
    assert scanner.bytes_wanted == 3
    scanner.feed(A[4:])
    assert scanner.bytes_wanted == 0


def test_flush_gives_what_an_incomplete_frame_swallowed() -> None:
    scanner = FrameScanner(FORMAT)
    assert scanner.feed(b"\xaa\x55\x3c\xaa\x55\x3b" + A + B + b"\xaa") == []
    assert scanner.flush() == [A, B]
    assert scanner.bytes_wanted == 0
    assert scanner.counters.bytes_skipped == 7


def test_two_syncs_are_found_in_one_stream() -> None:
    first, second = frame(b"x", b"\xbb\x55"), frame(b"y", b"\xcc\x55")
    stream = b"\xbb" + first + b"\xcc\xcc" + second + first
    for cut in range(len(stream)):
        assert scan([stream[:cut], stream[cut:]], TWO_SYNCS)[0] == [first, second, first]


# Streams dense in syncs, headers and whole frames: where resynchronisation goes wrong if it can.
pieces = st.one_of(
    st.binary(max_size=8),
    st.sampled_from([b"\xaa", b"\x55", b"\xaa\x55", b"\xaa\x55\x3c", b"\xaa\x55\x05", A, B, C, A[:-1], C[:20]]),
    st.binary(max_size=LIMIT).map(frame),
)


@given(st.lists(pieces, max_size=12).map(b"".join), st.data())
def test_the_result_does_not_depend_on_the_blocks(stream: bytes, data: st.DataObject) -> None:
    whole, reference = scan([stream])
    bytewise, one_by_one = scan([stream[k : k + 1] for k in range(len(stream))])
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    edges = [0, *cuts, len(stream)]
    blocks, in_blocks = scan([stream[a:b] for a, b in itertools.pairwise(edges)])
    assert whole == bytewise == blocks
    assert reference.counters == one_by_one.counters == in_blocks.counters
    assert reference.bytes_wanted == one_by_one.bytes_wanted == in_blocks.bytes_wanted
    assert reference.flush() == one_by_one.flush()


@given(st.lists(pieces, max_size=12).map(b"".join))
def test_finds_exactly_what_a_plain_search_finds(stream: bytes) -> None:
    frames, scanner = scan([stream])
    frames += scanner.flush()
    expected, position = [], 0
    while position < len(stream):
        candidate = stream[position : position + 4 + (stream[position + 2] if position + 2 < len(stream) else 0)]
        if (
            candidate[:2] == b"\xaa\x55"
            and len(candidate) >= 4
            and candidate[2] <= LIMIT
            and len(candidate) == candidate[2] + 4
            and is_intact(candidate)
        ):
            expected.append(candidate)
            position += len(candidate)
        else:
            position += 1
    assert frames == expected
    assert scanner.counters.bytes_skipped + sum(map(len, frames)) == len(stream)
