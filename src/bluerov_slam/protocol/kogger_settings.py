"""What can be set on a Kogger sonar and read back: ids 0x10 to 0x15.

Values may lie anywhere when they were read; `set_frame` refuses what no sonar takes. The limits are the wider of the
vendor's specification and KoggerApp's own.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import IntFlag
from math import ceil
from typing import ClassVar, Self

from bluerov_slam.errors import CommandError
from bluerov_slam.protocol.kogger_frame import FrameType, KoggerFrame, KoggerId, build_frame

MAX_RANGE_M = 200.0
DEFAULT_SOUND_SPEED_MPS = 1500.0


class SonarSetting(ABC):
    """One group of values: a SETTING carries them down, a GETTING asks for them, CONTENT brings them back."""

    __slots__ = ()
    frame_id: ClassVar[KoggerId]
    version: ClassVar[int] = 0
    layout: ClassVar[struct.Struct]
    get_payload: ClassVar[bytes] = b""

    @abstractmethod
    def check(self) -> None:
        """Raises CommandError with the value and the allowed range."""

    @abstractmethod
    def to_payload(self) -> bytes:
        """The values as SETTING and CONTENT carry them."""

    @classmethod
    @abstractmethod
    def from_payload(cls, payload: bytes) -> Self:
        """The values in the payload of a CONTENT frame."""

    def set_frame(self, route: int = 0) -> bytes:
        """The checked SETTING frame, asking for a result."""
        self.check()
        return self._frame(FrameType.SETTING, self.to_payload(), route)

    def content_frame(self, route: int = 0, *, mark: bool = False) -> bytes:
        """The sonar's answer with these values."""
        return build_frame(self.frame_id, self.to_payload(), version=self.version, route=route, mark=mark)

    @classmethod
    def get_frame(cls, route: int = 0) -> bytes:
        """The GETTING frame that asks for these values."""
        return cls._frame(FrameType.GETTING, cls.get_payload, route)

    @classmethod
    def parse(cls, frame: KoggerFrame) -> Self | None:
        """The values in a CONTENT or SETTING frame of this kind; None for any other frame."""
        carries = frame.frame_type == FrameType.SETTING or (
            frame.frame_type == FrameType.CONTENT and not frame.response
        )
        if not carries or frame.frame_id != cls.frame_id or frame.version != cls.version:
            return None
        return cls.from_payload(frame.payload) if len(frame.payload) >= cls.layout.size else None

    @classmethod
    def _frame(cls, frame_type: FrameType, payload: bytes, route: int) -> bytes:
        return build_frame(
            cls.frame_id, payload, frame_type=frame_type, version=cls.version, route=route, response=True
        )


@dataclass(frozen=True, slots=True)
class ChartSetup(SonarSetting):
    """Samples per ping, their spacing, and how many are skipped before the first."""

    sample_count: int
    resolution_mm: int
    first_sample: int = 0

    frame_id: ClassVar[KoggerId] = KoggerId.CHART_SETUP
    layout: ClassVar[struct.Struct] = struct.Struct("<3H")

    @property
    def range_m(self) -> float:
        """Slant range of the far end."""
        return (self.first_sample + self.sample_count) * self.resolution_mm / 1000

    def check(self) -> None:
        _check_range("sample count", self.sample_count, 1, 15_000, "")
        _check_range("resolution", self.resolution_mm, 10, 1000, "mm")
        _check_range("first sample", self.first_sample, 0, 0xFFFF, "")
        length_m = self.sample_count * self.resolution_mm / 1000
        if length_m > MAX_RANGE_M:
            raise CommandError(
                f"{self.sample_count} samples x {self.resolution_mm} mm = {length_m:g} m,"
                f" allowed up to {MAX_RANGE_M:g} m"
            )

    def to_payload(self) -> bytes:
        return self.layout.pack(self.sample_count, self.resolution_mm, self.first_sample)

    @classmethod
    def from_payload(cls, payload: bytes) -> Self:
        return cls(*cls.layout.unpack_from(payload))


class DatasetMask(IntFlag):
    """What a sonar sends by itself."""

    DISTANCE = 0x01
    CHART = 0x02
    ATTITUDE = 0x04
    QUATERNION = 0x08
    TEMPERATURE = 0x10
    TIMESTAMP = 0x20
    NMEA_DEPTH = 0x40
    NMEA_DEPTH_2 = 0x80


@dataclass(frozen=True, slots=True)
class Dataset(SonarSetting):
    """What the UART output slot 1 or 2 (0: both) sends, and how often. Period 0 is off."""

    channel: int
    period_ms: int
    mask: DatasetMask = DatasetMask.CHART

    frame_id: ClassVar[KoggerId] = KoggerId.DATASET
    layout: ClassVar[struct.Struct] = struct.Struct("<B2I")
    get_payload: ClassVar[bytes] = b"\x00"

    def check(self) -> None:
        _check_range("output slot", self.channel, 0, 2, "")
        _check_range("period", self.period_ms, 0, 3_600_000, "ms")
        _check_range("data set mask", int(self.mask), 0, 0xFF, "")

    def to_payload(self) -> bytes:
        return self.layout.pack(self.channel, self.period_ms, int(self.mask))

    @classmethod
    def from_payload(cls, payload: bytes) -> Self:
        channel, period_ms, mask = cls.layout.unpack_from(payload)
        return cls(channel, period_ms, DatasetMask(mask))


