"""A ping for the browser: the seed's JSON (200 bins) and the full-resolution binary form.

0  u8 'P' | u8 version 1 | u8 channel 0 A 1 B | u8 flags: bit 0 has gaps, 1 sub-channel 1, 2 simulated
4  u32 ping number | f64 unix seconds (NaN unknown) | f64 host monotonic seconds
24 u16 samples n | u16 first sample | u16 resolution mm | u8 decimation | u8 route
32 u16 gaps g | u16 0 | u32 0
40 g x (u16 start, u16 end) | n x u8
"""

from __future__ import annotations

import binascii
import struct
from dataclasses import dataclass
from math import nan

import numpy as np

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import Channel, Ping

SEED_BINS = 200
PING_VERSION = 1

_HEADER = struct.Struct("<4BI2d3H2B2HI")
_MAGIC = ord("P")
_HAS_GAPS = 1 << 0
_SUB_CHANNEL_1 = 1 << 1
_SIMULATED = 1 << 2
_CHANNELS = (Channel.A, Channel.B)


@dataclass(frozen=True, slots=True)
class BinaryPing:
    """What `unpack_ping` finds. The arrival time does not travel: the ping's `arrived_s` repeats `measured_s`."""

    ping: Ping
    time_unix_s: float | None
    simulated: bool


def seed_json(ping: Ping) -> dict[str, str | int]:
    """`ch`, `amp` (base64 of 200 bytes: the whole ping in equal bins, the maximum of each), `n`."""
    return {
        "ch": ping.channel.value,
        "amp": binascii.b2a_base64(_seed_bins(ping.samples), newline=False).decode("ascii"),
        "n": ping.number,
    }


def pack_ping(ping: Ping, time_unix_s: float | None, *, simulated: bool = False) -> bytes:
    """The binary form, little-endian."""
    flags = bool(ping.gaps) * _HAS_GAPS | (ping.sub_channel == 1) * _SUB_CHANNEL_1 | simulated * _SIMULATED
    header = _HEADER.pack(
        _MAGIC,
        PING_VERSION,
        ping.channel.index,
        flags,
        ping.number & 0xFFFFFFFF,
        nan if time_unix_s is None else time_unix_s,
        ping.measured_s,
        ping.samples.size,
        ping.first_sample,
        round(ping.resolution_m * 1000),
        ping.decimation,
        ping.route,
        len(ping.gaps),
        0,
        0,
    )
    gaps = struct.pack(f"<{2 * len(ping.gaps)}H", *(edge for gap in ping.gaps for edge in gap))
    return header + gaps + ping.samples.tobytes()


def unpack_ping(data: bytes) -> BinaryPing:
    """Undo `pack_ping`. Raises RecordingError where the bytes are no such ping."""
    if len(data) < _HEADER.size:
        raise RecordingError(f"binary ping of {len(data)} bytes, expected at least {_HEADER.size}")
    (magic, version, channel, flags, number, unix_s, monotonic_s, count, first_sample, resolution_mm, decimation, route,
     gap_count, _, _) = _HEADER.unpack_from(data)  # fmt: skip
    if magic != _MAGIC or version != PING_VERSION or channel > 1:
        raise RecordingError(f"not a binary ping of version {PING_VERSION}: begins {data[:4].hex(' ')}")
    samples_start = _HEADER.size + 4 * gap_count
    if len(data) != samples_start + count:
        raise RecordingError(f"binary ping of {len(data)} bytes, its header says {samples_start + count}")
    edges = struct.unpack_from(f"<{2 * gap_count}H", data, _HEADER.size)
    ping = Ping(
        channel=_CHANNELS[channel],
        sub_channel=1 if flags & _SUB_CHANNEL_1 else 0,
        route=route,
        number=number,
        measured_s=monotonic_s,
        arrived_s=monotonic_s,
        resolution_m=resolution_mm / 1000,
        first_sample=first_sample,
        samples=np.frombuffer(data, np.uint8, count, samples_start),
        gaps=tuple(zip(edges[::2], edges[1::2], strict=True)),
        decimation=decimation,
    )
    return BinaryPing(ping, None if unix_s != unix_s else unix_s, bool(flags & _SIMULATED))


def _seed_bins(samples: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> bytes:
    count = samples.size
    if count == 0:
        return bytes(SEED_BINS)
    if count < SEED_BINS:
        nearest = (2 * np.arange(SEED_BINS) + 1) * count // (2 * SEED_BINS)
        return samples[nearest].tobytes()
    starts = np.arange(SEED_BINS) * count // SEED_BINS
    return np.maximum.reduceat(samples, starts).tobytes()
