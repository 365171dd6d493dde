"""Which board the simulator runs: the native firmware core where it is built, else the Python reference."""

from __future__ import annotations

import os
from pathlib import Path

from bluerov_slam.errors import ConfigError, LinkError
from bluerov_slam.simulation.board import Board
from bluerov_slam.simulation.reference_board import ReferenceBoard
from bluerov_slam.sources.native_board import NativeBoard

PROGRAM_VARIABLE = "BLUEROV_SLAM_FIRMWARE"
_BUILT_PROGRAM = Path(__file__).resolve().parents[3] / "firmware" / "build" / "brov-firmware"


def native_program() -> Path:
    """Where the native core is expected: as the environment says, else where the checkout builds it."""
    named = os.environ.get(PROGRAM_VARIABLE)
    return Path(named) if named else _BUILT_PROGRAM


def choose_board(firmware: str, legacy: bool) -> tuple[Board, str]:
    """The board, and one line that says which. `legacy`: the user's old firmware, which only the reference plays."""
    program = native_program()
    if legacy:
        if firmware == "native":
            raise ConfigError("--firmware native: the native core does not play the old firmware; use reference")
        return ReferenceBoard(legacy=True), "board: Python reference, as the old firmware"
    if firmware == "reference":
        return ReferenceBoard(), "board: Python reference"
    if firmware == "auto" and not program.exists():
        if os.environ.get(PROGRAM_VARIABLE):
            raise LinkError(f"{PROGRAM_VARIABLE}={program}: there is no such file")
        return ReferenceBoard(), "board: Python reference (no native firmware is built: `make firmware`)"
    return NativeBoard(program), f"board: native firmware core, {program}"
