"""R12: is the truth's stated uncertainty honest? Simulated rigs, each in a session of its own, and where they were.

Of every session one pose is scored, drawn at random: rigs are independent of each other, poses of one rig are not. So
the squared errors over their covariance are sums of chi-squares of three, and their mean has the interval that these
have, widened by that of the rigs whose scatter the truth was told. Scored are places, and ways from home (what the
thesis calls displacement), which share the rig's build.

The rig's figures are the simulator's, the instrument's those below; the truth is told what the rig's make and the
thesis's real logs say (`rig_experiment.TOLD_SPREAD`, `collection_truth.ATTITUDE`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.acoustic_cases import share_row
from bluerov_slam.evaluation.navigation_table import Row, Target
from bluerov_slam.evaluation.rig_cases import RigCase, RigRun, figure
from bluerov_slam.evaluation.rig_experiment import TOLD_RIGS, TOLD_SPREAD
from bluerov_slam.evaluation.statistics import bootstrap
from bluerov_slam.geometry.platform_stack import PLATFORMS
from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.navigation.rotation import exp_so3
from bluerov_slam.rig.collection import set_point_of
from bluerov_slam.rig.collection_truth import ATTITUDE, counted_set_points, truth_spread
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.session_truth import SessionTruth
from bluerov_slam.rig.tool_truth import tool_truth
from bluerov_slam.rig.workspace import PlatformWorkspace
from bluerov_slam.simulation.noise_processes import GaussMarkov
from bluerov_slam.simulation.rig import RigFigures, SimulatedRig
from bluerov_slam.simulation.rig_receiver import euler_rad

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, ManufacturingSpread

_RIGS, _OTHER_RIGS = 300, 100
_THESIS_POSES = (
    ("A", (24.0, 12.0, -12.0, -24.0)), ("B", (16.0, 4.0, -8.0)), ("C", (16.0, 0.0, -16.0)),
    ("X", (20.0, 0.0, -20.0)), ("Y", (20.0, 0.0, -20.0)), ("Z", (64.0, 32.0, -32.0, -64.0)),
)  # fmt: skip
"""The ranges of the thesis's tests, sums of four platforms in mm and degrees, in fewer steps."""
_SCATTERED = 20
"""Poses at which every platform stands somewhere else, within their reach drawn nearer home by:"""
_NEARER = 0.6
_NOISE_RAD = np.radians([0.04, 0.04, 0.06])
_WANDER_RAD = np.radians([0.10, 0.10, 0.46])
_WANDER_S, _POSE_S = 60.0, 5.0
_SEAT_RAD = np.radians([0.2, 0.2, 0.0])
_STEPS, _STEP_S = 6, 0.05


@dataclass(frozen=True, slots=True)
class _Scored:
    """Of one pose: errors (3,) mm with covariances of place, of the way from home, and of the pose without a memory."""

    place: tuple[Floats, Floats]
    way: tuple[Floats, Floats]
    alone: tuple[Floats, Floats]
    largest_way_mm: float


def thesis_poses(_: np.random.Generator) -> list[Floats]:
    """Set points (platforms, 6): all platforms alike, one axis at a time."""
    return [np.tile(set_point_of(axis, value), (PLATFORMS, 1)) for axis, values in _THESIS_POSES for value in values]


def scattered_poses(random: np.random.Generator) -> list[Floats]:
    """Set points (platforms, 6): every platform somewhere else within reach."""
    drawn = PlatformWorkspace().sample(PLATFORMS * _SCATTERED, int(random.integers(1 << 31)))
    return list(_NEARER * drawn.reshape(_SCATTERED, PLATFORMS, 6))


def score(
    seed: int, spread: ManufacturingSpread, scattered: bool = False, figures: RigFigures | None = None
) -> _Scored:
    """One rig's session from home on, up to the pose that is scored."""
    random = np.random.default_rng([seed, 0x712])
    rig = SimulatedRig(seed, figures)
    truth = SessionTruth(FO_SHIP, spread, ATTITUDE)
    poses = [np.zeros((PLATFORMS, 6)), *(scattered_poses(random) if scattered else thesis_poses(random))]
    last = int(random.integers(1, len(poses)))
    wander = GaussMarkov(random, list(_WANDER_RAD), _WANDER_S)
    home = rig.pose
    # The board says zero where it is started, whatever the rig's yaw, its compass's error of that moment included.
    start = euler_rad(home.rotation)[2] + wander.at(0.0)[2]
    seat = exp_so3(_SEAT_RAD * random.standard_normal(3))
    for k, points in enumerate(poses[: last + 1]):
        if k:
            rig.move(poses[k - 1], points, _STEPS, _STEP_S)
        off = wander.at(_POSE_S * (k + 1)) + _NOISE_RAD * random.standard_normal(3)
        seen = exp_so3(np.array([0.0, 0.0, -start])) @ exp_so3(off) @ rig.pose.rotation @ seat
        counted = counted_set_points(points)
        found = truth.take(counted, seen)
    way, way_covariance = truth.since_first()
    std = np.sqrt(sum(np.square(each) for each in (ATTITUDE.noise_rad, ATTITUDE.wander_rad, ATTITUDE.seat_rad)))
    alone = tool_truth(counted, seen, std, FO_SHIP, spread)
    real = rig.pose.position_mm
    true_way = real - home.position_mm
    return _Scored(
        (found.position_mm - real, found.covariance[:3, :3]),
        (way - true_way, way_covariance),
        (alone.position_mm - real, alone.covariance[:3, :3]),
        float(np.linalg.norm(true_way)),
    )


