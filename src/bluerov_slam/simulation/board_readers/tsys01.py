"""TSYS01 thermometer at 0x77. Source: TE datasheet, temperature polynomial, PROM checksum."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from bluerov_slam.simulation.board_readers.i2c_device import CountedBus
from bluerov_slam.simulation.board_readers.readings import Fields, Stamp, rounded

_ADDRESS = 0x77
_RESET, _CONVERT, _READ_ADC, _READ_PROM = 0x1E, 0x48, 0x00, 0xA0
_START_US, _RESET_US, _CONVERSION_US, _PERIOD_US, _HEAL_US = 10_000, 10_000, 10_000, 100_000, 500_000
_FRESH_US = 1_000_000
_LEAST_DEGC, _MOST_DEGC = -40.0, 125.0
_PROM_WORDS = 8


def tsys01_prom_ok(prom: Sequence[int]) -> bool:
    """The sum of all bytes is 0. A bus held low reads as all zero, which the sum would accept."""
    return any(prom) and sum((word >> 8) + (word & 0xFF) for word in prom) % 256 == 0


def tsys01_temperature_degc(prom: Sequence[int], adc24: int) -> float:
    """The datasheet's polynomial in the firmware's order of operations.

    Check: 28446 24926 36016 32791 40781 and a = 36636 -> 10.59 degC.
    """
    a = adc24 / 256.0
    t = -2e-21 * prom[1]
    t = t * a + 4e-16 * prom[2]
    t = t * a + -2e-11 * prom[3]
    t = t * a + 1e-6 * prom[4]
    return t * a + -1.5e-2 * prom[5]


class _Step(Enum):
    RESET = auto()
    PROM = auto()
    CONVERT = auto()
    READ = auto()


class Tsys01:
    """Asks the sensor step by step, one transaction a tick."""

    def __init__(self) -> None:
        self.temperature_degc = 0.0
        self._step = _Step.RESET
        self._prom: list[int] = []
        self._wait_until_us, self._started_us = _START_US, 0
        self._reading_seen = Stamp()

    def start(self, boot_us: int) -> None:
        """Tell when the board booted."""
        self._wait_until_us = boot_us + _START_US

    def tick(self, now_us: int, bus: CountedBus) -> None:
        """Do what is due."""
        if now_us >= self._wait_until_us and not self._one_step(now_us, bus):
            self._step = _Step.RESET
            self._wait_until_us = now_us + _HEAL_US

    def _one_step(self, now_us: int, bus: CountedBus) -> bool:
        if self._step is _Step.RESET:
            self._prom.clear()
            self._step = _Step.PROM
            self._wait_until_us = now_us + _RESET_US
            return bus.command(_ADDRESS, _RESET, now_us)
        if self._step is _Step.PROM:
            return self._read_prom_word(now_us, bus)
        if self._step is _Step.CONVERT:
            self._step = _Step.READ
            self._started_us = now_us
            self._wait_until_us = now_us + _CONVERSION_US
            return bus.command(_ADDRESS, _CONVERT, now_us)
        self._step = _Step.CONVERT
        self._wait_until_us = self._started_us + _PERIOD_US
        return self._read_temperature(now_us, bus)

    def _read_prom_word(self, now_us: int, bus: CountedBus) -> bool:
        answer = bus.read_answer(_ADDRESS, _READ_PROM + 2 * len(self._prom), 2, now_us)
        if answer is None:
            return False
        self._prom.append(int.from_bytes(answer, "big"))
        if len(self._prom) < _PROM_WORDS:
            return True
        self._step = _Step.CONVERT
        if tsys01_prom_ok(self._prom):
            return True
        bus.count_bad_content()
        return False

    def _read_temperature(self, now_us: int, bus: CountedBus) -> bool:
        answer = bus.read_answer(_ADDRESS, _READ_ADC, 3, now_us)
        if answer is None:
            return False
        adc24 = int.from_bytes(answer, "big")
        temperature_degc = tsys01_temperature_degc(self._prom, adc24)
        if adc24 == 0 or not _LEAST_DEGC <= temperature_degc <= _MOST_DEGC:
            bus.count_bad_content()
            return False
        self.temperature_degc = temperature_degc
        self._reading_seen.set(now_us)
        return True

    @property
    def next_us(self) -> int:
        """When the next transaction is due."""
        return self._wait_until_us

    def ok(self, now_us: int) -> bool:
        """Whether the newest reading is fresh."""
        return self._reading_seen.within(now_us, _FRESH_US)

    def fill(self, fields: Fields, now_us: int) -> None:
        """Write temperature and ok."""
        if self.ok(now_us):
            fields["temperature_ok"] = 1
            fields["temperature_cdegc"] = rounded(self.temperature_degc * 100.0)
