"""WitMotion HWT905: packets of 11 bytes, its configuration, and bursts of raw samples."""

from __future__ import annotations

import struct
from dataclasses import replace
from enum import Enum

from bluerov_slam.simulation.board import Port
from bluerov_slam.simulation.board_readers.readings import (
    Fields,
    Hal,
    ImuSample,
    ReportSink,
    Stamp,
    arrival_us,
    divide_rounded,
)

_PACKET_BYTES = 11
_SYNC = 0x55
_ACCELERATION, _ANGULAR_RATE, _ANGLE, _MAGNETIC_FIELD = 0x51, 0x52, 0x53, 0x54
_FIRST_COMMAND_US = 500_000
_ALIVE_US = 1_200_000
_SAMPLE_SPAN_US = 100_000
_THINNING_SLACK_US = 5_000
_BURST_US = 100_000
_MAX_GATHERED = 4
_SILENCE_US, _SET_AGAIN_US, _COMMAND_GAP_US = 2_000_000, 10_000_000, 100_000
_OUTPUT_RATES = ((1_000, 3), (2_000, 4), (5_000, 5), (10_000, 6), (20_000, 7))
_AXES = struct.Struct("<hhh")


class _Command(Enum):
    UNLOCK = bytes.fromhex("ffaa6988b5")
    OUTPUTS = bytes.fromhex("ffaa021e00")
    RATE = bytes.fromhex("ffaa030000")
    SAVE = bytes.fromhex("ffaa000000")


