"""R1 to R4: kinematics there and back, the truth of real logs, pose uncertainty against rigs built at random."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.rig_cases import RigCase, RigRun, figure
from bluerov_slam.evaluation.rig_experiment import TOLD_SPREAD
from bluerov_slam.evaluation.thesis_checks import check_truth
from bluerov_slam.rig.collection_truth import truth_spread
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM, ManufacturingSpread
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import joints_mm, published_servo_angles_rad, servo_angles_rad
from bluerov_slam.rig.stack import stack_pose
from bluerov_slam.rig.uncertainty import pose_covariance, sample_poses
from bluerov_slam.rig.validation import stated_spread
from bluerov_slam.rig.workspace import PlatformWorkspace

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats

_POSES, _COMMANDS, _STACKS, _RIGS = 100_000, 20_000, 10, 4_000
_RIGS_ALONE = 1_000
_LEAST_RATIO, _MOST_RATIO = 0.9, 1.15
_LOG_TOLERANCE_MM = 0.0101


def round_trip(run: RigRun) -> list[Row]:
    """Set points to servo angles and back, and the branch of the published quadratic."""
    points = PlatformWorkspace().sample(run.count(_POSES, 100), run.seed)
    angles = servo_angles_rad(points, FO_SHIP_PLATFORM)
    found = plate_pose(angles, FO_SHIP_PLATFORM)
    radius = float(FO_SHIP_PLATFORM.plate_radius_mm)
    miss = np.abs(found.set_point - points) * np.array([1.0, 1.0, 1.0, radius, radius, radius])
    joints = joints_mm(points, FO_SHIP_PLATFORM)
    rods = np.linalg.norm(joints.plate_mm - joints.arm_ends_mm, axis=-1)
    published = np.abs(published_servo_angles_rad(points, FO_SHIP_PLATFORM) - angles)
    return [
        figure("R1", "inverse and forward: worst miss (turns at the plate's joints)", _worst(miss), "mm", high=1e-9),
        figure("R1.rods", "inverse: worst error of a rod's length", _worst(np.abs(rods - 106.0)), "mm", high=1e-9),
        figure("R1.branch", "inverse: worst difference from the published quadratic, put right",
               math.degrees(_worst(published)), "deg", high=1e-6),
    ]  # fmt: skip


def convergence(run: RigRun) -> list[Row]:
    """The forward solution inside the workspace, and for any servo angles within a quarter turn."""
    points = PlatformWorkspace().sample(run.count(_POSES, 100), run.seed + 1)
    found = plate_pose(servo_angles_rad(points, FO_SHIP_PLATFORM), FO_SHIP_PLATFORM)
    right = found.converged & (np.max(np.abs(found.set_point - points), axis=-1) < 1e-6)
    random = np.random.default_rng(run.seed)
    commands = random.uniform(-0.5 * np.pi, 0.5 * np.pi, (run.count(_COMMANDS, 100), 6))
    any_command = plate_pose(commands, FO_SHIP_PLATFORM)
    return [
        figure("R2", "forward: found, of reachable poses", 100.0 * float(np.mean(right)), "%", low=100.0),
        figure("R2.condition", "forward: worst condition number of those", _worst(found.condition), "1"),
        figure("R2.commands", "forward: assembled, of random servo angles within 90 deg",
               100.0 * float(np.mean(any_command.converged)), "%"),
    ]  # fmt: skip


def logged_truth(run: RigRun) -> list[Row]:
    """R3: the truth of the thesis's 27 logs, by the kinematics of equal platforms."""
    found = check_truth(run.logs, _LOG_TOLERANCE_MM)
    return [
        figure("R3", f"truth of {len(run.logs)} real logs: RMS on each axis", found.rms_mm, "mm", high=0.005),
        figure("R3.rows", f"rows of {found.rows} reproduced to 0.01 mm", 100.0 * found.met / found.rows, "%", low=98.0),
    ]


