"""The C++ codecs of the firmware give, block by block, what Python's decoders and packer give for the same bytes."""

import random
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bluerov_slam.protocol import kogger_coded
from bluerov_slam.protocol.checksums import kogger_mod255
from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType, encode_frame
from bluerov_slam.protocol.kogger_bundle import BundlePacker, Coding
from bluerov_slam.protocol.kogger_frame import ChecksumChoice, KoggerFrameDecoder, build_frame, build_v2_frame
from bluerov_slam.protocol.ping_assembly import ChartChunk
from bluerov_slam.records import Channel
from firmware_build import built

NEW_STREAM = struct.pack("<I", 0xFFFFFFFF)
MAX_BLOCK_BYTES = 256
AA55_LENGTHS = {
    MessageType.SENSORS: (76,),
    MessageType.KOGGER_RAW_A: (12, 220, 4096),
    MessageType.KOGGER_COMPRESSED: (1, 224, 512),
    MessageType.IMU_BURST: (28, 46, 1162),
    MessageType.STATUS: (62, 100),
    MessageType.COMMAND_ACK: (3,),
    MessageType.ACOUSTIC_TDOA: (16, 22),
    MessageType.GPS: (32,),
    MessageType.KOGGER_COMMAND_A: (9, 264),
    MessageType.CONFIG: (6, 41),
    MessageType.TIME_SYNC: (9,),
    0x7E: (0, 1, 4096),
}

pytestmark = pytest.mark.timeout(300)


