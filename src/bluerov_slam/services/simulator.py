"""Runs a virtual ESP32 on a pseudo-terminal in real time, as if it hung on a USB port.

A pseudo-terminal has no baud rate, so the pace is kept here: what the board has sent by now goes out, and never more
than `BURST_S` beyond what the line carries, even after this process was held up. A UART waits for nobody: what the
reader does not take is lost and counted.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import select
import termios
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bluerov_slam.errors import LinkError
from bluerov_slam.simulation.faults import Fault
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32

_log = logging.getLogger(__name__)

TICK_S = 0.01
BURST_S = 0.02
LONGEST_BACKLOG_S = 0.25
BY_ID_NAME = "usb-Silicon_Labs_CP2102_USB_to_UART_Bridge_Controller_0001-if00-port0"
_READ_BYTES = 4096
_BAUD_OF_SPEED = {termios.B9600: 9_600, termios.B115200: 115_200, termios.B230400: 230_400, termios.B921600: 921_600}


@dataclass(slots=True)
class SimulatorCounters:
    """What became of the bytes. `unheard`: nobody had the port open; `dropped`: the reader was too slow."""

    bytes_written: int = 0
    bytes_unheard: int = 0
    bytes_dropped: int = 0
    bytes_received: int = 0
    stalls: int = 0


class PacedOutput:
    """Bytes that may leave at most `BURST_S` ahead of what the line carries."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self._budget = 0.0

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, data: bytes) -> None:
        """Queue what the board has sent."""
        self._waiting += data

    def take(self, elapsed_s: float, bytes_per_s: float) -> bytes:
        """What may go out now, `elapsed_s` after the last call."""
        self._budget = min(self._budget + elapsed_s * bytes_per_s, BURST_S * bytes_per_s)
        count = min(len(self._waiting), int(self._budget))
        taken = bytes(self._waiting[:count])
        del self._waiting[:count]
        self._budget -= count
        return taken

    def clear(self) -> None:
        """The cable was pulled."""
        self._waiting.clear()


class SerialNode:
    """One pseudo-terminal and the names under which it can be found; the slave is left for others to open."""

    def __init__(self, links: list[Path]) -> None:
        self.master, slave = os.openpty()
        self.path = Path(os.ttyname(slave))
        tty.setraw(slave)
        os.close(slave)
        os.set_blocking(self.master, False)
        self._poll = select.poll()
        self._poll.register(self.master, select.POLLIN)
        self._links = links
        self._open = True
        target = self.path
        for link in links:
            _replace_link(link, target)
            target = link

    @property
    def baud(self) -> int | None:
        """The rate the reader has set, None while it is one that no serial program would choose."""
        speed = termios.tcgetattr(self.master)[5]
        return _BAUD_OF_SPEED.get(speed)

    def read(self) -> tuple[bytes, bool]:
        """What the host sent, and whether anybody has the port open."""
        events = self._poll.poll(0)
        flags = events[0][1] if events else 0
        data = b""
        if flags & select.POLLIN:
            with contextlib.suppress(OSError):
                data = os.read(self.master, _READ_BYTES)
        return data, not flags & select.POLLHUP

    def write(self, data: bytes) -> int:
        """Bytes taken; the rest finds the reader's buffer full."""
        try:
            return os.write(self.master, data)
        except OSError:
            return 0

    def remove_links(self) -> None:
        """The device nodes disappear; open descriptors stay."""
        for link in self._links:
            with contextlib.suppress(OSError):
                if link.is_symlink():
                    link.unlink()

    def close(self) -> None:
        """Hang up."""
        if self._open:
            self._open = False
            self.remove_links()
            os.close(self.master)


