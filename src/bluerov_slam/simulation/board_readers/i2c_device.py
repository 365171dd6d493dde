"""The I2C bus with the error counter that STATUS shows; recovers a stuck bus."""

from __future__ import annotations

from bluerov_slam.simulation.board import I2cBus
from bluerov_slam.simulation.board_readers.readings import Stamp

_FAILURES_BEFORE_RECOVERY = 5
_RECOVERY_GAP_US = 1_000_000


class CountedBus:
    """Counts failed transactions and bad contents of all devices together."""

    def __init__(self, bus: I2cBus) -> None:
        self.errors = 0
        self._bus = bus
        self._failed_in_a_row = 0
        self._recovered = Stamp()

    def command(self, address: int, code: int, now_us: int) -> bool:
        """Write one byte."""
        return self._note(self._bus.write(address, bytes((code,))), now_us)

    def read_answer(self, address: int, code: int, count: int, now_us: int) -> bytes | None:
        """A command byte and its answer, as one transaction: at most one error."""
        if not self.command(address, code, now_us):
            return None
        answer = self._bus.read(address, count)
        self._note(answer is not None, now_us)
        return answer

    def count_bad_content(self) -> None:
        """A bad CRC or an implausible reading."""
        self.errors = self.errors + 1 & 0xFFFF

    def _note(self, ok: bool, now_us: int) -> bool:
        if ok:
            self._failed_in_a_row = 0
            return True
        self.count_bad_content()
        self._failed_in_a_row = min(self._failed_in_a_row + 1, _FAILURES_BEFORE_RECOVERY)
        if self._failed_in_a_row == _FAILURES_BEFORE_RECOVERY and not self._recovered.within(
            now_us, _RECOVERY_GAP_US - 1
        ):
            self._bus.recover()
            self._recovered.set(now_us)
            self._failed_in_a_row = 0
        return False
