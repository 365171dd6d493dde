"""The real extension as a process of its own, on free ports, with the test at the other end of its serial port."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import signal
import subprocess
import sys
import threading
import time
import tty
import urllib.request
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from free_ports import free_port
from patience import PATIENCE_S

# Two answers of a process further apart than this say nothing about how it spent the time between.
SEEN_ALIVE_FOR_S = 0.2


def wait_for(condition: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
    """The first true value of `condition`; an AssertionError naming `what` when it stays false."""
    deadline = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < deadline, f"no {what} within {timeout_s} s"
        time.sleep(0.05)
    return value


class ExtensionProcess:
    """`command`: the words after `bluerov-slam`. Settings are dotted keys. Killed at the end of the `with` block."""

    def __init__(self, folder: Path, command: Sequence[str] = ("extension",), **settings: str) -> None:
        self.port = free_port()
        self.log = folder / "extension.log"
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        values = {
            "http.host": "127.0.0.1",
            "http.port": str(self.port),
            "http.sensor_ws_port": str(free_port()),
            "viewer.udp_port_a": str(free_port()),
            "viewer.udp_port_b": str(free_port()),
            "serial.port": os.ttyname(slave),
            "paths.state": str(folder / "state"),
            "recording.min_free_mb": "10",
        } | {key.replace("__", "."): value for key, value in settings.items()}
        flags = [word for key, value in values.items() for word in ("--set", f"{key}={value}")]
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "bluerov_slam", *command, *flags], stdout=log, stderr=log
            )
        self._slave = slave
        self.feeders: list[Feeder] = []

    def __enter__(self) -> ExtensionProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()
        for feeder in self.feeders:
            feeder.end()
        os.close(self._master)
        os.close(self._slave)

    def get(self, path: str) -> Any:
        """A JSON document, None while nobody listens."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=PATIENCE_S) as answer:
                return json.load(answer)
        except OSError:
            assert self.process.poll() is None, self.log.read_text(errors="replace")
            return None

    def wait_until_open(self) -> None:
        """Return once the serial port is open."""
        wait_for(lambda: (self.get("/health") or {}).get("serial"), "open port")

    def recorder(self) -> Any:
        """The recorder's part of the status."""
        return (self.get("/api/state") or {}).get("recorder", {})

    def write(self, data: bytes) -> None:
        """Put bytes on the wire."""
        while data:
            data = data[os.write(self._master, data[:2048]) :]

    def drain(self) -> None:
        """Take the bytes off the wire that a killed extension left on it: whoever writes more would wait for ever."""
        os.set_blocking(self._slave, False)
        with contextlib.suppress(BlockingIOError):
            while os.read(self._slave, 65536):
                pass

    def terminate(self) -> None:
        """End it as BlueOS does, and wait."""
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(PATIENCE_S) == 0, self.log.read_text()

    def kill(self) -> None:
        """SIGKILL."""
        self.process.kill()
        self.process.wait()


class Feeder(threading.Thread):
    """Plays `(at_s, bytes)` blocks into an extension in real time, and remembers when each was written."""

    def __init__(self, target: ExtensionProcess, blocks: Sequence[tuple[float, bytes]]) -> None:
        super().__init__(daemon=True)
        self.written: list[bytes] = []
        self.begun: list[bytes] = []
        self._target = target
        self._blocks = blocks
        self._ended = threading.Event()
        target.feeders.append(self)

    def run(self) -> None:
        begin = time.monotonic()
        for at_s, data in self._blocks:
            if self._ended.wait(max(0.0, begin + at_s - time.monotonic())):
                return
            self.begun.append(data)
            self._target.write(data)
            self.written.append(data)

    def end(self) -> None:
        """Stop writing, once what was begun is written."""
        self._ended.set()
        deadline = time.monotonic() + PATIENCE_S
        while self.is_alive():
            assert time.monotonic() < deadline, "the extension takes no more bytes"
            if self._target.process.returncode is not None:
                self._target.drain()
            self.join(0.05)


class Witness:
    """Sees what an extension has received, and for how long it was seen running since."""

    def __init__(self, target: ExtensionProcess) -> None:
        self._target = target
        self._seen: list[tuple[float, int]] = []
        self._running_s = 0.0

    def watch(self, running_s: float) -> None:
        """Look until the extension was seen running for so long; a machine that stands still does not count."""
        end_s, last_s = self._running_s + running_s, time.monotonic()
        while self._running_s < end_s:
            received = self._target.get("/api/state")["link"]["bytes"]
            now_s = time.monotonic()
            self._running_s += min(now_s - last_s, SEEN_ALIVE_FOR_S)
            last_s = now_s
            self._seen.append((self._running_s, received))
            time.sleep(0.02)

    def bytes_received_before(self, running_s: float) -> int:
        """What it had received when it then ran for so long."""
        return max((count for at_s, count in self._seen if self._running_s - at_s >= running_s), default=0)
