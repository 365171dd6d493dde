"""Finds a servo that sits on its spline off its zero, by the IMU on the tool alone: many stances, the attitude at each.

At one stance a wrong zero leans the tool, and so do the small errors of all other servos: three numbers for 24 servos.
But how a servo's zero turns the tool depends on how every platform stands. Over many stances that differ much, each
servo leaves a trace of its own. With r the turns of the readings from what the drawing says, all in one vector, S the
covariance that a good rig has (its build, which stays over the stances; play; the instrument) and f(size) the trace of
one servo off by so much:

    chi-square = (r - f)^T S^-1 (r - f)

A servo is named where its trace takes away enough of it; so are all others that would take away nearly as much.
`ServoTest` finds what does not move, or the wrong way; this one finds what moves well from the wrong place.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.navigation.rotation import log_so3
from bluerov_slam.rig.dimensions import FO_SHIP, LEGS, ManufacturingSpread
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.servo_test import Servo, ServoFinding
from bluerov_slam.rig.stack import stack_jacobian, stack_pose
from bluerov_slam.rig.uncertainty import set_point_errors
from bluerov_slam.rig.workspace import PlatformWorkspace

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions

STANCES = 80
_SEED, _NEARER = 4, 0.9
GOOD_RIG = ManufacturingSpread(
    servo_rad=float(np.radians(0.9)),
    slop_rad=float(np.radians(0.3)),
    rod_mm=0.3,
    arm_mm=0.3,
    joint_mm=0.3,
    gain=0.03,
    gain_alike=0.06,
)
"""Zeros that pass the gauge (0.88 degrees), horns and joints as stated; gains and play as of servos of that price."""
TILT_STD_RAD, YAW_STD_RAD = float(np.radians(0.15)), float(np.radians(0.5))
_SEAT_RAD = np.radians([1.0, 1.0, 10.0])
"""How the instrument sits, and where its yaw is zero, is not known."""
GAIN = 16.0
"""A wrong zero must explain chi-square by so much more: of 24 servos either way one good rig in 600 is accused."""
_CLEAR = 9.0
_SIZES_RAD = np.radians([-20.0, -10.0, 0.0, 10.0, 20.0])
_TRIED_RAD = np.radians(np.linspace(-25.0, 25.0, 201))


@dataclass(frozen=True, slots=True)
class ZeroVerdict:
    """The finding, None if all zeros are as good as they should be.

    Attributes:
        finding: the servo, its size, and the others that it may be instead.
        explained: how much of chi-square it takes away, or the best of all servos would.
        sizes_rad: of every servo by itself, (platforms, 6): how far off it would have to be.
        untested: how many of the readings were not there.
        size_std_rad: of the finding's size, in a rig that is good but for it; NaN without a finding.
        named_from_rad: how far off any servo must be to be named in 95 of 100 such runs, by the figures of a good rig;
            infinite where no size that is tried would be.
        misfit: chi-square of a reading's coordinate, the finding taken away; 1 of a rig as good as supposed.
    """

    finding: ServoFinding | None
    explained: float
    sizes_rad: Floats
    untested: int
    size_std_rad: float = float("nan")
    named_from_rad: float = float("inf")
    misfit: float = float("nan")

    def __str__(self) -> str:
        left = f"; {self.untested} stances were not measured" if self.untested else ""
        return f"{self.finding or 'no servo stands off its zero as far as the attitudes tell'}{left}"


class ZeroTest:
    """The test of one rig. `against` an earlier run of the same rig, known to be good, its build drops out."""

    def __init__(self, dimensions: StackDimensions = FO_SHIP, spread: ManufacturingSpread = GOOD_RIG) -> None:
        self._dimensions = dimensions
        count = len(dimensions.platforms)
        drawn = [PlatformWorkspace(each).sample(STANCES, _SEED + i) for i, each in enumerate(dimensions.platforms)]
        self._points = _NEARER * np.stack(drawn, axis=1)
        self._expected = stack_pose(self._points, dimensions).rotation
        self._build, self._play = self._covariances(spread)
        self._traces = np.array([self._trace(i, j) for i in range(count) for j in range(LEGS)])
        self._before: Floats | None = None

    @property
    def stances(self) -> Floats:
        """Set points (stances, platforms, 6) to go to, one after the other."""
        return self._points.copy()

    def against(self, before: Floats) -> ZeroTest:
        """The same test against the rotations of an earlier run of the same rig."""
        again = copy(self)
        again._before = self._turns(before)
        # Both runs play and are noisy; the build is the same, and a small share of its trace is left for what wears.
        again._build, again._play = _WORN * self._build, 2.0 * self._play
        return again

    def judge(self, rotations_seen: Floats) -> ZeroVerdict:
        """By the IMU's rotation at every stance, (stances, 3, 3); NaN where not measured."""
        turns = self._turns(rotations_seen)
        if self._before is not None:
            turns = turns - self._before
        known = np.isfinite(turns).all(axis=1)
        if not np.any(known):
            return ZeroVerdict(None, float("nan"), np.full((len(self._traces) // LEGS, LEGS), np.nan), len(turns))
        rows = np.repeat(known, 3)
        covariance = (self._build + self._play)[np.ix_(rows, rows)]
        factor = np.linalg.cholesky(covariance)
        seen = np.linalg.solve(factor, turns[known].ravel())
        traces = np.linalg.solve(factor, self._traces[:, :, rows].reshape(self._traces[..., 0].size, -1).T)
        chi = np.sum((seen[:, None] - traces) ** 2, axis=0).reshape(len(self._traces), len(_TRIED_RAD))
        best = np.argmin(chi, axis=1)
        least = chi[np.arange(len(chi)), best]
        sizes = _TRIED_RAD[best]
        k = int(np.argmin(least))
        explained = float(seen @ seen - least[k])
        finding, std = None, float("nan")
        if explained > GAIN:
            others = (n for n in np.argsort(least) if n != k and least[n] < least[k] + _CLEAR)
            finding = ServoFinding(_servo(k), "offset", tuple(_servo(int(n)) for n in others), float(sizes[k]))
            own = traces.reshape(len(seen), len(self._traces), -1)[:, k]
            std = 1.0 / float(np.linalg.norm(np.gradient(own, _TRIED_RAD, axis=1)[:, best[k]]))
        left = float((least[k] if finding else seen @ seen) / len(seen))
        strength = np.linalg.norm(traces, axis=0).reshape(len(self._traces), -1)
        return ZeroVerdict(
            finding, explained, sizes.reshape(-1, LEGS), int(np.sum(~known)), std, _named_from(strength), left
        )

    def _turns(self, rotations_seen: Floats) -> Floats:
        """Of what was seen from what the drawing says, (stances, 3) rad; NaN where not measured."""
        found = np.full((len(self._points), 3), np.nan)
        for i in np.flatnonzero(np.isfinite(rotations_seen).all(axis=(1, 2))):
            found[i] = log_so3(rotations_seen[i] @ self._expected[i].T)
        return found

    def _covariances(self, spread: ManufacturingSpread) -> tuple[Floats, Floats]:
        """Of all readings of a good rig: what its build and the seat make, and what is another at each."""
        jacobian = stack_jacobian(self._points, self._dimensions)[:, 3:]
        size = 3 * len(self._points)
        own, play, alike = [], np.zeros((size, size)), np.zeros((len(self._points), 3, 0))
        noise = np.square([TILT_STD_RAD, TILT_STD_RAD, YAW_STD_RAD])
        each = np.zeros((len(self._points), 3, 3))
        for i, platform in enumerate(self._dimensions.platforms):
            part, errors = jacobian[..., 6 * i : 6 * i + 6], set_point_errors(self._points[:, i], platform, spread)
            own.append(part @ errors.own)
            alike = part @ errors.alike + (alike if i else 0.0)
            moved = part @ errors.play
            each += moved @ np.swapaxes(moved, -1, -2)
        seat = np.broadcast_to(np.diag(_SEAT_RAD), (len(self._points), 3, 3))
        columns = np.concatenate([*own, alike, seat], axis=-1).reshape(size, -1)
        for k, one in enumerate(each):
            play[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = one + np.diag(noise)
        return columns @ columns.T, play

    def _trace(self, i: int, j: int) -> Floats:
        """Turns at all stances (tried sizes, 3 stances) of one servo off by so much, smooth between a few sizes."""
        platform, points = self._dimensions.platforms[i], self._points
        told = servo_angles_rad(points[:, i], platform)
        turned = []
        for size in _SIZES_RAD:
            real, made = told.copy(), points.copy()
            real[:, j] += size
            made[:, i] = plate_pose(real, platform, points[:, i]).set_point
            turned.append(self._turns(_stack_rotation(made)).ravel())
        known = np.array(turned)
        # A stance that a servo so far off could not take tells nothing of this servo.
        known = np.where(np.all(np.isfinite(known), axis=0), known, 0.0)
        curve = np.polynomial.polynomial.polyfit(_SIZES_RAD, known, len(_SIZES_RAD) - 1)
        return np.asarray(np.polynomial.polynomial.polyval(_TRIED_RAD, curve).T)


_WORN = 0.02
_SURELY = 1.645
"""Standard deviations that 95 of 100 lie below."""


def _named_from(strength: Floats) -> float:
    """The least size that is named for every servo, up and down; `strength` (servos, tried sizes) in standard ones."""
    shown = strength >= GAIN**0.5 + _SURELY
    worst = 0.0
    for side in (_TRIED_RAD > 0.0, _TRIED_RAD < 0.0):
        sizes = np.where(shown[:, side], np.abs(_TRIED_RAD[side]), np.inf)
        worst = max(worst, float(np.max(np.min(sizes, axis=1))))
    return worst


def _stack_rotation(points: Floats) -> Floats:
    reached = np.eye(3)
    for i in range(points.shape[1]):
        reached = reached @ rotations(points[:, i, 3:])
    return reached


def _servo(k: int) -> Servo:
    return k // LEGS, k % LEGS
