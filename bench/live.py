"""Latency, CPU, memory and loss of the two real services at full link load with ten clients on each page."""

from __future__ import annotations

import json
import os
import pty
import signal
import socket
import subprocess
import sys
import time
import tty

import psutil

from bench.load import BITS_PER_BYTE, full_load
from bench.system import SLICE_S, System, percentile, row, running_system

BAUD = 115_200
CLIENTS = 10
WARM_UP_S = 8.0
MEASURED_S = float(os.environ.get("BLUEROV_SLAM_BENCH_SECONDS", "60"))
REFERENCE_S = 20.0


def rows() -> list[dict[str, object]]:
    """Run both sides one after the other and compare."""
    reference = bare_relay()
    with running_system(BAUD, BLUEROV_SLAM_FORWARDING__TARGETS='["127.0.0.1"]') as system:
        measured = _load(system)
    ratio = measured["latency_ms"] / reference["latency_ms"]
    return [
        row(
            "latency_p99_ms", "last serial byte to WebSocket, p99", measured["latency_ms"], "ms", "<= 5",
            f"bare relay {reference['latency_ms']:.2f} ms, ratio {ratio:.2f}",
        ),
        row("waterfall_latency_p99_ms", "last serial byte of a ping to viewer's WebSocket, p99",
            measured["waterfall_ms"], "ms", "<= 20", f"bare relay {reference['latency_ms']:.2f} ms"),
        row("cpu_percent", "both services at full load, ten clients on each page", measured["cpu_percent"],
            "% of a core", "<= 6", f"bare relay {reference['cpu_percent']:.2f} %"),
        row("memory_mb", "PSS of both services", measured["pss_mb"], "MB", "<= 200"),
        row("sensors_lost", "SENSORS frames lost at a saturated link", measured["sensors_lost"], "frames", "== 0",
            f"of {measured['sensors_sent']}; pings lost {measured['pings_lost']:.0f} of {measured['pings_sent']}"),
    ]  # fmt: skip


def _load(system: System) -> dict[str, float]:
    seconds = WARM_UP_S + MEASURED_S
    clients = start_clients(
        f"http://127.0.0.1:{system.ports['http']}/ws",
        f"http://127.0.0.1:{system.ports['viewer']}/ws",
        CLIENTS,
        seconds + 3.0,
    )
    written, cpu_start_s, wall_start_s = [], 0.0, 0.0
    begin = time.monotonic()
    for item in system.feed(full_load(BAUD), seconds):
        system.drain_host_bytes()
        if item.at_s - begin < WARM_UP_S:
            continue
        if not written:
            cpu_start_s, wall_start_s = system.cpu_s(), time.monotonic()
        written.append(item)
    cpu_percent = 100.0 * (system.cpu_s() - cpu_start_s) / (time.monotonic() - wall_start_s)
    pss_mb = system.pss_mb()
    result = json.loads(clients.communicate(timeout=60)[0])
    sensors = dict(result["sensors"])
    pings = {(channel, number): times for channel, number, times in result["pings"]}
    sensors_sent = {w.frame.sensors_ms: w.at_s for w in written if w.frame.sensors_ms is not None}
    pings_sent = {(str(w.frame.ping[0]), w.frame.ping[1]): w.at_s for w in written if w.frame.ping is not None}
    return {
        "latency_ms": percentile(_delays_ms(sensors_sent, sensors), 99.0),
        "waterfall_ms": percentile(_delays_ms(pings_sent, pings), 99.0),
        "cpu_percent": cpu_percent,
        "pss_mb": pss_mb,
        "sensors_sent": len(sensors_sent),
        "sensors_lost": sum(CLIENTS - len(sensors.get(key, ())) for key in sensors_sent) / CLIENTS,
        "pings_sent": len(pings_sent),
        "pings_lost": sum(CLIENTS - len(pings.get(key, ())) for key in pings_sent) / CLIENTS,
    }


def bare_relay() -> dict[str, float]:
    """The same clients on the reference."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    relay = subprocess.Popen([sys.executable, "-m", "bench.bare_relay", os.ttyname(slave), str(port)])
    try:
        url = f"http://127.0.0.1:{port}/ws"
        _wait_for_port(port)
        clients = start_clients(url, "", 2 * CLIENTS, REFERENCE_S + 3.0)
        sent, start, due = {}, time.monotonic(), 0
        cpu_start = psutil.Process(relay.pid).cpu_times()
        for frame in full_load(BAUD):
            due += len(frame.data)
            while (time.monotonic() - start) * BAUD / BITS_PER_BYTE < due:
                time.sleep(SLICE_S)
            os.write(master, frame.data)
            if frame.sensors_ms is not None:
                sent[frame.sensors_ms] = time.monotonic()
            if time.monotonic() - start > REFERENCE_S:
                break
        cpu = psutil.Process(relay.pid).cpu_times()
        result = json.loads(clients.communicate(timeout=60)[0])
    finally:
        relay.send_signal(signal.SIGTERM)
        relay.wait(10)
        os.close(master)
        os.close(slave)
    return {
        "latency_ms": percentile(_delays_ms(sent, dict(result["sensors"])), 99.0),
        "cpu_percent": 100.0 * (cpu.user + cpu.system - cpu_start.user - cpu_start.system) / REFERENCE_S,
    }


def _delays_ms(sent: dict, arrived: dict) -> list[float]:
    return [1000.0 * (at_s - sent[key]) for key, times in arrived.items() if key in sent for at_s in times]


def start_clients(sensors_url: str, pings_url: str, count: int, seconds: float) -> subprocess.Popen[str]:
    """Bench clients in a process of their own, all connected when this returns."""
    process = subprocess.Popen(
        [sys.executable, "-m", "bench.clients", sensors_url, pings_url, str(count), str(seconds)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    line = process.stderr.readline()
    if line.strip() != "ready":
        raise RuntimeError(f"the clients did not start: {line}{process.stderr.read()}")
    return process


def _wait_for_port(port: int) -> None:
    for _ in range(100):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise RuntimeError("the reference did not start")


if __name__ == "__main__":
    for line in rows():
        print(line)
