"""What the readers share: when a byte came, how old a reading is, rounding, and where reports go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from bluerov_slam.protocol.esp32_messages import GpsFields
from bluerov_slam.simulation.board import SENSOR_BAUD

NEVER_US = 1 << 63
"""Later than any device time."""

Fields = dict[str, int]
"""The fields of `SensorFields` by name, while they are being gathered."""


@dataclass(frozen=True, slots=True)
class ImuSample:
    """One sample of the HWT905, raw counts."""

    time_us: int
    acceleration: tuple[int, ...]
    angular_rate: tuple[int, ...]
    magnetic_field: tuple[int, ...]


class ReportSink(Protocol):
    """Receives complete reports."""

    def imu_burst(self, t0_us: int, dt_us: int, samples: Sequence[ImuSample]) -> None:
        """Samples that belong into one IMU_BURST."""

    def gps_report(self, report: GpsFields) -> None:
        """One report of the receiver."""


class Hal(Protocol):
    """What a reader may do to the machine."""

    def port_write(self, port: int, data: bytes, now_us: int) -> None:
        """Bytes for a sensor's own UART; `port` is a `board.Port`."""


class Stamp:
    """The tick that took the newest of something, if there was any."""

    def __init__(self) -> None:
        self._at_us: int | None = None

    def set(self, now_us: int) -> None:
        """Now."""
        self._at_us = now_us

    def older_from_us(self, span_us: int) -> int:
        """The first instant at which `within` is false; 0 if there was none."""
        return 0 if self._at_us is None else self._at_us + span_us + 1

    def within(self, now_us: int, span_us: int) -> bool:
        """Whether it is no older than this."""
        return self._at_us is not None and now_us - self._at_us <= span_us


def unknown_fields() -> Fields:
    """SENSORS of a board that knows nothing yet."""
    return {
        "device_ms": 0,
        "roll_cdeg": 0,
        "pitch_cdeg": 0,
        "yaw_cdeg": 0,
        "acceleration_x_mg": 0,
        "acceleration_y_mg": 0,
        "acceleration_z_mg": 0,
        "imu_packets": 0,
        "imu_errors": 0,
        "imu_alive": 0,
        "latitude_e7": 0,
        "longitude_e7": 0,
        "altitude_dm": 0,
        "satellites": 0,
        "gps_alive": 0,
        "conductivity_dus": 0xFFFF,
        "ec_salinity_cpsu": 0xFFFF,
        "ec_alive": 0,
        "extension": 1,
        "full_conductivity_dus": 0xFFFFFF,
        "full_pressure_pa": 0xFFFFFF,
        "pressure_dmbar": 0xFFFF,
        "depth_temperature_cdegc": 0,
        "depth_ok": 0,
        "temperature_cdegc": 0,
        "temperature_ok": 0,
        "sound_speed_dmps": 0xFFFF,
        "depth_cm": 0xFFFF,
        "salinity_dpsu": 0xFF,
        "a_packets": 0,
        "a_bytes": 0,
        "b_packets": 0,
        "b_bytes": 0,
    }


def arrival_us(now_us: int, bytes_behind: int, baud: int = SENSOR_BAUD) -> int:
    """When a byte came that has so many bytes of its batch behind it, if the last one came now."""
    return max(0, now_us - bytes_behind * 10_000_000 // baud)


def divide_rounded(numerator: int, denominator: int) -> int:
    """The nearest integer, halves away from zero. denominator > 0."""
    quotient = (2 * abs(numerator) + denominator) // (2 * denominator)
    return quotient if numerator >= 0 else -quotient


def clamped(value: int, low: int, high: int) -> int:
    """The nearest value inside the range."""
    return max(low, min(high, value))


def rounded(x: float) -> int:
    """The nearest integer as `trunc(x + 0.5)`, halves away from zero."""
    return int(x + 0.5) if x >= 0.0 else -int(0.5 - x)
