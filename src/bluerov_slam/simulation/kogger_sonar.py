"""A Kogger side-scan sonar as its serial port shows it: charts, settings, results, version, mark, flash, reboot.

It follows the vendor's protocol: a result frame quotes the two check bytes of the command it answers, an unknown id
is ignored in silence, MARK is in every frame once set and is lost at a reboot.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.protocol.checksums import kogger_mod255
from bluerov_slam.protocol.kogger_frame import FrameType, KoggerFrame, KoggerFrameDecoder, KoggerId, build_frame

CONFIRM_KEY = 0xC96B5D4A
CHUNK_SAMPLES = 200
MASK_DISTANCE, MASK_CHART, MASK_ATTITUDE, MASK_TEMPERATURE, MASK_TIMESTAMP = 0x01, 0x02, 0x04, 0x10, 0x20
REBOOT_S = 1.5
_BOARD_SIDE_ENHANCED = 8
_FIRMWARE = (1, 7)
_RESULT_OK, _RESULT_PAYLOAD, _RESULT_VERSION, _RESULT_TYPE, _RESULT_KEY = 1, 3, 5, 6, 7
_TWO_WAY_MARGIN = 1.05

_U8, _U16, _U32, _CHART_HEADER = struct.Struct("<B"), struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<HHH")
_DATASET = struct.Struct("<BII")
_TRANSCEIVER = struct.Struct("<HBB")
_DISTANCE_SETUP = struct.Struct("<II")

# (samples, resolution_mm, first_sample) -> amplitudes, one row per sub-channel: uint8 (1 or 2, samples)
Echo = Callable[[int, int, int], NDArray[np.uint8]]


@dataclass(frozen=True, slots=True)
class SonarSettings:
    """What the sonar can be told, in the protocol's units; the defaults are the vendor's."""

    samples: int = 1000
    resolution_mm: int = 20
    first_sample: int = 0
    period_ms: int = 100
    mask: int = MASK_CHART
    frequency_khz: int = 675
    pulses: int = 10
    boost: int = 1
    sound_speed_mmps: int = 1_500_000
    smoothing: int = 1
    distance_start_mm: int = 500
    distance_end_mm: int = 50_000
    confidence_percent: int = 14

    @property
    def two_way_s(self) -> float:
        """Time until the echo of the last sample is back."""
        range_mm = (self.first_sample + self.samples) * self.resolution_mm
        return 2.0 * range_mm / self.sound_speed_mmps

    @property
    def period_s(self) -> float | None:
        """Time between pings: as asked for, but never less than the two-way time. None when stopped."""
        if self.period_ms == 0:
            return None
        return max(self.period_ms / 1000.0, self.two_way_s * _TWO_WAY_MARGIN)


class KoggerSonar:
    """One sonar. Bytes of commands in, bytes of frames out; the caller owns the clock and the pacing."""

    def __init__(self, serial_number: int, settings: SonarSettings, checksum: str, echo: Echo) -> None:
        self.settings = settings
        self.marked = False
        self.off_until_s = 0.0
        self._factory = settings
        self._flash = settings
        self._serial_number = serial_number
        self._mod255 = checksum == "mod255"
        self._echo = echo
        self._decoder = KoggerFrameDecoder("mod256")
        self._booted_s = 0.0
        self._lost_to_baud = False

    def alive(self, now_s: float) -> bool:
        """Powered, booted and still on the baud rate that the board listens to."""
        return now_s >= self.off_until_s and not self._lost_to_baud

    def power_up(self, now_s: float) -> None:
        """Back to the settings in flash, MARK cleared."""
        self.settings = self._flash
        self.marked = False
        self._booted_s = now_s

    def period(self, now_s: float, attitude_cdeg: tuple[int, int, int], temperature_degc: float) -> list[bytes]:
        """Every frame of one period: the chart's chunks, and whatever else DATASET asks for."""
        mask = self.settings.mask
        frames: list[bytes] = []
        if mask & MASK_TIMESTAMP:
            frames.append(
                self._content(KoggerId.TIMESTAMP, _U32.pack(int((now_s - self._booted_s) * 1000) & 0xFFFFFFFF))
            )
        amplitudes = self._echo(self.settings.samples, self.settings.resolution_mm, self.settings.first_sample)
        if mask & MASK_CHART:
            frames += self._chart(amplitudes)
        if mask & MASK_DISTANCE:
            frames.append(self._distance(amplitudes))
        if mask & MASK_ATTITUDE:
            roll, pitch, yaw = attitude_cdeg
            frames.append(self._content(KoggerId.ATTITUDE, struct.pack("<hhh", yaw, pitch, roll)))
        if mask & MASK_TEMPERATURE:
            frames.append(self._content(KoggerId.TEMPERATURE, struct.pack("<h", round(temperature_degc * 100))))
        return frames

    def receive(self, data: bytes, now_s: float) -> list[bytes]:
        """The answers to what the board sent down."""
        answers: list[bytes] = []
        for frame in self._decoder.feed(data):
            if frame.frame_type == FrameType.SETTING:
                code = self._set(frame, now_s)
                if code is not None and frame.response:
                    answers.append(self._result(frame, code))
            elif frame.frame_type == FrameType.GETTING:
                answers += self._get(frame)
        return answers

    def _chart(self, amplitudes: NDArray[np.uint8]) -> list[bytes]:
        """A chart of version 0, or of version 1 with two sub-channels interleaved byte by byte."""
        version = len(amplitudes) - 1
        stream = amplitudes.T.tobytes()
        resolution_mm, first = self.settings.resolution_mm, self.settings.first_sample
        return [
            self._content(
                KoggerId.CHART,
                _CHART_HEADER.pack(start, resolution_mm, first) + stream[start : start + CHUNK_SAMPLES],
                version,
            )
            for start in range(0, len(stream), CHUNK_SAMPLES)
        ]

    def _distance(self, amplitudes: NDArray[np.uint8]) -> bytes:
        """The bottom detector: the first strong sample inside the configured window."""
        settings = self.settings
        row = amplitudes[0].astype(np.int32)
        start = max(0, settings.distance_start_mm // settings.resolution_mm - settings.first_sample)
        strong = np.flatnonzero(row[start:] > max(40, int(row.max()) // 3))
        found_mm = (settings.first_sample + start + int(strong[0])) * settings.resolution_mm if len(strong) else 0
        return self._content(KoggerId.DISTANCE, _U32.pack(min(found_mm, settings.distance_end_mm)))

    def _set(self, frame: KoggerFrame, now_s: float) -> int | None:
        """Apply a SETTING; the result code, or None where the device stays silent."""
        handlers = {
            KoggerId.DATASET: self._set_dataset,
            KoggerId.DISTANCE_SETUP: self._set_distance,
            KoggerId.CHART_SETUP: self._set_chart,
            KoggerId.DSP: self._set_smoothing,
            KoggerId.TRANSCEIVER: self._set_transceiver,
            KoggerId.SOUND_SPEED: self._set_sound_speed,
        }
        if frame.frame_id in handlers:
            try:
                return handlers[KoggerId(frame.frame_id)](frame)
            except struct.error:
                return _RESULT_PAYLOAD
        if frame.frame_id in (KoggerId.MARK, KoggerId.FLASH, KoggerId.BOOT, KoggerId.UART):
            return self._set_with_key(frame, now_s)
        return _RESULT_TYPE if frame.frame_id == KoggerId.VERSION else None

    def _set_dataset(self, frame: KoggerFrame) -> int:
        slot, period_ms, mask = _DATASET.unpack(frame.payload)
        if slot > 2 or period_ms > 3_600_000:
            return _RESULT_PAYLOAD
        if slot in (0, 1):
            self.settings = replace(self.settings, period_ms=period_ms, mask=mask)
        return _RESULT_OK

    def _set_distance(self, frame: KoggerFrame) -> int:
        if frame.version == 2:
            self.settings = replace(self.settings, confidence_percent=_U8.unpack(frame.payload)[0])
            return _RESULT_OK
        start_mm, end_mm = _DISTANCE_SETUP.unpack(frame.payload)
        if start_mm >= end_mm:
            return _RESULT_PAYLOAD
        self.settings = replace(self.settings, distance_start_mm=start_mm, distance_end_mm=end_mm)
        return _RESULT_OK

    def _set_chart(self, frame: KoggerFrame) -> int:
        samples, resolution_mm, first_sample = _CHART_HEADER.unpack(frame.payload)
        if not (1 <= samples <= 5000 and 1 <= resolution_mm <= 1000):
            return _RESULT_PAYLOAD
        self.settings = replace(self.settings, samples=samples, resolution_mm=resolution_mm, first_sample=first_sample)
        return _RESULT_OK

    def _set_smoothing(self, frame: KoggerFrame) -> int:
        (smoothing,) = _U8.unpack(frame.payload)
        if smoothing > 4:
            return _RESULT_PAYLOAD
        self.settings = replace(self.settings, smoothing=smoothing)
        return _RESULT_OK

    def _set_transceiver(self, frame: KoggerFrame) -> int:
        frequency_khz, pulses, boost = _TRANSCEIVER.unpack(frame.payload)
        if not 40 <= frequency_khz <= 6000 or boost > 1:
            return _RESULT_PAYLOAD
        self.settings = replace(self.settings, frequency_khz=frequency_khz, pulses=pulses, boost=boost)
        return _RESULT_OK

    def _set_sound_speed(self, frame: KoggerFrame) -> int:
        (speed_mmps,) = _U32.unpack(frame.payload)
        if not 300_000 <= speed_mmps <= 6_000_000:
            return _RESULT_PAYLOAD
        self.settings = replace(self.settings, sound_speed_mmps=speed_mmps)
        return _RESULT_OK

    def _set_with_key(self, frame: KoggerFrame, now_s: float) -> int:
        if len(frame.payload) < _U32.size:
            return _RESULT_PAYLOAD
        if _U32.unpack_from(frame.payload)[0] != CONFIRM_KEY:
            return _RESULT_KEY
        if frame.frame_id == KoggerId.MARK:
            self.marked = True
        elif frame.frame_id == KoggerId.FLASH:
            return self._flash_command(frame.version)
        elif frame.frame_id == KoggerId.UART:
            self._lost_to_baud = frame.version == 0 and frame.payload[5:9] != _U32.pack(921_600)
        elif frame.version == 0:
            self.off_until_s = now_s + REBOOT_S
            self.power_up(self.off_until_s)
        return _RESULT_OK

    def _flash_command(self, version: int) -> int:
        if version == 0:
            self._flash = self.settings
        elif version == 1:
            self.settings = self._flash
        elif version == 2:
            self._flash = self._factory
        else:
            return _RESULT_VERSION
        return _RESULT_OK

    def _get(self, frame: KoggerFrame) -> list[bytes]:
        if frame.frame_id in (KoggerId.CHART, KoggerId.DISTANCE):
            settings = self.settings
            amplitudes = self._echo(settings.samples, settings.resolution_mm, settings.first_sample)
            polled_chart = frame.frame_id == KoggerId.CHART
            return self._chart(amplitudes) if polled_chart else [self._distance(amplitudes)]
        payload = self._read(frame)
        return [] if payload is None else [self._content(frame.frame_id, payload, frame.version)]

    def _read(self, frame: KoggerFrame) -> bytes | None:
        settings = self.settings
        if frame.frame_id == KoggerId.VERSION:
            return self._version(frame.version)
        if frame.frame_id == KoggerId.DISTANCE_SETUP and frame.version == 2:
            return _U8.pack(settings.confidence_percent)
        if frame.frame_id == KoggerId.DATASET:
            slot = frame.payload[0] if frame.payload else 1
            known = slot in (0, 1)
            return _DATASET.pack(slot, settings.period_ms if known else 0, settings.mask if known else 0)
        return {
            KoggerId.DISTANCE_SETUP: _DISTANCE_SETUP.pack(settings.distance_start_mm, settings.distance_end_mm),
            KoggerId.CHART_SETUP: _CHART_HEADER.pack(settings.samples, settings.resolution_mm, settings.first_sample),
            KoggerId.DSP: _U8.pack(settings.smoothing),
            KoggerId.TRANSCEIVER: _TRANSCEIVER.pack(settings.frequency_khz, settings.pulses, settings.boost),
            KoggerId.SOUND_SPEED: _U32.pack(settings.sound_speed_mmps),
            KoggerId.MARK: _U8.pack(self.marked),
        }.get(KoggerId(frame.frame_id) if frame.frame_id in set(KoggerId) else KoggerId.UPDATE)

    def _version(self, version: int) -> bytes | None:
        major, minor = _FIRMWARE
        if version == 0:
            head = struct.pack("<BBH8xBBI", 2, _BOARD_SIDE_ENHANCED, 0, 3, 1, self._serial_number)
            return head + b"SIMULATED".ljust(16, b"\0")
        if version == 1:
            return struct.pack("<III", 0x51AB0000 | self._serial_number & 0xFFFF, 0x534C414D, self._serial_number)
        if version == 2:
            return struct.pack("<BBBBBHBB", 0, 2, _BOARD_SIDE_ENHANCED, 3, 1, 0, minor, major)
        return None

    def _result(self, command: KoggerFrame, code: int) -> bytes:
        return self._content(command.frame_id, bytes((code,)) + command.check, command.version, response=True)

    def _content(self, frame_id: int, payload: bytes, version: int = 0, response: bool = False) -> bytes:
        frame = build_frame(frame_id, payload, version=version, mark=self.marked, response=response)
        return frame[:-2] + kogger_mod255(frame[2:-2]) if self._mod255 else frame
