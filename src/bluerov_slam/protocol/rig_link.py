"""Messages between a computer and the ground-truth rig's firmware, both ways: AA55 frames with types of their own.

Integers on the wire (nm, nrad), SI-near records here (mm, rad, as the rig's drawings). Every payload ends in a CRC-16
of its type and body: the frame's own 8-bit check lets one damaged header in 256 pass, too many where plates move.
What does not fit is never sent: NaN and degrees given as radians raise. The layout is docs/rig-link.md; the text link
to the acoustic receiver is `protocol/rig_receiver.py`.
"""

from __future__ import annotations

import binascii
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.protocol.checksums import xor8
from bluerov_slam.protocol.esp32_messages import HEADER_BYTES, SYNC, encode_frame
from bluerov_slam.protocol.framing import FrameFormat, FrameScanner

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from bluerov_slam.records import LinkCounters

PLATFORMS, SERVOS, AXES = 4, 6, 6
IMUS = 5
"""One on the base, one on every plate."""
STEP_S = 0.05
"""The firmware's interpolation, as published."""
MAX_STEPS = 1200
ALL_PLATFORMS = 0b1111
LINK_SILENCE_S = 0.5
"""Without an intact frame for so long the firmware stops what it moves."""
POLL_S = 0.1
"""How often to ask WHERE during a motion, so that the link is not silent."""
ANSWER_WAIT_S = 0.2
TRIES = 3
MAX_READINGS = 64
TRANSLATION_LIMIT_MM = 100.0
ROTATION_LIMIT_RAD = 1.0
"""A set point beyond these is no rig's: its angles were degrees, or its lengths micrometres."""

_UNKNOWN_I32 = -(1 << 31)
_UNKNOWN_I16 = -(1 << 15)
_UNKNOWN_U16 = 0xFFFF
_NANO_PER_MM, _NANO = 1e6, 1e9
_SCALE = np.array([_NANO_PER_MM] * 3 + [_NANO] * 3)
_LIMITS = np.array([TRANSLATION_LIMIT_MM] * 3 + [ROTATION_LIMIT_RAD] * 3)


class RigMessage(IntEnum):
    """Type byte; 0x30 and above travel down to the rig. None of them is a type of the vehicle's board."""

    STATE = 0x10
    ACK = 0x11
    IMU = 0x12
    MOVE = 0x30
    STOP = 0x31
    WHERE = 0x32
    READ_IMU = 0x33
    SERVOS = 0x34


class RigMode(IntEnum):
    """What the rig is doing."""

    STARTING = 0
    """The servo boards have not answered yet: where the plates are is unknown."""
    WAITING = 1
    """At home until the button is pressed."""
    READY = 2
    MOVING = 3
    HOMING = 4
    """The button was pressed: on the way home, then WAITING."""


class StopCause(IntEnum):
    """Why the last motion ended."""

    NONE = 0
    ARRIVED = 1
    COMMAND = 2
    BUTTON = 3
    LINK_SILENT = 4
    UNREACHABLE = 5
    """A step on the way had no servo angles; stopped at the one before."""
    SERVO_BOARD = 6
    """A servo board did not take its counts, or came up anew."""


class RigResult(IntEnum):
    """Result byte of ACK."""

    OK = 0
    BAD_CONTENT = 1
    UNKNOWN = 2
    LIMIT = 3
    UNREACHABLE = 4
    SERVO_RANGE = 5
    NOT_NOW = 6
    """Paused: the next press of the button goes on."""
    SERVO_BOARD = 7


@dataclass(frozen=True, slots=True)
class RigAck:
    """Answer to MOVE, STOP and SERVOS. Platform and servo are None where the result is not about one."""

    acked_type: int
    sequence: int
    result: int
    platform: int | None = None
    servo: int | None = None


@dataclass(frozen=True, slots=True)
class RigMove:
    """Go to these set points in a number of equal steps of `STEP_S`. Platforms whose bit is 0 stay."""

    sequence: int
    platforms: int
    steps: int
    set_points: NDArray[np.float64]
    """(4, 6), mm and rad, base first."""


@dataclass(frozen=True, slots=True)
class RigState:
    """STATE: where the rig is. NaN where that is unknown."""

    sequence: int
    """Of the WHERE it answers; 0 unasked."""
    mode: int
    stopped_by: int
    moving_platforms: int
    steps_done: int
    steps: int
    t_ms: int
    set_points: NDArray[np.float64]
    """(4, 6), mm and rad, of the step now held."""
    servo_angles_rad: NDArray[np.float64]
    """(4, 6)."""
    counts: NDArray[np.float64]
    """(4, 6), as written to the servo boards."""
    bad_frames: int = 0
    refused: int = 0
    i2c_errors: int = 0
    servo_board_restarts: int = 0
    presses: int = 0


