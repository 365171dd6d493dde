"""The native firmware core as a board: a process of its own in lockstep virtual time.

It speaks `docs/firmware-core.md` section 7 on its standard input and output. It ends at the end of its input, so it
never outlives this process, however that ends.
"""

from __future__ import annotations

import contextlib
import os
import select
import struct
import subprocess
import tempfile
import time
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from bluerov_slam.errors import LinkError
from bluerov_slam.simulation.board import BoardSettings, BootInfo, Output

PATIENCE_S = 20.0
"""For one answer: a machine that swaps is slow, a program that hangs is slower."""
_END_PATIENCE_S = 2.0
_READ_BYTES = 1 << 16
_MAX_COMPLAINT = 300

_BOOT = struct.Struct("<cQHBIIIBB")
_FEED = struct.Struct("<cBQH")
_I2C = struct.Struct("<cBQB")
_RUN = struct.Struct("<cQ")
_OUTPUT = struct.Struct("<BQH")
_DONE = struct.Struct("<Q")


class NativeBoard:
    """A `Board`. Raises LinkError when the program is missing, ends or does not answer."""

    def __init__(self, program: Path, arguments: Sequence[str] = ("--lockstep",)) -> None:
        self.program = program
        # Closed when the program ends.
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = _start(program, arguments, self._complaints)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._to, False)
        os.set_blocking(self._from, False)
        self._waiting = bytearray()
        self._end = weakref.finalize(self, _end, self._process, self._complaints)

    @property
    def pid(self) -> int:
        """Of the program."""
        return self._process.pid

    def boot(self, info: BootInfo, settings: BoardSettings) -> None:
        self._waiting += _BOOT.pack(
            b"B",
            info.boot_us,
            info.boot_count & 0xFFFF,
            info.reset_reason,
            settings.baud,
            settings.sensors_rate_mhz,
            settings.imu_rate_mhz,
            settings.decimation,
            settings.coding,
        )

    def feed(self, port: int, data: bytes, at_us: int) -> None:
        self._waiting += _FEED.pack(b"F", port, at_us, len(data)) + data

    def i2c(self, what: int, data: bytes, at_us: int) -> None:
        self._waiting += _I2C.pack(b"I", what, at_us, len(data)) + data

    def run(self, until_us: int) -> tuple[int, list[Output]]:
        if not self._end.alive:
            raise LinkError(f"the native firmware {self.program} has been ended")
        self._waiting += _RUN.pack(b"R", until_us)
        deadline_s = time.monotonic() + PATIENCE_S
        self._send(deadline_s)
        return self._receive(deadline_s)

    def close(self) -> None:
        """End the program; nothing of it is left behind."""
        self._end()

    def _send(self, deadline_s: float) -> None:
        while self._waiting:
            try:
                sent = os.write(self._to, self._waiting)
            except BlockingIOError:
                self._wait(self._to, select.POLLOUT, deadline_s)
            except OSError as error:
                raise self._gone() from error
            else:
                del self._waiting[:sent]

    def _receive(self, deadline_s: float) -> tuple[int, list[Output]]:
        outputs: list[Output] = []
        data = b""
        while True:
            position = 0
            while (message := _next_message(data, position)) is not None:
                value, position = message
                if isinstance(value, int):
                    return value, outputs
                outputs.append(value)
            data = data[position:] + self._read(deadline_s)
            if data[0] not in b"OD":
                raise LinkError(f"{self.program} is not a native firmware that we know: it answers {data[:16]!r}")

    def _read(self, deadline_s: float) -> bytes:
        while True:
            try:
                data = os.read(self._from, _READ_BYTES)
            except BlockingIOError:
                self._wait(self._from, select.POLLIN, deadline_s)
                continue
            except (OSError, ValueError) as error:
                raise self._gone() from error
            if not data:
                raise self._gone()
            return data

    def _wait(self, descriptor: int, event: int, deadline_s: float) -> None:
        poll = select.poll()
        poll.register(descriptor, event)
        if not poll.poll(max(0.0, deadline_s - time.monotonic()) * 1000.0):
            self.close()
            raise LinkError(f"the native firmware {self.program} has not answered for {PATIENCE_S:g} s; it was ended")

    def _gone(self) -> LinkError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_PATIENCE_S)
        complaint = ""
        if not self._complaints.closed:
            self._complaints.seek(0)
            complaint = self._complaints.read().decode(errors="replace").strip()[-_MAX_COMPLAINT:]
        self.close()
        how = f"with code {self._process.returncode}" if self._process.returncode is not None else "its output"
        return LinkError(
            f"the native firmware {self.program} has ended {how}" + (f": {complaint}" if complaint else "")
        )


def _start(program: Path, arguments: Sequence[str], complaints: BinaryIO) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(  # noqa: S603
            [str(program), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=complaints,
            bufsize=0,
            start_new_session=True,  # Ctrl-C is for us; the program goes when we go
        )
    except FileNotFoundError as error:
        raise LinkError(f"no native firmware at {program}; `make firmware` builds it") from error
    except OSError as error:
        raise LinkError(f"the native firmware {program} cannot be started: {error}") from error


def _end(process: subprocess.Popen[bytes], complaints: BinaryIO) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    try:
        process.wait(_END_PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    complaints.close()


def _next_message(data: bytes, position: int) -> tuple[Output | int, int] | None:
    """The message that begins here and where it ends: an output, or the time reached. None if it is not all there."""
    if position >= len(data):
        return None
    start = position + 1
    if data[position] == ord("D"):
        end = start + _DONE.size
        return (_DONE.unpack_from(data, start)[0], end) if end <= len(data) else None
    if data[position] != ord("O") or start + _OUTPUT.size > len(data):
        return None
    sink, at_us, count = _OUTPUT.unpack_from(data, start)
    start += _OUTPUT.size
    return (Output(sink, at_us, data[start : start + count]), start + count) if start + count <= len(data) else None
