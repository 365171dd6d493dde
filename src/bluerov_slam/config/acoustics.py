"""The settings of acoustic positioning."""

from __future__ import annotations

import itertools
import math
from typing import Literal, Self

from pydantic import field_validator, model_validator
from pydantic_core import PydanticCustomError

from bluerov_slam.config.kinds import (
    PLACE_PATTERN,
    Angles3,
    Group,
    HostName,
    Port,
    Resonances,
    Skews,
    Vector3,
    on_earth,
    place_deg,
    setting,
)


class AcousticsSettings(Group):
    """Acoustic positioning: an array of receivers on the vehicle hears one transmitter at a known place."""

    enabled: bool = setting(
        False, "an array is fitted: find direction and position from what its board sends", live=True
    )
    udp_host: HostName = setting(
        "127.0.0.1",
        "address where the board's datagrams are taken; 0.0.0.0 for a board on the vehicle's network",
        live=True,
    )
    udp_port: Port = setting(14557, "UDP port for the board's frames; 0 takes a free port", live=True)
    array: Literal["cross", "cross_with_centre", "cross_with_stalk", "places"] = setting(
        "cross",
        "four receivers in an X, a fifth in its middle or an arm's length before it, or anywhere (acoustics.places_m)",
        live=True,
    )
    arm_m: float = setting(0.25, "from the centre of the X to each receiver", unit="m", live=True, ge=0.02, le=5.0)
    places_m: str = setting(
        "",
        "forward, right, down of each receiver from the array's centre, such as 0,-0.2,-0.2; 0,-0.2,0.2; 0,0.2,0",
        unit="m",
        live=True,
        max_length=1000,
    )
    sample_skew_us: Skews = setting(
        (), "how much later than receiver 0 the board samples each one, in raw records; empty: all at once", unit="us",
        live=True,
    )  # fmt: skip
    receiver_khz: Resonances = setting(
        (), "resonance of each receiver as isbl calibrate-array finds it; evens out raw records; empty: not known",
        unit="kHz", live=True,
    )  # fmt: skip
    mounting_rpy_deg: Angles3 = setting(
        (0.0, 0.0, 0.0),
        "roll, pitch, yaw that turn the array's forward, right, down into the vehicle's; looking down: 0, -90, 0",
        unit="deg", live=True,
    )  # fmt: skip
    lever_arm_frd_m: Vector3 = setting(
        (0.0, 0.0, 0.0), "the array's centre from the IMU: forward, right, down", unit="m", live=True
    )
    beacon: str = setting(
        "",
        "the transmitter's latitude and longitude in degrees, such as 54.3219, 10.1356; empty: only its direction",
        live=True,
        pattern=PLACE_PATTERN,
    )
    beacon_depth_m: float = setting(
        1.0, "the transmitter's depth below the surface", unit="m", live=True, ge=0.0, le=6000.0
    )
    beacon_std_m: float = setting(
        1.0, "how sure the transmitter's place is, one standard deviation", unit="m", live=True, ge=0.0, le=1000.0
    )
    beacon_from_message: bool = setting(
        True, "take the transmitter's place from its own messages where it sends any", live=True
    )
    sound_speed_source: Literal["ctd", "fixed"] = setting(
        "ctd", "where the speed of sound comes from; without a CTD it is the fixed one", live=True
    )
    sound_speed_mps: float = setting(
        1500.0, "speed of sound: sea water 1450 to 1550, fresh water 1400 to 1500, air 343", unit="m/s", live=True,
        ge=300.0, le=1700.0,
    )  # fmt: skip
    carrier_khz: float = setting(40.0, "frequency of the transmitter", unit="kHz", live=True, ge=5.0, le=500.0)
    delay_std_us: float = setting(
        0.5, "error of a delay that the board measured itself, one standard deviation", unit="us", live=True,
        ge=0.001, le=1000.0,
    )  # fmt: skip
    use_for_navigation: bool = setting(True, "let the position estimate rest on it, too", live=True)

    @field_validator("beacon")
    @classmethod
    def _beacon_ison_earth(cls, beacon: str) -> str:
        return on_earth(beacon)

    @model_validator(mode="after")
    def _receivers_fit(self) -> Self:
        wanted = self.array == "places"
        try:
            places = self.receiver_places_m
            fits = all(len(place) == 3 for place in places) and (not wanted or len(places) >= 3)
            fits = fits and all(math.dist(a, b) >= 0.001 for a, b in itertools.combinations(places, 2))
        except ValueError:
            fits = False
        if not fits:
            raise PydanticCustomError(
                "setting",
                "expected three numbers for each of three or more receivers, no two at one place, such as "
                "0,-0.2,-0.2; 0,-0.2,0.2; 0,0.2,0",
                {"key": "acoustics.places_m"},
            )
        count = len(places) if wanted else 4 + (self.array != "cross")
        if self.sample_skew_us and len(self.sample_skew_us) != count:
            raise PydanticCustomError(
                "setting",
                "expected one number for each receiver, or none",
                {"key": "acoustics.sample_skew_us"},
            )
        if self.receiver_khz and len(self.receiver_khz) != count:
            raise PydanticCustomError(
                "setting",
                "expected one number for each receiver, or none",
                {"key": "acoustics.receiver_khz"},
            )
        return self

    @property
    def receiver_places_m(self) -> tuple[tuple[float, ...], ...]:
        """`places_m` as numbers. Raises ValueError."""
        rows = [row for row in self.places_m.split(";") if row.strip()]
        return tuple(tuple(float(part) for part in row.split(",")) for row in rows)

    @property
    def beacon_deg(self) -> tuple[float, float] | None:
        """The transmitter's place, if it is known."""
        return place_deg(self.beacon)