@dataclass(frozen=True, slots=True)
class RigImu:
    """IMU: the mean of so many readings; NaN without any."""

    sequence: int
    imu: int
    """0 on the base, then the plates upwards."""
    readings: int
    acceleration_mps2: NDArray[np.float64]
    """(3,), in the sensor's frame."""
    rate_radps: NDArray[np.float64]
    temperature_degc: float


@dataclass(frozen=True, slots=True)
class RigServos:
    """SERVOS: one platform's calibration; counts = 300 + offset + gain * angle."""

    sequence: int
    platform: int
    gain_counts_per_rad: NDArray[np.float64]
    """(6,), negative for a servo that turns the other way."""
    offset_counts: NDArray[np.float64]


RigRecord = RigAck | RigMove | RigState | RigImu | RigServos | tuple[RigMessage, int] | tuple[RigMessage, int, int, int]

_CRC = struct.Struct("<H")
_MOVE = struct.Struct("<BBH24i")
_ONE = struct.Struct("<B")
_READ_IMU = struct.Struct("<BBB")
_SERVOS = struct.Struct("<BB12i")
_STATE = struct.Struct("<BBBBHHI24i24i24H5H")
_ACK = struct.Struct("<BBBBB")
_IMU = struct.Struct("<BBB6ih")
_BODIES = {
    RigMessage.STATE: _STATE,
    RigMessage.ACK: _ACK,
    RigMessage.IMU: _IMU,
    RigMessage.MOVE: _MOVE,
    RigMessage.STOP: _ONE,
    RigMessage.WHERE: _ONE,
    RigMessage.READ_IMU: _READ_IMU,
    RigMessage.SERVOS: _SERVOS,
}
_LENGTHS = {int(kind): body.size + _CRC.size for kind, body in _BODIES.items()}
_NONE_U8 = 0xFF


def encode_move(sequence: int, set_points: ArrayLike, steps: int, platforms: int = ALL_PLATFORMS) -> bytes:
    """Frame of MOVE. Raises OutOfValidityError where the numbers cannot be set points, mm and rad."""
    return encode_rig_frame(RigMessage.MOVE, pack_move(RigMove(sequence, platforms, steps, _set_points(set_points))))


def encode_stop(sequence: int) -> bytes:
    """Frame of STOP: hold where the last step is."""
    return encode_rig_frame(RigMessage.STOP, _ONE.pack(sequence))


def encode_where(sequence: int) -> bytes:
    """Frame of WHERE, answered by STATE."""
    return encode_rig_frame(RigMessage.WHERE, _ONE.pack(sequence))


def encode_read_imu(sequence: int, imu: int, readings: int = 16) -> bytes:
    """Frame of READ_IMU, answered by IMU."""
    if imu not in range(IMUS) or readings not in range(1, MAX_READINGS + 1):
        raise OutOfValidityError(f"IMU {imu} and {readings} readings, expected 0..{IMUS - 1} and 1..{MAX_READINGS}")
    return encode_rig_frame(RigMessage.READ_IMU, _READ_IMU.pack(sequence, imu, readings))


def encode_servos(
    sequence: int, platform: int, gain_counts_per_rad: Sequence[float], offset_counts: Sequence[float]
) -> bytes:
    """Frame of SERVOS: the calibration of one platform's six servos, until the next start."""
    gains, offsets = np.asarray(gain_counts_per_rad, np.float64), np.asarray(offset_counts, np.float64)
    if platform not in range(PLATFORMS) or gains.shape != (SERVOS,) or offsets.shape != (SERVOS,):
        raise OutOfValidityError(f"servo calibration of platform {platform}: six gains and six offsets of one of four")
    if not (np.all(np.abs(gains) < 1e3) and np.all(np.abs(offsets) < 1e3)):  # NaN fails this too
        raise OutOfValidityError("servo calibration: gains and offsets below 1000 counts")
    return encode_rig_frame(RigMessage.SERVOS, pack_servos(RigServos(sequence, platform, gains, offsets)))


def pack_move(move: RigMove) -> bytes:
    """Body of MOVE."""
    if move.steps not in range(1, MAX_STEPS + 1) or move.platforms not in range(1, ALL_PLATFORMS + 1):
        raise OutOfValidityError(f"{move.steps} steps of platforms {move.platforms:#06b}, expected 1..{MAX_STEPS}")
    return _MOVE.pack(move.sequence, move.platforms, move.steps, *_nano(move.set_points))


