"""Finds servos that are stuck, built in the wrong way round, exchanged or off: one is moved at a time, the IMU judges.

From a stance each servo goes up by a step, back, down, back; every time the tool turns by what the kinematics say of
that servo (an answer: two turns, six numbers). All answers and the stance's own roll and pitch are held against a good
rig and against every rig with one fault: a servo stuck, reversed, exchanged with another or off its zero, each
calculated through all six legs. Where no single fault explains everything, each wrong answer is explained by itself.
A servo off its zero shows almost only in the lean of the stance, three numbers for 24 servos: then all that it may be
are named.

The stance is not home: with all plates level, servos in the same place of two platforms turn the tool alike, and
nothing could tell which of the two moved. Here every platform leans another way.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.navigation.chi_square import chi_square_quantile
from bluerov_slam.rig.dimensions import FO_SHIP, LEGS
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import servo_angles_rad

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats, StackDimensions

Servo = tuple[int, int]
"""Platform and servo, from 0."""

STEP_RAD = float(np.radians(10.0))
_LEAN_RAD = float(np.radians(9.0))
LEAN_STD_RAD, PLAY = float(np.radians(0.9)), 0.12
"""Of a good rig never measured before: zeros within the gauge lean the stance by 0.7 degrees, its gains differ."""
LEAN_AGAIN_STD_RAD, PLAY_AGAIN = float(np.radians(0.25)), 0.04
"""Of a good rig against itself."""
ALARM = 0.9999
"""A servo is only accused beyond this: of 24 good ones, one in 400 tests."""
_GAIN = 14.0
"""A fault must explain chi-square this much better than none: 24 shares tried, one good rig in 200 is accused."""
_CLEAR = 9.0
"""Explanations whose chi-squares differ by less are all named."""
_OFFSETS_RAD = np.radians([-16.0, -8.0, 0.0, 8.0, 16.0])
_TRIED_OFFSETS_RAD = np.radians(np.linspace(-25.0, 25.0, 101))


@dataclass(frozen=True, slots=True)
class ServoFinding:
    """What is wrong with a servo.

    Attributes:
        servo: platform and servo, from 0.
        fault: "stuck", "reversed", "exchanged", "offset", "weak" (moves another share than told) or "unclear".
        others: servos that it might be instead ("offset") or is exchanged with ("exchanged").
        size: offset in rad or share of the motion; None where there is none.
    """

    servo: Servo
    fault: str
    others: tuple[Servo, ...] = ()
    size: float | None = None

    def __str__(self) -> str:
        others = " or ".join(_name(other) for other in self.others)
        match self.fault:
            case "stuck":
                return f"{_name(self.servo)} does not move"
            case "reversed":
                return f"{_name(self.servo)} turns the wrong way round"
            case "exchanged":
                return f"{_name(self.servo)} is exchanged with {others}"
            case "offset":
                doubt = f" (or it is {others})" if others else ""
                return f"{_name(self.servo)} stands {np.degrees(self.size or 0.0):+.1f} degrees off its zero{doubt}"
            case "weak":
                return f"{_name(self.servo)} moves {100.0 * (self.size or 0.0):.0f} % of what it is told"
        return f"{_name(self.servo)} does something that no single fault explains"


@dataclass(frozen=True, slots=True)
class ServoVerdict:
    """All findings, and what they come from.

    Attributes:
        findings: empty if all servos are as they should be.
        untested: servos whose answer was not measured.
        chi_square: of each servo's answer against a good one, (platforms, 6), chi-square of six; NaN if untested.
    """

    findings: tuple[ServoFinding, ...]
    untested: tuple[Servo, ...]
    chi_square: Floats

    def __str__(self) -> str:
        words = [str(each) for each in self.findings] + [f"{_name(each)} was not tested" for each in self.untested]
        return "; ".join(words) or "all servos answer as they should"


def stance(platforms: int) -> Floats:
    """Set points (platforms, 6) in which every platform leans another way; the leans add up to little."""
    points = np.zeros((platforms, 6))
    for i in range(platforms):
        bearing = 2.0 * np.pi * i / max(platforms, 1)
        points[i, 3:5] = _LEAN_RAD * np.array([np.cos(bearing), np.sin(bearing)])
    return points


@dataclass(frozen=True, slots=True, eq=False)
class _Fault:
    """A rig with one fault: the lean of its stance (2,) and its answers (servos, 6)."""

    finding: ServoFinding
    lean: Floats
    answers: Floats


class ServoTest:
    """The test of one rig.

    `against` an earlier run of the same rig, known to be good, its own build and gains drop out, and much smaller
    faults show. `imu_std_rad`: of a turn between two readings at rest, each axis. `level_std_rad`: how far
    the stance of a good rig may lean from what is expected. `play`: how far its answers may differ, as a share.
    """

    def __init__(
        self,
        dimensions: StackDimensions = FO_SHIP,
        imu_std_rad: float = float(np.radians(0.2)),
        level_std_rad: float = LEAN_STD_RAD,
        play: float = PLAY,
        step_rad: float = STEP_RAD,
    ) -> None:
        self._dimensions = dimensions
        self._imu_std_rad, self._level_std_rad, self._play = imu_std_rad, level_std_rad, play
        points = stance(len(dimensions.platforms))
        self._points = points
        here = np.stack(
            [servo_angles_rad(point, each) for point, each in zip(points, dimensions.platforms, strict=True)]
        )
        self.servos: tuple[Servo, ...] = tuple((i, j) for i in range(len(points)) for j in range(LEGS))
        told = np.tile(here, (1 + 2 * len(self.servos), 1, 1))
        for k, servo in enumerate(self.servos):
            told[1 + 2 * k, *servo] += step_rad
            told[2 + 2 * k, *servo] -= step_rad
        self._told = told
        self._good = [self._plate_rotations(i, told[:, i]) for i in range(len(points))]
        self._level = self._tool(told)[0]
        _, self._expected = self._predict(told)
        self._faults: list[_Fault] = []
        self._fault_leans, self._fault_answers = np.empty((0, 2)), np.empty((0, len(self.servos), 6))
        # Of the rig as it was against the drawing: (2,) and (servos, 6).
        self._own_lean, self._own_answers = np.zeros(2), np.zeros_like(self._expected)

    @property
    def stance_angles_rad(self) -> Floats:
        """Servo angles (platforms, 6) to start from and to go back to between any two moves."""
        return np.array(self._told[0])

    def moves(self) -> tuple[tuple[Servo, Floats], ...]:
        """For every servo up, then down: which it is, and the servo angles (platforms, 6) to go to."""
        return tuple((self.servos[k // 2], angles.copy()) for k, angles in enumerate(self._told[1:]))

    def against(self, before: tuple[Floats, Floats]) -> ServoTest:
        """The same test against an earlier run of the same rig; what was calculated is kept."""
        self._known_faults()
        again = copy(self)
        again._imu_std_rad *= 2.0**0.5  # both runs are noisy
        again._level_std_rad, again._play = LEAN_AGAIN_STD_RAD, PLAY_AGAIN
        again._own_lean, answers = self._measured(*before)
        again._own_answers = np.nan_to_num(answers - self._expected)
        return again

    def judge(self, rotations_seen: Floats, at_stance: Floats) -> ServoVerdict:
        """What is wrong.

        Args:
            rotations_seen: of the IMU after each of `moves`, (2 servos, 3, 3); NaN where not measured.
            at_stance: at the stance, the mean of the readings between the moves, (3, 3).
        """
        lean, answers = self._measured(rotations_seen, at_stance)
        lean, answers = lean - self._own_lean, answers - self._own_answers
        chi = self._chi_square(answers, self._expected)
        tested = np.isfinite(chi)
        limit = chi_square_quantile(ALARM, 6.0)
        wrong = np.flatnonzero(tested & (chi > limit))
        untested = tuple(servo for servo, known in zip(self.servos, tested, strict=True) if not known)
        findings = self._one_fault(answers, lean, tested)
        if findings is None:
            findings = [self._explain(int(k), answers) for k in wrong]
        return ServoVerdict(tuple(_pairs_once(findings)), untested, chi.reshape(-1, LEGS))

    def _measured(self, rotations_seen: Floats, at_stance: Floats) -> tuple[Floats, Floats]:
        """Lean of the stance (2,) and answers (servos, 6)."""
        answers = _turns(rotations_seen @ at_stance.T).reshape(len(self.servos), 6)
        return _turns((at_stance @ self._level.T)[None])[0, :2], answers

    def _one_fault(self, answers: Floats, lean: Floats, tested: NDArray[np.bool_]) -> list[ServoFinding] | None:
        """The one fault that explains everything; none if all is well already, None if there is no such fault."""
        nothing = self._total(answers, lean, tested, np.zeros(2), self._expected)
        known = self._known_faults()
        totals = self._totals(answers, lean, tested)
        near_best = np.flatnonzero(totals <= np.min(totals) + _CLEAR)
        tries = [(float(totals[k]), known[k]) for k in near_best]
        for k in np.flatnonzero(tested):
            share, weak = self._share(int(k), answers), self._expected.copy()
            weak[k] = share * (self._expected[k] + self._own_answers[k]) - self._own_answers[k]
            # A servo stuck anywhere leans the stance by any amount: its lean says nothing.
            fault = _Fault(_share_finding(self.servos[k], share), lean if abs(share) < _STUCK else np.zeros(2), weak)
            tries.append((self._total(answers, lean, tested, fault.lean, fault.answers), fault))
        best, fault = min(tries, key=lambda each: each[0])
        limit = chi_square_quantile(ALARM, 6.0)
        if nothing - best < _GAIN:
            return None if np.any(self._chi_square(answers, self._expected)[tested] > limit) else []
        if np.any(self._chi_square(answers, fault.answers)[tested] > limit):
            return None
        near = [each for chi, each in sorted(tries, key=lambda each: each[0]) if chi < best + _CLEAR]
        return [_with_doubt(fault.finding, [each.finding for each in near])]

    def _totals(self, answers: Floats, lean: Floats, tested: NDArray[np.bool_]) -> Floats:
        """Chi-squares of all known faults at once."""
        of_lean = np.sum(((lean - self._fault_leans) / self._level_std_rad) ** 2, axis=1)
        return np.asarray(of_lean + np.sum(self._chi_square(answers[tested], self._fault_answers[:, tested]), axis=1))

    def _total(self, answers: Floats, lean: Floats, tested: NDArray[np.bool_], at: Floats, expected: Floats) -> float:
        of_lean = float(np.sum(((lean - at) / self._level_std_rad) ** 2))
        return of_lean + float(np.sum(self._chi_square(answers, expected)[tested]))

    def _explain(self, k: int, answers: Floats) -> ServoFinding:
        """The fault of one servo whose answer is not its own, among several faults."""
        limit = chi_square_quantile(ALARM, 6.0)
        servo, share = self.servos[k], self._share(k, answers)
        scaled = share * (self._expected[k] + self._own_answers[k]) - self._own_answers[k]
        tries = [
            (float(self._chi_square(answers[k], each.answers[k])), each.finding)
            for each in self._known_faults()
            if each.finding.servo == servo or (each.finding.fault == "exchanged" and servo in each.finding.others)
        ]
        tries.append((float(self._chi_square(answers[k], scaled)) + 1.0, _share_finding(servo, share)))
        best, finding = min(tries, key=lambda each: each[0])
        return finding if best <= limit else ServoFinding(servo, "unclear")

    def _share(self, k: int, answers: Floats) -> float:
        """How much of its usual answer a servo gives."""
        usual = self._expected[k] + self._own_answers[k]
        return float((answers[k] + self._own_answers[k]) @ usual / (usual @ usual))

    def _known_faults(self) -> list[_Fault]:
        """Every rig with one fault, calculated at the first call."""
        if not self._faults:
            for k, servo in enumerate(self.servos):
                still = self._told.copy()
                still[:, *servo] = self._told[0, *servo]
                self._add(still, ServoFinding(servo, "stuck"))
                turned = self._told.copy()
                turned[:, *servo] *= -1.0
                self._add(turned, ServoFinding(servo, "reversed"))
                for other in self.servos[k + 1 :]:
                    swapped = self._told.copy()
                    swapped[:, *servo], swapped[:, *other] = self._told[:, *other], self._told[:, *servo]
                    self._add(swapped, ServoFinding(servo, "exchanged", (other,)))
                self._add_offsets(servo)
            self._fault_leans = np.array([each.lean for each in self._faults])
            self._fault_answers = np.array([each.answers for each in self._faults])
        return self._faults

    def _add(self, real: Floats, finding: ServoFinding) -> None:
        lean, answers = self._predict(real)
        if np.all(np.isfinite(answers)) and np.all(np.isfinite(lean)):
            self._faults.append(_Fault(finding, lean, answers))

    def _add_offsets(self, servo: Servo) -> None:
        """Calculated at a few offsets and smooth between them."""
        leans, answers = [], []
        for size in _OFFSETS_RAD:
            real = self._told.copy()
            real[:, *servo] += size
            lean, turned = self._predict(real)
            leans.append(lean)
            answers.append(turned.ravel())
        known = np.concatenate([np.array(leans), np.array(answers)], axis=1)
        whole = np.all(np.isfinite(known), axis=1)
        curve = np.polynomial.polynomial.polyfit(_OFFSETS_RAD[whole], known[whole], int(np.sum(whole)) - 1)
        for size, row in zip(
            _TRIED_OFFSETS_RAD, np.polynomial.polynomial.polyval(_TRIED_OFFSETS_RAD, curve).T, strict=True
        ):
            finding = ServoFinding(servo, "offset", (), float(size))
            self._faults.append(_Fault(finding, row[:2], row[2:].reshape(-1, 6)))

    def _predict(self, real: Floats) -> tuple[Floats, Floats]:
        """Lean of the stance and answers of a rig whose servos stand at `real` (1 + 2 servos, platforms, 6)."""
        tool = self._tool(real)
        lean = _turns((tool[0] @ self._level.T)[None])[0, :2]
        return lean, _turns(tool[1:] @ tool[0].T).reshape(len(self.servos), 6)

    def _tool(self, real: Floats) -> Floats:
        """Rotations of the tool, (n, 3, 3); only platforms that are not as told are calculated anew."""
        reached = np.eye(3)
        for i, good in enumerate(self._good):
            same = np.array_equal(real[:, i], self._told[:, i])
            reached = reached @ (good if same else self._plate_rotations(i, real[:, i]))
        return reached

    def _plate_rotations(self, i: int, angles: Floats) -> Floats:
        return rotations(plate_pose(angles, self._dimensions.platforms[i], self._points[i]).set_point[:, 3:])

    def _chi_square(self, answers: Floats, expected: Floats) -> Floats:
        """Of answers (..., 6) against expected ones (..., 6)."""
        parts = np.reshape(expected, (*np.shape(expected)[:-1], 2, 3))
        size = np.repeat(np.linalg.norm(parts, axis=-1), 3, axis=-1)
        variance = self._imu_std_rad**2 + (self._play * size) ** 2
        return np.asarray(np.sum((answers - expected) ** 2 / variance, axis=-1))


def _turns(matrices: Floats) -> Floats:
    """Rotation vectors (n, 3) of rotations (n, 3, 3) by less than half a turn; NaN for NaN."""
    axis = np.stack(
        [
            matrices[:, 2, 1] - matrices[:, 1, 2],
            matrices[:, 0, 2] - matrices[:, 2, 0],
            matrices[:, 1, 0] - matrices[:, 0, 1],
        ],
        axis=1,
    )
    sine = 0.5 * np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, 0.5 * (np.trace(matrices, axis1=1, axis2=2)[:, None] - 1.0))
    return np.asarray(0.5 * axis * np.where(sine > _TINY, angle / np.maximum(sine, _TINY), 1.0))


_TINY = 1e-9
_STUCK = 0.15


def _share_finding(servo: Servo, share: float) -> ServoFinding:
    return ServoFinding(servo, "stuck") if abs(share) < _STUCK else ServoFinding(servo, "weak", (), share)


def _with_doubt(best: ServoFinding, near: list[ServoFinding]) -> ServoFinding:
    """The finding with the other servos that explain nearly as much in the same way."""
    if best.fault == "offset":
        others = dict.fromkeys(each.servo for each in near if each.fault == "offset" and each.servo != best.servo)
        return replace(best, others=tuple(others))
    if best.fault == "exchanged":
        same = (each for each in near if each.fault == "exchanged" and each.servo == best.servo)
        return replace(best, others=tuple(dict.fromkeys(other for each in same for other in each.others)))
    return best


def _pairs_once(findings: list[ServoFinding]) -> list[ServoFinding]:
    """Two servos exchanged with each other are one finding."""
    kept: list[ServoFinding] = []
    for each in findings:
        if each.fault != "exchanged" or each not in kept:
            kept.append(each)
    return kept


def _name(servo: Servo) -> str:
    return f"servo {servo[1] + 1} of platform {servo[0] + 1}"