def honest_truth(run: RigRun) -> list[Row]:
    """Rigs of the make that the truth was told of, on the thesis's motions and all over the workspace."""
    rows = []
    for place, what, scattered in (
        ("R12", "thesis's motions", False),
        ("R12.far", "platforms all over their reach", True),
    ):
        scored = [score(run.seed + k, TOLD_SPREAD, scattered) for k in range(run.count(_RIGS, 10))]
        rows += _judged(place, f"truth (simulated), {what}: place", [each.place for each in scored])
        rows += _judged(f"{place}.way", f"truth (simulated), {what}: way from home", [each.way for each in scored])
        if not scattered:
            rows += _told(f"{place}.alone", "truth of each pose by itself (simulated)", [each.alone for each in scored])
    rows += _others(run)
    return rows


def _others(run: RigRun) -> list[Row]:
    """What is stated where the truth was told of another make than the rig is."""
    count, rows = run.count(_OTHER_RIGS, 5), []
    for place, share in (("better", 1.0 / 1.5), ("worse", 1.5)):
        figures = RigFigures()
        scaled = {each.name: getattr(figures, each.name) * share for each in fields(figures)}
        made = replace(figures, **{**scaled, "speed_radps": figures.speed_radps})
        scored = [score(run.seed + k, TOLD_SPREAD, figures=made) for k in range(count)]
        what = f"rigs with {share:.2g} of the errors told (simulated)"
        rows += _told(f"R12.{place}", f"{what}: place", [each.place for each in scored])
        rows += _told(f"R12.{place}.way", f"{what}: way from home", [each.way for each in scored])
    scored = [score(run.seed + k, truth_spread()) for k in range(count)]
    what = "simulated rigs, told of the thesis's rig instead"
    rows += _told("R12.published", f"{what}: place", [each.place for each in scored])
    rows += _told("R12.published.way", f"{what}: way from home", [each.way for each in scored])
    return rows


def _squares(scored: list[tuple[Floats, Floats]]) -> Floats:
    return np.array([error @ np.linalg.solve(covariance, error) for error, covariance in scored])


def _judged(place: str, what: str, scored: list[tuple[Floats, Floats]]) -> list[Row]:
    squares = _squares(scored)
    dof = 3.0 / (1.0 / len(squares) + 1.0 / TOLD_RIGS)
    interval = Target(chi_square_quantile(0.025, dof) / dof, chi_square_quantile(0.975, dof) / dof)
    inside = float(np.mean(squares <= chi_square_quantile(0.95, 3.0)))
    mean = bootstrap(squares / 3.0, lambda values: np.mean(values, axis=-1))
    count = len(squares)
    return [
        Row(
            f"{place}.nees",
            f"{what}, {count} rigs: NEES per coordinate (must: 95 % interval of so many)",
            mean,
            "1",
            interval,
        ),
        figure(f"{place}.cover", f"{what}: inside its 95 % region", 100.0 * inside, "%", low=90.0, high=98.0),
        *_sizes(place, what, scored),
    ]


def _told(place: str, what: str, scored: list[tuple[Floats, Floats]]) -> list[Row]:
    squares = _squares(scored)
    outside = squares > chi_square_quantile(0.95, 3.0)
    mean = bootstrap(squares / 3.0, lambda values: np.mean(values, axis=-1))
    return [
        Row(f"{place}.nees", f"{what}: NEES per coordinate", mean, "1"),
        share_row(f"{place}.outside", f"{what}: outside the 95 % region", outside, None),
        *_sizes(place, what, scored),
    ]


def _sizes(place: str, what: str, scored: list[tuple[Floats, Floats]]) -> list[Row]:
    rms = math.sqrt(float(np.mean([error @ error for error, _ in scored])))
    stated = math.sqrt(float(np.mean([np.trace(covariance) for _, covariance in scored])))
    return [
        figure(f"{place}.rms", f"{what}: RMS error, 3-D", rms, "mm"),
        figure(f"{place}.stated", f"{what}: stated deviation, 3-D", stated, "mm"),
    ]


CASES = (RigCase("R12", "honest truth", honest_truth),)
