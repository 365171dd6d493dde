"""A simulated dive recorded as the extension records it: the decoder beside the recorder, on the same bytes."""

from __future__ import annotations

from pathlib import Path

from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.records import LinkBytes, Record
from bluerov_slam.sinks.mcap_recorder import Recorder, RecordingLimits
from recording_samples import NO_GUARD, FakeClocks
from simulated import link_bytes


def to_whole_ns(seconds: float) -> float:
    """As time.monotonic() would have read it."""
    return round(seconds * 1e9) / 1e9


def record_dive(
    folder: Path, duration_s: float = 30.0, limits: RecordingLimits = NO_GUARD, **simulation: object
) -> tuple[Path, list[LinkBytes], list[Record]]:
    """Record a simulated dive below `folder`; the session folder, every block and every record of the live run."""
    clock = FakeClocks(mono_ns=1_000_000_000)
    recorder = Recorder(folder, limits, clocks=clock.clocks())
    decoder = LinkDecoder()
    blocks: list[LinkBytes] = []
    records: list[Record] = []
    for at_s, data in link_bytes(duration_s, **simulation):  # type: ignore[arg-type]
        block = LinkBytes(data, to_whole_ns(1.0 + at_s))
        clock.mono_ns = round(block.arrived_s * 1e9)
        blocks.append(block)
        decoded = decoder.feed(data, block.arrived_s)
        records += decoded
        for record in (block, *decoded):
            recorder.observe(record)
        recorder.cycle()
    recorder.finish()
    records += decoder.finish()
    (session,) = folder.glob("session_*")
    return session, blocks, records