def covariance(run: RigRun) -> list[Row]:
    """Scatter of rigs built at random, whitened by the covariance that the derivatives give: 1 in every direction."""
    spread = stated_spread()
    points = PlatformWorkspace().sample(4 * _STACKS, run.seed + 2).reshape(_STACKS, 4, 6)
    count = run.count(_RIGS, 500)
    ratios = []
    for k, stack in enumerate(points):
        nominal, made = stack_pose(stack, FO_SHIP), sample_poses(stack, FO_SHIP, spread, count, run.seed + k)
        rest = made.rotation @ nominal.rotation.T
        turn = 0.5 * np.stack([rest[:, i, j] - rest[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1)
        errors = np.concatenate([made.position_mm - nominal.position_mm, turn], axis=-1)
        white = np.linalg.solve(np.linalg.cholesky(pose_covariance(stack, FO_SHIP, spread)), errors.T)
        ratios.append(np.linalg.eigvalsh(white @ white.T / count))
    # Extreme directions of a sample of `count` in six dimensions lie about sqrt(6 / count) off either way, twice over.
    band = 4.0 * math.sqrt(6.0 / count)
    return [
        figure("R4.most", "pose covariance: most scatter in any direction, of that told", float(np.max(ratios)), "1",
               high=1.0 + band),
        figure("R4.least", "pose covariance: least scatter in any direction, of that told", float(np.min(ratios)), "1",
               low=1.0 - band),
        *_sources_alone(run),
    ]  # fmt: skip


def _sources_alone(run: RigRun) -> list[Row]:
    """Each source of errors by itself, and all, of the simulated make and of the thesis's rig: scatter over told."""
    poses, count = run.count(_STACKS, 3), run.count(_RIGS_ALONE, 500)
    points = PlatformWorkspace().sample(4 * poses, run.seed + 3).reshape(poses, 4, 6)
    sources = {
        each.name: ManufacturingSpread(**{each.name: getattr(TOLD_SPREAD, each.name)})
        for each in fields(TOLD_SPREAD)
        if np.any(getattr(TOLD_SPREAD, each.name))
    }
    rows = []
    for name, spread in (sources | {"all": TOLD_SPREAD, "fo_ship": truth_spread()}).items():
        ratios = [_told_ratio(stack, spread, count, run.seed + k) for k, stack in enumerate(points)]
        what = {"all": "all of the simulated make", "fo_ship": "all of the thesis's rig"}.get(name, f"{name} alone")
        told = f"pose covariance over the workspace, {what}: scatter of rigs / deviation told"
        rows += [
            figure(f"R4.{name}.most", f"{told}, place or turn, most of {poses} poses", float(np.max(ratios)), "1",
                   high=_MOST_RATIO),
            figure(f"R4.{name}.least", f"{told}, place or turn, least", float(np.min(ratios)), "1", low=_LEAST_RATIO),
        ]  # fmt: skip
    return rows


def _told_ratio(stack: Floats, spread: ManufacturingSpread, count: int, seed: int) -> list[float]:
    """3-D deviation of places, and of turns where there are any, over what the derivatives say."""
    nominal, made = stack_pose(stack, FO_SHIP), sample_poses(stack, FO_SHIP, spread, count, seed)
    told = np.diag(pose_covariance(stack, FO_SHIP, spread))
    off = made.position_mm - nominal.position_mm
    found = [math.sqrt(float(np.mean(np.sum(off**2, axis=1)) / np.sum(told[:3])))]
    if np.sum(told[3:]) > 0.0:
        rest = made.rotation @ nominal.rotation.T
        turn = np.arccos(np.clip(0.5 * (np.trace(rest, axis1=1, axis2=2) - 1.0), -1.0, 1.0))
        found.append(math.sqrt(float(np.mean(turn**2) / np.sum(told[3:]))))
    return found


def _worst(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """NaN if any is."""
    return float(np.max(values))


CASES = (
    RigCase("R1", "servo angles and back", round_trip),
    RigCase("R2", "forward kinematics", convergence),
    RigCase("R3", "truth of the thesis's logs", logged_truth, needs_logs=True),
    RigCase("R4", "pose uncertainty", covariance),
)
