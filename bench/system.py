"""The two real services as processes on free ports, fed through a pseudo-terminal that this process writes."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
import tty
import urllib.request
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import psutil

from bench.load import BITS_PER_BYTE, LoadFrame

START_DEADLINE_S = 30.0
# A USB serial adapter hands bytes over about once a millisecond.
SLICE_S = 0.001
PORTS = {
    "http": "BLUEROV_SLAM_HTTP__PORT",
    "sensors_ws": "BLUEROV_SLAM_HTTP__SENSOR_WS_PORT",
    "viewer": "BLUEROV_SLAM_VIEWER__PORT",
    "waterfall_ws": "BLUEROV_SLAM_VIEWER__WATERFALL_WS_PORT",
    "udp_a": "BLUEROV_SLAM_VIEWER__UDP_PORT_A",
    "udp_b": "BLUEROV_SLAM_VIEWER__UDP_PORT_B",
}


@dataclass(frozen=True, slots=True)
class Written:
    """When the last byte of a frame was handed to the terminal, host monotonic seconds."""

    frame: LoadFrame
    at_s: float


class System:
    """Extension and viewer, running. `ports` by name; `write` and `feed` put bytes on the wire."""

    def __init__(self, folder: Path, baud: int, settings: Mapping[str, str]) -> None:
        self.folder = folder
        self.baud = baud
        self.ports = {name: _free_port(name.startswith("udp")) for name in PORTS}
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self._slave = slave
        self.dropped_bytes = 0
        environment = (
            os.environ
            | {variable: str(self.ports[name]) for name, variable in PORTS.items()}
            | {
                "BLUEROV_SLAM_HTTP__HOST": "127.0.0.1",
                "BLUEROV_SLAM_SERIAL__PORT": os.ttyname(slave),
                "BLUEROV_SLAM_SERIAL__BAUD": str(baud),
                "BLUEROV_SLAM_PATHS__STATE": str(folder / "state"),
            }
            | settings
        )
        self.processes = {
            name: subprocess.Popen(
                [sys.executable, "-m", "bluerov_slam", name],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=(folder / f"{name}.log").open("wb"),
            )
            for name in ("extension", "viewer")
        }

    def wait_until_up(self) -> None:
        """Return when both services answer; raises RuntimeError with their log otherwise."""
        deadline = time.monotonic() + START_DEADLINE_S
        for name in ("http", "viewer"):
            while not self._answers(name):
                if time.monotonic() > deadline or any(p.poll() is not None for p in self.processes.values()):
                    logs = "\n".join(path.read_text() for path in self.folder.glob("*.log"))
                    raise RuntimeError(f"{name} did not start:\n{logs[-4000:]}")
                time.sleep(0.1)
        while not self.get("http", "/health")["serial"]:
            if time.monotonic() > deadline:
                raise RuntimeError("the extension did not open the terminal")
            time.sleep(0.05)

    def get(self, name: str, path: str) -> dict:
        """A JSON document of one of the services."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.ports[name]}{path}", timeout=5) as answer:
            return json.load(answer)

    def feed(self, frames: Iterable[LoadFrame], duration_s: float) -> Iterator[Written]:
        """Write frames at the baud rate for this long; yields each frame once its last byte is written."""
        bytes_per_s = self.baud / BITS_PER_BYTE
        start = time.monotonic()
        due, pending = 0, b""
        for frame in frames:
            pending += frame.data
            due += len(frame.data)
            while pending:
                now = time.monotonic()
                allowed = int((now - start) * bytes_per_s) - (due - len(pending))
                if allowed > 0:
                    self.write(pending[:allowed])
                    pending = pending[allowed:]
                if pending:
                    time.sleep(SLICE_S)
            yield Written(frame, time.monotonic())
            if time.monotonic() - start > duration_s:
                return

    def write(self, data: bytes) -> None:
        """Put bytes on the wire; what nobody takes is lost and counted, as on a real UART."""
        try:
            written = os.write(self._master, data)
        except BlockingIOError:
            written = 0
        self.dropped_bytes += len(data) - written

    def write_waiting(self, data: bytes) -> None:
        """Put bytes on the wire as fast as they are taken; nothing is lost."""
        view = memoryview(data)
        while view:
            select.select([], [self._master], [])
            self.drain_host_bytes()
            with contextlib.suppress(BlockingIOError):
                view = view[os.write(self._master, view[:4096]) :]

    def drain_host_bytes(self) -> None:
        """Throw away what the services sent down, so that they never block."""
        with contextlib.suppress(BlockingIOError):
            os.read(self._master, 65536)

    def cpu_s(self) -> float:
        """CPU seconds of both services since their start."""
        times = [psutil.Process(p.pid).cpu_times() for p in self.processes.values()]
        return sum(t.user + t.system for t in times)

    def pss_mb(self) -> float:
        """Proportional set size of both services, MB."""
        return sum(process_pss_mb(p.pid) for p in self.processes.values())

    def worker_pid(self) -> int:
        """The extension's navigation worker."""
        (worker,) = psutil.Process(self.processes["extension"].pid).children()
        return worker.pid

    def stop(self) -> None:
        for process in self.processes.values():
            process.send_signal(signal.SIGTERM)
        for process in self.processes.values():
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        os.close(self._master)
        os.close(self._slave)

    def _answers(self, name: str) -> bool:
        try:
            self.get(name, "/health")
        except (OSError, ValueError):
            return False
        return True


@contextlib.contextmanager
def running_system(baud: int = 115_200, **settings: str) -> Iterator[System]:
    """Both services up and the terminal open; everything is stopped and removed at the end."""
    with tempfile.TemporaryDirectory(prefix="bluerov-slam-bench-") as folder:
        system = System(Path(folder), baud, settings)
        try:
            system.wait_until_up()
            yield system
        finally:
            system.stop()


def process_pss_mb(pid: int) -> float:
    """Proportional set size of one process, MB."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) / 1024.0
    raise RuntimeError(f"no Pss of process {pid}")


def percentile(values: list[float], percent: float) -> float:
    """Nearest-rank percentile; NaN of nothing."""
    if not values:
        return float("nan")
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100.0))]


def row(identifier: str, name: str, value: float, unit: str, must: str = "", reference: str = "") -> dict[str, object]:
    """One line of the table. `must` is an operator and a number, such as '<= 5', or empty: then it is only told."""
    operator, limit = must.split() if must else ("", "nan")
    bound = float(limit)
    holds = {"<=": value <= bound, ">=": value >= bound, "==": value == bound, "": True}[operator]
    return {
        "id": identifier,
        "name": name,
        "value": round(value, 3),
        "unit": unit,
        "must": must,
        "met": bool(holds),
        "reference": reference,
    }


def _free_port(udp: bool) -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM if udp else socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
