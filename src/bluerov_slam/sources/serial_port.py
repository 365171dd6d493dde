"""The serial link to the ESP32: found, opened for us alone, read without blocking, reopened by itself."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import logging
import os
import stat
import struct
import termios
import time
from collections.abc import Awaitable, Callable
from enum import StrEnum
from pathlib import Path
from typing import Final

from bluerov_slam.errors import LinkError
from bluerov_slam.pipeline.health import LinkFacts, PortState
from bluerov_slam.sources.port_search import AUTO, PortCandidate, find_candidates, has_serial_devices

_log = logging.getLogger(__name__)

BACKOFF_FIRST_S: Final = 0.2
BACKOFF_LAST_S: Final = 2.0
# A port that says nothing understandable for so long is called silent; with `auto` the next candidate gets its turn.
SILENT_AFTER_S: Final = 5.0
READ_BYTES: Final = 4096
OUTGOING_LIMIT_BYTES: Final = 4096
# Longest pause between two reads while frames are under way: a whole ping of 1000 samples takes 28 ms at 115200 baud,
# and every read in between costs as much as a useful one.
LONGEST_PAUSE_S: Final = 0.035
BITS_PER_BYTE: Final = 10
_GONE: Final = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR})
_SPEEDS: Final = {9600: termios.B9600, 115200: termios.B115200, 921600: termios.B921600}

OnData = Callable[[bytes, float], int]


class SerialState(StrEnum):
    """What the port is doing."""

    SEARCHING = "searching"
    OPENING = "opening"
    CONNECTED = "connected"
    SILENT = "silent"
    ABSENT = "absent"
    BUSY = "busy"
    PERMISSION_DENIED = "permission_denied"
    FAILED = "failed"


_PORT_STATES: Final = {
    SerialState.CONNECTED: PortState.CONNECTED,
    SerialState.SILENT: PortState.CONNECTED,
    SerialState.BUSY: PortState.BUSY,
    SerialState.PERMISSION_DENIED: PortState.DENIED,
    SerialState.FAILED: PortState.FAILED,
}


class OpenFailure(LinkError):
    """Why a port could not be opened: the state to show, and the system's words."""

    def __init__(self, state: SerialState, detail: str) -> None:
        super().__init__(detail)
        self.state = state
        self.detail = detail


