"""How fast a dive is simulated: the truth of 1990 s, and with it every byte of board and autopilot.

Time is the processor time of this process and of the native board's, which take turns: what the clock shows on a quiet
machine, so that other programs do not count.
"""

from __future__ import annotations

import os
from collections.abc import Callable

from bluerov_slam.cli.firmware_choice import native_program
from bluerov_slam.simulation.board import Board
from bluerov_slam.simulation.dive import SimulatedDive
from bluerov_slam.simulation.dive_plan import DIVE_PLANS
from bluerov_slam.simulation.reference_board import ReferenceBoard
from bluerov_slam.sources.native_board import NativeBoard

_PLAN = DIVE_PLANS["n4"]
_MUST = 100.0
_SEED = 3


def rows() -> list[dict[str, object]]:
    """One row per board that is there; only the native one has a target."""
    found = [_row("sim.reference", "Python reference board", ReferenceBoard, 0.0)]
    if native_program().exists():
        found.insert(0, _row("sim.native", "native board", lambda: NativeBoard(native_program()), _MUST))
    return found


def _row(name: str, board: str, make_board: Callable[[], Board], must: float) -> dict[str, object]:
    begin_s = _processor_s()
    dive = SimulatedDive(_PLAN, _SEED, make_board())
    flown_s = _processor_s() - begin_s
    items = sum(1 for _ in dive.inputs())
    all_s = _processor_s() - begin_s
    speed = dive.truth.end_s / (all_s - flown_s)
    return {
        "id": name,
        "name": f"Simulated dive with DVL, without sonars: inputs, {board}",
        "value": round(speed),
        "unit": "x real time",
        "must": f">= {must:g}" if must else "-",
        "met": speed >= must,
        "reference": f"{items} inputs of {dive.truth.end_s:.0f} s; truth in {flown_s:.1f} s; together "
        f"{dive.truth.end_s / all_s:.0f} x",
    }


def _processor_s() -> float:
    """Of this process and of all it started that have ended."""
    return sum(os.times()[:4])
