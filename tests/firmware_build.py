"""Programs of `firmware/`, built when a test needs them."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parents[1] / "firmware"


def built(program: str) -> Path:
    """`firmware/build/<program>`, up to date; skips the test where there is no C++ compiler."""
    compiler = os.environ.get("CXX", "g++")
    if shutil.which(compiler) is None:
        pytest.skip(f"no C++ compiler here ({compiler}): the firmware cannot be built")
    path = FIRMWARE / "build" / program
    path.parent.mkdir(exist_ok=True)
    with (path.parent / ".lock").open("w") as lock:  # test processes side by side must not build over one another
        fcntl.flock(lock, fcntl.LOCK_EX)
        result = subprocess.run(
            ["make", "-s", "-C", FIRMWARE, f"build/{program}"], capture_output=True, text=True, check=False
        )
    assert result.returncode == 0, result.stderr
    return path