class SerialPort:
    """A link source (docs/interfaces.md section 1): keeps one serial port open and says what it waits for.

    After each read the callback tells how many bytes complete the frame under way; reading pauses for about as long
    as they take at this baud rate, so that a busy link costs about one wake-up a frame. When they do not come the
    callback is told so by empty data.
    """

    kind = "serial"

    def __init__(
        self,
        port: str,
        baud: int,
        *,
        device_folder: Path = Path("/dev"),
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
        silent_after_s: float = SILENT_AFTER_S,
    ) -> None:
        self.state = SerialState.SEARCHING
        self.reconnects = 0
        self.wakeups = 0
        # Frames understood so far, set by the owner: lets `auto` pass over a port that speaks another language.
        self.frames_understood: Callable[[], int] = lambda: self._reads
        self._port = port
        self._baud = baud
        self._device_folder = device_folder
        self._sleep = sleep
        self._silent_after_s = silent_after_s
        self._detail = ""
        self._waiting_for: str | None = self._awaited_port()
        self._candidate: PortCandidate | None = None
        self._last_good: Path | None = None
        self._passed_over: list[Path] = []
        self._descriptor: int | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._is_armed = False
        self._outgoing = bytearray()
        self._reads = 0
        self._device_folder_seen = True
        self._ever_connected = False
        self._on_data: OnData = lambda _data, _arrived_s: 0
        self._on_change: Callable[[], None] = lambda: None
        self._lost = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    def now_s(self) -> float:
        """The clock of the arrival stamps."""
        return time.monotonic()

    def start(self, on_data: OnData, on_change: Callable[[], None]) -> None:
        """Begin to look for the port; `on_data` gets what arrives, `on_change` is called when the state changes."""
        self._on_data = on_data
        self._on_change = on_change
        self._task = asyncio.get_running_loop().create_task(self._keep_open(), name="serial port")

    async def stop(self) -> None:
        """Close the port and end the search."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
            self._task = None
        self._close()

    def aim(self, port: str, baud: int) -> None:
        """Use another port or speed from now on."""
        if (port, baud) == (self._port, self._baud):
            return
        self._port, self._baud = port, baud
        self._last_good = None
        self._passed_over.clear()
        if self._descriptor is not None:
            self._lose("another port or speed was chosen")

    def send(self, data: bytes) -> bool:
        """Write one whole frame without waiting; False when there is no link or it takes nothing more."""
        if self._descriptor is None or len(self._outgoing) + len(data) > OUTGOING_LIMIT_BYTES:
            return False
        self._outgoing += data
        self._write()
        return self._descriptor is not None

    def facts(self) -> LinkFacts:
        """What the health page needs to know."""
        candidate = self._candidate
        return LinkFacts(
            state=_PORT_STATES.get(self.state, PortState.ABSENT),
            kind=self.kind,
            port=str(candidate.node) if candidate else (None if self._port == AUTO else self._port),
            by_id=str(candidate.by_id) if candidate and candidate.by_id else None,
            baud=self._baud,
            reconnects=self.reconnects,
            waiting_for=self._waiting_for,
            detail=self._detail,
            device_folder_seen=self._device_folder_seen,
        )

    async def _keep_open(self) -> None:
        backoff_s = BACKOFF_FIRST_S
        while True:
            try:
                await self._open_first()
            except OpenFailure as failure:
                self._set(failure.state, failure.detail, self._awaited_port())
                await self._sleep(backoff_s)
                backoff_s = min(2 * backoff_s, BACKOFF_LAST_S)
                continue
            heard = await self._until_lost()
            backoff_s = BACKOFF_FIRST_S if heard else min(2 * backoff_s, BACKOFF_LAST_S)
            self._close()
            self._set(SerialState.SEARCHING, self._detail, self._awaited_port())
            await self._sleep(backoff_s)

    async def _open_first(self) -> None:
        """Open the best candidate that can be opened. Raises the OpenFailure of the best one when none can."""
        candidates = await asyncio.to_thread(find_candidates, self._port, self._device_folder, self._last_good)
        if not candidates:
            self._device_folder_seen = await asyncio.to_thread(has_serial_devices, self._device_folder)
        fresh = [candidate for candidate in candidates if candidate.path not in self._passed_over]
        if not fresh:
            self._passed_over.clear()
            fresh = candidates
        failure = OpenFailure(SerialState.ABSENT, "no serial port found")
        for number, candidate in enumerate(fresh):
            try:
                descriptor = await asyncio.to_thread(open_port, candidate.path, self._baud)
            except OpenFailure as reason:
                if number == 0:
                    failure = reason
                    self._candidate = candidate if reason.state is not SerialState.ABSENT else None
                continue
            self._begin(descriptor, candidate)
            return
        raise failure

    def _begin(self, descriptor: int, candidate: PortCandidate) -> None:
        self._descriptor = descriptor
        self._candidate = candidate
        self._lost.clear()
        self._outgoing.clear()
        if self._ever_connected:
            self.reconnects += 1
        self._ever_connected = True
        self._arm(descriptor)
        _log.info("opened %s (%s) at %d baud", candidate.path, candidate.node, self._baud)
        self._set(SerialState.CONNECTED, "", None)

    async def _until_lost(self) -> bool:
        """Wait until the port is lost or, with `auto`, has nothing to say; True if it ever said something."""
        candidate = self._candidate
        assert candidate is not None
        understood = self.frames_understood()
        heard = False
        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._silent_after_s):
                    await self._lost.wait()
            now_understood = self.frames_understood()
            if now_understood != understood:
                understood, heard = now_understood, True
                self._last_good = candidate.by_id or (candidate.path if self._port == AUTO else None)
            elif not self._lost.is_set():
                self._set(SerialState.SILENT, "the port is open, but no valid frame arrives", "data from the ESP32")
                if self._port == AUTO and await self._has_others(candidate):
                    self._passed_over.append(candidate.path)
                    return heard
                continue
            if self._lost.is_set():
                return heard
            self._set(SerialState.CONNECTED, "", None)

    async def _has_others(self, candidate: PortCandidate) -> bool:
        others = await asyncio.to_thread(find_candidates, self._port, self._device_folder, None)
        return any(other.node != candidate.node for other in others)

    def _read(self) -> None:
        self._timer = None
        descriptor = self._descriptor
        if descriptor is None:
            return
        self.wakeups += 1
        try:
            data = os.read(descriptor, READ_BYTES)
        except BlockingIOError:
            self._on_data(b"", time.monotonic())
            self._arm(descriptor)
            return
        except OSError as error:
            self._lose(f"the port was lost: {error.strerror}")
            return
        if not data:
            self._lose("the port was lost: hang-up")
            return
        self._reads += 1
        missing = self._on_data(data, time.monotonic())
        if missing > 0:
            self._pause(descriptor, min(missing * BITS_PER_BYTE / self._baud, LONGEST_PAUSE_S))
        else:
            self._arm(descriptor)

    def _pause(self, descriptor: int, delay_s: float) -> None:
        loop = asyncio.get_running_loop()
        if self._is_armed:
            loop.remove_reader(descriptor)
            self._is_armed = False
        self._timer = loop.call_later(delay_s, self._read)

    def _arm(self, descriptor: int) -> None:
        if not self._is_armed:
            asyncio.get_running_loop().add_reader(descriptor, self._read)
            self._is_armed = True

    def _write(self) -> None:
        descriptor = self._descriptor
        if descriptor is None:
            return
        loop = asyncio.get_running_loop()
        try:
            written = os.write(descriptor, self._outgoing)
        except BlockingIOError:
            written = 0
        except OSError as error:
            self._lose(f"the port was lost: {error.strerror}")
            return
        del self._outgoing[:written]
        if self._outgoing:
            loop.add_writer(descriptor, self._write)
        else:
            loop.remove_writer(descriptor)

    def _lose(self, detail: str) -> None:
        _log.warning("%s: %s", self._candidate.node if self._candidate else self._port, detail)
        self._close()
        self._detail = detail
        self._lost.set()

    def _close(self) -> None:
        descriptor, self._descriptor = self._descriptor, None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if descriptor is None:
            return
        loop = asyncio.get_running_loop()
        loop.remove_reader(descriptor)
        self._is_armed = False
        loop.remove_writer(descriptor)
        with contextlib.suppress(OSError, termios.error):
            termios.tcflush(descriptor, termios.TCOFLUSH)  # closing would wait for unsent bytes
        with contextlib.suppress(OSError):
            os.close(descriptor)

    def _set(self, state: SerialState, detail: str, waiting_for: str | None) -> None:
        changed = state != self.state
        self.state, self._detail, self._waiting_for = state, detail, waiting_for
        if changed:
            if state not in (SerialState.CONNECTED, SerialState.SEARCHING):
                _log.warning("serial port %s: %s", state, detail)
            self._on_change()

    def _awaited_port(self) -> str:
        return "the ESP32's USB serial port" if self._port == AUTO else self._port


def open_port(path: Path, baud: int) -> int:
    """Open a serial port for us alone, raw, without resetting the board where that is possible; its descriptor.

    Raises OpenFailure. A port that another process locked, or opened exclusively, is busy.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise _failure(path, error) from error
    try:
        if not stat.S_ISCHR(os.fstat(descriptor).st_mode):
            raise OpenFailure(SerialState.FAILED, f"{path} is no serial port")
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
        _release_control_lines(descriptor)
        _make_raw(descriptor, baud)
        termios.tcflush(descriptor, termios.TCIFLUSH)
    except BlockingIOError as error:
        os.close(descriptor)
        raise OpenFailure(SerialState.BUSY, f"another program holds {path}") from error
    except (OSError, termios.error) as error:
        os.close(descriptor)
        raise OpenFailure(SerialState.FAILED, f"{path} is no serial port: {error}") from error
    except OpenFailure:
        os.close(descriptor)
        raise
    return descriptor


