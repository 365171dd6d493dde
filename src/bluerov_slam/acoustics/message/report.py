"""What the transmitter tells about itself: 16 bytes.

    u8 kind (1) | i32 latitude, i32 longitude 1e-7 deg | u16 horizontal standard deviation cm |
    u32 time mark: microseconds of the UTC hour at which the frame's first drive step began | u8 transmitter depth 0.1 m

big-endian; the largest value of an unsigned field means unknown, and the smallest i32 an unknown latitude or longitude.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from bluerov_slam.errors import ExpectedError

PAYLOAD_BYTES = 16
HOUR_US = 3_600_000_000

_LAYOUT = struct.Struct(">BiiHIB")
_KIND_POSITION = 1
_UNKNOWN_ANGLE = -(1 << 31)
_UNKNOWN_STD, _UNKNOWN_MARK, _UNKNOWN_DEPTH = 0xFFFF, 0xFFFFFFFF, 0xFF


class MessageContentError(ExpectedError):
    """Bytes that came through intact but say nothing this program knows."""


@dataclass(frozen=True, slots=True)
class BeaconReport:
    """Where the transmitter is; every value may be None where its own receiver does not know it.

    `time_mark_us`: microseconds of the UTC hour (0 to 3.6e9) when this frame's first step began; with a synchronised
    clock at the receiver it gives the range. `depth_m`: of the transmitter below the surface.
    """

    latitude_deg: float | None
    longitude_deg: float | None
    horizontal_std_m: float | None = None
    time_mark_us: int | None = None
    depth_m: float | None = None

    def pack(self) -> bytes:
        """The 16 bytes. A standard deviation or depth beyond its field saturates (655.34 m, 25.4 m).

        Raises ValueError for an impossible latitude, longitude or time mark.
        """
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise ValueError("latitude and longitude are known together or not at all")
        return _LAYOUT.pack(
            _KIND_POSITION,
            _angle(self.latitude_deg, 90.0, "latitude"),
            _angle(self.longitude_deg, 180.0, "longitude"),
            _saturated(self.horizontal_std_m, 100.0, _UNKNOWN_STD),
            self._mark(),
            _saturated(self.depth_m, 10.0, _UNKNOWN_DEPTH),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> BeaconReport:
        """The report in these bytes; raises `MessageContentError` if they hold none."""
        if len(payload) != PAYLOAD_BYTES:
            raise MessageContentError(f"a beacon report has {PAYLOAD_BYTES} bytes, not {len(payload)}")
        kind, latitude, longitude, std, mark, depth = _LAYOUT.unpack(payload)
        if kind != _KIND_POSITION:
            raise MessageContentError(f"message of kind {kind}, only {_KIND_POSITION} (position) is known")
        known = latitude != _UNKNOWN_ANGLE and longitude != _UNKNOWN_ANGLE
        if known and (abs(latitude) > 900_000_000 or abs(longitude) > 1_800_000_000):
            raise MessageContentError("the beacon's position is not on earth")
        if mark != _UNKNOWN_MARK and mark >= HOUR_US:
            raise MessageContentError("the beacon's time mark lies beyond the hour")
        return cls(
            latitude_deg=latitude * 1e-7 if known else None,
            longitude_deg=longitude * 1e-7 if known else None,
            horizontal_std_m=None if std == _UNKNOWN_STD else std / 100.0,
            time_mark_us=None if mark == _UNKNOWN_MARK else mark,
            depth_m=None if depth == _UNKNOWN_DEPTH else depth / 10.0,
        )

    def _mark(self) -> int:
        if self.time_mark_us is None:
            return _UNKNOWN_MARK
        if not 0 <= self.time_mark_us < HOUR_US:
            raise ValueError(f"time mark {self.time_mark_us} us, expected 0 to {HOUR_US - 1}")
        return self.time_mark_us


def _angle(angle_deg: float | None, limit_deg: float, name: str) -> int:
    if angle_deg is None:
        return _UNKNOWN_ANGLE
    if not math.isfinite(angle_deg) or abs(angle_deg) > limit_deg:
        raise ValueError(f"{name} {angle_deg} deg, expected -{limit_deg:g} to {limit_deg:g}")
    return round(angle_deg * 1e7)


def _saturated(value: float | None, per_unit: float, unknown: int) -> int:
    if value is None or math.isnan(value):
        return unknown
    return min(max(round(min(value, 1e6) * per_unit), 0), unknown - 1)
