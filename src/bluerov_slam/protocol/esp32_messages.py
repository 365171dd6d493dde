"""AA55 frames between the ESP32 and the host, both ways, and every payload except SENSORS and KOGGER_COMPRESSED.

Exact integers of the wire in, the same out; no clock, no units. `unpack_*` returns None for a payload whose content
does not add up. The layout is `docs/protocol.md`.
"""

from __future__ import annotations

import struct
from dataclasses import astuple, dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.errors import BugError
from bluerov_slam.protocol.checksums import xor8
from bluerov_slam.protocol.framing import FrameFormat, FrameScanner
from bluerov_slam.records import AckResult, Channel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from bluerov_slam.records import LinkCounters

SYNC = b"\xaa\x55"
HEADER_BYTES = 5
MAX_PAYLOAD_BYTES = 4096
_OVERHEAD_BYTES = HEADER_BYTES + 1
_BB55_MIN_BYTES, _BB55_MAX_BYTES = 8, 263


class MessageType(IntEnum):
    """Type byte of an AA55 frame; 0x20 and above travel down to the ESP32."""

    SENSORS = 0x01
    KOGGER_RAW_A = 0x02
    KOGGER_RAW_B = 0x03
    KOGGER_COMPRESSED = 0x04
    IMU_BURST = 0x05
    STATUS = 0x06
    COMMAND_ACK = 0x07
    ACOUSTIC_TDOA = 0x08
    ACOUSTIC_RECORD = 0x09
    ACOUSTIC_MESSAGE = 0x0A
    GPS = 0x0B
    KOGGER_COMMAND_A = 0x20
    KOGGER_COMMAND_B = 0x21
    CONFIG = 0x22
    TIME_SYNC = 0x23


KNOWN_TYPES = frozenset(MessageType)


class ConfigKey(IntEnum):
    """What CONFIG can change."""

    SENSORS_RATE_MHZ = 1
    IMU_RATE_MHZ = 2
    DECIMATION = 3
    BAUD = 4


_CONFIG_RANGES = {
    ConfigKey.SENSORS_RATE_MHZ: range(500, 20_001),
    ConfigKey.IMU_RATE_MHZ: range(1000, 20_001),
    ConfigKey.DECIMATION: range(1, 9),
    ConfigKey.BAUD: (115_200, 921_600),
}


def config_allowed(key: int, value: int) -> bool:
    """Whether the firmware accepts this pair of CONFIG."""
    return key in _CONFIG_RANGES and value in _CONFIG_RANGES[ConfigKey(key)]


_IMU_SAMPLE_BYTES = 18
_IMU_HEADER = struct.Struct("<IIBB")
_STATUS = struct.Struct("<BBBBIHBBIIIIIIIHHHHHQI")
_ACK = struct.Struct("<BBB")
_GPS = struct.Struct("<IBBHiiiHHQ")
_TIME_SYNC = struct.Struct("<BQ")
_CONFIG_PAIR = struct.Struct("<BI")
_U32 = struct.Struct("<I")
_STATUS_MAX_BYTES = 126
_MAX_CONFIG_PAIRS = 8
_MAX_IMU_SAMPLES = 64
_MAX_RECEIVERS = 16


def _lengths(minimum: int, maximum: int, step: int = 1) -> range:
    return range(minimum, maximum + 1, step)


# A false header is refused early by the length its type cannot have. STATUS may grow in later layout versions; what
# an old firmware puts into 0x04 is not known, so its length is free.
_LENGTHS = {
    MessageType.SENSORS: _lengths(76, 76),
    MessageType.KOGGER_RAW_A: _lengths(4 + _BB55_MIN_BYTES, MAX_PAYLOAD_BYTES),
    MessageType.KOGGER_RAW_B: _lengths(4 + _BB55_MIN_BYTES, MAX_PAYLOAD_BYTES),
    MessageType.KOGGER_COMPRESSED: _lengths(1, MAX_PAYLOAD_BYTES),
    MessageType.IMU_BURST: _lengths(
        _IMU_HEADER.size + _IMU_SAMPLE_BYTES, _IMU_HEADER.size + _MAX_IMU_SAMPLES * _IMU_SAMPLE_BYTES, _IMU_SAMPLE_BYTES
    ),
    MessageType.STATUS: _lengths(_STATUS.size, _STATUS_MAX_BYTES),
    MessageType.COMMAND_ACK: _lengths(_ACK.size, _ACK.size),
    MessageType.ACOUSTIC_TDOA: _lengths(4 + 6 * 2, 4 + 6 * _MAX_RECEIVERS, 6),
    MessageType.ACOUSTIC_RECORD: _lengths(22, 512),
    MessageType.ACOUSTIC_MESSAGE: _lengths(6, 261),
    MessageType.GPS: _lengths(_GPS.size, _GPS.size),
    MessageType.KOGGER_COMMAND_A: _lengths(1 + _BB55_MIN_BYTES, 1 + _BB55_MAX_BYTES),
    MessageType.KOGGER_COMMAND_B: _lengths(1 + _BB55_MIN_BYTES, 1 + _BB55_MAX_BYTES),
    MessageType.CONFIG: _lengths(1 + _CONFIG_PAIR.size, 1 + _MAX_CONFIG_PAIRS * _CONFIG_PAIR.size, _CONFIG_PAIR.size),
    MessageType.TIME_SYNC: _lengths(_TIME_SYNC.size, _TIME_SYNC.size),
}
_LENGTHS_OF_TYPE = tuple(
    _LENGTHS[MessageType(code)] if code in _LENGTHS else _lengths(0, MAX_PAYLOAD_BYTES) for code in range(256)
)


