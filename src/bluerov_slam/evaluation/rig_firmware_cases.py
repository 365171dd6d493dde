"""R9: the rig's firmware against the Python kinematics, and what its kinematics cost a processor.

The angles come from the native program through the real link; the instructions were counted under QEMU. What was not
measured is no number: the row says why and how to get it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.errors import LinkError
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.rig_cases import RigCase, RigRun, figure
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM, FO_SHIP_SERVOS, AxisLimits
from bluerov_slam.rig.limits import PlatformLimits, platform_margins
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.workspace import StackWorkspace

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats

LARGEST_DIFFERENCE_DEG = 0.01
ESP32_HZ = 240e6
CYCLES_PER_INSTRUCTION = 1.5
"""Assumed, as in the firmware's own report: taken branches, loads that are waited for, misses of the flash's cache."""
_STACKS = 200
_SEEN_UNDER_QEMU = "LX106 code under QEMU, no FPU: an upper end for the ESP32"


def firmware(run: RigRun) -> list[Row]:
    """Angles through the link, then the instructions."""
    return [*_angles(run), *_instructions(run)]


def _angles(run: RigRun) -> list[Row]:
    points = _set_points(run.count(_STACKS, 4), run.seed)
    title = f"firmware (native, through its link) - Python: angles of {len(points)} stacks of 24 servos"
    try:
        if run.firmware is None:
            raise LinkError("no firmware was given to this run")
        found = run.firmware.angles_rad(points)
    except LinkError as error:
        return [figure("R9", f"{title}: not measured: {error}", math.nan, "deg", high=LARGEST_DIFFERENCE_DEG)]
    expected = servo_angles_rad(points, FO_SHIP_PLATFORM)
    refused = np.isnan(found).any(axis=(1, 2))
    off = np.degrees(np.abs(found - expected)[~refused])
    worst, rms = (float(np.max(off)), float(np.sqrt(np.mean(off**2)))) if off.size else (math.nan, math.nan)
    return [
        figure("R9", f"{title}: largest difference", worst, "deg", high=LARGEST_DIFFERENCE_DEG),
        figure("R9.rms", f"{title}: rms", rms, "deg"),
        figure("R9.refused", "firmware: reachable stacks that it refused", 100.0 * float(refused.mean()), "%", high=0),
    ]  # fmt: skip


def _set_points(count: int, seed: int) -> Floats:
    """Reachable ones (n, 4, 6): every axis alone at its limits, where that can be reached, then drawn stacks."""
    limits = PlatformLimits.of_servos(FO_SHIP_SERVOS)
    corners = np.concatenate([np.diag(sign * AxisLimits().array()) for sign in (-1.0, 1.0)])
    allowed = [
        platform_margins(corners, each, own).allowed for each, own in zip(FO_SHIP.platforms, limits, strict=True)
    ]
    corners = corners[np.all(allowed, axis=0)]
    drawn, _ = StackWorkspace(FO_SHIP, limits).sample(count, seed)
    return np.concatenate([np.repeat(corners[:, None], len(limits), axis=1), drawn])


def _instructions(run: RigRun) -> list[Row]:
    title = "firmware: instructions of the inverse kinematics, six legs"
    try:
        if run.firmware is None:
            raise LinkError("no firmware was given to this run")
        counts = run.firmware.counts()
    except LinkError as error:
        return [figure("R9.instructions", f"{title}: not measured: {error}", math.nan, "instructions")]
    mean, worst = (counts.get(f"ik_six_legs_{which}", math.nan) for which in ("mean", "worst"))
    return [
        figure("R9.instructions", f"{title}, mean ({_SEEN_UNDER_QEMU})", mean, "instructions"),
        figure("R9.instructions_worst", f"{title}, worst ({_SEEN_UNDER_QEMU})", worst, "instructions"),
        figure("R9.time", f"firmware: estimate of the mean at {ESP32_HZ / 1e6:.0f} MHz, at an assumed "
               f"{CYCLES_PER_INSTRUCTION} cycles an instruction; not run on an ESP32",
               mean * CYCLES_PER_INSTRUCTION / ESP32_HZ * 1e6, "us"),
    ]  # fmt: skip


CASES = (RigCase("R9", "firmware", firmware),)
