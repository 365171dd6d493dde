"""Where the real recordings lie. They are never committed: a test that needs one skips, with its reason, without it."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("BLUEROV_SLAM_DATA", Path(__file__).parents[2] / "shared" / "data"))
NEEDS = "needs the recording"


def recording(*parts: str) -> Path:
    """The path of a real recording; skips the test where it is not."""
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"{NEEDS} {path} (set BLUEROV_SLAM_DATA)")
    return path