def pack_servos(servos: RigServos) -> bytes:
    """Body of SERVOS."""
    pairs = np.column_stack([servos.gain_counts_per_rad * 1e6, servos.offset_counts * 1e3])
    return _SERVOS.pack(servos.sequence, servos.platform, *np.rint(pairs).astype(np.int64).ravel().tolist())


def pack_state(state: RigState) -> bytes:
    """Body of STATE."""
    angles = np.where(np.isnan(state.servo_angles_rad), _UNKNOWN_I32, np.rint(state.servo_angles_rad * _NANO))
    counts = np.where(np.isnan(state.counts), _UNKNOWN_U16, state.counts)
    return _STATE.pack(
        *(state.sequence, state.mode, state.stopped_by, state.moving_platforms),
        *(state.steps_done, state.steps, state.t_ms & 0xFFFFFFFF),
        *_nano(state.set_points),
        *angles.astype(np.int64).ravel().tolist(),
        *counts.astype(np.int64).ravel().tolist(),
        *(state.bad_frames, state.refused, state.i2c_errors, state.servo_board_restarts, state.presses),
    )


def pack_ack(ack: RigAck) -> bytes:
    """Body of ACK."""
    about = (_NONE_U8 if number is None else number for number in (ack.platform, ack.servo))
    return _ACK.pack(ack.acked_type, ack.sequence, ack.result, *about)


def pack_imu(imu: RigImu) -> bytes:
    """Body of IMU."""
    values = np.concatenate([imu.acceleration_mps2, imu.rate_radps])
    micro = np.where(np.isnan(values), _UNKNOWN_I32, np.rint(values * 1e6)).astype(np.int64).tolist()
    unknown = np.isnan(imu.temperature_degc)
    temperature = _UNKNOWN_I16 if unknown else round(imu.temperature_degc * 100.0)
    return _IMU.pack(imu.sequence, imu.imu, imu.readings, *micro, temperature)


def encode_rig_frame(kind: RigMessage, body: bytes) -> bytes:
    """One whole frame of this link."""
    return encode_frame(kind, body + _CRC.pack(_crc16(kind, body)))


def unpack(kind: int, body: bytes) -> RigRecord | None:
    """The record of a frame's body; None for one whose content does not add up."""
    if kind not in _LENGTHS or len(body) != _BODIES[RigMessage(kind)].size:
        return None
    match RigMessage(kind):
        case RigMessage.STATE:
            return _unpack_state(body)
        case RigMessage.ACK:
            acked, sequence, result, *about = _ACK.unpack(body)
            platform, servo = (None if number == _NONE_U8 else number for number in about)
            return RigAck(acked, sequence, result, platform, servo)
        case RigMessage.IMU:
            sequence, imu, readings, *micro, temperature = _IMU.unpack(body)
            values = _floats(micro, _UNKNOWN_I32) / 1e6
            degc = float("nan") if temperature == _UNKNOWN_I16 else temperature / 100.0
            return RigImu(sequence, imu, readings, values[:3], values[3:], degc)
        case RigMessage.MOVE:
            sequence, platforms, steps, *nano = _MOVE.unpack(body)
            return RigMove(sequence, platforms, steps, _millimetres(nano))
        case RigMessage.SERVOS:
            sequence, platform, *pairs = _SERVOS.unpack(body)
            gains, offsets = np.array(pairs, np.float64).reshape(SERVOS, 2).T
            return RigServos(sequence, platform, gains / 1e6, offsets / 1e3)
        case RigMessage.READ_IMU:
            sequence, imu, readings = _READ_IMU.unpack(body)
            return RigMessage.READ_IMU, sequence, imu, readings
        case RigMessage.STOP | RigMessage.WHERE as plain:
            return plain, body[0]


class RigFrameDecoder:
    """Frames of this link out of a byte stream, in either direction. What is not one is counted and skipped."""

    def __init__(self) -> None:
        self._scanner = FrameScanner(_FORMAT)

    @property
    def counters(self) -> LinkCounters:
        """Counts since this decoder was made; a wrong CRC-16 is a checksum error too."""
        return self._scanner.counters

    def feed(self, data: bytes) -> list[tuple[RigMessage, bytes]]:
        """Take the next bytes; returns (type, body) of every frame they completed."""
        return [(RigMessage(frame[2]), frame[HEADER_BYTES : -1 - _CRC.size]) for frame in self._scanner.feed(data)]


class CommandOutcome(IntEnum):
    """How a command to the rig ended."""

    ANSWERED = 0
    SILENT = 1


