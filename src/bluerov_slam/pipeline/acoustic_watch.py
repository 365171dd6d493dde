"""What the pilot is told about the array: one sentence and its cure, from the last pulses."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from bluerov_slam.pipeline.acoustic_callers import OTHER_TEXT, PLACES_TEXT, TWO_TEXT, WRONG_TEXT

if TYPE_CHECKING:
    from bluerov_slam.records import AcousticFix

# The transmitter calls once a second; a pilot who waits longer than this wants to know why.
NO_PULSES_S: Final = 10.0
REMEMBERED_S: Final = 15.0
REMEMBERED: Final = 40
# What one pulse says may be chance; most of the last ones are not.
RECENT: Final = 5


class AcousticState(StrEnum):
    """How it stands with the array."""

    OFF = "off"
    WAITING = "waiting"
    OK = "ok"
    WARN = "warn"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class AcousticWords:
    """A sentence, and what to do; `cure` is empty where nothing is wrong."""

    state: AcousticState
    text: str
    cure: str = ""


NOT_FITTED: Final = AcousticWords(AcousticState.OFF, "No acoustic array is fitted")
NOT_DESCRIBED: Final = AcousticWords(
    AcousticState.WARN,
    "An acoustic board sends, but no array is described",
    "Enter the array under Settings, acoustics, and switch acoustics.enabled on.",
)
NAVIGATION_OFF: Final = AcousticWords(
    AcousticState.FAULT,
    "Acoustic positioning needs navigation, which is off",
    "Switch navigation.enabled on under Settings.",
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
            return AcousticWords(AcousticState.WAITING, "No pulse was heard yet", _CHECKS)
        newest = self._fixes[-1]
        silent_s = now_s - newest.arrived_s
        if silent_s > NO_PULSES_S:
            return AcousticWords(AcousticState.FAULT, f"No pulses for {_duration(silent_s)}", _CHECKS)
        others = sum(fix.reason == OTHER_TEXT for fix in self._fixes)
        recent = [fix for fix in self._fixes if fix.reason != OTHER_TEXT][-RECENT:]
        bad = [fix for fix in recent if not fix.accepted]
        if len(bad) > len(recent) // 2:
            return AcousticWords(AcousticState.FAULT, *_rejected(bad[-1]))
        if others >= RECENT - 1:
            return AcousticWords(
                AcousticState.WARN,
                "Two transmitters are heard; the one where ours should be is used",
                "Switch the other one off, or move away from it.",
            )
        if (faulty := _faulty_receiver(recent)) is not None:
            return AcousticWords(AcousticState.WARN, *faulty)
        if newest.range_m is None and newest.reason:
            return AcousticWords(AcousticState.WARN, *_direction_only(newest.reason))
        if bad:
            return AcousticWords(AcousticState.OK, f"Heard; {len(bad)} of the last {len(recent)} pulses were left out")
        if newest.position_deg is None:
            return AcousticWords(AcousticState.OK, "Heard; direction and range are known")
        return AcousticWords(AcousticState.OK, "Heard; the position rests on its direction and the depth")


def _faulty_receiver(recent: list[AcousticFix]) -> tuple[str, str] | None:
    """The receiver that most of the last pulses left out."""
    counts: dict[int, int] = {}
    reasons: dict[int, str] = {}
    for fix in recent:
        for receiver, reason in fix.excluded:
            counts[receiver] = counts.get(receiver, 0) + 1
            reasons[receiver] = reason
    worst = max(counts, key=lambda receiver: counts[receiver], default=None)
    if worst is None or worst < 0 or counts[worst] <= len(recent) // 2:
        return None
    what, _, cure = reasons[worst].partition(": ")
    return f"Receiver {worst}: {what}", _sentence(cure or "Check its cable and its place in the settings")


_REJECTION_CURES: Final = (
    (TWO_TEXT, "Switch one of them off, or dive further from it; the position is held without the sound meanwhile."),
    (PLACES_TEXT, "Two transmitters are on, or a strong echo comes from a wall: switch one off, or move away from it."),
    (
        WRONG_TEXT,
        "Another transmitter is heard, or a setting is wrong: its place, the array's mounting, the receivers' order.",
    ),
    ("no receiver heard", "Come nearer, or check the transmitter and its battery."),
    ("only ", "See which receivers are marked below and check their cables."),
    (
        "a receiver may be wrong",
        "Wait for the next pulse; if it stays so, check the receivers' places and their match.",
    ),
    (
        "delay",
        "Check acoustics.arm_m and the order of the receivers; switch other sound sources of this frequency off.",
    ),
    ("the delays do not fit", "Two transmitters, an echo, or receivers in another order than in the settings."),
    ("the receivers lie on a line", "Place one receiver beside the line of the others."),
)


def _rejected(fix: AcousticFix) -> tuple[str, str]:
    cure = next((cure for start, cure in _REJECTION_CURES if fix.reason.startswith(start)), "")
    what, _, rest = fix.reason.partition("; ")
    return _capital(what), cure or _sentence(rest)


def _direction_only(reason: str) -> tuple[str, str]:
    what = reason.removeprefix("no position: ")
    what, _, cure = what.partition("; ")
    if not cure and "contradicts the angles" in what:
        cure = "check acoustics.beacon_depth_m, the surface's zero and the array's mounting"
    elif not cure and "elevation" in what:
        cure = "it can be told where transmitter and vehicle differ more in depth, or with a fifth receiver"
    return f"Direction only: {what}", _sentence(cure)


def _sentence(text: str) -> str:
    return f"{_capital(text)}." if text else ""


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"
