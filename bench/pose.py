"""Pose latency: from the last serial byte of an IMU burst to the WebSocket message that the navigator made of it.

The link carries what the virtual ESP32 sends on a survey, both sonars included, at its own pace.
"""

from __future__ import annotations

import json
import os
import statistics
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator

import psutil

from bench.live import bare_relay, start_clients
from bench.load import LoadFrame
from bench.system import SLICE_S, System, Written, percentile, process_pss_mb, row, running_system
from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32

BAUD = 115_200
CLIENTS = 10
WARM_UP_S = 15.0
MEASURED_S = float(os.environ.get("BLUEROV_SLAM_BENCH_SECONDS", "60"))
STEP_S = 0.002


def rows() -> list[dict[str, object]]:
    """Run the reference, then the extension with its navigator."""
    reference = bare_relay()
    with running_system(BAUD) as system:
        measured = _measure(system)
    beside = f"bare relay {reference['latency_ms']:.2f} ms"
    count = f"{measured['rate_hz']:.1f} messages a second, median {measured['median_ms']:.2f} ms"
    return [
        row("pose_latency_p99_ms", "last serial byte of an IMU burst to WebSocket, p99", measured["p99_ms"], "ms",
            "<= 20", f"{beside}; {count}"),
        row("navigator_cpu_percent", "navigation worker on a survey", measured["cpu_percent"], "% of a core", "<= 15"),
        row("navigator_memory_mb", "PSS of the navigation worker", measured["pss_mb"], "MB", "<= 80"),
        row("navigator_dropped", "records left out of navigation", measured["dropped"], "records", "== 0"),
    ]  # fmt: skip


def _measure(system: System) -> dict[str, float]:
    seconds = WARM_UP_S + MEASURED_S
    blocks = list(_survey(seconds))
    clients = start_clients(f"http://127.0.0.1:{system.ports['http']}/ws", "", CLIENTS, seconds + 3.0)
    written: list[Written] = []
    cpu_s = wall_s = 0.0
    begin = time.monotonic()
    for due_s, data, frames in blocks:
        while (wait_s := begin + due_s - time.monotonic()) > 0.0:
            time.sleep(min(wait_s, SLICE_S))
        system.write(data)
        at_s = time.monotonic()
        system.drain_host_bytes()
        if due_s < WARM_UP_S:
            continue
        if not wall_s:
            cpu_s, wall_s = _cpu_s(system), at_s
        written += [Written(frame, at_s) for frame in frames]
    cpu_percent = 100.0 * (_cpu_s(system) - cpu_s) / (time.monotonic() - wall_s)
    pss_mb = process_pss_mb(system.worker_pid())
    dropped = _metric(system, "bluerov_slam_navigation_records_dropped_total")
    result = json.loads(clients.communicate(timeout=60)[0])
    delays_ms = _delays_ms(written, result["navigation"])
    return {
        "p99_ms": percentile(delays_ms, 99.0),
        "median_ms": percentile(delays_ms, 50.0),
        "rate_hz": len(delays_ms) / CLIENTS / MEASURED_S,
        "cpu_percent": cpu_percent,
        "pss_mb": pss_mb,
        "dropped": dropped,
    }


def _survey(seconds: float) -> Iterator[tuple[float, bytes, list[LoadFrame]]]:
    """(when, bytes, IMU bursts that they complete) of a vehicle that gets its fix at the surface and dives."""
    board = VirtualEsp32(SCENARIOS["survey"], BAUD)
    decoder = Esp32FrameDecoder()
    for step in range(1, round(seconds / STEP_S) + 1):
        if data := board.advance(step * STEP_S):
            found = [payload for kind, payload in decoder.feed(data) if kind == MessageType.IMU_BURST]
            yield step * STEP_S, data, [LoadFrame(b"", imu_us=_t_us(payload)) for payload in found]


def _t_us(payload: bytes) -> int:
    return int.from_bytes(payload[:4], "little")


def _delays_ms(written: list[Written], messages: list[tuple[float, float]]) -> list[float]:
    """Each message belongs to the burst of its instant; the clocks' offset is what it is for most of them."""
    bursts = [(item.at_s, (item.frame.imu_us or 0) * 1e-6) for item in written]
    offsets = []
    for t, arrived_s in messages:
        before = [device_s for at_s, device_s in bursts if at_s <= arrived_s]
        offsets += [t - before[-1]] if before else []
    offset_s = statistics.median(offsets)
    delays_ms = []
    counts: Counter[float] = Counter()
    for t, arrived_s in sorted(messages, key=lambda message: message[1]):
        counts[t] += 1
        if counts[t] > CLIENTS:  # said again, because nothing newer came
            continue
        at_s, device_s = min(bursts, key=lambda burst: abs(t - offset_s - burst[1]))
        if abs(t - offset_s - device_s) < 0.02:
            delays_ms.append(1000.0 * (arrived_s - at_s))
    return delays_ms


def _cpu_s(system: System) -> float:
    times = psutil.Process(system.worker_pid()).cpu_times()
    return times.user + times.system


def _metric(system: System, name: str) -> float:
    with urllib.request.urlopen(f"http://127.0.0.1:{system.ports['http']}/metrics", timeout=5) as answer:
        for line in answer.read().decode().splitlines():
            if line.startswith(f"{name} "):
                return float(line.split()[1])
    raise RuntimeError(f"no metric {name}")


if __name__ == "__main__":
    for line in rows():
        print(line)
