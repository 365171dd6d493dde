"""Recording at full load: every byte written to the link must be in the recording."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

from bench.__main__ import table
from bench.load import full_load
from bench.system import row, running_system
from bluerov_slam.sources.recording_reader import open_recording

BAUD = 921_600
MEASURED_S = float(os.environ.get("BLUEROV_SLAM_BENCH_SECONDS", "60"))


def rows() -> list[dict[str, object]]:
    """Feed a real extension through a real pseudo-terminal at 921600 baud; compare byte for byte."""
    written = bytearray()
    with running_system(BAUD, BLUEROV_SLAM_RECORDING__MIN_FREE_MB="10") as system:
        cpu_s = system.cpu_s()
        for item in system.feed(full_load(BAUD), MEASURED_S):
            written += item.frame.data
            system.drain_host_bytes()
        cpu_percent = 100.0 * (system.cpu_s() - cpu_s) / MEASURED_S
        lost_on_wire = system.dropped_bytes
        recorder_dropped = system.get("http", "/api/state")["recorder"]["dropped"]
        extension = system.processes["extension"]
        extension.terminate()
        extension.wait(20)
        recorded = recorded_bytes(system.folder)
        disk = sum(path.stat().st_size for path in system.folder.rglob("*.mcap"))
    lost = missing_bytes(bytes(written), recorded) + recorder_dropped
    reference = (
        f"of {len(written)}; {disk / len(written):.2f} bytes on disk per byte; pty refused {lost_on_wire}; "
        f"both services {cpu_percent:.1f} % of a core"
    )
    return [row("recorded_bytes_lost", f"recording at {BAUD} full load, {MEASURED_S:.0f} s", lost, "bytes", "== 0",
                reference)]  # fmt: skip


def recorded_bytes(folder: Path) -> bytes:
    """The raw link of the one session below `folder`."""
    (session,) = folder.rglob("session_*/session.json")
    return b"".join(block.data for block in open_recording(session.parent).blocks())


def missing_bytes(written: bytes, recorded: bytes) -> int:
    """0 when the recording is what was written, byte for byte; otherwise how much of it is wrong."""
    if hashlib.sha256(written).digest() == hashlib.sha256(recorded).digest():
        return 0
    same = next((i for i, (a, b) in enumerate(zip(written, recorded, strict=False)) if a != b), None)
    if same is None:
        return abs(len(written) - len(recorded))
    return max(len(written) - same, 1)


if __name__ == "__main__":
    results = rows()
    print(table(results))
    sys.exit(0 if all(result["met"] for result in results) else 1)
