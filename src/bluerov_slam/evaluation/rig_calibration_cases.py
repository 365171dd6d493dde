"""R5, R6, R10, R11: table 2.4, gauge, servo test and identification of the ground-truth rig."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.acoustic_cases import share_row
from bluerov_slam.evaluation.navigation_table import Row, Target
from bluerov_slam.evaluation.rig_cases import RigCase, RigRun, figure
from bluerov_slam.evaluation.statistics import bootstrap
from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.navigation.rotation import exp_so3
from bluerov_slam.rig.dimensions import FO_SHIP, LEGS, AxisLimits
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.gauge import largest_misalignment_rad, misalignment_branches, servo_errors, worst_case
from bluerov_slam.rig.identification import PRIOR_STD, MeasuredPoses, Parameter, identify, parameters_of
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.servo_test import Servo, ServoFinding, ServoTest
from bluerov_slam.rig.stack import stack_pose
from bluerov_slam.rig.validation import (
    TABLE_2_4,
    Prediction,
    logged_spread,
    predict,
    published_error_mm,
    stated_spread,
    told_attitude,
)

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions

PUBLISHED_GAUGE_DEG = 3.7
_PUBLISHED_ROUNDING_DEG = 0.05
_ROUNDING_MM = math.sqrt(3.0) * 0.5
"""The furthest that a place printed in whole millimetres may be from what was meant."""


def gauge(run: RigRun) -> list[Row]:
    """The published angle again, and what it means for one servo."""
    published = math.degrees(largest_misalignment_rad())
    worst, _ = worst_case()
    errors = servo_errors()
    physical = sum(root.physical for root in misalignment_branches())
    return [
        figure("R6", "gauge: |angle between horns - published 3.7 deg|", abs(published - PUBLISHED_GAUGE_DEG), "deg",
               high=_PUBLISHED_ROUNDING_DEG),
        figure("R6.roots", "gauge: roots of the published equation that are physical", physical, "1", 1, 1),
        figure("R6.worst", "gauge: worst angle between horns over the stated ranges", math.degrees(worst), "deg"),
        figure("R6.servo", "gauge: worst error of one servo (gauge free to tilt)", math.degrees(errors.one_servo_rad),
               "deg"),
        figure("R6.opposite", "gauge: worst error of servos turned oppositely", math.degrees(errors.opposite_rad),
               "deg"),
        figure("R6.std", "gauge: standard deviation of one servo that passed",
               math.degrees(math.sqrt(errors.covariance_rad2[0, 0])), "deg"),
    ]  # fmt: skip


def table_2_4(run: RigRun) -> list[Row]:
    """R5: the published validation, with what is stated and with the deviation that the real logs show."""
    told = [told_attitude(place) for place in TABLE_2_4]
    rounding = max(each.residual_mm for each in told)
    logged, about = logged_spread(), logged_spread(about_logged=True)
    ways: dict[str, list[Prediction]] = {
        "set points, stated tolerances": [predict(each, stated_spread(), with_attitude=False) for each in TABLE_2_4],
        "set points, gains as uncertain as logged": [predict(each, logged, with_attitude=False) for each in TABLE_2_4],
        "with the IMU, stated tolerances": [predict(each, stated_spread()) for each in TABLE_2_4],
        "with the IMU, gains as uncertain as logged": [predict(each, logged) for each in TABLE_2_4],
        "set points with the logs' gains": [
            predict(each, about, with_attitude=False, as_logged=True) for each in TABLE_2_4
        ],
        "with the IMU and the logs' gains": [predict(each, about, as_logged=True) for each in TABLE_2_4],
    }
    rows = [
        figure("R5", "table 2.4 (real): an attitude gives each published estimate, worst distance", rounding, "mm",
               high=_ROUNDING_MM),
        figure("R5.published", "table 2.4 (real): mean error as published",
               float(np.mean([published_error_mm(each) for each in TABLE_2_4])), "mm"),
    ]  # fmt: skip
    for number, (way, found) in enumerate(ways.items(), start=1):
        outside = [each.place.name for each in found if not each.inside]
        names = "all" if len(outside) == len(found) else ", ".join(outside) or "none"
        rows += [
            figure(f"R5.{number}", f"table 2.4 (real), {way}: of 8 measured places inside the 95 % region "
                   f"(outside: {names})", sum(each.inside for each in found), "1"),
            figure(f"R5.{number}.miss", f"table 2.4 (real), {way}: mean distance from the measured place",
                   float(np.mean([each.distance_mm for each in found])), "mm"),
            figure(f"R5.{number}.nees",
                   f"table 2.4 (real), {way}: squared miss / covariance of a coordinate (1: as told)",
                   float(np.mean([each.squared for each in found])) / 3.0, "1"),
        ]  # fmt: skip
    return rows


@dataclass(frozen=True, slots=True, eq=False)
class RealRig:
    """A rig otherwise than drawn, with figures of its own: dimensions, servos' gains and zeros, the IMU's seat."""

    dimensions: StackDimensions
    gain: Floats
    zero_rad: Floats
    mount: Floats


SLOP_RAD, IMU_RAD = float(np.radians(0.25)), float(np.radians(0.1))


def drawn_rig(random: np.random.Generator) -> RealRig:
    def around(values: Floats, deviation: float) -> Floats:
        return values + deviation * random.standard_normal(np.shape(values))

    platforms = tuple(
        replace(
            each,
            base_joints_mm=around(each.base_joints_mm, 0.2),
            plate_joints_mm=around(each.plate_joints_mm, 0.2),
            arm_mm=around(each.arm_mm, 0.2),
            rod_mm=around(each.rod_mm, 0.2),
        )
        for each in FO_SHIP.platforms
    )
    count = len(platforms)
    gain = (1.0 + 0.05 * random.standard_normal()) * around(np.ones((count, LEGS)), 0.02)
    zero = np.radians(0.7) * random.standard_normal((count, LEGS))
    return RealRig(replace(FO_SHIP, platforms=platforms), gain, zero, np.radians(0.4) * random.standard_normal(3))


def _seen(
    test: ServoTest, rig: RealRig, kind: str, size: float, servo: Servo, other: Servo, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """What the IMU of such a rig tells after every move of the test, and at its stance."""
    here = test.stance_angles_rad
    told = np.array([here, *(angles for _, angles in test.moves())])
    ideal = told.copy()
    if kind == "exchanged":
        ideal[:, *servo], ideal[:, *other] = told[:, *other], told[:, *servo]
    elif kind == "reversed":
        ideal[:, *servo] *= -1.0
    elif kind == "stuck":
        ideal[:, *servo] = here[servo] + size
    elif kind == "offset":
        ideal[:, *servo] += size
    # A servo plays anew when it has moved; the others stand where they stood.
    play = np.tile(SLOP_RAD * random.standard_normal(here.shape), (len(told), 1, 1))
    moved = told != here
    play[moved] = SLOP_RAD * random.standard_normal(int(np.sum(moved)))
    real = rig.gain * ideal + rig.zero_rad + play
    reached = np.eye(3)
    for i, platform in enumerate(rig.dimensions.platforms):
        reached = reached @ rotations(plate_pose(real[:, i], platform).set_point[:, 3:])
    noise = np.array([exp_so3(IMU_RAD * random.standard_normal(3)) for _ in reached])
    noise[0] = exp_so3(IMU_RAD / math.sqrt(len(told)) * random.standard_normal(3))  # read between all moves
    seen = noise @ exp_so3(rig.mount) @ reached
    return seen[1:], seen[0]


_FAULTS = (
    ("none", 0.0, 5.0),
    ("stuck", 0.15, 2.0),
    ("reversed", 0.0, 10.0),
    ("exchanged", 0.0, 15.0),
    ("offset", float(np.radians(5.0)), None),
    ("offset", float(np.radians(10.0)), None),
    ("offset", float(np.radians(20.0)), None),
    ("stuck", 0.0, 2.0),
    ("stuck", float(np.radians(20.0)), 2.0),
)
"""Kind, size, and of how many per cent a fault may be missed."""


def servo_test(run: RigRun) -> list[Row]:
    """R10: faults built into simulated rigs that the test does not know, one servo each, in turn."""
    first = ServoTest()
    count = run.count(240, 6)
    rows: list[Row] = []
    for number, (kind, size, must) in enumerate(_FAULTS):
        missed: dict[str, list[bool]] = {"": [], ".again": []}
        for k in range(count):
            random = np.random.default_rng((run.seed, number, k))
            servo = first.servos[k % len(first.servos)]
            other = first.servos[(k + 1 + int(random.integers(len(first.servos) - 1))) % len(first.servos)]
            rig = drawn_rig(random)
            good = _seen(first, rig, "none", 0.0, servo, other, random)
            bad = _seen(first, rig, kind, size, servo, other, random)
            for way, test in (("", first), (".again", first.against(good))):
                findings = test.judge(*bad).findings
                missed[way].append(bool(findings) if kind == "none" else not _names(kind, servo, other, findings))
        for way, flags in missed.items():
            sized = kind in ("offset", "stuck")
            place = f"R10{way}.{kind}{f'{np.degrees(size):.0f}' if sized else ''}"
            what = f"{kind} by {np.degrees(size):.0f} deg" if sized else kind
            told = "good rigs accused" if kind == "none" else f"servo {what}, not named"
            beside = "against an earlier run" if way else "first run"
            rows.append(share_row(place, f"servo test (simulated), {beside}: {told}", np.array(flags), must))
    return rows


def _names(kind: str, servo: Servo, other: Servo, findings: tuple[ServoFinding, ...]) -> bool:
    """Whether the fault is among the findings, with the servo named or one of those that it may be."""
    for each in findings:
        servos = {each.servo, *each.others}
        if each.fault == kind and servo in servos and (kind != "exchanged" or other in servos):
            return True
    return False


def identification(run: RigRun) -> list[Row]:
    """R11: simulated rigs found from 60 measured poses: whether the errors are as large as stated, and how large."""
    squares, misfits, left = [], [], []
    kinds = ("offset", "gain", "arm", "rod")
    parameters = parameters_of(len(FO_SHIP.platforms), kinds)
    place_mm, turn_rad = np.full(3, 0.5), np.full(3, np.radians(0.3))
    for k in range(run.count(20, 2)):
        random = np.random.default_rng((run.seed, 11, k))
        truth = np.array([PRIOR_STD[each.kind] for each in parameters]) * random.standard_normal(len(parameters))
        rig = _with(parameters, truth)
        limits = 0.5 * AxisLimits().array()
        points = random.uniform(-limits, limits, (60, len(FO_SHIP.platforms), 6))
        told = np.stack([servo_angles_rad(points[:, i], each) for i, each in enumerate(FO_SHIP.platforms)], axis=1)
        angles = rig.gain * told + rig.zero_rad
        made = [plate_pose(angles[:, i], each).set_point for i, each in enumerate(rig.dimensions.platforms)]
        pose = stack_pose(np.stack(made, axis=1), rig.dimensions)
        position = pose.position_mm + place_mm * random.standard_normal(pose.position_mm.shape)
        turned = np.array([exp_so3(turn_rad * random.standard_normal(3)) @ each for each in pose.rotation])
        found = identify(MeasuredPoses(told, position, turned, place_mm, turn_rad), FO_SHIP, parameters)
        error = found.values - truth
        squares.append(float(error @ np.linalg.solve(found.covariance, error)) / len(error))
        misfits.append(found.misfit)
        offsets = [i for i, each in enumerate(parameters) if each.kind == "offset"]
        left.append(float(np.degrees(np.sqrt(np.mean(error[offsets] ** 2)))))
    mean = bootstrap(squares, lambda values: np.mean(values, axis=-1))
    name = f"identification (simulated), {len(parameters)} parameters from 60 poses: mean squared error / covariance"
    return [
        Row("R11", name, mean, "1", Target(0.8, 1.2)),
        Row("R11.misfit", "identification: mean square of what stays unexplained", bootstrap(misfits), "1"),
        Row("R11.offset", "identification: RMS error of a servo's offset (2 deg before)", bootstrap(left), "deg"),
    ]


def _with(parameters: tuple[Parameter, ...], values: Floats) -> RealRig:
    """The drawn rig with these arms, rods, gains and zeros."""
    count = len(FO_SHIP.platforms)
    gain, zero, platforms = np.ones((count, LEGS)), np.zeros((count, LEGS)), list(FO_SHIP.platforms)
    for each, value in zip(parameters, values, strict=True):
        i = each.platform or 0
        if each.kind == "offset":
            zero[i, each.servo] = value
        elif each.kind == "gain":
            gain[i, each.servo] += value
        elif each.kind == "arm":
            platforms[i] = replace(platforms[i], arm_mm=platforms[i].arm_mm + value)
        else:
            platforms[i] = replace(platforms[i], rod_mm=platforms[i].rod_mm + value)
    return RealRig(replace(FO_SHIP, platforms=tuple(platforms)), gain, zero, np.zeros(3))


CASES = (
    RigCase("R5", "table 2.4", table_2_4),
    RigCase("R6", "go/no-go gauge", gauge),
    RigCase("R10", "servo test", servo_test),
    RigCase("R11", "identification", identification),
)