class Filter:
    """One `codec_filter` process; it answers every message with lines up to `end`."""

    def __init__(self, program: Path, codec: str, end: str) -> None:
        self._end = end
        self._process = subprocess.Popen([program, codec], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def new_stream(self) -> None:
        assert self._process.stdin
        self._process.stdin.write(NEW_STREAM)

    def answer(self, message: bytes) -> list[str]:
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.write(struct.pack("<I", len(message)) + message)
        self._process.stdin.flush()
        lines: list[str] = []
        while not lines or not lines[-1].startswith(self._end):
            line = self._process.stdout.readline()
            assert line, f"codec_filter ended: {self._process.wait()}"
            lines.append(line.decode().rstrip("\n"))
        return lines

    def close(self) -> None:
        self._process.communicate()
        assert self._process.returncode == 0


def running(codec: str, end: str) -> Iterator[Filter]:
    program = Filter(built("codec_filter"), codec, end)
    yield program
    program.close()


@pytest.fixture(scope="module")
def aa55() -> Iterator[Filter]:
    yield from running("aa55", "fed")


@pytest.fixture(scope="module")
def bb55() -> Iterator[Filter]:
    yield from running("bb55", "fed")


@pytest.fixture(scope="module")
def bb55_auto() -> Iterator[Filter]:
    yield from running("bb55-auto", "fed")


@pytest.fixture(scope="module")
def packer() -> Iterator[Filter]:
    yield from running("bundle", "packed")


@pytest.fixture(scope="module")
def decoder() -> Iterator[Filter]:
    yield from running("coded", "")


class Aa55Reference:
    """What `codec_filter aa55` has to answer."""

    def __init__(self) -> None:
        self._decoder = Esp32FrameDecoder()

    def answer(self, block: bytes) -> list[str]:
        lines = [f"{frame_type:d} {payload.hex()}" for frame_type, payload in self._decoder.feed(block)]
        c = self._decoder.counters
        return [*lines, f"fed {c.frames_ok} {c.checksum_errors} {c.length_errors} {c.bytes_skipped}"]


class Bb55Reference:
    """What `codec_filter bb55` and `bb55-auto` have to answer. Frames refused by `auto` may not repeat."""

    def __init__(self, checksum: ChecksumChoice) -> None:
        self.decoder = KoggerFrameDecoder(checksum, bb55_only=True)
        self._stream = b""
        self._offset = 0  # of _stream in the whole stream; nothing before it can begin a frame

    def answer(self, block: bytes) -> list[str]:
        self._stream += block
        lines = []
        for frame in self.decoder.feed(block):
            start = self._stream.index(frame.raw)
            lines.append(f"{len(self._stream) - start - 1} {frame.raw.hex()}")
            self._stream = self._stream[start + len(frame.raw) :]
        counters = self.decoder.counters
        idle = not self.decoder.bytes_wanted
        return [*lines, f"fed {counters.frames_ok} {counters.checksum_errors} {idle:d}"]


def assert_same(program: Filter, reference: Aa55Reference | Bb55Reference, blocks: list[bytes]) -> None:
    program.new_stream()
    for number, block in enumerate(blocks):
        actual, expected = program.answer(block), reference.answer(block)
        assert actual == expected, f"block {number} of {len(blocks)}"


def cut(stream: bytes, rng: random.Random, longest: int = MAX_BLOCK_BYTES) -> list[bytes]:
    blocks, at = [], 0
    while at < len(stream):
        size = rng.randint(1, rng.choice((3, 100, longest)))
        blocks.append(stream[at : at + min(size, longest)])
        at += min(size, longest)
    return blocks


def aa55_frame(rng: random.Random, payload: bytes | None = None) -> bytes:
    if payload is not None:
        return encode_frame(0x7E, payload)
    kind = rng.choice(list(AA55_LENGTHS))
    return encode_frame(kind, rng.randbytes(rng.choice(AA55_LENGTHS[kind])))


def aa55_piece(rng: random.Random) -> bytes:
    """Something that a stream may hold: good, damaged, cut off, or a header of anything."""
    frame = aa55_frame(rng)
    match rng.randrange(10):
        case 0:
            return rng.randbytes(rng.randrange(400))
        case 1:
            return frame[: rng.randrange(len(frame))]
        case 2:
            return damaged(frame, rng)
        case 3:
            return b"\xaa\x55" + bytes((rng.randrange(256), rng.randrange(17), rng.randrange(256)))
        case 4:
            return rng.choice((b"\xaa", b"\x55", b"\xaa\xaa", b"\xaa\x55"))
        case 5:
            return aa55_frame(rng, frame[:2000] + aa55_frame(rng)[:2000])
        case _:
            return frame


def bb55_frame(rng: random.Random, payload: bytes | None = None) -> bytes:
    payload = rng.randbytes(rng.choice((0, 1, 6, 20, 206, 255))) if payload is None else payload
    route, mode, frame_id = rng.randbytes(3)
    return build_frame(
        frame_id, payload[:255], frame_type=mode & 3, version=mode >> 3 & 7, route=route, mark=bool(mode & 0x40)
    )


def bb55_piece(rng: random.Random) -> bytes:
    frame = bb55_frame(rng)
    match rng.randrange(12):
        case 0:
            return rng.randbytes(rng.randrange(400))
        case 1:
            return frame[: rng.randrange(len(frame))]
        case 2:
            return damaged(frame, rng)
        case 3:
            return b"\xbb\x55" + rng.randbytes(4)
        case 4:
            return rng.choice((b"\xbb", b"\x55", b"\xbb\xbb", b"\xbb\x55", b"\xcc\x55"))
        case 5:
            return bb55_frame(rng, frame[:120] + bb55_frame(rng)[:120])
        case 6:
            return build_v2_frame(3, frame[:300])
        case 7:
            return b"".join(textbook(bb55_frame(rng)) for _ in range(rng.randrange(25)))
        case _:
            return frame


def textbook(frame: bytes) -> bytes:
    return frame[:-2] + kogger_mod255(frame[2:-2])


def damaged(frame: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(frame))
    match rng.randrange(3):
        case 0:
            return frame[:at] + bytes((frame[at] ^ 1 << rng.randrange(8),)) + frame[at + 1 :]
        case 1:
            return frame[:at] + frame[at + 1 :]
        case _:
            return frame[:at] + rng.randbytes(1) + frame[at:]


@pytest.mark.parametrize("seed", range(3))
def test_aa55_in_a_million_bytes(aa55: Filter, seed: int) -> None:
    rng = random.Random(seed)
    stream = bytearray()
    while len(stream) < 1_000_000:
        stream += aa55_piece(rng)
    assert_same(aa55, Aa55Reference(), cut(bytes(stream), rng))


@pytest.mark.parametrize("seed", range(3))
def test_bb55_in_a_million_bytes(bb55: Filter, bb55_auto: Filter, seed: int) -> None:
    rng = random.Random(seed)
    stream = bytearray()
    while len(stream) < 1_000_000:
        stream += bb55_piece(rng)
    blocks = cut(bytes(stream), rng)
    assert_same(bb55, Bb55Reference("mod256"), blocks)
    learning = Bb55Reference("auto")
    assert_same(bb55_auto, learning, blocks)
    assert learning.decoder.checksum_switches > 10


def test_aa55_in_pure_noise(aa55: Filter) -> None:
    rng = random.Random(4)
    dense = bytes(rng.choices(b"\xaa\x55\x00\x10\x03\x7e", k=200_000))
    assert_same(aa55, Aa55Reference(), cut(rng.randbytes(1_000_000) + dense, rng))


def test_bb55_in_pure_noise(bb55: Filter, bb55_auto: Filter) -> None:
    rng = random.Random(5)
    dense = bytes(rng.choices(b"\xbb\x55\x00\x01\x03\x14", k=200_000))
    blocks = cut(rng.randbytes(1_000_000) + dense, rng)
    assert_same(bb55, Bb55Reference("mod256"), blocks)
    assert_same(bb55_auto, Bb55Reference("auto"), blocks)


def test_aa55_refuses_the_same_lengths_at_once(aa55: Filter) -> None:
    lengths = [*range(560), *range(1140, 1185), *range(4090, 4100), 0xFFFF]
    for frame_type in (*range(0x0D), *range(0x1F, 0x26), 0xFF):
        for length in lengths:
            assert_same(aa55, Aa55Reference(), [b"\xaa\x55" + struct.pack(">BH", frame_type, length)])


def test_aa55_headers_that_all_claim_the_longest_frame(aa55: Filter) -> None:
    """Nothing but false starts, each of them 4102 bytes long: the buffer is always full."""
    stream = b"\xaa\x55\x7e\x10\x00" * 2500
    rng = random.Random(6)
    for longest in (1, 11, 255, 256):
        assert_same(aa55, Aa55Reference(), cut(stream, rng, longest))


def test_aa55_every_damaged_and_every_missing_byte(aa55: Filter) -> None:
    rng = random.Random(7)
    frames = [
        encode_frame(MessageType.CONFIG, rng.randbytes(11)),
        encode_frame(MessageType.TIME_SYNC, rng.randbytes(9)),
    ]
    stream = frames[0] + frames[1] + frames[0]
    for at in range(len(stream)):
        for change in (0x01, 0x80, 0xFF):
            hurt = stream[:at] + bytes((stream[at] ^ change,)) + stream[at + 1 :] + bytes(4200)
            assert_same(aa55, Aa55Reference(), cut(hurt, rng))
        assert_same(aa55, Aa55Reference(), cut(stream[:at] + stream[at + 1 :] + bytes(100), rng))
        assert_same(aa55, Aa55Reference(), cut(stream[:at], rng))


def test_bb55_every_damaged_and_every_missing_byte(bb55: Filter) -> None:
    rng = random.Random(8)
    stream = bb55_frame(rng, rng.randbytes(20)) + bb55_frame(rng, b"") + bb55_frame(rng, rng.randbytes(9))
    for at in range(len(stream)):
        for change in (0x01, 0x80, 0xFF):
            hurt = stream[:at] + bytes((stream[at] ^ change,)) + stream[at + 1 :] + bytes(300)
            assert_same(bb55, Bb55Reference("mod256"), cut(hurt, rng))
        assert_same(bb55, Bb55Reference("mod256"), cut(stream[:at] + stream[at + 1 :] + bytes(100), rng))
        assert_same(bb55, Bb55Reference("mod256"), cut(stream[:at], rng))


def streams(sync: int, frame: bytes) -> st.SearchStrategy[bytes]:
    head = bytes((sync, 0x55))
    pieces = st.one_of(
        st.binary(max_size=8),
        st.sampled_from(
            [head, head[:1], head[1:], head + b"\x07\x00\x03", head + b"\x00\x01\x03\x04", frame, frame[:-1]]
        ),
    )
    return st.lists(pieces, max_size=12).map(b"".join)


blocks_of = st.lists(st.integers(1, 20), min_size=1, max_size=8)
many = settings(max_examples=300, deadline=None)


def in_turn(stream: bytes, sizes: list[int]) -> list[bytes]:
    blocks = []
    while stream:
        size = sizes[len(blocks) % len(sizes)]
        blocks.append(stream[:size])
        stream = stream[size:]
    return blocks


@many
@given(stream=streams(0xAA, encode_frame(MessageType.COMMAND_ACK, b"\x20\x11\x00")), sizes=blocks_of)
def test_aa55_streams_dense_in_starts(aa55: Filter, stream: bytes, sizes: list[int]) -> None:
    assert_same(aa55, Aa55Reference(), in_turn(stream, sizes))


@many
@given(stream=streams(0xBB, build_frame(3, b"\x00\x00\x14\x00\x00\x00\xbb\x55")), sizes=blocks_of)
def test_bb55_streams_dense_in_starts(bb55: Filter, stream: bytes, sizes: list[int]) -> None:
    assert_same(bb55, Bb55Reference("mod256"), in_turn(stream, sizes))


def random_chunks(rng: random.Random) -> list[ChartChunk]:
    chunks, seq_offset = [], rng.choice((0, 0, 400, 19_000))
    sizes = rng.choice(((200,), (1, 2, 7, 15, 16, 17, 240, 248, 249), range(1, 250), range(250, 800)))
    for _ in range(rng.randint(1, 12)):
        samples = rng.randbytes(rng.choice(sizes))
        if rng.random() < 0.2:
            samples = bytes(rng.choices((0, 1, 254, 255), k=len(samples)))  # where rounding and overflow show
        elif rng.random() < 0.5:
            level = rng.choice((2, 20, 100, 200))  # as echoes are
            samples = bytes(min(255, int(level * rng.weibullvariate(1.0, 2.0))) for _ in samples)
        chunks.append(ChartChunk(seq_offset, rng.choice((1, 20, 65_535)), rng.choice((0, 50, 65_535)), samples))
        seq_offset += len(samples) + rng.choice((0, 0, 0, 100))
    return chunks


@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("coding", list(Coding))
@pytest.mark.parametrize("decimation", range(1, 9))
def test_bundles(packer: Filter, decimation: int, coding: Coding, version: int) -> None:
    rng = random.Random(decimation * 100 + coding * 10 + version)
    for number in range(100):
        channel, limit = rng.choice((Channel.A, Channel.B)), rng.choice((224, 512, 40, 61))
        t_us, mark, chunks = rng.randrange(2**32), rng.random() < 0.5, random_chunks(rng)
        reference = BundlePacker(channel, decimation=decimation, coding=coding, payload_limit=limit)
        reference.begin(number, t_us, version=version, mark=mark)
        payloads = [payload for chunk in chunks for payload in reference.add(chunk)] + reference.end()

        message = struct.pack("<6BIH", channel.index, decimation, coding, version, mark, number, t_us, limit)
        for chunk in chunks:
            header = chunk.seq_offset, chunk.resolution_mm, chunk.first_sample, len(chunk.samples)
            message += struct.pack("<4H", *header) + chunk.samples
        assert packer.answer(message) == [*(payload.hex() for payload in payloads), "packed"]


def assert_decoded_alike(decoder: Filter, code: bytes, count: int) -> bool:
    """Whether it is a code at all."""
    expected = kogger_coded.decode(code, count)
    assert decoder.answer(struct.pack("<H", count) + code) == ["none" if expected is None else expected.tobytes().hex()]
    return expected is not None


def test_codes_are_decoded_alike(decoder: Filter) -> None:
    rng = random.Random(1)
    codes = 0
    for _ in range(400):
        size, count = rng.randint(16, 503), rng.randint(1, 2000)
        if count > 8 * size - 15:
            continue
        spread = rng.choice((3, 60, 256))
        code = bytearray(kogger_coded.encode(bytes(rng.randrange(spread) for _ in range(count)), size))
        assert assert_decoded_alike(decoder, bytes(code), count)
        for _ in range(4):
            code[rng.randrange(size)] ^= 1 << rng.randrange(8)
            codes += assert_decoded_alike(decoder, bytes(code), count + rng.choice((0, 0, 0, 1, -1)))
    assert codes > 100


@given(st.binary(max_size=80), st.integers(0, 700))
def test_any_bytes_are_decoded_alike(decoder: Filter, code: bytes, count: int) -> None:
    assert_decoded_alike(decoder, code, count)
