"""Memory over a compressed 8-hour session: the bytes of eight full hours, as fast as both services take them."""

from __future__ import annotations

import os
import sys
import time

from bench.live import start_clients
from bench.load import BITS_PER_BYTE, full_load
from bench.system import System, row, running_system

BAUD = 115_200
HOURS = int(os.environ.get("BLUEROV_SLAM_BENCH_HOURS", "8"))
BLOCK_FRAMES = 2000
# The same minutes again and again: what is measured is memory, not the variety of pings.
CLIENT_SECONDS = 3600.0


def rows() -> list[dict[str, object]]:
    """PSS of both services after the first and after the last hour."""
    # The faster baud setting keeps the reader from waiting for bytes that are already there.
    with running_system(
        BAUD,
        BLUEROV_SLAM_SERIAL__BAUD="921600",
        BLUEROV_SLAM_RECORDING__MAX_FILE_MB="64",
    ) as system:
        clients = start_clients(
            f"http://127.0.0.1:{system.ports['http']}/ws", f"http://127.0.0.1:{system.ports['viewer']}/ws", 1,
            CLIENT_SECONDS,
        )  # fmt: skip
        begin = time.monotonic()
        try:
            pss_mb = _session(system)
        finally:
            clients.kill()
            clients.communicate()
        minutes = (time.monotonic() - begin) / 60.0
    note = ", ".join(f"{value:.0f}" for value in pss_mb)
    return [
        row("memory_growth_mb", f"PSS of both services, hour 1 to hour {HOURS} of a compressed session at full load",
            pss_mb[-1] - pss_mb[0], "MB", "<= 5", f"by hour: {note} MB; took {minutes:.0f} min"),
    ]  # fmt: skip


def _session(system: System) -> list[float]:
    """Feed the hours; PSS at the end of each, after a pause in which queues empty."""
    frames = full_load(BAUD)
    pss_mb: list[float] = []
    for hour in range(HOURS):
        left = int(3600 * BAUD / BITS_PER_BYTE)
        while left > 0:
            block = b"".join(next(frames).data for _ in range(BLOCK_FRAMES))
            system.write_waiting(block)
            left -= len(block)
        time.sleep(3.0)
        pss_mb.append(system.pss_mb())
        print(f"# hour {hour + 1}: {pss_mb[-1]:.1f} MB", file=sys.stderr, flush=True)
    return pss_mb


if __name__ == "__main__":
    for line in rows():
        print(line)
