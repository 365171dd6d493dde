"""What a simulated run consists of: sea, survey, sonars, board and scripted faults. Data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import cast, get_type_hints

from bluerov_slam.errors import ConfigError
from bluerov_slam.simulation.acoustic_plan import AcousticPlan, acoustic_plan_from_mapping
from bluerov_slam.simulation.conditions import CONDITIONS, FAMILIES
from bluerov_slam.simulation.faults import Fault, fault_from_mapping
from bluerov_slam.simulation.water import WaterProfile


@dataclass(frozen=True, slots=True)
class Scenario:
    """One run. The same scenario, baud rate and host bytes always give the same bytes.

    `mission_start_s` skips that much of the mission (0 = at the surface before the first dive). `uptime_s` is the
    board's age at the start. `b_starts_mid_ping`: sonar B is switched on in the middle of a ping. `new_sensors`: IMU
    and conductivity probe are as from the factory, and the board has to set them up. `conditions` and `noise_family`
    say how hard sea and instruments are (`conditions.py`), `thrusters` which frame flies; `uncalibrated`: IMU and
    compass as delivered. `acoustics`: a beacon in the water and an array on the vehicle.
    """

    name: str = "survey"
    seed: int = 1
    water_depth_m: float = 15.0
    survey_depth_m: float = 9.0
    water: WaterProfile = field(default_factory=WaterProfile)
    origin_latitude_deg: float = 47.6123
    origin_longitude_deg: float = -2.7456
    mission_start_s: float = 0.0
    utc_start_unix_s: float = 1_780_300_800.0
    samples: int = 1000
    resolution_mm: int = 20
    ping_period_ms: int = 100
    dataset_mask: int = 0x02
    checksum_a: str = "mod256"
    checksum_b: str = "mod256"
    dual_channel_a: bool = False
    b_starts_mid_ping: bool = True
    sensors_rate_mhz: int = 2_000
    imu_rate_mhz: int = 20_000
    decimation: int = 4
    coding: str = "mean"
    legacy: bool = False
    clock_drift_ppm: float = 14.0
    uptime_s: float = 0.0
    new_sensors: bool = False
    boot_count: int = 7
    conditions: str = "calm"
    noise_family: str = "nominal"
    thrusters: int = 6
    dvl: bool = False
    uncalibrated: bool = False
    acoustics: AcousticPlan | None = None
    faults: tuple[Fault, ...] = ()


_FRESH_WATER = WaterProfile(24.0, 22.5, 0.25, 0.25, 1.0, 0.5, 997.4, 0.3)

SCENARIOS = {
    "survey": Scenario(),
    "pool": Scenario(name="pool", water_depth_m=4.0, survey_depth_m=2.0, water=_FRESH_WATER, resolution_mm=10),
    "deep": Scenario(name="deep", water_depth_m=84.0, survey_depth_m=78.0),
    "saturated": Scenario(name="saturated", samples=2000, resolution_mm=15),
    "high_resolution": Scenario(name="high_resolution", samples=3000, resolution_mm=10, mission_start_s=60.0),
    "beacon": Scenario(name="beacon", acoustics=AcousticPlan(array="cross_with_stalk")),
    "legacy": Scenario(name="legacy", legacy=True),
    "dual_channel": Scenario(name="dual_channel", dual_channel_a=True),
    "mod255": Scenario(name="mod255", checksum_a="mod255", checksum_b="mod255"),
    "faulty": Scenario(
        name="faulty",
        faults=tuple(
            fault_from_mapping(values)
            for values in (
                {"kind": "bit_errors", "at": 15, "duration": 10, "rate": 2.0e-4},
                {"kind": "garbage", "at": 30, "duration": 5, "rate": 4},
                {"kind": "drop", "at": 40, "duration": 10, "rate": 2.0e-3},
                {"kind": "silent", "at": 55, "duration": 10, "sensor": "imu"},
                {"kind": "silent", "at": 70, "duration": 10, "sensor": "b"},
                {"kind": "mid_ping", "at": 80, "sensor": "b"},
                {"kind": "i2c_errors", "at": 85, "duration": 8},
                {"kind": "probe", "at": 95, "duration": 2},
                {"kind": "reset", "at": 100, "reason": 9},
                {"kind": "unplug", "at": 115, "duration": 4},
            )
        ),
    ),
}

_RANGES: dict[str, tuple[float, float]] = {
    "seed": (0, 2**32 - 1),
    "water_depth_m": (1.0, 1000.0),
    "survey_depth_m": (0.3, 990.0),
    "origin_latitude_deg": (-85.0, 85.0),
    "origin_longitude_deg": (-180.0, 180.0),
    "mission_start_s": (0.0, 1.0e8),
    "utc_start_unix_s": (0.0, 4.0e9),
    "samples": (1, 5000),
    "resolution_mm": (1, 1000),
    "ping_period_ms": (0, 60_000),
    "sensors_rate_mhz": (500, 20_000),
    "imu_rate_mhz": (1_000, 20_000),
    "decimation": (1, 8),
    "clock_drift_ppm": (-500.0, 500.0),
    "uptime_s": (0.0, 5.0e6),
    "boot_count": (0, 65_535),
}
_CHOICES: dict[str, tuple[object, ...]] = {
    "checksum_a": ("mod256", "mod255"),
    "checksum_b": ("mod256", "mod255"),
    "coding": ("mean", "peak", "coded"),
    "conditions": tuple(CONDITIONS),
    "noise_family": FAMILIES,
    "thrusters": (6, 8),
}


def scenario_from_mapping(values: Mapping[str, object]) -> Scenario:
    """A scenario from a file's contents: `base` names the one to start from, `faults` is a list of tables.

    Raises ConfigError with the key and what is allowed.
    """
    base = str(values.get("base", "survey"))
    if base not in SCENARIOS:
        raise ConfigError(f"scenario: base '{base}' is unknown; there are {', '.join(SCENARIOS)}")
    changes: dict[str, object] = {}
    types = get_type_hints(Scenario)
    for key, value in values.items():
        if key == "base":
            continue
        if key not in types:
            raise ConfigError(f"scenario: unknown key '{key}'; allowed: base, {', '.join(types)}")
        changes[key] = _checked(key, value, types[key])
    scenario = replace(SCENARIOS[base], **changes)  # type: ignore[arg-type]
    if scenario.survey_depth_m > scenario.water_depth_m - 0.8:
        raise ConfigError(
            f"scenario: survey_depth_m {scenario.survey_depth_m} m is less than 0.8 m above the bottom "
            f"(water_depth_m {scenario.water_depth_m} m)"
        )
    return scenario


def _checked(key: str, value: object, wanted: object) -> object:
    if key == "faults":
        if not isinstance(value, list | tuple):
            raise ConfigError("scenario: faults must be a list of tables")
        return tuple(fault_from_mapping(cast(Mapping[str, object], item)) for item in value)
    if key == "water":
        return _water(value)
    if key == "acoustics":
        if not isinstance(value, Mapping):
            raise ConfigError("scenario: acoustics must be a table")
        return acoustic_plan_from_mapping(value)
    if key in _CHOICES and value not in _CHOICES[key]:
        raise ConfigError(f"scenario: {key} must be one of {', '.join(map(str, _CHOICES[key]))}, not {value!r}")
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, cast(type, wanted)) or (wanted is int and isinstance(value, bool)):
        raise ConfigError(f"scenario: {key} must be a {cast(type, wanted).__name__}, not {value!r}")
    if key in _RANGES and isinstance(value, int | float):
        low, high = _RANGES[key]
        if not low <= value <= high:
            raise ConfigError(f"scenario: {key} must be {low:g}..{high:g}, not {value}")
    return value


def _water(value: object) -> WaterProfile:
    names = [item.name for item in fields(WaterProfile)]
    if not isinstance(value, Mapping) or set(value) - set(names):
        raise ConfigError(f"scenario: water must be a table with keys out of {', '.join(names)}")
    try:
        return replace(WaterProfile(), **{key: float(str(number)) for key, number in value.items()})
    except ValueError as error:
        raise ConfigError(f"scenario: water: {error}") from error
