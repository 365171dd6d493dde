"""Fit the guess of what the rig's stack reaches, and store it in the package; ten minutes of one processor."""

from __future__ import annotations

from pathlib import Path

from bluerov_slam.evaluation.rig_reach_training import train, write
from bluerov_slam.rig import reach_guess

if __name__ == "__main__":
    network = train()
    with Path(reach_guess.__file__).with_name(reach_guess.FILE).open("wb") as file:
        write(network, file)