class WitMotionReader:
    """Bytes in, bursts and the newest attitude out."""

    def __init__(self) -> None:
        self.errors = 0
        self._packets = 0
        self._buffer: list[tuple[int, int]] = []  # bytes and when they came
        self._angle = self._acceleration = (0, 0, 0)
        self._packet_seen, self._angle_seen, self._acceleration_seen = Stamp(), Stamp(), Stamp()
        self._sample_seen = Stamp()
        self._open: ImuSample | None = None
        self._has_rate = False
        self._sample_us = self._interval_us = 0
        self._next_us = 0
        self._gathered: list[ImuSample] = []
        self._command: _Command | None = _Command.UNLOCK
        self._whole_set, self._looked, self._may_save = True, False, True
        self._command_us, self._set_us = _FIRST_COMMAND_US, 0

    def start(self, boot_us: int) -> None:
        """Tell when the board booted."""
        self._command_us = boot_us + _FIRST_COMMAND_US

    def feed(self, batch: bytes, now_us: int, rate_mhz: int, sink: ReportSink) -> None:
        """Take bytes, the last of which came now."""
        for index, byte in enumerate(batch):
            self._buffer.append((byte, arrival_us(now_us, len(batch) - 1 - index)))
            self._search(now_us, rate_mhz, sink)

    def _search(self, now_us: int, rate_mhz: int, sink: ReportSink) -> None:
        while self._buffer:
            if self._buffer[0][0] != _SYNC:
                del self._buffer[0]
                continue
            if len(self._buffer) < 2:
                return
            if self._buffer[1][0] & 0xF0 == 0x50:
                if len(self._buffer) < _PACKET_BYTES:
                    return
                packet = bytes(byte for byte, _ in self._buffer)
                if sum(packet[:-1]) & 0xFF == packet[-1]:
                    time_us = self._buffer[0][1]
                    self._buffer.clear()
                    self._packet(packet, time_us, now_us, rate_mhz, sink)
                    return
            self.errors = self.errors + 1 & 0xFFFF
            del self._buffer[0]

    def _packet(self, packet: bytes, time_us: int, now_us: int, rate_mhz: int, sink: ReportSink) -> None:
        self._packets = self._packets + 1 & 0xFFFFFFFF
        self._packet_seen.set(now_us)
        values = _AXES.unpack_from(packet, 2)
        kind = packet[1]
        if kind == _ACCELERATION:
            self._acceleration = values
            self._acceleration_seen.set(now_us)
            self._open = ImuSample(time_us, values, (0, 0, 0), (0, 0, 0))
            self._has_rate = False
        elif kind == _ANGLE:
            self._angle = values
            self._angle_seen.set(now_us)
        elif self._open is not None and time_us <= self._open.time_us + _SAMPLE_SPAN_US:
            if kind == _ANGULAR_RATE:
                self._open = replace(self._open, angular_rate=values)
                self._has_rate = True
            elif kind == _MAGNETIC_FIELD and self._has_rate:
                sample = replace(self._open, magnetic_field=values)
                self._open = None
                self._complete(sample, now_us, rate_mhz, sink)

    def _complete(self, sample: ImuSample, now_us: int, rate_mhz: int, sink: ReportSink) -> None:
        time_us = sample.time_us
        self._interval_us = time_us - self._sample_us if self._sample_us > 0 and time_us > self._sample_us else 0
        self._sample_us = time_us
        self._sample_seen.set(now_us)
        if time_us + _THINNING_SLACK_US < self._next_us:
            return
        period_us = 1_000_000_000 // rate_mhz
        self._next_us = max(self._next_us + period_us, time_us + period_us - _THINNING_SLACK_US)
        if self._gathered and time_us > self._gathered[-1].time_us + 3 * period_us:
            self._send_burst(period_us, sink)
        self._gathered.append(sample)
        if (2 * len(self._gathered) + 1) * period_us >= 2 * _BURST_US or len(self._gathered) == _MAX_GATHERED:
            self._send_burst(period_us, sink)

    def _send_burst(self, period_us: int, sink: ReportSink) -> None:
        samples, self._gathered = self._gathered, []
        first_us, last_us = samples[0].time_us, samples[-1].time_us
        spacing_us = (last_us - first_us) // (len(samples) - 1) if len(samples) > 1 else period_us
        sink.imu_burst(first_us & 0xFFFFFFFF, spacing_us & 0xFFFFFFFF, samples)

    def configure(self, now_us: int, rate_mhz: int, hal: Hal) -> None:
        """Send a configuration command if one is due."""
        if self._command is None:
            if self._sample_seen.within(now_us, _SILENCE_US) or now_us - self._set_us < _SET_AGAIN_US:
                return
            self._command, self._whole_set = _Command.UNLOCK, True
        if now_us < self._command_us:
            return
        if not self._looked:
            self._looked = True
            self._set_us = now_us
            if self._delivers_as_set(now_us, rate_mhz):
                self._command = None
                return
        command = self._command
        data = command.value
        if command is _Command.UNLOCK:
            self._set_us = now_us if self._whole_set else self._set_us
            self._command = _Command.OUTPUTS if self._whole_set else _Command.RATE
        elif command is _Command.OUTPUTS:
            self._command = _Command.RATE
        elif command is _Command.RATE:
            data = data[:3] + bytes((_output_rate(rate_mhz)[1], 0))
            self._command = _Command.SAVE if self._whole_set and self._may_save else None
        else:
            self._may_save = False
            self._command = None
        self._command_us = now_us + _COMMAND_GAP_US
        hal.port_write(Port.IMU, data, now_us)

    @property
    def next_us(self) -> int:
        """No command is due before this, unless bytes arrive."""
        if self._command is not None:
            return self._command_us
        silent_us = self._sample_seen.older_from_us(_SILENCE_US)
        return max(silent_us, self._set_us + _SET_AGAIN_US, self._command_us)

    def _delivers_as_set(self, now_us: int, rate_mhz: int) -> bool:
        wanted_us = 1_000_000_000 // _output_rate(rate_mhz)[0]
        fits = self._interval_us > 0 and 4 * abs(self._interval_us - wanted_us) <= wanted_us
        return fits and self._sample_seen.within(now_us, _SILENCE_US)

    def rate_changed(self) -> None:
        """The board was told another rate."""
        if self._command is None:
            self._whole_set = False
        self._command = _Command.UNLOCK

    def fill(self, fields: Fields, now_us: int) -> None:
        """Write roll, pitch, yaw, acceleration, counters and alive."""
        fields["imu_packets"] = self._packets
        fields["imu_errors"] = self.errors
        fields["imu_alive"] = int(self._packet_seen.within(now_us, _ALIVE_US))
        if self._angle_seen.within(now_us, _ALIVE_US):
            for name, raw in zip(("roll", "pitch", "yaw"), self._angle, strict=True):
                fields[f"{name}_cdeg"] = divide_rounded(raw * 18_000, 32_768)
        if self._acceleration_seen.within(now_us, _ALIVE_US):
            for name, raw in zip("xyz", self._acceleration, strict=True):
                fields[f"acceleration_{name}_mg"] = divide_rounded(raw * 16_000, 32_768)


def _output_rate(rate_mhz: int) -> tuple[int, int]:
    return next((rate for rate in _OUTPUT_RATES if rate[0] >= rate_mhz), _OUTPUT_RATES[-1])
