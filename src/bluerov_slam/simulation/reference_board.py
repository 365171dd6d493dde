"""The board in plain Python: what the native core is checked against, and what runs where there is no compiler.

Not a second firmware: it follows `docs/firmware-core.md` rule by rule, at Python's pace. It also plays the user's old
firmware (`legacy`), which the native core does not have.
"""

from __future__ import annotations

from collections import deque

from bluerov_slam.errors import BugError
from bluerov_slam.records import Channel
from bluerov_slam.simulation.board import TICK_US, BoardSettings, BootInfo, Output, Port, Sink
from bluerov_slam.simulation.board_readers.readings import NEVER_US
from bluerov_slam.simulation.i2c_devices import I2cDevices
from bluerov_slam.simulation.reference_firmware import Firmware

_SONARS = {Port.SONAR_A: Channel.A, Port.SONAR_B: Channel.B}
_RING_BYTES = {Port.HOST: 2048, Port.SONAR_A: 16_384, Port.SONAR_B: 16_384, Port.IMU: 512, Port.GPS: 512, Port.EC: 512}
_BATCH_BYTES = {Port.HOST: 512, Port.SONAR_A: 1024, Port.SONAR_B: 1024, Port.IMU: 256, Port.GPS: 256, Port.EC: 256}


class _Input:
    """Bytes on their way to one port, and the ring in which they wait for a tick."""

    def __init__(self, port: Port) -> None:
        self.coming: deque[tuple[int, bytes]] = deque()
        self.ring = bytearray()
        self._ring_bytes = _RING_BYTES[port]
        self._batch_bytes = _BATCH_BYTES[port]

    @property
    def next_us(self) -> int:
        """When there is something to take."""
        if self.ring:
            return 0
        return self.coming[0][0] if self.coming else NEVER_US

    def arrive(self, now_us: int) -> int:
        """Bring in what has arrived; returns the bytes that found no room."""
        lost = 0
        while self.coming and self.coming[0][0] <= now_us:
            data = self.coming.popleft()[1]
            room = self._ring_bytes - len(self.ring)
            self.ring += data[:room]
            lost += max(0, len(data) - room)
        return lost

    def take(self) -> bytes:
        """The batch of this tick."""
        batch = bytes(self.ring[: self._batch_bytes])
        del self.ring[: self._batch_bytes]
        return batch


class ReferenceBoard:
    """A `Board`."""

    def __init__(self, legacy: bool = False) -> None:
        self._legacy = legacy
        self._devices = I2cDevices()
        self._told: deque[tuple[int, int, bytes]] = deque()
        self._inputs = {port: _Input(port) for port in Port}
        self._firmware: Firmware | None = None
        self._ticked_us = 0
        self._arrival_us = NEVER_US
        self._wanted_us = 0

    def boot(self, info: BootInfo, settings: BoardSettings) -> None:
        for _, what, data in self._told:
            self._devices.tell(what, data)
        self._told.clear()
        self._inputs = {port: _Input(port) for port in Port}
        self._firmware = Firmware(info, settings, self._devices, self._legacy)
        self._devices.on_recovery = self._firmware.note_recovery
        self._ticked_us = info.boot_us // TICK_US * TICK_US
        self._arrival_us = NEVER_US
        self._wanted_us = self._firmware.next_us()

    def feed(self, port: int, data: bytes, at_us: int) -> None:
        self._inputs[Port(port)].coming.append((at_us, data))
        self._arrival_us = min(self._arrival_us, at_us)

    def i2c(self, what: int, data: bytes, at_us: int) -> None:
        self._told.append((at_us, what, data))

    def run(self, until_us: int) -> tuple[int, list[Output]]:
        if self._firmware is None:
            raise BugError("the board runs before it was booted")
        outputs: list[Output] = []
        while (tick_us := self._next_tick_us()) <= until_us:
            self._ticked_us = tick_us
            made = self._tick(self._firmware, tick_us)
            outputs += made
            if any(output.sink != Sink.LINK for output in made):
                return tick_us, outputs
        self._ticked_us = max(self._ticked_us, until_us // TICK_US * TICK_US)
        return until_us, outputs

    def close(self) -> None:
        pass

    def _next_tick_us(self) -> int:
        """The first tick from here on that has anything to do."""
        return max(self._ticked_us + TICK_US, -(-min(self._wanted_us, self._arrival_us) // TICK_US) * TICK_US)

    def _tick(self, firmware: Firmware, now_us: int) -> list[Output]:
        while self._told and self._told[0][0] <= now_us:
            _, what, data = self._told.popleft()
            self._devices.tell(what, data)
        taken = self._take(firmware, now_us) if self._arrival_us <= now_us else {}
        outputs = firmware.tick(now_us, taken)
        self._wanted_us = firmware.next_us()
        return outputs

    def _take(self, firmware: Firmware, now_us: int) -> dict[int, bytes]:
        taken: dict[int, bytes] = {}
        for port, source in self._inputs.items():
            if source.next_us <= now_us:
                lost = source.arrive(now_us)
                if lost and port in _SONARS:
                    firmware.ring_overflow_bytes[_SONARS[port]] += lost
                taken[port] = source.take()
        self._arrival_us = min([source.next_us for source in self._inputs.values()])
        return taken
