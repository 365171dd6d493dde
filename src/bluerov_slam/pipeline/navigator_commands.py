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

    `at_s` is the host's monotonic clock, which starts anew with the host: whoever keeps the file must know whether it
    is the same boot, or pass the age to `Navigator`. `layout` names the blocks of the error state, `values` (n,) holds
    them and `covariance` their covariance, row by row from the diagonal on. None or empty where unknown.
    """

    at_s: float
    version: int = SAVED_VERSION
    origin_deg: tuple[float, float] | None = None
    position_known: bool = False
    quaternion_ned_frd: tuple[float, float, float, float] | None = None
    layout: tuple[tuple[str, int], ...] = ()
    values: tuple[float, ...] = ()
    covariance: tuple[float, ...] = ()
    last_fix_s: float | None = None
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
            values["origin_deg"] = _vector(values.get("origin_deg"), 2)
            values["quaternion_ned_frd"] = _vector(values.get("quaternion_ned_frd"), 4)
            layout = tuple((str(name), int(size)) for name, size in values.get("layout") or ())
            states = sum(size for _, size in layout)
            values["layout"] = layout
            values["values"] = _vector(values.get("values") or (), states)
            values["covariance"] = _vector(values.get("covariance") or (), states * (states + 1) // 2)
            numbers = [values[name] for name in ("at_s", "distance_m", "reset_counter") if name in values]
            optional = [values.get(name) for name in ("surface_pressure_pa", "last_fix_s")]
            _vector([*numbers, *(number for number in optional if number is not None)], None)
            if not isinstance(values.get("calibration", {}), dict):
                return None
            return cls(**values)
        except (TypeError, ValueError):
            return None


def _vector(value: object, size: int | None) -> Any:
    if value is None:
        return None
    if not isinstance(value, (list, tuple)) or (size is not None and len(value) != size):
        raise ValueError("wrong size")
    vector = tuple(float(number) for number in value)
    if not all(math.isfinite(number) for number in vector):
        raise ValueError("not a number")
    return vector


@dataclass(frozen=True, slots=True)
class CalibrationProgress:
    """How far one guided routine is. `instruction`: what to do now; `residual` in `unit`: what was left after it."""

    kind: str
    state: str  # none, running, ready or done
    progress: float | None
    instruction: str
    residual: float | None
    unit: str
    made_unix_s: float | None
