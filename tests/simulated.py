"""Link bytes of the virtual ESP32 for tests and benches: what a reader of the serial port would have got, and when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bluerov_slam.simulation.faults import Fault, parse_fault
from bluerov_slam.simulation.scenario import SCENARIOS, Scenario
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32


def link_bytes(
    duration_s: float,
    *,
    seed: int = 1,
    baud: int = 115_200,
    faults: Sequence[Fault | str] = (),
    scenario: Scenario | str = "survey",
    step_s: float = 0.01,
) -> list[tuple[float, bytes]]:
    """Blocks `(arrived_s, bytes)` paced by the baud rate, one per step that brought any bytes.

    `faults` take the words of the command line, e.g. "kind=garbage at=2 duration=1". Virtual time starts at 0, the
    vehicle floats at the surface until 20 s; `replace(SCENARIOS["survey"], mission_start_s=60.0)` starts under way.
    """
    base = SCENARIOS[scenario] if isinstance(scenario, str) else scenario
    scripted = tuple(parse_fault(fault) if isinstance(fault, str) else fault for fault in faults)
    board = VirtualEsp32(replace(base, seed=seed, faults=base.faults + scripted), baud)
    blocks: list[tuple[float, bytes]] = []
    for step in range(1, round(duration_s / step_s) + 1):
        data = board.advance(step * step_s)
        if data:
            blocks.append((step * step_s, data))
    return blocks
