"""The real extension as a process of its own, on free ports, with the test at the other end of its serial port."""

from __future__ import annotations

import json
import os
import pty
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

START_S = 40.0


def free_port() -> int:
    """A TCP port that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(condition: Callable[[], Any], what: str, timeout_s: float = START_S) -> Any:
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

    def __enter__(self) -> ExtensionProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()
        os.close(self._master)
        os.close(self._slave)

    def get(self, path: str) -> Any:
        """A JSON document, None while the service does not answer."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=5) as answer:
                return json.load(answer)
        except (urllib.error.URLError, OSError):
            return None

    def wait_until_open(self) -> None:
        """Return once the serial port is open."""
        wait_for(lambda: (self.get("/health") or {}).get("serial"), f"open port; log:\n{self.log.read_text()}")

    def recorder(self) -> Any:
        """The recorder's part of the status."""
        return (self.get("/api/state") or {}).get("recorder", {})

    def write(self, data: bytes) -> None:
        """Put bytes on the wire."""
        while data:
            data = data[os.write(self._master, data[:2048]) :]

    def terminate(self) -> None:
        """End it as BlueOS does, and wait."""
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(20) == 0, self.log.read_text()

    def kill(self) -> None:
        """SIGKILL."""
        self.process.kill()
        self.process.wait()


class Feeder(threading.Thread):
    """Plays `(at_s, bytes)` blocks into an extension in real time, and remembers when each was written."""

    def __init__(self, target: ExtensionProcess, blocks: Sequence[tuple[float, bytes]]) -> None:
        super().__init__(daemon=True)
        self.written: list[tuple[float, bytes]] = []
        self._target = target
        self._blocks = blocks
        self._ended = threading.Event()

    def run(self) -> None:
        begin = time.monotonic()
        for at_s, data in self._blocks:
            if self._ended.wait(max(0.0, begin + at_s - time.monotonic())):
                return
            self._target.write(data)
            self.written.append((time.monotonic(), data))

    def end(self) -> None:
        """Stop writing."""
        self._ended.set()
        self.join(5)

    def bytes_until(self, at_s: float) -> bytes:
        """Everything written up to this instant."""
        return b"".join(data for written_s, data in self.written if written_s <= at_s)
