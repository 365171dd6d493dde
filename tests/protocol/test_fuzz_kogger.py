import os
import random
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from bluerov_slam.protocol.checksums import kogger_mod256
from bluerov_slam.protocol.kogger import KoggerFrame, KoggerFrameDecoder, build_frame, build_v2_frame
from bluerov_slam.protocol.kogger_bundle import Bundle, UnknownLayout, expand
from bluerov_slam.protocol.ping_assembly import MAX_PING_BYTES, PingAssembler
from bluerov_slam.records import Channel, Ping

FUZZ_BYTES = int(os.environ.get("BLUEROV_SLAM_FUZZ_BYTES", "300000"))
STREAM_BYTES = 50_000
STREAMS = max(1, FUZZ_BYTES // STREAM_BYTES)
LARGEST_FRAME = 384


@dataclass
class Stream:
    """Random, damaged and whole frames in one row; where the whole ones lie."""

    data: bytearray = field(default_factory=bytearray)
    planted: list[tuple[int, int]] = field(default_factory=list)

    def plant(self, frame: bytes) -> None:
        self.planted.append((len(self.data), len(self.data) + len(frame)))
        self.data += frame


def random_frame(rng: random.Random) -> bytes:
    """Mostly charts of a running ping, some of them with offsets out of their mind."""
    kind = rng.random()
    options = {
        "version": rng.choice((0, 0, 0, 1, 2, 7)),
        "mark": rng.random() < 0.5,
        "route": rng.choice((0, 0, 1, 2, 77)),
    }
    if kind < 0.7:
        seq_offset = rng.choice((0, 50, 100, 150, 200, rng.randrange(65_536)))
        header = b"".join(value.to_bytes(2, "little") for value in (seq_offset, rng.choice((20, 20, 10, 0)), 0))
        return build_frame(3, header + rng.randbytes(rng.choice((0, 1, 49, 50, 50, 50))), **options)  # type: ignore[arg-type]
    if kind < 0.8:
        return build_v2_frame(rng.randrange(200), rng.randbytes(rng.randrange(370)), route=1)
    return build_frame(
        rng.randrange(256), rng.randbytes(rng.randrange(256)), frame_type=rng.randrange(4), response=rng.random() < 0.2
    )


def damaged(frame: bytes, rng: random.Random) -> bytes:
    data = bytearray(frame)
    for _ in range(rng.randrange(1, 4)):
        position = rng.randrange(len(data))
        how = rng.randrange(5)
        if how == 0:
            data[position] ^= 1 << rng.randrange(8)
        elif how == 1:
            del data[position : position + rng.randrange(1, 20)]
        elif how == 2:
            data[position:position] = rng.randbytes(rng.randrange(1, 8))
        elif how == 3:
            data[position:position] = rng.choice((b"\xbb\x55", b"\xcc\x55", b"\xbb", b"\x55"))
        elif len(data) > 5:
            data[5] = rng.randrange(256)
        if not data:
            break
    return bytes(data)


def random_stream(rng: random.Random) -> Stream:
    stream = Stream()
    while len(stream.data) < STREAM_BYTES:
        what = rng.random()
        if what < 0.5:
            stream.plant(random_frame(rng))
        elif what < 0.8:
            stream.data += damaged(random_frame(rng), rng)
        elif what < 0.95:
            stream.data += rng.randbytes(rng.randrange(1, 60))
        else:
            stream.data += bytes(rng.choices((0xBB, 0x55, 0xCC, 0x00, 0x01), k=rng.randrange(1, 60)))
    return stream


def blocks(data: bytes, rng: random.Random) -> Iterator[bytes]:
    position = 0
    while position < len(data):
        size = rng.choice((1, 2, 7, 64, 500, 4096))
        yield data[position : position + size]
        position += size


def plainly_scanned(data: bytes) -> list[tuple[int, int]]:
    """The spans of all frames by the rule itself: try every place in turn, go on behind a frame that passes."""
    spans: list[tuple[int, int]] = []
    start = 0
    while start < len(data):
        end = start + plain_size(data, start)
        if start < end <= len(data) and kogger_mod256(data[start + 2 : end - 2]) == data[end - 2 : end]:
            spans.append((start, end))
            start = end
        else:
            start += 1
    return spans


def plain_size(data: bytes, start: int) -> int:
    """0 where no frame can begin."""
    header = data[start : start + 6]
    if len(header) < 6 or header[:2] not in (b"\xbb\x55", b"\xcc\x55"):
        return 0
    if header[0] == 0xBB:
        return header[5] + 8
    total, options = header[2] + 256 * header[3], header[4] - 1
    return total if 0 <= options <= total - 7 and total <= LARGEST_FRAME else 0


@pytest.mark.parametrize("seed", range(STREAMS))
def test_damaged_streams_lose_no_frame_that_the_rule_does_not_lose(seed: int) -> None:
    rng = random.Random(seed)
    stream = random_stream(rng)
    data = bytes(stream.data)
    decoder = KoggerFrameDecoder("mod256")
    frames: list[KoggerFrame] = []
    framed_bytes = 0

    for block in blocks(data, rng):
        new = decoder.feed(block)
        frames += new
        framed_bytes += sum(len(frame.raw) for frame in new)
        counters = decoder.counters
        held = counters.bytes_received - counters.bytes_skipped - framed_bytes
        assert 0 <= held <= LARGEST_FRAME
        assert 0 <= decoder.bytes_wanted <= LARGEST_FRAME
    frames += decoder.flush()

    spans = plainly_scanned(data)
    assert [frame.raw for frame in frames] == [data[start:end] for start, end in spans]
    found = set(spans)
    for start, end in stream.planted:
        assert (start, end) in found or any(s < end and start < e for s, e in spans), "a whole frame was lost"
    # Each place is tried once: the work grows with the bytes and with nothing else.
    places = data.count(b"\xbb\x55") + data.count(b"\xcc\x55")
    assert decoder.counters.checksum_errors + decoder.counters.length_errors + len(frames) <= places


@pytest.mark.parametrize("seed", range(STREAMS))
def test_assembler_stays_within_bounds_whatever_comes(seed: int) -> None:
    rng = random.Random(seed)
    decoder = KoggerFrameDecoder("auto")
    assembler = PingAssembler(Channel.A, expected_samples=rng.choice((None, 150, 200, 30_000)))
    pings: list[Ping] = []
    now_s = 0.0
    for block in blocks(bytes(random_stream(rng).data), rng):
        now_s += rng.choice((0.0, 0.001, 0.05, 3.0, -1.0))
        for frame in decoder.feed(block):
            pings += assembler.feed(frame, now_s, now_s, last_of_ping=rng.random() < 0.1)
        if rng.random() < 0.1:
            pings += assembler.flush(now_s)
        assert len(assembler.pending) <= 8
    pings += assembler.finish()

    assert pings
    assert assembler.counters.pings == pings[-1].number
    for ping in pings:
        assert 0 < ping.samples.size < MAX_PING_BYTES
        edges = [edge for gap in ping.gaps for edge in gap]
        assert edges == sorted(edges)
        assert all(start < end for start, end in ping.gaps)
        assert all(edge <= ping.samples.size for edge in edges)
        assert not any(ping.samples[start:end].any() for start, end in ping.gaps)


@pytest.mark.parametrize(
    "pattern", [b"\xbb\x55", b"\xcc\x55", b"\xbb\x55\x00\x01\x03\xff", b"\xcc\x55\x80\x01\x01", b"\xbb"]
)
def test_syncs_without_end_are_searched_in_linear_work_and_constant_memory(pattern: bytes) -> None:
    data = pattern * (FUZZ_BYTES // 10 // len(pattern))
    decoder = KoggerFrameDecoder("mod256")

    frames = decoder.feed(data)

    counters = decoder.counters
    assert counters.checksum_errors + counters.length_errors + len(frames) <= len(data) // 2
    held = counters.bytes_received - counters.bytes_skipped - sum(len(frame.raw) for frame in frames)
    assert held <= LARGEST_FRAME


@pytest.mark.parametrize("seed", range(STREAMS))
def test_expand_takes_any_payload(seed: int) -> None:
    rng = random.Random(seed)
    for _ in range(100):
        header = bytes((rng.randrange(3), rng.randrange(256), rng.randrange(10), rng.randrange(6), 0, 0, 0, 0, 0))
        chunks = b"".join(
            rng.choice((b"\x00\x00", b"\x05\x00", b"\xc8\x00"))
            + b"\x14\x00\x00\x00\x05"
            + rng.randbytes(rng.randrange(4))
            for _ in range(rng.randrange(5))
        )
        outcome = expand(header + chunks)
        assert isinstance(outcome, Bundle | UnknownLayout)
        if isinstance(outcome, Bundle):
            assert len(outcome.frames) == len(outcome.chunks) == header[3]
