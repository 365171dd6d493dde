"""Where the tool is, pose after pose of one rig: what its build is off stays from pose to pose, its play does not.

`tool_truth` knows one pose. A session has many, and each tells of the same build: a rig that goes 6 % too far goes
6 % too far at every point, and its attitude shows it. Here all numbers of the build (`uncertainty.set_point_errors`),
the play of the servos as they now stand and the attitude's own errors are one vector of independent unit normals at
first; every measured attitude corrects it (a Kalman filter over the points), and place, turn and their covariance
follow from it:

    e = E(told) build + F(told) play           set points, with E and F at the pose that was told
    measured = exp(seat + wander + noise) R(told + e)
    wander' = r wander + sqrt(1 - r^2) new     one step each reading
    play' = new where a servo moved, the same where it did not

The first pose is kept beside (`since_first`): the errors of two poses of one rig are mostly the same, so the way from
one to the other is better known than either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.navigation.rotation import exp_so3, log_so3
from bluerov_slam.rig.dimensions import LEGS
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.stack import stack_jacobian, stack_pose
from bluerov_slam.rig.tool_truth import ToolTruth
from bluerov_slam.rig.uncertainty import ALIKE, OWN, set_point_errors, zero_factor

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, ManufacturingSpread, StackDimensions

_ROUNDS = 2
_ANGLE_STILL_RAD = 1e-9


@dataclass(frozen=True, slots=True)
class AttitudeErrors:
    """Of the instrument on the tool, standard deviations of turns about x, y, z of the rig frame, rad.

    Attributes:
        noise_rad: another at each reading.
        wander_rad: slow: of a compass, or of what vibration does to a level.
        seat_rad: the same at all readings: how it sits, and where its yaw was set to zero.
        wander_readings: after how many readings the wander has lost all but 1/e of itself.
    """

    noise_rad: tuple[float, float, float]
    wander_rad: tuple[float, float, float]
    seat_rad: tuple[float, float, float]
    wander_readings: float = 10.0


class SessionTruth:
    """Truth of one rig over a session; `take` each pose in turn."""

    def __init__(self, dimensions: StackDimensions, spread: ManufacturingSpread, attitude: AttitudeErrors) -> None:
        self._dimensions, self._spread, self._attitude = dimensions, spread, attitude
        self._platforms = count = len(dimensions.platforms)
        sizes = {"own": OWN * count, "alike": ALIKE, "bases": 3 * count, "foot": 3, "tool": 3}
        sizes |= {"seat": 3, "wander": 3, "play": LEGS * count, "first": 6}
        ends = np.cumsum(list(sizes.values()))
        self._at = {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}
        # The mean of zeros, gains and play goes through the forward kinematics, that of all others by derivatives.
        servos = np.zeros(ends[-1], dtype=bool)
        servos[self._at["own"]] = np.tile(np.arange(OWN) < 2 * LEGS, count)
        servos[self._at["alike"].start] = True
        servos[self._at["play"]] = True
        self._linear = ~servos
        self._mean = np.zeros(ends[-1])
        self._covariance = np.eye(ends[-1])
        # The first pose's own errors: a copy of what is said of it, made when it is there.
        self._covariance[self._at["first"], self._at["first"]] = 0.0
        self._angles: Floats | None = None
        self._first: tuple[Floats, Floats] | None = None
        self._now: tuple[Floats, Floats] | None = None

    def take(self, set_points: Floats, rotation: Floats | None = None) -> ToolTruth:
        """The pose at commanded set points (platforms, 6); the tool's measured rotation (3, 3) is used if it is known.

        NaN throughout where a set point cannot be reached; what is known of the rig is then as before.
        """
        told = np.asarray(set_points, dtype=np.float64)
        angles = np.array([servo_angles_rad(told[i], each) for i, each in enumerate(self._dimensions.platforms)])
        if not np.all(np.isfinite(angles)):
            self._now = None
            unknown = np.full(3, np.nan)
            return ToolTruth(unknown, np.full((3, 3), np.nan), np.full((6, 6), np.nan), told, float("nan"))
        self._moved(angles)
        surprise = float("nan")
        points, columns = self._expected(told, angles)
        if rotation is not None and np.all(np.isfinite(rotation)):
            self._wandered()
            surprise = self._corrected(points, columns, np.asarray(rotation, dtype=np.float64))
            points, columns = self._expected(told, angles)
        jacobian = self._jacobian(points, columns)
        pose = stack_pose(points, self._dimensions)
        place = pose.position_mm + self._offset_columns(pose.rotation) @ self._mean
        covariance = jacobian @ self._covariance @ jacobian.T
        if self._first is None:
            self._first = place, jacobian @ self._mean
            self._covariance = _with_copy(self._covariance, jacobian, self._at["first"])
            self._mean[self._at["first"]] = self._first[1]
        self._now = place, jacobian
        return ToolTruth(place, pose.rotation, covariance, points, surprise)

    def since_first(self) -> tuple[Floats, Floats]:
        """Displacement (3,) mm of the last pose from the first one, and its covariance (3, 3); NaN if not known."""
        if self._now is None or self._first is None:
            return np.full(3, np.nan), np.full((3, 3), np.nan)
        (place, jacobian), (first, error) = self._now, self._first
        # What was learnt since has moved the first pose, too.
        first = first + (self._mean[self._at["first"]] - error)[:3]
        rows = jacobian[:3].copy()
        rows[:, self._at["first"]] -= np.eye(6)[:3]
        return place - first, np.asarray(rows @ self._covariance @ rows.T)

    def restart(self) -> None:
        """A new session of the same rig: the instrument may have been set up anew, and the next pose is its first."""
        for name in ("seat", "wander", "first"):
            which = self._at[name]
            self._renewed(np.arange(which.start, which.stop, dtype=np.intp), 0.0 if name == "first" else 1.0)
        self._first = self._now = None

    def _renewed(self, which: NDArray[np.intp], variance: float) -> None:
        self._mean[which] = 0.0
        self._covariance[which, :] = 0.0
        self._covariance[:, which] = 0.0
        self._covariance[which, which] = variance

    def _moved(self, angles: Floats) -> None:
        if self._angles is not None:
            moved = np.abs(angles - self._angles).ravel() > _ANGLE_STILL_RAD
            self._renewed(np.flatnonzero(moved) + self._at["play"].start, 1.0)
        self._angles = angles

    def _wandered(self) -> None:
        kept = float(np.exp(-1.0 / self._attitude.wander_readings))
        which = self._at["wander"]
        self._mean[which] *= kept
        self._covariance[which, :] *= kept
        self._covariance[:, which] *= kept
        self._covariance[which, which] += (1.0 - kept**2) * np.eye(3)

    def _expected(self, told: Floats, angles: Floats) -> tuple[Floats, Floats]:
        """Most likely set points (platforms, 6), and what each number does to them about there, (6 platforms, n).

        What is known of the servos goes through the forward kinematics: with arms at 60 degrees some degrees of error
        are no small ones. Dimensions are.
        """
        own = self._mean[self._at["own"]].reshape(self._platforms, OWN)
        zeros = own[:, :LEGS] @ zero_factor(self._spread).T
        gain = self._spread.gain * own[:, LEGS : 2 * LEGS]
        gain = gain + self._spread.gain_alike * self._mean[self._at["alike"].start]
        play = self._spread.slop_rad * self._mean[self._at["play"]].reshape(self._platforms, LEGS)
        real = angles + zeros + gain * angles + play
        points, columns = told.copy(), np.zeros((6 * self._platforms, len(self._mean)))
        for i, platform in enumerate(self._dimensions.platforms):
            found = plate_pose(real[i], platform, told[i])
            # Commands that a rig as drawn could follow and this one by its numbers could not: they stay as told.
            points[i] = found.set_point if bool(found.converged) else told[i]
            rows, errors = slice(6 * i, 6 * i + 6), set_point_errors(points[i], platform, self._spread, angles[i])
            columns[rows, self._at["own"]][:, OWN * i : OWN * (i + 1)] = errors.own
            columns[rows, self._at["alike"]] = errors.alike
            columns[rows, self._at["play"]][:, LEGS * i : LEGS * (i + 1)] = errors.play
            columns[rows, self._at["bases"]][:3, 3 * i : 3 * i + 3] = self._spread.stacking_mm * np.eye(3)
        return points + (columns[:, self._linear] @ self._mean[self._linear]).reshape(points.shape), columns

    def _offset_columns(self, rotation: Floats) -> Floats:
        """What the offsets of foot and tool do to the tool's place, (3, n)."""
        found = np.zeros((3, len(self._mean)))
        found[:, self._at["foot"]] = self._spread.stacking_mm * np.eye(3)
        found[:, self._at["tool"]] = self._spread.stacking_mm * rotation
        return found

    def _jacobian(self, points: Floats, columns: Floats) -> Floats:
        """What each number does to the tool's place and turn, (6, n)."""
        jacobian = stack_jacobian(points, self._dimensions) @ columns
        jacobian[:3] += self._offset_columns(stack_pose(points, self._dimensions).rotation)
        return np.asarray(jacobian)

    def _corrected(self, expected_points: Floats, columns: Floats, measured: Floats) -> float:
        """Correct all numbers by a measured rotation, and say how surprising it was (chi-square of three)."""
        prior, before = self._covariance, self._mean
        noise = np.diag(np.square(self._attitude.noise_rad))
        mean, surprise = before, float("nan")
        for _ in range(_ROUNDS):
            points = expected_points + (columns @ (mean - before)).reshape(expected_points.shape)
            rows = stack_jacobian(points, self._dimensions)[3:] @ columns
            rows[:, self._at["seat"]] += np.diag(self._attitude.seat_rad)
            rows[:, self._at["wander"]] += np.diag(self._attitude.wander_rad)
            bias = np.array(self._attitude.seat_rad) * mean[self._at["seat"]]
            bias = bias + np.array(self._attitude.wander_rad) * mean[self._at["wander"]]
            left = log_so3(measured @ stack_pose(points, self._dimensions).rotation.T @ exp_so3(-bias))
            left = left + rows @ (mean - before)
            across = prior @ rows.T
            expected = rows @ across + noise
            gain = np.linalg.solve(expected, across.T).T
            mean = before + gain @ left
            if not np.isfinite(surprise):
                surprise = float(left @ np.linalg.solve(expected, left))
        self._mean = mean
        kept = prior - gain @ across.T
        self._covariance = 0.5 * (kept + kept.T)
        return surprise


def _with_copy(covariance: Floats, jacobian: Floats, which: slice) -> Floats:
    """The covariance with the pose's errors copied into some numbers."""
    found = covariance.copy()
    across = jacobian @ covariance
    found[which, :] = across
    found[:, which] = across.T
    found[which, which] = across @ jacobian.T
    return found