class CommandExchange:
    """One command on its way to the rig: the same frame at most three times. The firmware obeys a repeated one once."""

    def __init__(self, frame: bytes) -> None:
        self._frame = frame
        self.kind = RigMessage(frame[2])
        self.sequence = frame[HEADER_BYTES]
        self.tries = 0
        self.answer: RigAck | RigState | RigImu | None = None
        self.outcome: CommandOutcome | None = None
        """None while it is under way."""

    def begin(self) -> bytes:
        """What to send first."""
        self.tries = 1
        return self._frame

    def heard(self, record: RigRecord | None) -> bool:
        """Something came; returns whether it is this command's answer."""
        match record:
            case RigAck(acked_type=acked) if acked != self.kind:
                return False
            case RigState() if self.kind is not RigMessage.WHERE:
                return False
            case RigImu() if self.kind is not RigMessage.READ_IMU:
                return False
            case RigAck() | RigState() | RigImu() if record.sequence == self.sequence:
                self.answer, self.outcome = record, CommandOutcome.ANSWERED
                return True
        return False

    def timed_out(self) -> bytes:
        """Nothing came for `ANSWER_WAIT_S`; returns what to send now (nothing when it is over)."""
        if self.outcome is None and self.tries < TRIES:
            self.tries += 1
            return self._frame
        self.outcome = self.outcome or CommandOutcome.SILENT
        return b""


def _crc16(kind: int, body: bytes) -> int:
    """CRC-16/CCITT-FALSE. Check: "123456789" -> 29B1."""
    return binascii.crc_hqx(body, binascii.crc_hqx(bytes((kind,)), 0xFFFF))


def _total_bytes(buffer: bytes, start: int) -> int | None:
    length = buffer[start + 3] << 8 | buffer[start + 4]
    return length + HEADER_BYTES + 1 if _LENGTHS.get(buffer[start + 2]) == length else None


def _is_intact(frame: bytes) -> bool:
    # The check makes everything behind the sync cancel out, which leaves AA ^ 55.
    body, crc = frame[HEADER_BYTES : -1 - _CRC.size], frame[-1 - _CRC.size : -1]
    return xor8(frame) == 0xFF and _CRC.pack(_crc16(frame[2], body)) == crc


_FORMAT = FrameFormat((SYNC,), HEADER_BYTES, 2, _total_bytes, _is_intact)


def _set_points(given: ArrayLike) -> NDArray[np.float64]:
    set_points = np.asarray(given, np.float64)
    if set_points.shape != (PLATFORMS, AXES):
        raise OutOfValidityError(f"set points of shape {set_points.shape}, expected (4, 6)")
    wrong = ~(np.abs(set_points) <= _LIMITS)  # NaN is wrong too
    if wrong.any():
        platform, axis = map(int, np.argwhere(wrong)[0])
        name, unit = ("x", "y", "z", "roll", "pitch", "yaw")[axis], "mm" if axis < 3 else "rad"
        hint = (
            "; degrees given as radians?" if axis >= 3 and abs(set_points[platform, axis]) > ROTATION_LIMIT_RAD else ""
        )
        raise OutOfValidityError(
            f"{name} of platform {platform + 1}: {set_points[platform, axis]} {unit}, expected within "
            f"{_LIMITS[axis]:g} {unit}{hint}"
        )
    return set_points


def _unpack_state(body: bytes) -> RigState:
    fields = _STATE.unpack(body)
    sequence, mode, stopped_by, moving_platforms, steps_done, steps, t_ms = fields[:7]
    bad_frames, refused, i2c_errors, servo_board_restarts, presses = fields[79:]
    return RigState(
        sequence,
        mode,
        stopped_by,
        moving_platforms,
        steps_done,
        steps,
        t_ms,
        _millimetres(fields[7:31]),
        (_floats(fields[31:55], _UNKNOWN_I32) / _NANO).reshape(PLATFORMS, SERVOS),
        _floats(fields[55:79], _UNKNOWN_U16).reshape(PLATFORMS, SERVOS),
        bad_frames,
        refused,
        i2c_errors,
        servo_board_restarts,
        presses,
    )


def _nano(set_points: NDArray[np.float64]) -> list[int]:
    scaled = np.where(np.isnan(set_points), _UNKNOWN_I32, np.rint(set_points * _SCALE))
    return [int(value) for value in scaled.ravel()]


def _millimetres(nano: Sequence[int]) -> NDArray[np.float64]:
    return np.asarray(_floats(nano, _UNKNOWN_I32).reshape(PLATFORMS, AXES) / _SCALE)


def _floats(numbers: Sequence[int], unknown: int) -> NDArray[np.float64]:
    values = np.array(numbers, np.float64)
    values[values == unknown] = np.nan
    return values
