import json
import os
import random
import tracemalloc
from dataclasses import dataclass, field
from pathlib import Path

from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.esp32_messages import MAX_PAYLOAD_BYTES, Esp32FrameDecoder, encode_frame
from bluerov_slam.protocol.kogger_bundle import compress_ping
from bluerov_slam.protocol.ping_assembly import MAX_PING_BYTES, ChartChunk
from bluerov_slam.records import Channel, Ping, SonarFrames

FUZZ_BYTES = int(os.environ.get("BLUEROV_SLAM_FUZZ_BYTES", "300000"))
STREAM_BYTES = 50_000
STREAMS = max(1, FUZZ_BYTES // STREAM_BYTES)
LARGEST_FRAME = MAX_PAYLOAD_BYTES + 6
RETAINED_LIMIT_BYTES = 3_000_000

GOLDEN = [
    bytes.fromhex(message["frame"])
    for message in json.loads((Path(__file__).parents[1] / "vectors" / "esp32.json").read_text())["messages"]
]

# Payload lengths as the protocol page gives them, written down once more: minimum, maximum, step.
LENGTHS = {
    0x01: (76, 76, 1),
    0x02: (12, 4096, 1),
    0x03: (12, 4096, 1),
    0x04: (1, 4096, 1),
    0x05: (28, 10 + 64 * 18, 18),
    0x06: (62, 126, 1),
    0x07: (3, 3, 1),
    0x08: (16, 100, 6),
    0x09: (22, 512, 1),
    0x0A: (6, 261, 1),
    0x0B: (32, 32, 1),
    0x20: (9, 264, 1),
    0x21: (9, 264, 1),
    0x22: (6, 41, 5),
    0x23: (9, 9, 1),
}


@dataclass
class Stream:
    """Random, damaged and whole frames in one row; where the whole ones lie."""

    data: bytearray = field(default_factory=bytearray)
    planted: list[tuple[int, int]] = field(default_factory=list)

    def plant(self, frame: bytes) -> None:
        self.planted.append((len(self.data), len(self.data) + len(frame)))
        self.data += frame


def random_frame(rng: random.Random) -> bytes:
    """A frame that passes its check: golden, golden with damaged content, a ping's, or random of any type."""
    kind = rng.random()
    if kind < 0.3:
        return rng.choice(GOLDEN)
    if kind < 0.6:
        frame = rng.choice(GOLDEN)
        payload = bytearray(frame[5:-1])
        for _ in range(rng.randrange(1, 4)):
            payload[rng.randrange(len(payload))] = rng.randrange(256)
        return encode_frame(frame[2], bytes(payload))
    if kind < 0.8:
        chunks = [ChartChunk(200 * k, 20, 0, rng.randbytes(200)) for k in range(3)]
        payloads = compress_ping(
            rng.choice(list(Channel)), chunks, ping_number=rng.randrange(256), t_us=rng.randrange(2**32)
        )
        return encode_frame(0x04, rng.choice(payloads))
    frame_type = rng.choice((*LENGTHS, rng.randrange(256)))
    low, high, step = LENGTHS.get(frame_type, (0, 300, 1))
    return encode_frame(frame_type, rng.randbytes(rng.randrange(low, min(high, 300) + 1, step)))


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
            data[position:position] = rng.choice((b"\xaa\x55", b"\xaa", b"\x55", b"\xaa\x55\x04\x00"))
        elif len(data) > 4:
            data[3:5] = rng.randrange(5000).to_bytes(2, "big")
        if not data:
            break
    return bytes(data)


def random_stream(rng: random.Random) -> Stream:
    stream = Stream()
    while len(stream.data) < STREAM_BYTES:
        what = rng.random()
        if what < 0.5:
            stream.plant(random_frame(rng))
        elif what < 0.75:
            stream.data += damaged(random_frame(rng), rng)
        elif what < 0.95:
            stream.data += rng.randbytes(rng.randrange(1, 60))
        else:
            stream.data += rng.choice((b"\xaa\x55", b"\xaa\x55\xff\x0f\xff")) * rng.randrange(1, 20)
    return stream


def blocks(data: bytes, rng: random.Random) -> list[bytes]:
    """The stream as reads of a port would cut it, some of them single bytes."""
    cut, at = [], 0
    while at < len(data):
        size = rng.choice((1, 1, 7, 64, 512, 4096))
        cut.append(data[at : at + size])
        at += size
    return cut


def valid_spans(data: bytes) -> list[tuple[int, int]]:
    """Every span that passes every check, overlapping or not; plain bytes and loops."""
    spans = []
    at = data.find(b"\xaa\x55")
    while at >= 0:
        header = data[at + 2 : at + 5]
        if len(header) == 3:
            length = header[1] << 8 | header[2]
            low, high, step = LENGTHS.get(header[0], (0, 4096, 1))
            frame = data[at : at + length + 6]
            if low <= length <= high and (length - low) % step == 0 and len(frame) == length + 6:
                check = 0
                for byte in frame[2:-1]:
                    check ^= byte
                if check == frame[-1]:
                    spans.append((at, at + len(frame)))
        at = data.find(b"\xaa\x55", at + 1)
    return spans


def without_overlaps(spans: list[tuple[int, int]]) -> list[tuple[int, int]]:
    chosen: list[tuple[int, int]] = []
    for span in spans:
        if not chosen or span[0] >= chosen[-1][1]:
            chosen.append(span)
    return chosen


def test_no_valid_frame_is_lost_outside_another_valid_span() -> None:
    for seed in range(STREAMS):
        rng = random.Random(f"frames {seed}")
        stream = random_stream(rng)
        data = bytes(stream.data)
        decoder = Esp32FrameDecoder()
        found = []
        for block in blocks(data, rng):
            found += decoder.feed(block)
            assert 0 <= decoder.bytes_wanted <= LARGEST_FRAME
        found += decoder.flush()
        spans = valid_spans(data)
        chosen = without_overlaps(spans)
        assert found == [(data[start + 2], data[start + 5 : end - 1]) for start, end in chosen]
        lost = set(stream.planted) - set(chosen)
        assert lost <= set(spans)
        assert all(any(a < end and start < b for a, b in chosen) for start, end in lost)
        counters = decoder.counters
        assert counters.bytes_received == len(data)
        assert counters.bytes_skipped == len(data) - sum(end - start for start, end in chosen)


def test_the_link_decoder_takes_anything_and_stays_small() -> None:
    tracemalloc.start()
    try:
        decoder = LinkDecoder()
        now_s, after_first = 0.0, 0
        for seed in range(STREAMS):
            rng = random.Random(f"link {seed}")
            for block in blocks(bytes(random_stream(rng).data), rng):
                now_s += len(block) / 11_520 + (0.2 if rng.random() < 0.01 else 0.0)
                for record in decoder.feed(block, now_s):
                    if isinstance(record, Ping):
                        assert 0 < len(record.samples) < MAX_PING_BYTES
                    elif isinstance(record, SonarFrames):
                        assert all(frame[:2] in (b"\xbb\x55", b"\xcc\x55") for frame in record.frames)
            after_first = after_first or tracemalloc.get_traced_memory()[0]
        decoder.finish()
        assert tracemalloc.get_traced_memory()[0] - after_first < RETAINED_LIMIT_BYTES
    finally:
        tracemalloc.stop()
    counters = decoder.counters
    assert counters.link.bytes_received >= STREAMS * STREAM_BYTES
    assert all(sonar.pings for sonar in counters.sonars.values())
    assert counters.unknown_layouts
    assert counters.unknown_types
