"""Where the pretended surroundings meet the board: bytes in, bytes out, in virtual time.

A board is the native firmware core in a process of its own, or the Python reference. Both are driven alike and give
the same outputs at the same times for the same inputs; `docs/firmware-core.md` section 7 has every rule. All times
are device time: microseconds of the board's one timer.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Protocol

TICK_US = 1000
SONAR_BAUD = 921_600
SENSOR_BAUD = 9_600
ROM_BAUD = 115_200


class Port(IntEnum):
    """Inputs of the board, in the order in which a tick takes them."""

    HOST = 0
    SONAR_A = 1
    SONAR_B = 2
    IMU = 3
    GPS = 4
    EC = 5


class Sink(IntEnum):
    """Where an output goes. Everything but LINK ends a run early."""

    LINK = 0
    """One whole AA55 frame, handed over to the line."""
    SONAR_A = 1
    SONAR_B = 2
    IMU = 3
    EC = 5
    LINK_BAUD = 16
    """u32: the line runs at this rate from now on."""
    SETTINGS = 17
    """u32 SENSORS rate mHz, u32 IMU rate mHz, u8 decimation: what survives power-off."""
    I2C_RECOVERY = 18


class I2cInput(IntEnum):
    """What the surroundings tell the I2C devices."""

    MS5837_PROM = 0
    """7 u16."""
    TSYS01_PROM = 1
    """8 u16."""
    MS5837_ADC = 2
    """D1 and D2, u32 each."""
    TSYS01_ADC = 3
    """u32."""
    BUS = 4
    """u8, a `BusState`."""


class BusState(IntEnum):
    """Who acknowledges on the I2C bus."""

    FINE = 0
    MS5837_SILENT = 1
    TSYS01_SILENT = 2
    BOTH_SILENT = 3
    HELD_LOW = 4


class Output(NamedTuple):
    """What a tick gave."""

    sink: int
    at_us: int
    data: bytes


@dataclass(frozen=True, slots=True)
class BootInfo:
    """Device time at the start, and what the machine knows about it (reset reason: the ESP-IDF's number)."""

    boot_us: int = 0
    boot_count: int = 0
    reset_reason: int = 1


@dataclass(frozen=True, slots=True)
class BoardSettings:
    """What the board is born with. `coding` is that of KOGGER_COMPRESSED."""

    baud: int = 115_200
    sensors_rate_mhz: int = 2_000
    imu_rate_mhz: int = 20_000
    decimation: int = 4
    coding: int = 0


class Board(Protocol):
    """A board in lockstep with its surroundings."""

    def boot(self, info: BootInfo, settings: BoardSettings) -> None:
        """Start anew: everything but what the I2C devices were told is forgotten."""

    def feed(self, port: int, data: bytes, at_us: int) -> None:
        """Bytes that all arrive at one instant; at most 65 535, per port never earlier than those before."""

    def i2c(self, what: int, data: bytes, at_us: int) -> None:
        """Tell the I2C devices something, packed as `I2cInput` says."""

    def run(self, until_us: int) -> tuple[int, list[Output]]:
        """Run the ticks up to this time, ending behind one that gave more than frames; time reached, and outputs."""

    def close(self) -> None:
        """Let go of whatever runs outside."""


class I2cBus(Protocol):
    """The bus as a driver sees it."""

    def write(self, address: int, data: bytes) -> bool:
        """Whether the device acknowledged."""

    def read(self, address: int, count: int) -> bytes | None:
        """That many bytes, None if the device does not acknowledge."""

    def recover(self) -> None:
        """Nine clocks and a stop."""