@dataclass(frozen=True, slots=True)
class Transceiver(SonarSetting):
    """Transmit frequency, pulse length in periods, and the boost: the sonar has no receive gain."""

    frequency_khz: int
    pulse_count: int
    boost: bool

    frame_id: ClassVar[KoggerId] = KoggerId.TRANSCEIVER
    layout: ClassVar[struct.Struct] = struct.Struct("<H2B")

    def check(self) -> None:
        _check_range("frequency", self.frequency_khz, 40, 6000, "kHz")
        _check_range("pulse count", self.pulse_count, 0, 0xFF, "")

    def to_payload(self) -> bytes:
        return self.layout.pack(self.frequency_khz, self.pulse_count, self.boost)

    @classmethod
    def from_payload(cls, payload: bytes) -> Self:
        frequency_khz, pulse_count, boost = cls.layout.unpack_from(payload)
        return cls(frequency_khz, pulse_count, bool(boost))


@dataclass(frozen=True, slots=True)
class SoundSpeed(SonarSetting):
    """The sound speed with which the sonar turns time into range."""

    sound_speed_mps: float

    frame_id: ClassVar[KoggerId] = KoggerId.SOUND_SPEED
    layout: ClassVar[struct.Struct] = struct.Struct("<I")

    def check(self) -> None:
        _check_range("sound speed", self.sound_speed_mps, 300, 6000, "m/s")

    def to_payload(self) -> bytes:
        return self.layout.pack(round(self.sound_speed_mps * 1000))

    @classmethod
    def from_payload(cls, payload: bytes) -> Self:
        return cls(cls.layout.unpack_from(payload)[0] / 1000)


@dataclass(frozen=True, slots=True)
class Dsp(SonarSetting):
    """Horizontal smoothing over pings, 0 (off) to 4."""

    smoothing: int

    frame_id: ClassVar[KoggerId] = KoggerId.DSP
    layout: ClassVar[struct.Struct] = struct.Struct("<B")

    def check(self) -> None:
        _check_range("smoothing", self.smoothing, 0, 4, "")

    def to_payload(self) -> bytes:
        return self.layout.pack(self.smoothing)

    @classmethod
    def from_payload(cls, payload: bytes) -> Self:
        return cls(*cls.layout.unpack_from(payload))


@dataclass(frozen=True, slots=True)
class DistanceSetup(SonarSetting):
    """Where the sonar's own bottom detector looks."""

    start_mm: int
    end_mm: int

    frame_id: ClassVar[KoggerId] = KoggerId.DISTANCE_SETUP
    version: ClassVar[int] = 1
    layout: ClassVar[struct.Struct] = struct.Struct("<2I")

    def check(self) -> None:
        _check_range("start of the bottom search", self.start_mm, 0, MAX_RANGE_M * 1000, "mm")
        _check_range("end of the bottom search", self.end_mm, self.start_mm + 1, MAX_RANGE_M * 1000, "mm")

    def to_payload(self) -> bytes:
        return self.layout.pack(self.start_mm, self.end_mm)

    @classmethod
    def from_payload(cls, payload: bytes) -> Self:
        return cls(*cls.layout.unpack_from(payload))


@dataclass(frozen=True, slots=True)
class DistanceConfidence(SonarSetting):
    """How sure the sonar's own bottom detector must be."""

    confidence_percent: int

    frame_id: ClassVar[KoggerId] = KoggerId.DISTANCE_SETUP
    version: ClassVar[int] = 2
    layout: ClassVar[struct.Struct] = struct.Struct("<B")

    def check(self) -> None:
        _check_range("confidence", self.confidence_percent, 0, 100, "%")

    def to_payload(self) -> bytes:
        return self.layout.pack(self.confidence_percent)

    @classmethod
    def from_payload(cls, payload: bytes) -> Self:
        return cls(*cls.layout.unpack_from(payload))


SETTING_KINDS: tuple[type[SonarSetting], ...] = (
    Dataset,
    DistanceSetup,
    DistanceConfidence,
    ChartSetup,
    Dsp,
    Transceiver,
    SoundSpeed,
)


def parse_setting(frame: KoggerFrame) -> SonarSetting | None:
    """Whichever of the settings the frame carries."""
    for kind in SETTING_KINDS:
        setting = kind.parse(frame)
        if setting is not None:
            return setting
    return None


def two_way_time_s(chart: ChartSetup, sound_speed_mps: float = DEFAULT_SOUND_SPEED_MPS) -> float:
    """How long the echo of the far end takes. Check: 1000 x 20 mm at 1500 m/s -> 26.7 ms."""
    return 2 * chart.range_m / sound_speed_mps


def check_period(period_ms: float, chart: ChartSetup, sound_speed_mps: float = DEFAULT_SOUND_SPEED_MPS) -> None:
    """Raises CommandError, arithmetic included, where pings would come faster than their echoes. Period 0 is off."""
    two_way_ms = 1000 * two_way_time_s(chart, sound_speed_mps)
    if period_ms and period_ms < two_way_ms:
        raise CommandError(
            f"period {period_ms:g} ms is shorter than the two-way time"
            f" 2 x {chart.range_m:g} m / {sound_speed_mps:g} m/s = {two_way_ms:.1f} ms;"
            f" choose at least {ceil(two_way_ms)} ms, or a range of at most {period_ms / 2000 * sound_speed_mps:.1f} m"
        )


def _check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        suffix = f" {unit}" if unit else ""
        raise CommandError(f"{name} {value:g}{suffix}, allowed {low:g}..{high:g}{suffix}")
