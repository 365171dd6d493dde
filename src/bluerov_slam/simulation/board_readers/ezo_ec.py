"""Atlas EZO EC: lines of conductivity and salinity. They have no checksum."""

from __future__ import annotations

from bluerov_slam.simulation.board import Port
from bluerov_slam.simulation.board_readers.decimal_text import NANO, parse_decimal
from bluerov_slam.simulation.board_readers.readings import Fields, Hal, Stamp, arrival_us, divide_rounded

_MAX_LINE_BYTES = 40
_FIRST_COMMAND_US = 700_000
_ALIVE_US = 3_000_000
_LINE_GAP_US = 100_000
_LINE_SPAN_US = 3_000_000
_SILENCE_US, _SET_AGAIN_US, _COMMAND_GAP_US = 5_000_000, 15_000_000, 400_000
_MOST_CONDUCTIVITY_DUS = 0xFFFFFE
_MOST_SALINITY_PSU = 42
_COMMANDS = (b"O,EC,1\r", b"O,S,1\r", b"O,TDS,0\r", b"O,SG,0\r", b"C,1\r")
_ANSWERS = (b"*OK", b"*RS", b"*RE", b"*WA", b"*UV", b"*OV", b"*SL")


class EzoEcReader:
    """Bytes in, the newest conductivity and salinity out."""

    def __init__(self) -> None:
        self.errors = 0
        self.conductivity_dus = 0
        self._salinity_cpsu = 0xFFFF
        self._line = bytearray()
        self._too_long = self._whole = False
        self._end_us: int | None = None
        self._byte_us = 0
        self._reading_seen, self._both_seen = Stamp(), Stamp()
        self._command = 0
        self._configuring = True
        self._command_us, self._set_us = _FIRST_COMMAND_US, 0

    def start(self, boot_us: int) -> None:
        """Tell when the board booted."""
        self._command_us = boot_us + _FIRST_COMMAND_US

    def feed(self, batch: bytes, now_us: int) -> None:
        """Take bytes, the last of which came now."""
        for index, byte in enumerate(batch):
            if byte != ord("\n"):
                self._take(byte, arrival_us(now_us, len(batch) - 1 - index), now_us)

    def _take(self, byte: int, time_us: int, now_us: int) -> None:
        if self._line and time_us > self._byte_us + _LINE_GAP_US:
            if not self._too_long:
                self._count_error()
            self._line.clear()
            self._too_long = False
            self._end_us = None
        self._byte_us = time_us
        if byte == ord("\r"):
            if self._line and not self._too_long and self._whole:
                self._end_line(bytes(self._line), now_us)
            self._line.clear()
            self._too_long = False
            self._end_us = time_us
            return
        if not self._line:
            self._whole = self._end_us is not None and time_us <= self._end_us + _LINE_SPAN_US
        if len(self._line) < _MAX_LINE_BYTES:
            self._line.append(byte)
        elif not self._too_long:
            self._too_long = True
            self._count_error()

    def _count_error(self) -> None:
        self.errors = self.errors + 1 & 0xFFFF

    def _end_line(self, line: bytes, now_us: int) -> None:
        if line in _ANSWERS or line.startswith(b"?"):
            return
        first, comma, second = line.partition(b",")
        conductivity = parse_decimal(first)
        salinity = parse_decimal(second) if comma else 0
        if conductivity is None or salinity is None or salinity > _MOST_SALINITY_PSU * NANO:
            self._count_error()
            return
        self.conductivity_dus = min(divide_rounded(conductivity, NANO // 10), _MOST_CONDUCTIVITY_DUS)
        self._salinity_cpsu = divide_rounded(salinity, NANO // 100) if comma else 0xFFFF
        self._reading_seen.set(now_us)
        if comma:
            self._both_seen.set(now_us)

    def configure(self, now_us: int, hal: Hal) -> None:
        """Send a configuration command if one is due."""
        if not self._configuring:
            if self._both_seen.within(now_us, _SILENCE_US) or now_us - self._set_us < _SET_AGAIN_US:
                return
            self._configuring = True
        if now_us < self._command_us:
            return
        if self._command == 0:
            self._set_us = now_us
        hal.port_write(Port.EC, _COMMANDS[self._command], now_us)
        self._command_us = now_us + _COMMAND_GAP_US
        self._command = (self._command + 1) % len(_COMMANDS)
        self._configuring = self._command > 0

    @property
    def next_us(self) -> int:
        """No command is due before this, unless bytes arrive."""
        if self._configuring:
            return self._command_us
        return max(self._both_seen.older_from_us(_SILENCE_US), self._set_us + _SET_AGAIN_US, self._command_us)

    def alive(self, now_us: int) -> bool:
        """Whether the newest reading is fresh."""
        return self._reading_seen.within(now_us, _ALIVE_US)

    def fill(self, fields: Fields, now_us: int) -> None:
        """Write conductivity, salinity and alive."""
        if self.alive(now_us):
            fields["ec_alive"] = 1
            fields["conductivity_dus"] = min(self.conductivity_dus, 0xFFFF)
            fields["full_conductivity_dus"] = self.conductivity_dus
            fields["ec_salinity_cpsu"] = self._salinity_cpsu
