"""A simulated dive with its vehicle's own messages, recorded as the extension records it."""

from __future__ import annotations

from pathlib import Path

from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.records import LinkBytes
from bluerov_slam.simulation.dive import SimulatedDive
from bluerov_slam.simulation.dive_plan import DivePlan
from bluerov_slam.sinks.mcap_recorder import Recorder
from recording_samples import NO_GUARD, FakeClocks

# Afloat under GPS for a good minute, then under water: two minutes and a half in all.
SHORT_DIVE = DivePlan(legs=2, leg_m=25.0, spacing_m=5.0, afloat_first_s=40.0, conditions="calm", depth_m=3.0)


def record_short_dive(folder: Path, seed: int = 3, plan: DivePlan = SHORT_DIVE) -> tuple[Path, SimulatedDive]:
    """The session folder, and the dive with its truth; both count time alike."""
    dive = SimulatedDive(plan, seed)
    clock = FakeClocks(mono_ns=0)
    recorder = Recorder(folder, NO_GUARD, clocks=clock.clocks(), simulated=True)
    decoder = LinkDecoder()
    for received in dive.inputs():
        clock.mono_ns = max(clock.mono_ns, round(received.arrived_s * 1e9))
        decoded = decoder.feed(received.data, received.arrived_s) if isinstance(received, LinkBytes) else []
        for record in (received, *decoded):
            recorder.observe(record)
        recorder.cycle()
    recorder.finish()
    (session,) = folder.glob("session_*")
    return session, dive
