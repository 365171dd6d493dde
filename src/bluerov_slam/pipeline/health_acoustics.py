"""Health of acoustic positioning: heard or not, believed or not, and how good its newest fix is."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from bluerov_slam.pipeline.acoustic_watch import AcousticState, within_m
from bluerov_slam.pipeline.health_model import ChipState, FaultLevel, Finding, PortState, wrong
from bluerov_slam.records import SensorTrust

if TYPE_CHECKING:
    from bluerov_slam.pipeline.health_memory import HealthMemory
    from bluerov_slam.pipeline.health_model import HealthFacts
    from bluerov_slam.records import AcousticFix

# Transmitters call once in one to five seconds: a fix older than this says where the vehicle was.
STALE_S: Final = 6.0
NEWEST: Final = "Newest pulse"
_SENSOR: Final = "acoustics"
_LEVELS: Final = {AcousticState.WARN: FaultLevel.WARNING, AcousticState.FAULT: FaultLevel.ERROR}

_SILENCE: Final = "The transmitter was heard before; now the array hears nothing of it, or its board sends nothing."


def check_acoustics(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """The array and its transmitter."""
    acoustics = facts.acoustics
    if acoustics is None or acoustics.words.state is AcousticState.OFF:
        return Finding(ChipState.OFF, "No array" if acoustics is None else acoustics.words.brief)
    words, age_s, parts = acoustics.words, acoustics.age_s, acoustics.parts
    if facts.link.state is PortState.FINISHED and words.kind in ("silent", "waiting"):
        return Finding(ChipState.UNKNOWN, "Replay finished", age_s=age_s, parts=parts)
    if words.state in _LEVELS:
        found = wrong(
            f"acoustics_{words.kind}",
            words.brief,
            _SILENCE if words.kind == "silent" else _sentence(words.text),
            words.cure,
            level=_LEVELS[words.state],
            age_s=age_s,
        )
        # What the cause says is not said twice.
        return replace(found, parts=tuple(part for part in parts if part[0] != NEWEST))
    if words.state is AcousticState.WAITING:
        return Finding(ChipState.UNKNOWN, words.brief, age_s=age_s, parts=(*parts, ("To check", words.cure)))
    if age_s is not None and age_s > STALE_S:
        return Finding(ChipState.UNKNOWN, f"Stale: {age_s:.0f} s old", age_s=age_s, parts=parts)
    distrusted = () if facts.navigation is None else facts.navigation.distrusted
    refused = next((each for each in distrusted if each.name == _SENSOR), None)
    if refused is not None and refused.trust is SensorTrust.REJECTED:
        # The fault itself is told beside the estimator, which refuses.
        why = ("Why", refused.reason or "It contradicts everything else.")
        return Finding(ChipState.WARN, "Navigation refuses it", age_s=age_s, parts=(why, *parts))
    return Finding(ChipState.OK, words.brief, age_s=age_s, parts=parts)


def acoustic_parts(fix: AcousticFix | None, pings: int, refused: int) -> tuple[tuple[str, str], ...]:
    """What the newest pulse told, in words; only what was accepted."""
    if fix is None:
        return ()
    parts = [] if fix.reason == "" else [(NEWEST, fix.reason.replace("; ", ": ", 1))]
    if fix.accepted and fix.azimuth_rad is not None and fix.elevation_rad is not None:
        parts.append(("Transmitter", f"{_side(fix.azimuth_rad)}, {_height(fix.elevation_rad)}"))
    if fix.accepted and fix.range_m is not None and fix.range_std_m is not None:
        parts.append(("Distance", f"{fix.range_m:.1f} m, within {1.96 * fix.range_std_m:.1f} m (95 %)"))
    metres = within_m(fix) if fix.accepted else None
    if metres is not None:
        parts.append(("Fix", f"within {metres:.1f} m (95 %)"))
    parts.append(("Pulses", f"{pings} heard, {refused} refused"))
    return tuple(parts)


def _sentence(text: str) -> str:
    """The words without what the chip has said already."""
    rest = text.removeprefix("Direction only: ").rstrip(".")
    return f"{rest[:1].upper()}{rest[1:]}."


def _side(azimuth_rad: float) -> str:
    degrees = math.degrees(azimuth_rad)
    return f"{abs(degrees):.0f}\u00b0 to {'starboard' if degrees >= 0.0 else 'port'}"


def _height(elevation_rad: float) -> str:
    degrees = math.degrees(elevation_rad)
    return f"{abs(degrees):.0f}\u00b0 {'down' if degrees >= 0.0 else 'up'}"