def _total_bytes(buffer: bytes, start: int) -> int | None:
    length = buffer[start + 3] << 8 | buffer[start + 4]
    return length + _OVERHEAD_BYTES if length in _LENGTHS_OF_TYPE[buffer[start + 2]] else None


def _is_intact(frame: bytes) -> bool:
    # The check makes everything behind the sync cancel out, which leaves AA ^ 55.
    return xor8(frame) == 0xFF


_FORMAT = FrameFormat((SYNC,), HEADER_BYTES, 2, _total_bytes, _is_intact)


class Esp32FrameDecoder:
    """AA55 frames out of a byte stream, in either direction."""

    def __init__(self) -> None:
        self._scanner = FrameScanner(_FORMAT)

    @property
    def bytes_wanted(self) -> int:
        """Bytes still missing of the frame being received, 0 when none is open."""
        return self._scanner.bytes_wanted

    @property
    def counters(self) -> LinkCounters:
        """Counts since this decoder was made."""
        return self._scanner.counters

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Take the next bytes; returns (type, payload) of every frame they completed."""
        return [(frame[2], frame[HEADER_BYTES:-1]) for frame in self._scanner.feed(data)]

    def flush(self) -> list[tuple[int, bytes]]:
        """The stream ended: give up the incomplete frame; returns whole frames found inside it."""
        return [(frame[2], frame[HEADER_BYTES:-1]) for frame in self._scanner.flush()]


def encode_frame(frame_type: int, payload: bytes) -> bytes:
    """One whole AA55 frame."""
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise BugError(f"AA55 payload of {len(payload)} bytes, at most {MAX_PAYLOAD_BYTES} fit")
    body = bytes((frame_type, len(payload) >> 8, len(payload) & 0xFF)) + payload
    return SYNC + body + bytes((xor8(body),))


@dataclass(frozen=True, slots=True)
class KoggerRawFields:
    """KOGGER_RAW_A and _B: whole BB55 frames as the sonar sent them."""

    t_us: int
    frames: bytes


def pack_kogger_raw(fields: KoggerRawFields) -> bytes:
    """Payload of 0x02 or 0x03."""
    return _U32.pack(fields.t_us) + fields.frames


def unpack_kogger_raw(payload: bytes) -> KoggerRawFields | None:
    """Fields of 0x02 or 0x03."""
    if len(payload) < _U32.size:
        return None
    return KoggerRawFields(_U32.unpack_from(payload)[0], payload[_U32.size :])


class ImuScale(IntEnum):
    """How the numbers of IMU_BURST are scaled."""

    HWT905_RAW = 1


@dataclass(frozen=True, slots=True)
class ImuBurstFields:
    """IMU_BURST. `samples`: int16 (n, 9), accelerometer xyz, gyroscope xyz, magnetometer xyz."""

    t0_us: int
    dt_us: int
    scale: int
    samples: NDArray[np.int16]


def pack_imu_burst(fields: ImuBurstFields) -> bytes:
    """Payload of 0x05."""
    header = _IMU_HEADER.pack(fields.t0_us, fields.dt_us, len(fields.samples), fields.scale)
    return header + fields.samples.astype("<i2").tobytes()


def unpack_imu_burst(payload: bytes) -> ImuBurstFields | None:
    """Fields of 0x05; None when the sample count and the length disagree."""
    if len(payload) <= _IMU_HEADER.size:
        return None
    t0_us, dt_us, count, flags = _IMU_HEADER.unpack_from(payload)
    if len(payload) != _IMU_HEADER.size + count * _IMU_SAMPLE_BYTES:
        return None
    samples = np.frombuffer(payload, "<i2", offset=_IMU_HEADER.size).reshape(count, 9)
    return ImuBurstFields(t0_us, dt_us, flags & 0x0F, samples)


@dataclass(frozen=True, slots=True)
class StatusFields:
    """STATUS in wire order; `echoed_host_us` 0 means no TIME_SYNC was received."""

    layout_version: int
    firmware_major: int
    firmware_minor: int
    firmware_patch: int
    uptime_ms: int
    boot_count: int
    reset_reason: int
    link_load_percent: int
    tx_bytes: int
    a_pings_dropped: int
    b_pings_dropped: int
    a_frame_errors: int
    b_frame_errors: int
    a_overflow_bytes: int
    b_overflow_bytes: int
    i2c_errors: int
    imu_errors: int
    gps_errors: int
    ec_errors: int
    bad_commands: int
    echoed_host_us: int
    echo_device_us: int


def pack_status(fields: StatusFields) -> bytes:
    """Payload of 0x06."""
    return _STATUS.pack(*astuple(fields))


def unpack_status(payload: bytes) -> StatusFields | None:
    """Fields of 0x06. Later layout versions may append to it; version 0 does not exist."""
    if len(payload) < _STATUS.size or payload[0] == 0:
        return None
    return StatusFields(*_STATUS.unpack_from(payload))


@dataclass(frozen=True, slots=True)
class CommandAckFields:
    """COMMAND_ACK."""

    acked_type: int
    sequence: int
    result: AckResult


def pack_command_ack(fields: CommandAckFields) -> bytes:
    """Payload of 0x07."""
    return _ACK.pack(*astuple(fields))


def unpack_command_ack(payload: bytes) -> CommandAckFields | None:
    """Fields of 0x07; None for a result code that does not exist."""
    if len(payload) != _ACK.size or payload[2] > max(AckResult):
        return None
    return CommandAckFields(payload[0], payload[1], AckResult(payload[2]))


@dataclass(frozen=True, slots=True)
class GpsFields:
    """GPS: one report of the receiver. `utc_ms` 0 means unknown."""

    t_us: int
    fix: int
    satellites: int
    hdop_x100: int
    latitude_e7: int
    longitude_e7: int
    altitude_mm: int
    speed_cmps: int
    course_cdeg: int
    utc_ms: int


def pack_gps(fields: GpsFields) -> bytes:
    """Payload of 0x0B."""
    return _GPS.pack(*astuple(fields))


def unpack_gps(payload: bytes) -> GpsFields | None:
    """Fields of 0x0B."""
    return GpsFields(*_GPS.unpack(payload)) if len(payload) == _GPS.size else None


@dataclass(frozen=True, slots=True)
class KoggerCommandFields:
    """KOGGER_COMMAND_A and _B: one BB55 frame for one sonar, not looked into here."""

    channel: Channel
    sequence: int
    frame: bytes


def encode_kogger_command(channel: Channel, sequence: int, bb55_frame: bytes) -> bytes:
    """The whole AA55 frame that sends `bb55_frame` to a sonar."""
    frame_type = MessageType.KOGGER_COMMAND_A + channel.index
    return encode_frame(frame_type, bytes((sequence & 0xFF,)) + bb55_frame)


def unpack_kogger_command(frame_type: int, payload: bytes) -> KoggerCommandFields | None:
    """Fields of 0x20 or 0x21."""
    if len(payload) < 1 + _BB55_MIN_BYTES:
        return None
    channel = Channel.A if frame_type == MessageType.KOGGER_COMMAND_A else Channel.B
    return KoggerCommandFields(channel, payload[0], payload[1:])


@dataclass(frozen=True, slots=True)
class ConfigFields:
    """CONFIG: key and value pairs as received, not judged yet."""

    sequence: int
    pairs: tuple[tuple[int, int], ...]


def encode_config(sequence: int, values: Mapping[ConfigKey, int]) -> bytes:
    """The whole CONFIG frame."""
    pairs = b"".join(_CONFIG_PAIR.pack(key, value) for key, value in values.items())
    return encode_frame(MessageType.CONFIG, bytes((sequence & 0xFF,)) + pairs)


def unpack_config(payload: bytes) -> ConfigFields | None:
    """Fields of 0x22; None when a pair is cut off."""
    if len(payload) <= 1 or (len(payload) - 1) % _CONFIG_PAIR.size:
        return None
    return ConfigFields(payload[0], tuple(_CONFIG_PAIR.iter_unpack(payload[1:])))


@dataclass(frozen=True, slots=True)
class TimeSyncFields:
    """TIME_SYNC: the host's monotonic clock when it was sent."""

    sequence: int
    host_us: int


def encode_time_sync(sequence: int, host_us: int) -> bytes:
    """The whole TIME_SYNC frame."""
    return encode_frame(MessageType.TIME_SYNC, _TIME_SYNC.pack(sequence & 0xFF, host_us))


def unpack_time_sync(payload: bytes) -> TimeSyncFields | None:
    """Fields of 0x23."""
    return TimeSyncFields(*_TIME_SYNC.unpack(payload)) if len(payload) == _TIME_SYNC.size else None
