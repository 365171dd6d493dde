"""Programs of `firmware/`, built when a test needs them."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
from functools import lru_cache
from pathlib import Path

import pytest

from bluerov_slam.simulation.board import Board
from bluerov_slam.simulation.reference_board import ReferenceBoard
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.sources.native_board import NativeBoard

FIRMWARE = Path(__file__).parents[1] / "firmware"
_COMPILER = os.environ.get("CXX", "g++")


def board_in_the_loop(scenario: Scenario) -> Board:
    """The native firmware for a test of the whole system; the reference as the old one, or without a compiler."""
    if scenario.legacy or not _has_compiler():
        return ReferenceBoard(legacy=scenario.legacy)
    return NativeBoard(built("brov-firmware"))


def _has_compiler() -> bool:
    return shutil.which(_COMPILER) is not None


@lru_cache
def built(program: str) -> Path:
    """`firmware/build/<program>`, up to date; skips the test where there is no C++ compiler."""
    if not _has_compiler():
        pytest.skip(f"no C++ compiler here ({_COMPILER}): the firmware cannot be built")
    path = FIRMWARE / "build" / program
    path.parent.mkdir(exist_ok=True)
    with (path.parent / ".lock").open("w") as lock:  # test processes side by side must not build over one another
        fcntl.flock(lock, fcntl.LOCK_EX)
        result = subprocess.run(
            ["make", "-s", "-C", FIRMWARE, f"build/{program}"], capture_output=True, text=True, check=False
        )
    assert result.returncode == 0, result.stderr
    return path
