"""The verdict of a check in words: what is wrong, by how much and how surely, the cure; or what it would have found."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bluerov_slam.rig.check import CheckVerdict
    from bluerov_slam.rig.servo_test import ServoFinding

FAULT, UNKNOWN, GOOD = "fault found", "cannot tell", "no fault found"
FIRST_DEG, AGAIN_DEG = 10.0, 5.0
"""Zeros that R13 misses in 3 and 2 of 100 simulated rigs, at a first run and against an earlier one."""
_GAUGE = "loosen its horn and set it anew with the go/no-go gauge (docs/rig-calibration.md)"
_CURES = {
    "stuck": "look at its plug and at the screw of its horn; if both are good, replace it",
    "reversed": "its calibration has the wrong sense of turning, or it was replaced by one that turns the other way",
    "exchanged": "their plugs are exchanged: put each where the other is",
    "offset": _GAUGE,
    "weak": "its horn slips or it is overloaded: tighten the screw, look for what it rubs on, else replace it",
    "unclear": "look at its plug, horn, rod and joints",
}


def outcome(verdict: CheckVerdict) -> str:
    """FAULT, UNKNOWN or GOOD."""
    if verdict.servos is not None and any(each.fault != "offset" for each in verdict.servos.findings):
        return FAULT
    if verdict.zeros is None:
        return FAULT if verdict.servos is not None and verdict.servos.findings else UNKNOWN
    if verdict.zeros.finding is not None:
        return FAULT
    return UNKNOWN if verdict.unknown else GOOD


def words(verdict: CheckVerdict) -> list[str]:
    """Lines for a person, the verdict first."""
    result = outcome(verdict)
    lines = [f"Verdict: {result}"]
    servos = verdict.servos.findings if verdict.servos is not None else ()
    # The zero test knows zeros far better than the lean of one stance.
    moving = [each for each in servos if each.fault != "offset" or verdict.zeros is None]
    for each in moving:
        lines += _faulty(str(each), each)
    zeros = verdict.zeros
    if zeros is not None and zeros.finding is not None:
        size, std = np.degrees([zeros.finding.size or 0.0, zeros.size_std_rad])
        told = str(zeros.finding).replace(f"{size:+.1f} degrees", f"{size:+.1f} +- {2.0 * std:.1f} degrees (95 %)")
        lines += _faulty(told, zeros.finding)
        lines.append("  Only one wrong zero is named at a time: check again after the cure")
    lines += [f"Not known: {each}" for each in verdict.unknown]
    if zeros is not None and zeros.untested:
        lines.append(f"{zeros.untested} stances are missing")
    if result == GOOD:
        lines += _would_have_found(verdict)
    return lines


def _faulty(told: str, finding: ServoFinding) -> list[str]:
    return [told[0].upper() + told[1:], f"  Cure: {_CURES[finding.fault]}"]


def _would_have_found(verdict: CheckVerdict) -> list[str]:
    assert verdict.zeros is not None
    least = max(float(np.degrees(verdict.zeros.named_from_rad)), AGAIN_DEG if verdict.compared else FIRST_DEG)
    lines = [
        "It would have found, in 95 of 100 rigs: a servo that does not move; "
        f"a zero off by {least:.1f} degrees or more",
        "  (by the figures of a good rig, and no better than R10 and R13 of simulated rigs: docs/rig-calibration.md)",
    ]
    if not verdict.compared:
        lines.append(f"  Against this run (--compare) a later one finds {AGAIN_DEG:g} to 7 degrees; the gauge finds 2")
    return lines
