"""How fast the link is decoded: from bytes to records and whole pings, on one core, against the byte-wise reference.

Time is the processor time of this process, so that other programs do not count.
"""

from __future__ import annotations

import json
import random
import time

import numpy as np

from bench.bytewise_reference import BytewiseLinkParser
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.esp32_messages import ImuBurstFields, ImuScale, MessageType, encode_frame, pack_imu_burst
from bluerov_slam.protocol.kogger_bundle import compress_ping
from bluerov_slam.protocol.ping_assembly import ChartChunk
from bluerov_slam.protocol.sensor_frame import SENSORS_BYTES
from bluerov_slam.records import Channel, Ping, SonarFrames

LINK_BYTES_PER_S = 11_520
PING_SAMPLES = 1000
CHUNK_SAMPLES = 200
READ_BYTES = 512
SECONDS = 20
ROUNDS = 5


def link_second(second: int, random_source: random.Random) -> bytes:
    """One second of a full 115200-baud link: 2 SENSORS, 10 bursts of 2 IMU samples, the rest pings of A and B."""
    t_us = second * 1_000_000
    fixed = [encode_frame(MessageType.SENSORS, _sensors(second * 1000 + 500 * k, random_source)) for k in range(2)]
    fixed += [encode_frame(MessageType.IMU_BURST, _imu(t_us + 100_000 * k, random_source)) for k in range(10)]
    room = LINK_BYTES_PER_S - sum(map(len, fixed))
    pings: list[bytes] = []
    size = len(b"".join(_ping(0, t_us, random_source)))
    count = room // size
    for number in range(count):
        pings += _ping(second * count + number, t_us + number * 1_000_000 // count, random_source)
    step = max(1, len(pings) // len(fixed))
    for index, frame in enumerate(fixed):
        pings.insert(min(len(pings), index * (step + 1)), frame)
    return b"".join(pings)


def _sensors(device_ms: int, random_source: random.Random) -> bytes:
    payload = bytearray(random_source.randbytes(SENSORS_BYTES))
    payload[0:4] = device_ms.to_bytes(4, "little")
    payload[40:47] = b"\x01" + (420_000).to_bytes(3, "little") + (160_000).to_bytes(3, "little")
    for flag in (22, 34, 39, 51, 54):
        payload[flag] = 1
    payload[52:54] = (1500).to_bytes(2, "little")
    return bytes(payload)


def _imu(t_us: int, random_source: random.Random) -> bytes:
    samples = np.frombuffer(random_source.randbytes(36), "<i2").reshape(2, 9)
    return pack_imu_burst(ImuBurstFields(t_us, 50_000, ImuScale.HWT905_RAW, samples))


def _ping(number: int, t_us: int, random_source: random.Random) -> list[bytes]:
    samples = random_source.randbytes(PING_SAMPLES)
    chunks = [ChartChunk(at, 20, 0, samples[at : at + CHUNK_SAMPLES]) for at in range(0, PING_SAMPLES, CHUNK_SAMPLES)]
    channel = (Channel.A, Channel.B)[number % 2]
    payloads = compress_ping(channel, chunks, ping_number=number // 2, t_us=t_us)
    return [encode_frame(MessageType.KOGGER_COMPRESSED, payload) for payload in payloads]


def link_blocks(seconds: int) -> list[tuple[bytes, float]]:
    """(data, arrived_s) as a reader of the port would give them."""
    stream = b"".join(link_second(second, random.Random(second)) for second in range(seconds))
    return [
        (stream[at : at + READ_BYTES], (at + READ_BYTES) / LINK_BYTES_PER_S) for at in range(0, len(stream), READ_BYTES)
    ]


def _decode(blocks: list[tuple[bytes, float]]) -> tuple[float, int, int]:
    """Seconds needed, pings and BB55 frames found."""
    decoder = LinkDecoder()
    pings = frames = 0
    start = time.process_time()
    for data, arrived_s in blocks:
        for record in decoder.feed(data, arrived_s):
            if isinstance(record, Ping):
                pings += 1
            elif isinstance(record, SonarFrames):
                frames += len(record.frames)
    return time.process_time() - start, pings, frames


def _decode_bytewise(blocks: list[tuple[bytes, float]], *, reparse: bool = True) -> tuple[float, int, int]:
    parser = BytewiseLinkParser(reparse=reparse)
    start = time.process_time()
    for data, _ in blocks:
        parser.feed(data)
    elapsed_s = time.process_time() - start
    return elapsed_s, sum(len(sonar.pings) for sonar in parser.sonars), parser.frames


def rows() -> list[dict[str, object]]:
    """decode_realtime_ratio and decode_vs_bytewise. Best of several rounds: other programs only ever slow it down."""
    blocks = link_blocks(SECONDS)
    link_s = sum(len(data) for data, _ in blocks) / LINK_BYTES_PER_S
    # In turns, so that whatever else the machine does slows both down.
    runs = [(_decode(blocks), _decode_bytewise(blocks)) for _ in range(ROUNDS)]
    fast, plain = [run[0] for run in runs], [run[1] for run in runs]
    if fast[0][1:] != plain[0][1:]:
        raise AssertionError(f"the decoders disagree: {fast[0][1:]} against {plain[0][1:]} pings and frames")
    fast_s, plain_s = min(run[0] for run in fast), min(run[0] for run in plain)
    lean_s = min(_decode_bytewise(blocks, reparse=False)[0] for _ in range(ROUNDS))
    return [
        _row("decode_realtime_ratio", "Decoding, times real time", link_s / fast_s, 200,
             f"byte-wise parser {link_s / plain_s:.0f} x"),
        _row("decode_vs_bytewise", "Decoding, times a byte-wise parser of the original's two stages",
             plain_s / fast_s, 5, f"{lean_s / fast_s:.1f} x one that trusts the frames it rebuilt"),
    ]  # fmt: skip


def _row(row_id: str, name: str, value: float, least: float, reference: str) -> dict[str, object]:
    return {
        "id": row_id,
        "name": name,
        "value": round(value, 1),
        "unit": "x",
        "must": f">= {least:g}",
        "met": value >= least,
        "reference": reference,
    }


if __name__ == "__main__":
    for row in rows():
        print(json.dumps(row))
