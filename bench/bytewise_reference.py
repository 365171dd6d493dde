"""The plain way to decode the link: one byte at a time, no arrays. What the fast decoder is compared with.

It follows the original description stage by stage: an AA55 state machine, 0x04 expanded to BB55 frames with their
checks, a BB55 state machine that verifies them, chunks placed in a fill buffer, whole pings out. Plainly written; no
work is done twice within a stage. The fast decoder needs no second parse of frames it has just built; `reparse=False`
leaves that stage out here too, and the table gives both ratios.
"""

from __future__ import annotations

import struct

_SENSORS = struct.Struct("<I6hIHB2ih2B2HBB3s3sHhBhB2HB4I")


class BytewiseKoggerParser:
    """BB55 state machine and ping assembly of one sonar."""

    def __init__(self) -> None:
        self.pings: list[bytes] = []
        self._state = 0
        self._header = bytearray()
        self._payload = bytearray()
        self._length = 0
        self._check1 = self._check2 = self._received1 = 0
        self._fill = bytearray(20_000)
        self._filled = 0

    def feed(self, data: bytes) -> None:
        """Run the state machine over every byte."""
        for byte in data:
            if self._state == 0:
                if byte == 0xBB:
                    self._state = 1
            elif self._state == 1:
                self._state = 2 if byte == 0x55 else 1 if byte == 0xBB else 0
                self._header = bytearray()
                self._check1 = self._check2 = 0
            elif self._state == 2:
                self._header.append(byte)
                self._check1 = (self._check1 + byte) & 0xFF
                self._check2 = (self._check2 + self._check1) & 0xFF
                if len(self._header) == 4:
                    self._length = byte
                    self._payload = bytearray()
                    self._state = 3 if byte else 4
            elif self._state == 3:
                self._payload.append(byte)
                self._check1 = (self._check1 + byte) & 0xFF
                self._check2 = (self._check2 + self._check1) & 0xFF
                if len(self._payload) == self._length:
                    self._state = 4
            elif self._state == 4:
                self._received1 = byte
                self._state = 5
            else:
                if self._received1 == self._check1 and byte == self._check2 and self._header[2] == 3:
                    self.place(self._payload)
                self._state = 0

    def end_ping(self) -> None:
        """The last chunk of a ping was fed."""
        self.pings.append(bytes(self._fill[: self._filled]))
        self._filled = 0

    def place(self, payload: bytes | bytearray) -> None:
        """Put the samples of one chart chunk where they belong."""
        seq_offset = payload[0] | payload[1] << 8
        if seq_offset == 0 and self._filled:
            self.end_ping()
        for index in range(6, len(payload)):
            self._fill[seq_offset + index - 6] = payload[index]
        self._filled = seq_offset + len(payload) - 6


class BytewiseLinkParser:
    """Feed bytes; `messages` and the pings of `sonars` collect what was decoded."""

    def __init__(self, *, reparse: bool = True) -> None:
        self._reparse = reparse
        self.messages: list[dict[str, object]] = []
        self.frames = 0
        self.sonars = (BytewiseKoggerParser(), BytewiseKoggerParser())
        self._state = 0
        self._type = 0
        self._length = 0
        self._crc = 0
        self._payload = bytearray()

    def feed(self, data: bytes) -> None:
        """Run the state machine over every byte."""
        for byte in data:
            if self._state == 0:
                if byte == 0xAA:
                    self._state = 1
            elif self._state == 1:
                self._state = 2 if byte == 0x55 else 1 if byte == 0xAA else 0
            elif self._state == 2:
                self._type = self._crc = byte
                self._state = 3
            elif self._state == 3:
                self._length = byte << 8
                self._crc ^= byte
                self._state = 4
            elif self._state == 4:
                self._length |= byte
                self._crc ^= byte
                self._payload = bytearray()
                self._state = 0 if self._length > 4096 else 5 if self._length else 6
            elif self._state == 5:
                self._payload.append(byte)
                self._crc ^= byte
                if len(self._payload) == self._length:
                    self._state = 6
            else:
                if byte == self._crc:
                    self._on_frame(self._type, bytes(self._payload))
                self._state = 0

    def _on_frame(self, frame_type: int, payload: bytes) -> None:
        if frame_type == 0x01 and len(payload) == 76:
            self._on_sensors(payload)
        elif frame_type == 0x05:
            self._on_imu(payload)
        elif frame_type == 0x04:
            self._on_compressed(payload)

    def _on_sensors(self, payload: bytes) -> None:
        values = _SENSORS.unpack(payload)
        self.messages.append(
            {
                "ts": values[0],
                "roll": values[1] / 100,
                "pitch": values[2] / 100,
                "yaw": values[3] / 100,
                "conductivity": int.from_bytes(values[19], "little") / 10,
                "pressure": int.from_bytes(values[20], "little") / 100,
                "temperature": values[24] / 100,
            }
        )

    def _on_imu(self, payload: bytes) -> None:
        t0_us, dt_us, count, _ = struct.unpack_from("<IIBB", payload)
        samples = []
        for index in range(count):
            raw = struct.unpack_from("<9h", payload, 10 + 18 * index)
            accel = [value * 16 * 9.80665 / 32768 for value in raw[:3]]
            gyro = [value * 2000 / 32768 for value in raw[3:6]]
            samples.append((accel, gyro, raw[6:]))
        self.messages.append({"t0_us": t0_us, "dt_us": dt_us, "samples": samples})

    def _on_compressed(self, payload: bytes) -> None:
        channel, flags, decimation, count, _number, _t_us = struct.unpack_from("<5BI", payload)
        position = 9
        for _ in range(count):
            seq_offset, resolution, first, samples = struct.unpack_from("<3HB", payload, position)
            position += 7
            size = (samples + decimation - 1) // decimation
            held = bytearray()
            for byte in payload[position : position + size]:
                for _ in range(decimation):
                    if len(held) < samples:
                        held.append(byte)
            position += size
            self.frames += 1
            frame = self._rebuild(flags, seq_offset, resolution, first, held)
            if self._reparse:
                self.sonars[channel].feed(frame)
            else:
                self.sonars[channel].place(frame[6:-2])
        if flags & 0x40:
            self.sonars[channel].end_ping()

    @staticmethod
    def _rebuild(flags: int, seq_offset: int, resolution: int, first: int, held: bytearray) -> bytes:
        mode = 0x01 | (flags >> 2 & 7) << 3 | (0x40 if flags & 0x20 else 0)
        body = bytearray((0, mode, 3, len(held) + 6)) + struct.pack("<3H", seq_offset, resolution, first) + held
        check1 = check2 = 0
        for byte in body:
            check1 = (check1 + byte) & 0xFF
            check2 = (check2 + check1) & 0xFF
        return b"\xbb\x55" + bytes(body) + bytes((check1, check2))
