"""200 browsers on the viewer at 20 binary pings a second, 20 of which never read a byte."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import json
import os
import socket
import struct
import subprocess
import sys
import termios
import time
import urllib.request

import numpy as np

from bench.clients import run as run_clients
from bench.load import CHUNK_SAMPLES, DIGIT_STEP, NUMBER_DIGITS, PING_SAMPLES, RESOLUTION_MM
from bench.system import percentile, process_pss_mb, row, running_system
from bluerov_slam.protocol.kogger_frame import build_frame

READERS = 180
STALLED = 20
PINGS_PER_S = 20
MEASURED_S = float(os.environ.get("BLUEROV_SLAM_BENCH_SECONDS", "60"))
WARM_UP_S = 8.0
STALLED_BUFFER_BYTES = 4096
CHART_ID = 3
HANDSHAKE = (
    "GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


def rows() -> list[dict[str, object]]:
    """Measure; the reference is the same run's first seconds of memory."""
    with running_system() as system:
        url = f"http://127.0.0.1:{system.ports['viewer']}/ws"
        seconds = WARM_UP_S + MEASURED_S
        readers = subprocess.Popen(
            [sys.executable, "-m", "bench.fanout", url, str(READERS), str(seconds + 3.0)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert readers.stderr is not None
        if readers.stderr.readline().strip() != "ready":
            raise RuntimeError(readers.stderr.read())
        stalled = [_stalled_client(system.ports["viewer"]) for _ in range(STALLED)]
        viewer_pid = system.processes["viewer"].pid
        sent, pss_mb, full = _send(system.ports["udp_a"], system.ports["udp_b"], seconds, viewer_pid, stalled)
        metrics = _metrics(system.ports["viewer"])
        result = json.loads(readers.communicate(timeout=60)[0])
        for client in stalled:
            client.close()
    arrived = {(channel, number): times for channel, number, times in result["pings"]}
    delays_ms = [1000.0 * (t - at_s) for key, at_s in sent.items() for t in arrived.get(key, ())]
    expected = len(sent) * READERS
    return [
        row("fanout_p99_ms", f"{READERS} clients at {PINGS_PER_S} pings/s beside {STALLED} that never read, p99",
            percentile(delays_ms, 99.0), "ms", "<= 50", f"p50 {percentile(delays_ms, 50.0):.1f} ms"),
        row("fanout_lost", "of the readers' messages, lost", float(expected - len(delays_ms)), "messages", "== 0",
            f"of {expected}"),
        row("fanout_stalled_full", "stalled clients whose receive buffer was full", float(full), "clients",
            f"== {STALLED}"),
        row("fanout_drops_counted", "messages dropped for them, as the viewer's metrics say", metrics, "messages",
            ">= 1"),
        row("fanout_memory_growth_mb", "PSS of the viewer, last second against after warm-up", pss_mb[-1] - pss_mb[0],
            "MB", "<= 5", f"{pss_mb[0]:.0f} MB then {pss_mb[-1]:.0f} MB"),
    ]  # fmt: skip


def _send(
    port_a: int, port_b: int, seconds: float, viewer_pid: int, stalled: list[socket.socket]
) -> tuple[dict[tuple[str, int], float], list[float], int]:
    """Pings of both sonars by UDP at the set rate; what was sent when, the viewer's memory, full receive buffers."""
    random = np.random.default_rng(7)
    texture = random.gamma(2.0, 20.0, PING_SAMPLES).clip(0, 255).astype(np.uint8)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sent: dict[tuple[str, int], float] = {}
    pss_mb: list[float] = []
    full = 0
    start = time.monotonic()
    count = int(seconds * PINGS_PER_S)
    for index in range(count):
        wait_s = start + index / PINGS_PER_S - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        number = index // 2
        channel, route, port = (("A", 1, port_a), ("B", 2, port_b))[index % 2]
        sender.sendto(_ping_datagram(texture, number, route), ("127.0.0.1", port))
        if time.monotonic() - start > WARM_UP_S:
            sent[channel, number] = time.monotonic()
            if index % PINGS_PER_S == 0:
                pss_mb.append(process_pss_mb(viewer_pid))
                full = max(full, sum(_unread_bytes(client) > 0 and _is_stuck(client) for client in stalled))
    return sent, pss_mb, full


def _ping_datagram(texture: np.ndarray, number: int, route: int) -> bytes:
    samples = texture.copy()
    digits = np.frombuffer(f"{number:0{NUMBER_DIGITS}d}".encode(), np.uint8) - ord("0")
    samples[: NUMBER_DIGITS * 4] = np.repeat(digits * DIGIT_STEP, 4)
    return b"".join(
        build_frame(
            CHART_ID,
            struct.pack("<3H", at, RESOLUTION_MM, 0) + samples[at : at + CHUNK_SAMPLES].tobytes(),
            route=route,
        )
        for at in range(0, PING_SAMPLES, CHUNK_SAMPLES)
    )


def _stalled_client(port: int) -> socket.socket:
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, STALLED_BUFFER_BYTES)
    client.connect(("127.0.0.1", port))
    client.sendall(HANDSHAKE.encode())
    return client


def _unread_bytes(client: socket.socket) -> int:
    return struct.unpack("i", fcntl.ioctl(client, termios.FIONREAD, b"\0" * 4))[0]


_last_unread: dict[int, int] = {}


def _is_stuck(client: socket.socket) -> bool:
    """Whether the kernel holds as much for this client as a second ago: nothing more fits."""
    unread = _unread_bytes(client)
    stuck = _last_unread.get(client.fileno()) == unread
    _last_unread[client.fileno()] = unread
    return stuck


def _metrics(port: int) -> float:
    """Sum of the viewer's counters of dropped WebSocket messages."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5) as answer:
        lines = answer.read().decode().splitlines()
    return sum(float(line.split()[-1]) for line in lines if "websocket" in line and "dropped" in line)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        pings_only = asyncio.run(run_clients("", sys.argv[1], int(sys.argv[2]), float(sys.argv[3])))
        json.dump(pings_only, sys.stdout)
