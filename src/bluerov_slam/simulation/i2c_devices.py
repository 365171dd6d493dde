"""MS5837 and TSYS01 as register models on one bus, as `docs/firmware-core.md` section 7 defines them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from bluerov_slam.simulation.board import BusState, I2cInput

MS5837_ADDRESS, TSYS01_ADDRESS = 0x76, 0x77
_RESET, _READ_ADC, _READ_PROM = 0x1E, 0x00, 0xA0
_CONVERT = {MS5837_ADDRESS: {0x4A: 0, 0x5A: 1}, TSYS01_ADDRESS: {0x48: 0}}
_SILENT = {
    MS5837_ADDRESS: (BusState.MS5837_SILENT, BusState.BOTH_SILENT, BusState.HELD_LOW),
    TSYS01_ADDRESS: (BusState.TSYS01_SILENT, BusState.BOTH_SILENT, BusState.HELD_LOW),
}
_PROM = {I2cInput.MS5837_PROM: MS5837_ADDRESS, I2cInput.TSYS01_PROM: TSYS01_ADDRESS}
_ADC = {I2cInput.MS5837_ADC: MS5837_ADDRESS, I2cInput.TSYS01_ADC: TSYS01_ADDRESS}


@dataclass(slots=True)
class _Device:
    prom: tuple[int, ...] = ()
    adc: tuple[int, ...] = (0, 0)
    converted: int | None = None
    selected: bytes = b""


class I2cDevices:
    """The bus with both devices; what they hold and whether they answer is told from outside."""

    def __init__(self) -> None:
        self.state = BusState.FINE
        self.on_recovery: Callable[[], None] = lambda: None
        self._devices = {MS5837_ADDRESS: _Device(), TSYS01_ADDRESS: _Device()}

    def tell(self, what: int, data: bytes) -> None:
        """Take an `I2cInput`."""
        kind = I2cInput(what)
        if kind is I2cInput.BUS:
            self.state = BusState(data[0])
        elif kind in _PROM:
            self._devices[_PROM[kind]].prom = struct.unpack(f"<{len(data) // 2}H", data)
        else:
            self._devices[_ADC[kind]].adc = struct.unpack(f"<{len(data) // 4}I", data)

    def write(self, address: int, data: bytes) -> bool:
        """A command byte; whether it was acknowledged."""
        device = self._answering(address)
        if device is None:
            return False
        command = data[0]
        device.selected = b""
        if command == _RESET:
            device.converted = None
        elif command in _CONVERT[address]:
            device.converted = _CONVERT[address][command]
        elif command == _READ_ADC:
            value = 0 if device.converted is None else device.adc[device.converted]
            device.converted = None
            device.selected = (value & 0xFFFFFF).to_bytes(3, "big")
        elif command >= _READ_PROM and not command & 1:
            index = (command - _READ_PROM) // 2
            device.selected = (device.prom[index] if index < len(device.prom) else 0).to_bytes(2, "big")
        return True

    def read(self, address: int, count: int) -> bytes | None:
        """So many bytes of what the last command selected; None when nobody acknowledges."""
        device = self._answering(address)
        return None if device is None else device.selected[:count].ljust(count, b"\0")

    def recover(self) -> None:
        """Nine clocks; what holds the bus decides whether they help."""
        self.on_recovery()

    def _answering(self, address: int) -> _Device | None:
        if address not in self._devices or self.state in _SILENT[address]:
            return None
        return self._devices[address]
