"""What settings are made of: kinds of values, one setting, a group of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

Port = Annotated[int, Field(ge=0, le=65535)]
HostName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:\-]{1,253}$")]
Metres = Annotated[float, Field(ge=-10.0, le=10.0)]
Vector3 = Annotated[tuple[Metres, Metres, Metres], Field(strict=False)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
Angles3 = Annotated[tuple[Degrees, Degrees, Degrees], Field(strict=False)]
Resonances = Annotated[tuple[Annotated[float, Field(ge=5.0, le=500.0)], ...], Field(strict=False, max_length=16)]
Skews = Annotated[tuple[Annotated[float, Field(ge=-100.0, le=100.0)], ...], Field(strict=False, max_length=16)]
PLACE_PATTERN = r"^\s*(-?\d{1,2}(\.\d{1,12})?\s*,\s*-?\d{1,3}(\.\d{1,12})?\s*)?$"
Directions = Annotated[tuple[Literal[1, -1], ...], Field(strict=False, max_length=8)]
Names = Annotated[tuple[HostName, ...], Field(strict=False, max_length=16)]
Origins = Annotated[
    tuple[Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:/\-]{1,253}$")], ...],
    Field(strict=False, max_length=16),
]


def setting(
    default: Any, reason: str, *, unit: str | None = None, live: bool = False, secret: bool = False, **limits: Any
) -> Any:
    """One setting. `live`: a change takes effect at once, without a restart. `secret`: never shown or backed up."""
    extra: dict[str, Any] = {"unit": unit, "restart": not live, "secret": secret}
    return Field(default=default, description=reason, json_schema_extra=extra, **limits)


class Group(BaseModel):
    """One group of settings: immutable, no unknown key, no value of another type."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def on_earth(place: str) -> str:
    """The text of a place as it is. Raises ValueError where no such place is."""
    degrees = place_deg(place)
    if degrees is not None and (abs(degrees[0]) > 90.0 or abs(degrees[1]) > 180.0):
        raise ValueError("expected latitude -90 to 90 and longitude -180 to 180")
    return place


def place_deg(text: str) -> tuple[float, float] | None:
    """Latitude and longitude of '48.1, -2.3'; None of nothing."""
    if not text.strip():
        return None
    latitude_deg, longitude_deg = map(float, text.split(","))
    return latitude_deg, longitude_deg
