"""The HWT905's own settings: which packets it sends and how often, as the board's commands leave them."""

from __future__ import annotations

from dataclasses import dataclass, replace

_HEADER = b"\xff\xaa"
_COMMAND_BYTES = 5
_PACKET_BYTES = 11
_SAVE, _OUTPUTS, _RATE, _UNLOCK = 0x00, 0x02, 0x03, 0x69
_UNLOCK_KEY = b"\x88\xb5"
_UNLOCKED_S = 10.0
_RATES_HZ = {1: 0.2, 2: 0.5, 3: 1.0, 4: 2.0, 5: 5.0, 6: 10.0, 7: 20.0, 8: 50.0, 9: 100.0, 11: 200.0}
_FACTORY_OUTPUTS = 0b1_1110


@dataclass(frozen=True, slots=True)
class ImuSettings:
    """Bit n of `outputs` switches packet 0x50 + n on. As from the factory: acceleration to magnetic field at 10 Hz."""

    outputs: int = _FACTORY_OUTPUTS
    rate_hz: float = 10.0


class WitMotionImu:
    """Obeys commands of five bytes, behind an unlock; what was not saved is forgotten without power."""

    def __init__(self, settings: ImuSettings | None = None) -> None:
        self.settings = settings or ImuSettings()
        self._saved = self.settings
        self._unlocked_until_s = 0.0
        self._received = b""

    def power_up(self) -> None:
        """Back to what was saved."""
        self.settings = self._saved
        self._unlocked_until_s = 0.0
        self._received = b""

    def shown(self, packets: bytes) -> list[bytes]:
        """Those of these packets that are switched on."""
        each = [packets[start : start + _PACKET_BYTES] for start in range(0, len(packets), _PACKET_BYTES)]
        return [packet for packet in each if self.settings.outputs >> (packet[1] & 0x0F) & 1]

    def receive(self, data: bytes, now_s: float) -> None:
        """What the board writes."""
        self._received += data
        while (start := self._received.find(_HEADER)) >= 0 and len(self._received) >= start + _COMMAND_BYTES:
            register, value = self._received[start + 2], self._received[start + 3 : start + _COMMAND_BYTES]
            self._received = self._received[start + _COMMAND_BYTES :]
            self._obey(register, value, now_s)

    def _obey(self, register: int, value: bytes, now_s: float) -> None:
        if register == _UNLOCK and value == _UNLOCK_KEY:
            self._unlocked_until_s = now_s + _UNLOCKED_S
        elif now_s >= self._unlocked_until_s:
            return
        elif register == _OUTPUTS:
            self.settings = replace(self.settings, outputs=int.from_bytes(value, "little"))
        elif register == _RATE and value[0] in _RATES_HZ:
            self.settings = replace(self.settings, rate_hz=_RATES_HZ[value[0]])
        elif register == _SAVE and not any(value):
            self._saved = self.settings
