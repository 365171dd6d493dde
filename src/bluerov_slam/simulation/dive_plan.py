"""What is to be dived: where, under which conditions, with which sensors. Data, and the plans that results are for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import cast

from bluerov_slam.errors import ConfigError
from bluerov_slam.simulation.acoustic_plan import AcousticPlan, acoustic_plan_from_mapping
from bluerov_slam.simulation.conditions import CONDITIONS, FAMILIES
from bluerov_slam.simulation.faults import Fault, fault_from_mapping
from bluerov_slam.simulation.routes import DepthPlan, JoinedRoutes, LegRoute, SwingRoute, lawnmower_corners
from bluerov_slam.simulation.water import WaterProfile

KINDS = ("lawnmower", "swing", "swing_lawnmower", "tumble")
_SWING_TURNS, _SWING_TURN_S = 2.0, 75.0
_SPEED_MPS = 0.5
_TUMBLE_S = 150.0


@dataclass(frozen=True, slots=True)
class DivePlan:
    """One dive. `afloat_first_s`, `afloat_last_s`: at the surface under GPS at the ends of the track.

    `rest_s`: afloat and at rest before the track begins, so that everything has power, a fix and a first attitude; it
    comes before the 1960 s of a lawnmower. `kind`: lawnmower; swing (two slow turns on the spot, afloat); the one
    behind the other; tumble (on deck, every face of the IMU up once, then turned about in the hand). `acoustics`: a
    beacon and an array; what the array's board sends comes over the ESP32's line.
    """

    name: str = "lawnmower"
    kind: str = "lawnmower"
    conditions: str = "hard"
    noise_family: str = "nominal"
    dvl: bool = False
    afloat_first_s: float = 400.0
    afloat_last_s: float = 0.0
    depth_m: float = 8.0
    rest_s: float = 30.0
    uncalibrated: bool = False
    thrusters: int = 6
    legs: int = 5
    leg_m: float = 180.0
    spacing_m: float = 20.0
    origin_latitude_deg: float = 47.6123
    origin_longitude_deg: float = -2.7456
    water: WaterProfile = field(default_factory=WaterProfile)
    water_depth_m: float = 15.0
    acoustics: AcousticPlan | None = None
    faults: tuple[Fault, ...] = ()

    def route(self) -> LegRoute | SwingRoute | JoinedRoutes:
        """What the pilot follows; on deck nobody flies."""
        if self.kind == "swing":
            return SwingRoute(_SWING_TURNS, _SWING_TURN_S, DepthPlan(((0.0, None),)), self.rest_s)
        if self.kind == "swing_lawnmower":
            swing = SwingRoute(_SWING_TURNS, _SWING_TURN_S, DepthPlan(((0.0, None),)), self.rest_s)
            return JoinedRoutes(swing, self._legs(0.0))
        return self._legs(self.rest_s)

    @property
    def duration_s(self) -> float:
        """From power-up to the end."""
        return _TUMBLE_S if self.kind == "tumble" else self.route().end_s

    @property
    def track_start_s(self) -> float:
        """When the track begins."""
        if self.kind == "swing_lawnmower":
            return self.rest_s + _SWING_TURNS * _SWING_TURN_S
        return self.rest_s

    def _legs(self, rest_s: float) -> LegRoute:
        corners = lawnmower_corners(self.legs, self.leg_m, self.spacing_m)
        way_s = LegRoute(corners, _SPEED_MPS, DepthPlan(((0.0, None),)), rest_s).end_s
        changes: list[tuple[float, float | None]] = [(0.0, None), (rest_s + self.afloat_first_s, self.depth_m)]
        if self.afloat_last_s > 0.0:
            changes.append((way_s - self.afloat_last_s - self.depth_m / 0.3, None))
        return LegRoute(corners, _SPEED_MPS, DepthPlan(tuple(changes)), rest_s)


DIVE_PLANS = {
    "n2": DivePlan("n2"),
    "n3": DivePlan("n3", afloat_first_s=60.0, afloat_last_s=60.0),
    "n4": DivePlan("n4", afloat_first_s=60.0, afloat_last_s=60.0, dvl=True),
    "n5": DivePlan("n5", kind="swing_lawnmower", afloat_first_s=120.0, legs=3, leg_m=90.0),
    "beacon": DivePlan(
        "beacon",
        afloat_first_s=60.0,
        depth_m=5.0,
        acoustics=AcousticPlan(
            beacon_north_m=90.0,
            beacon_east_m=40.0,
            beacon_depth_m=14.5,
            pulse_period_s=5.0,
            array="cross_with_stalk",
            mounting_rpy_deg=(0.0, -90.0, 0.0),
            lever_arm_frd_m=(0.1, 0.0, 0.2),
            record_every=0,
            message_every=0,
        ),
    ),
    "compass_swing": DivePlan("compass_swing", kind="swing", uncalibrated=True),
    "tumble": DivePlan("tumble", kind="tumble", uncalibrated=True),
}


def dive_plan_from_mapping(values: Mapping[str, object]) -> DivePlan:
    """A plan from a file's contents: `base` names the one to start from. Raises ConfigError with the key."""
    base = str(values.get("base", "n2"))
    if base not in DIVE_PLANS:
        raise ConfigError(f"dive plan: base '{base}' is unknown; there are {', '.join(DIVE_PLANS)}")
    plan = DIVE_PLANS[base]
    changes: dict[str, object] = {}
    known = {item.name: getattr(plan, item.name) for item in fields(DivePlan)}
    for key, value in values.items():
        if key == "base":
            continue
        if key not in known:
            raise ConfigError(f"dive plan: unknown key '{key}'; allowed: base, {', '.join(known)}")
        if key == "faults" and isinstance(value, list | tuple):
            changes[key] = tuple(fault_from_mapping(cast(Mapping[str, object], item)) for item in value)
        elif key == "acoustics" and isinstance(value, Mapping):
            changes[key] = acoustic_plan_from_mapping(value)
        elif key == "water" and isinstance(value, Mapping):
            changes[key] = replace(WaterProfile(), **value)
        elif isinstance(known[key], float) and isinstance(value, int | float) and not isinstance(value, bool):
            changes[key] = float(value)
        elif type(value) is type(known[key]):
            changes[key] = value
        else:
            raise ConfigError(f"dive plan: {key} must be a {type(known[key]).__name__}, not {value!r}")
    chosen = replace(plan, **changes)  # type: ignore[arg-type]
    for key, allowed in (("kind", KINDS), ("conditions", tuple(CONDITIONS)), ("noise_family", FAMILIES)):
        if getattr(chosen, key) not in allowed:
            raise ConfigError(f"dive plan: {key} must be one of {', '.join(allowed)}, not {getattr(chosen, key)!r}")
    if chosen.thrusters not in (6, 8):
        raise ConfigError(f"dive plan: thrusters must be 6 or 8, not {chosen.thrusters}")
    return chosen
