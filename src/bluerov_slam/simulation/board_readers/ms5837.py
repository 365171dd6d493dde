"""MS5837-30BA depth sensor at 0x76. Source: TE datasheet rev C2, "Pressure and temperature calculation"; AN520."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto
from typing import NamedTuple

from bluerov_slam.simulation.board_readers.i2c_device import CountedBus
from bluerov_slam.simulation.board_readers.readings import Fields, Stamp, divide_rounded

_ADDRESS = 0x76
_RESET, _CONVERT_D1, _CONVERT_D2, _READ_ADC, _READ_PROM = 0x1E, 0x4A, 0x5A, 0x00, 0xA0
_START_US, _RESET_US, _CONVERSION_US, _PAIR_US, _HEAL_US = 10_000, 10_000, 20_000, 50_000, 500_000
_FRESH_US = 1_000_000
_MOST_PRESSURE_PA = 3_200_000
_LEAST_CDEGC, _MOST_CDEGC = -2000, 8500
_PROM_WORDS = 7


def ms58xx_crc4(words: Sequence[int]) -> int:
    """The checksum of the family over eight words, with the bits of the checksum itself zero.

    Check: 3132 3334 3536 3738 3940 4142 4344 4500 (hex) -> B.
    """
    remainder = 0
    for byte in b"".join(word.to_bytes(2, "big") for word in words):
        remainder ^= byte
        for _ in range(8):
            remainder = (remainder << 1 ^ 0x3000) & 0xFFFF if remainder & 0x8000 else remainder << 1
    return remainder >> 12


def ms5837_prom_ok(prom: Sequence[int]) -> bool:
    """CRC-4 in the top bits of word 0. A bus held low reads as all zero, which the CRC would accept."""
    return any(prom) and ms58xx_crc4([prom[0] & 0x0FFF, *prom[1:], 0]) == prom[0] >> 12


class Ms5837Result(NamedTuple):
    """Compensated to the second order."""

    pressure_pa: int
    temperature_cdegc: int


def ms5837_compute(prom: Sequence[int], d1: int, d2: int) -> Ms5837Result:
    """First and second order in integers, every division a shift that rounds down."""
    dt = d2 - prom[5] * 256
    temperature = 2000 + (dt * prom[6] >> 23)
    offset = prom[2] * 65_536 + (prom[4] * dt >> 7)
    sensitivity = prom[1] * 32_768 + (prom[3] * dt >> 8)
    from_20_squared = (temperature - 2000) ** 2
    if temperature < 2000:
        temperature_less = 3 * dt * dt >> 33
        offset_less = 3 * from_20_squared >> 1
        sensitivity_less = 5 * from_20_squared >> 3
        if temperature < -1500:
            offset_less += 7 * (temperature + 1500) ** 2
            sensitivity_less += 4 * (temperature + 1500) ** 2
    else:
        temperature_less = 2 * dt * dt >> 37
        offset_less = from_20_squared >> 4
        sensitivity_less = 0
    scaled_d1 = d1 * (sensitivity - sensitivity_less) >> 21
    return Ms5837Result((scaled_d1 - (offset - offset_less)) * 10 >> 13, temperature - temperature_less)


class _Step(Enum):
    RESET = auto()
    PROM = auto()
    CONVERT1 = auto()
    READ1 = auto()
    CONVERT2 = auto()
    READ2 = auto()


class Ms5837:
    """Asks the sensor step by step, one transaction a tick."""

    def __init__(self) -> None:
        self.pressure_pa = 0
        self._temperature_cdegc = 0
        self._step = _Step.RESET
        self._prom: list[int] = []
        self._d1 = 0
        self._wait_until_us, self._pair_started_us = _START_US, 0
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
        if self._step is _Step.CONVERT1:
            self._pair_started_us = now_us
            return self._convert(_CONVERT_D1, _Step.READ1, now_us, bus)
        if self._step is _Step.CONVERT2:
            return self._convert(_CONVERT_D2, _Step.READ2, now_us, bus)
        value = self._read_adc(now_us, bus)
        if value == 0:
            return False
        if self._step is _Step.READ1:
            self._step = _Step.CONVERT2
            self._d1 = value
            return True
        self._step = _Step.CONVERT1
        self._wait_until_us = self._pair_started_us + _PAIR_US
        return self._take_pair(value, now_us, bus)

    def _read_prom_word(self, now_us: int, bus: CountedBus) -> bool:
        answer = bus.read_answer(_ADDRESS, _READ_PROM + 2 * len(self._prom), 2, now_us)
        if answer is None:
            return False
        self._prom.append(int.from_bytes(answer, "big"))
        if len(self._prom) < _PROM_WORDS:
            return True
        self._step = _Step.CONVERT1
        if ms5837_prom_ok(self._prom):
            return True
        bus.count_bad_content()
        return False

    def _convert(self, code: int, then: _Step, now_us: int, bus: CountedBus) -> bool:
        self._step = then
        self._wait_until_us = now_us + _CONVERSION_US
        return bus.command(_ADDRESS, code, now_us)

    def _read_adc(self, now_us: int, bus: CountedBus) -> int:
        answer = bus.read_answer(_ADDRESS, _READ_ADC, 3, now_us)
        if answer is None:
            return 0
        value = int.from_bytes(answer, "big")
        if value == 0:
            bus.count_bad_content()
        return value

    def _take_pair(self, d2: int, now_us: int, bus: CountedBus) -> bool:
        pressure_pa, temperature_cdegc = ms5837_compute(self._prom, self._d1, d2)
        if not (0 < pressure_pa <= _MOST_PRESSURE_PA and _LEAST_CDEGC <= temperature_cdegc <= _MOST_CDEGC):
            bus.count_bad_content()
            return False
        self.pressure_pa, self._temperature_cdegc = pressure_pa, temperature_cdegc
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
        """Write pressure, the sensor's own temperature and ok."""
        if self.ok(now_us):
            fields["depth_ok"] = 1
            fields["full_pressure_pa"] = self.pressure_pa
            fields["pressure_dmbar"] = min(divide_rounded(self.pressure_pa, 10), 0xFFFF)
            fields["depth_temperature_cdegc"] = self._temperature_cdegc