def _release_control_lines(descriptor: int) -> None:
    """DTR and RTS off in one step: one after the other would pull the ESP32's reset line for a moment."""
    both = struct.pack("I", termios.TIOCM_DTR | termios.TIOCM_RTS)
    try:
        fcntl.ioctl(descriptor, termios.TIOCMBIC, both)
    except OSError as error:
        if error.errno not in (errno.ENOTTY, errno.EINVAL):  # a pseudo-terminal has no such lines
            raise


def _make_raw(descriptor: int, baud: int) -> None:
    _, _, _, _, _, _, control = termios.tcgetattr(descriptor)
    speed = _SPEEDS[baud]
    # 8N1, receiver on, no modem control; without HUPCL closing leaves DTR and RTS, and so the board, alone.
    cflag = termios.CS8 | termios.CREAD | termios.CLOCAL
    control[termios.VMIN] = 1
    control[termios.VTIME] = 0
    termios.tcsetattr(descriptor, termios.TCSANOW, [termios.IGNBRK, 0, cflag, 0, speed, speed, control])


def _failure(path: Path, error: OSError) -> OpenFailure:
    if error.errno in _GONE:
        link = f", which points to {path.resolve()}" if path.is_symlink() else ""
        return OpenFailure(SerialState.ABSENT, f"{path}{link} does not exist")
    if error.errno == errno.EBUSY:
        return OpenFailure(SerialState.BUSY, f"another program holds {path}")
    if error.errno in (errno.EACCES, errno.EPERM):
        return OpenFailure(SerialState.PERMISSION_DENIED, f"no permission to open {path}")
    return OpenFailure(SerialState.FAILED, f"{path} cannot be opened: {error.strerror}")