class Simulator:
    """The board on its line. `run` goes on until it is cancelled.

    `link` is one symbolic link to the port. With `device_folder`, that folder plays /dev: a `ttyUSB<n>` whose number
    grows at each replug, and a `serial/by-id` name that stays.
    """

    def __init__(
        self,
        board: VirtualEsp32,
        link: Path | None = None,
        device_folder: Path | None = None,
        on_event: Callable[[str], None] = _log.info,
        loop_length_s: float | None = None,
    ) -> None:
        self.board = board
        self.counters = SimulatorCounters()
        self.ready = asyncio.Event()
        self._link = link
        self._device_folder = device_folder
        self._on_event = on_event
        self._loop_length_s = loop_length_s
        self._loops = 0
        self._plugs = 0
        self._rename = False
        self._node: SerialNode | None = None
        self._old_node: int | None = None
        self._output = PacedOutput()
        self._origin_s = 0.0
        self._last_tick_s = 0.0

    @property
    def path(self) -> Path | None:
        """The name to open, None while unplugged."""
        if self._node is None:
            return None
        return self._links()[-1] if self._links() else self._node.path

    def inject(self, fault: Fault) -> None:
        """Add a fault while running; its `at_s` is virtual time, and the past means now."""
        self.board.add_fault(fault)

    async def run(self) -> None:
        """Simulate until cancelled; the links are gone afterwards."""
        self._origin_s = self._last_tick_s = time.monotonic() - self.board.now_s
        self._plug()
        try:
            due_s = time.monotonic()
            while True:
                self.tick(time.monotonic())
                due_s = max(due_s + TICK_S, time.monotonic())
                await asyncio.sleep(due_s - time.monotonic())
        finally:
            if self._node is not None:
                self._node.close()
                self._node = None
            self._release_old_node()
            self.board.close()

    def tick(self, monotonic_s: float) -> None:
        """One round: hear the host, let the board run to the present, send what the line carries."""
        elapsed_s = monotonic_s - self._last_tick_s
        self._last_tick_s = monotonic_s
        self._hold_back(elapsed_s)
        now_s = max(monotonic_s - self._origin_s, self.board.now_s)
        listening = self._hear(now_s)
        self._output.add(self.board.advance(now_s))
        self._follow_plug()
        self._say_loops(now_s)
        data = self._output.take(elapsed_s, self.board.bytes_per_s)
        if self._node is None or not data:
            return
        if not listening:
            self.counters.bytes_unheard += len(data)
            return
        written = self._node.write(data)
        self.counters.bytes_written += written
        self.counters.bytes_dropped += len(data) - written

    def _hold_back(self, elapsed_s: float) -> None:
        """After a long stall virtual time waits, so that the backlog stays short even on a full line."""
        if elapsed_s > LONGEST_BACKLOG_S:
            self.counters.stalls += 1
        backlog_s = len(self._output) / self.board.bytes_per_s
        excess_s = max(0.0, backlog_s + elapsed_s - LONGEST_BACKLOG_S)
        self._origin_s += min(excess_s, elapsed_s)

    def _hear(self, now_s: float) -> bool:
        if self._node is None:
            return False
        data, listening = self._node.read()
        if listening:
            self.board.set_host_baud(self._node.baud)
        if data:
            self.counters.bytes_received += len(data)
            self.board.receive(data, now_s)
        return listening

    def _follow_plug(self) -> None:
        if self.board.plugged and self._node is None:
            self._plug()
        elif not self.board.plugged and self._node is not None:
            self._unplug()

    def _plug(self) -> None:
        self._plugs += 1
        if self._plugs > 1 and self._replug_renames():
            self._rename = True
        try:
            self._node = SerialNode(self._links())
        except OSError as error:
            raise LinkError(
                f"cannot make a pseudo-terminal: {error}; give --link a folder that can be written"
            ) from error
        self._release_old_node()
        self.ready.set()
        self._on_event(f"serial port {self.path} -> {self._node.path}")

    def _unplug(self) -> None:
        node = self._node
        assert node is not None
        # The kernel hands out the lowest free number: an open descriptor keeps the old one from coming back at once.
        self._old_node = os.open(node.path, os.O_RDWR | os.O_NOCTTY)
        node.close()
        self._node = None
        self._output.clear()
        self._on_event("serial port unplugged")

    def _release_old_node(self) -> None:
        if self._old_node is not None:
            os.close(self._old_node)
            self._old_node = None

    def _replug_renames(self) -> bool:
        return any(fault.rename for fault in self.board.unplug_faults if fault.at_s <= self.board.now_s)

    def _links(self) -> list[Path]:
        """Names of the present node, each pointing at the one before."""
        links: list[Path] = []
        if self._device_folder is not None:
            links.append(self._device_folder / f"ttyUSB{self._plugs - 1}")
            links.append(self._device_folder / "serial" / "by-id" / BY_ID_NAME)
        if self._link is not None:
            suffix = f"-{self._plugs}" if self._rename else ""
            links.append(self._link.with_name(self._link.name + suffix))
        return links

    def _say_loops(self, now_s: float) -> None:
        if self._loop_length_s is None:
            return
        loops = int((self.board.scenario.mission_start_s + now_s) / self._loop_length_s)
        if loops > self._loops:
            self._loops = loops
            self._on_event(f"the recording has ended and starts again (pass {loops + 1})")


def _replace_link(link: Path, target: Path) -> None:
    """Point `link` at `target`. Only ever replaces a link, never a file."""
    link.parent.mkdir(parents=True, exist_ok=True)
    if link.is_symlink():
        link.unlink()
    elif link.exists():
        raise LinkError(f"{link} exists and is no symbolic link; give --link another path")
    link.symlink_to(target)
