"""What a user may ask of the navigator, and what it keeps over a restart."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from typing import Any

SAVED_VERSION = 1


class NavigatorAction(StrEnum):
    """Verbs of POST /api/navigation."""

    ZERO_DEPTH = "zero_depth"
    SET_ORIGIN = "set_origin"
    RESET = "reset"
    START_CALIBRATION = "start_calibration"
    FINISH_CALIBRATION = "finish_calibration"
    CANCEL_CALIBRATION = "cancel_calibration"
    CLEAR_CALIBRATION = "clear_calibration"


@dataclass(frozen=True, slots=True)
class NavigatorCommand:
    """One order.

    `set_origin` without a position means: here. `unix_s` dates a calibration: the navigator has no wall clock.
    """

    action: NavigatorAction
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    kind: str | None = None
    unix_s: float | None = None


@dataclass(frozen=True, slots=True)
class SavedNavigation:
    """What a restart needs, as plain numbers: `SavedNavigation.from_json(saved.to_json())` is the same.

    `at_s` is the host's monotonic clock, which starts anew with the host: whoever keeps the file notes the wall clock
    beside it and passes the age to `Navigator`. None or empty where unknown.
    """

    at_s: float
    version: int = SAVED_VERSION
    origin_deg: tuple[float, float] | None = None
    position_known: bool = False
    position_ned_m: tuple[float, float, float] | None = None
    velocity_ned_mps: tuple[float, float, float] | None = None
    quaternion_ned_frd: tuple[float, float, float, float] | None = None
    blocks: dict[str, list[float]] = field(default_factory=dict)
    standard_deviations: dict[str, list[float]] = field(default_factory=dict)
    surface_pressure_pa: float | None = None
    distance_m: float = 0.0
    reset_counter: int = 0
    calibration: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Plain dictionary."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: object) -> SavedNavigation | None:
        """The saved state, or None when it is not one (another version, a damaged file, something not a number)."""
        if not isinstance(data, dict) or data.get("version") != SAVED_VERSION:
            return None
        known = {each.name for each in fields(cls)}
        try:
            values = {name: value for name, value in data.items() if name in known}
            for name, size in (
                ("origin_deg", 2),
                ("position_ned_m", 3),
                ("velocity_ned_mps", 3),
                ("quaternion_ned_frd", 4),
            ):
                values[name] = _vector(values.get(name), size)
            saved = cls(**values)
            blocks = [saved.blocks, saved.standard_deviations]
            numbers = [saved.at_s, saved.distance_m, saved.reset_counter]
            for block in blocks:
                numbers += [float(number) for row in block.values() for number in row]
            finite = all(math.isfinite(float(number)) for number in numbers)
        except (TypeError, ValueError, AttributeError):
            return None
        return saved if finite else None


def _vector(value: object, size: int) -> Any:
    if value is None:
        return None
    if not isinstance(value, (list, tuple)) or len(value) != size:
        raise ValueError("wrong size")
    vector = tuple(float(number) for number in value)
    if not all(math.isfinite(number) for number in vector):
        raise ValueError("not a number")
    return vector
