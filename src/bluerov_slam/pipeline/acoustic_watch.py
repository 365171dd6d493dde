"""What the pilot is told about the array: one sentence and its cure, from the last pulses."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

import numpy as np

from bluerov_slam.acoustics.position import IN_PLANE
from bluerov_slam.pipeline.acoustic_callers import OTHER_TEXT, PLACES_TEXT, TWO_TEXT
from bluerov_slam.protocol.navigation_json import error_ellipse

if TYPE_CHECKING:
    from bluerov_slam.records import AcousticFix

# The transmitter calls once a second; a pilot who waits longer than this wants to know why.
NO_PULSES_S: Final = 10.0
REMEMBERED_S: Final = 15.0
REMEMBERED: Final = 40
# What one pulse says may be chance; most of the last ones are not.
RECENT: Final = 5
# Two lines of the narrowest chip.
MOST_ON_CHIP: Final = 28


class AcousticState(StrEnum):
    """How it stands with the array."""

    OFF = "off"
    WAITING = "waiting"
    OK = "ok"
    WARN = "warn"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class AcousticWords:
    """A sentence, and what to do; `cure` is empty where nothing is wrong.

    `brief`: the same on a chip. `kind`: stays as long as the matter does, whatever the figures in the sentence.
    """

    state: AcousticState
    text: str
    cure: str
    brief: str
    kind: str


NOT_FITTED: Final = AcousticWords(AcousticState.OFF, "No acoustic array is fitted", "", "No array", "off")
NOT_DESCRIBED: Final = AcousticWords(
    AcousticState.WARN,
    "An acoustic board sends, but no array is described",
    "Enter the array under Settings, acoustics, and switch acoustics.enabled on.",
    "Array not described",
    "settings",
)
NAVIGATION_OFF: Final = AcousticWords(
    AcousticState.FAULT,
    "Acoustic positioning needs navigation, which is off",
    "Switch navigation.enabled on under Settings.",
    "Needs navigation",
    "settings",
)
_CHECKS: Final = (
    "Check that the transmitter is on, in the water and within range, and that the board is connected and sends to "
    "this computer's serial link or its UDP port (acoustics.udp_port)."
)


class AcousticWatch:
    """`observe` each fix, `words` at any time."""

    def __init__(self) -> None:
        self._fixes: deque[AcousticFix] = deque(maxlen=REMEMBERED)

    def observe(self, fix: AcousticFix) -> None:
        """Take the newest fix."""
        self._fixes.append(fix)
        while fix.arrived_s - self._fixes[0].arrived_s > REMEMBERED_S:
            self._fixes.popleft()

    def words(self, now_s: float) -> AcousticWords:
        """The sentence for this moment."""
        if not self._fixes:
            return AcousticWords(
                AcousticState.WAITING, "No pulse was heard yet", _CHECKS, "No pulse heard yet", "waiting"
            )
        newest = self._fixes[-1]
        silent_s = now_s - newest.arrived_s
        if silent_s > NO_PULSES_S:
            text = f"No pulses for {_duration(silent_s)}"
            return AcousticWords(AcousticState.FAULT, text, _CHECKS, text, "silent")
        others = sum(fix.reason == OTHER_TEXT for fix in self._fixes)
        recent = [fix for fix in self._fixes if fix.reason != OTHER_TEXT][-RECENT:]
        bad = [fix for fix in recent if not fix.accepted]
        if len(bad) > len(recent) // 2:
            return _refused(bad[-1])
        if others >= RECENT - 1:
            return AcousticWords(
                AcousticState.WARN,
                "Two transmitters are heard; the one where ours should be is used",
                "Switch the other one off, or move away from it.",
                "Two heard, ours used",
                "two",
            )
        if (faulty := _faulty_receiver(recent)) is not None:
            return faulty
        good = [fix for fix in recent if fix.accepted]
        alone = [fix for fix in good if fix.range_m is None and fix.reason]
        if len(alone) > len(good) // 2:
            return _direction_only(alone[-1].reason)
        brief = _fix_within(recent)
        if bad:
            text = f"Heard; {len(bad)} of the last {len(recent)} pulses were left out"
        elif good and good[-1].position_deg is None:
            text = "Heard; direction and range are known"
        else:
            text = "Heard; the position rests on its direction and the depth"
        return AcousticWords(AcousticState.OK, text, "", brief, "ok")


def within_m(fix: AcousticFix) -> float | None:
    """How far off the fix may be with 95 %, along the longer axis of its ellipse."""
    if fix.position_deg is None or fix.covariance_ned_m2 is None:
        return None
    ellipse = error_ellipse(np.array(fix.covariance_ned_m2))
    return None if ellipse is None else ellipse.major_m


def _fix_within(recent: list[AcousticFix]) -> str:
    newest = next((fix for fix in reversed(recent) if fix.accepted), None)
    metres = None if newest is None else within_m(newest)
    return "Direction and range" if metres is None else f"Fix within {metres:.1f} m"


_RECEIVER_CURES: Final = {
    "dead": "check its cable, its plug and its amplifier's supply",
    "silent": "check its cable, its plug and its amplifier's supply",
    "clipped": "lower its gain, or go further from the transmitter",
    "swapped": "check the order of the plugs and of acoustics.places_m",
}


def _faulty_receiver(recent: list[AcousticFix]) -> AcousticWords | None:
    """The receiver that most of the last pulses left out."""
    counts: dict[int, int] = {}
    reasons: dict[int, str] = {}
    for fix in recent:
        for receiver, reason in fix.excluded:
            counts[receiver] = counts.get(receiver, 0) + 1
            reasons[receiver] = reason
    used: dict[int, bool] = {}
    for fix in recent:
        used |= {receiver: receiver in fix.receivers for receiver, _ in fix.excluded}
    worst = max(counts, key=lambda receiver: counts[receiver], default=None)
    if worst is None or worst < 0 or counts[worst] <= len(recent) // 2:
        return None
    what, _, more = reasons[worst].partition(": ")
    cure = more
    if what in _RECEIVER_CURES and not more.startswith("check"):
        cure = _RECEIVER_CURES[what]
        what += f", {more}" if more else ""
    text = f"Receiver {worst}: {what}"
    brief = next((f"Receiver {worst}: {each}" for each in _RECEIVER_CURES if what.startswith(each)), text)
    doubted = "is doubtful" if used[worst] else "is left out"
    return AcousticWords(
        AcousticState.WARN,
        text,
        _sentence(cure or "Check its cable and its place in the settings"),
        brief if len(brief) <= MOST_ON_CHIP else f"Receiver {worst} {doubted}",
        "receiver",
    )


# How a reason begins, the few words of it for a chip, and its cure (empty: the reason brings its own).
_REFUSALS: Final = (
    (
        TWO_TEXT,
        "two transmitters",
        "Switch one of them off, or dive further from it; the position is held without the sound meanwhile.",
    ),
    (
        PLACES_TEXT,
        "direction jumps",
        "Two transmitters are on, or a strong echo comes from a wall: switch one off, or move away from it.",
    ),
    (
        "the sound does not come from",  # WRONG_TEXT, and where another order of the receivers would put it right
        "wrong direction",
        "Another transmitter is heard, or a setting is wrong: its place, the array's mounting, the receivers' order.",
    ),
    ("no receiver heard", "nothing heard", "Come nearer, or check the transmitter and its battery."),
    ("only ", "too few receivers", "See which receivers are marked below and check their cables."),
    (
        "a receiver may be wrong",
        "timing ambiguous",
        "Wait for the next pulse; if it stays so, check the receivers' places and their match.",
    ),
    (
        "delay",
        "delays too long",
        "Check acoustics.arm_m and the order of the receivers; switch other sound sources of this frequency off.",
    ),
    (
        "the delays do not fit",
        "delays do not fit",
        "Two transmitters, an echo, or receivers in another order than in the settings.",
    ),
    (
        IN_PLANE,
        "in the array plane",
        "Dive deeper or higher than the transmitter, or add a receiver on a stalk.",
    ),
    ("the receivers lie on a line", "array is a line", "Place one receiver beside the line of the others."),
    ("receivers ", "receivers swapped", ""),
    ("the board sends", "receiver count", ""),
    ("a sample rate", "wrong sample rate", "Set the sample rate of the board that its records state."),
    ("sample rate: ", "wrong sample rate", "Set the sample rate of the board that its records state."),
    (
        "short: ",
        "record too short",
        "Have the board record a whole pulse: one bit of it, better two, at its sample rate.",
    ),
)
_NO_OWN_CURE: Final = "Wait for the next pulses; if it stays so, check the array's settings and its cables."


def _refused(fix: AcousticFix) -> AcousticWords:
    what, _, rest = fix.reason.partition("; ")
    brief, cure = next(((brief, cure) for start, brief, cure in _REFUSALS if fix.reason.startswith(start)), ("", ""))
    return AcousticWords(
        AcousticState.FAULT,
        _capital(what) or "The pulses cannot be used",
        cure or _sentence(rest) or _NO_OWN_CURE,
        f"Refused: {brief}" if brief else "Pulses refused",
        "refused",
    )


def _direction_only(reason: str) -> AcousticWords:
    what = reason.removeprefix("no position: ")
    what, _, cure = what.partition("; ")
    if not cure and "contradicts the angles" in what:
        cure = "check acoustics.beacon_depth_m, the surface's zero and the array's mounting"
    elif not cure and "attitude" in what:
        cure = "wait until navigation knows the attitude; the Navigation tab says what it waits for"
    elif not cure and "elevation" in what:
        cure = (
            "it can be told with more depth between transmitter and vehicle, or by five receivers a few metres from it"
        )
    return AcousticWords(
        AcousticState.WARN,
        f"Direction only: {what}",
        _sentence(cure) or _NO_OWN_CURE,
        "Depth contradicts angles" if "contradicts the angles" in what else "Direction only",
        "direction_only",
    )


def _sentence(text: str) -> str:
    return f"{_capital(text)}." if text else ""


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"
