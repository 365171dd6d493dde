"""A beacon in the simulated sea and an array on the vehicle: what they are and how wrong they are. Data only.

The figures are the simulator's own; the estimator has its own (docs/navigation.md section 4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal

from bluerov_slam.errors import ConfigError

_PERIODS = ("beacon_watch_s", "beacon_gps_correlation_s", "wander_correlation_s")


@dataclass(frozen=True, slots=True)
class AcousticErrors:
    """What is wrong with sound, array and board. Standard deviations of what is drawn once, unless it says otherwise.

    `wander_*`: a slow change of the direction of arrival (water that is not in layers), correlated over
    `wander_correlation_s`. `jitter_rad`: scale of a Laplace distribution, ping by ping. `shadowed_share` of the pings
    lose most of the direct path and arrive by an echo: the outliers. Echoes have Rayleigh distributed strengths.
    `thruster_noise`: relative rise of the noise per ampere.
    """

    receiver_place_m: float = 0.0005
    mounting_rad: float = 0.0087
    resonance: float = 0.005
    filter_corner: float = 0.03
    gain: float = 0.1
    board_clock_ppm: float = 15.0
    beacon_clock: float = 0.013  # mean relative slowness of the beacon's clock, as the thesis's; half of it drawn
    beacon_watch_m: float = 0.0  # radius of a moored buoy's circle
    beacon_watch_s: float = 240.0
    beacon_gps_m: float = 1.2
    beacon_gps_correlation_s: float = 300.0
    wander_rad: float = 0.002
    wander_correlation_s: float = 45.0
    jitter_rad: float = 0.0004
    shadowed_share: float = 0.05
    shadowed_gain: float = 0.15
    surface_echo: float = 0.10
    bottom_echo: float = 0.12
    thruster_noise: float = 0.03


_NO_ERRORS = AcousticErrors(**{item.name: 0.0 for item in fields(AcousticErrors) if item.name not in _PERIODS})
ERROR_SETS = {
    "none": _NO_ERRORS,
    "nominal": AcousticErrors(),
    "hard": AcousticErrors(
        receiver_place_m=0.001,
        resonance=0.01,
        filter_corner=0.10,
        beacon_watch_m=1.5,
        wander_rad=0.005,
        jitter_rad=0.001,
        shadowed_share=0.10,
        surface_echo=0.25,
        bottom_echo=0.30,
        thruster_noise=0.06,
    ),
}
FAULT_KINDS = {"dead": 1, "silent": 1, "clipped": 1, "swapped": 2}  # and how many receivers it takes
CHAINS = ("band_limited", "thesis")
ARRAYS = {"cross": 4, "cross_with_centre": 5, "cross_with_stalk": 5}


@dataclass(frozen=True, slots=True)
class AcousticPlan:
    """One beacon, one array. Places are NED from the survey's origin, the mounting is FRD from the array's frame.

    The array looks up by default: its four receivers lie in a horizontal plane. A fifth one stands in their middle, or
    before it on a stalk of the arm's length, which tells above from below and sees flat directions. `chain`: how the
    board computes the delays it sends. Every `record_every`-th pulse is sent as a record, too (0: none), every
    `message_every`-th one brings a message. `link`: whether the frames come by UDP or over the ESP32's line. `faults`:
    what is wrong with the receivers from the start, such as "dead 2", "silent 1", "clipped 0" or "swapped 1 2".
    `second_beacon_ned_m`: another transmitter of the same kind, with a clock of its own.
    """

    beacon_north_m: float = 25.0
    beacon_east_m: float = 25.0
    beacon_depth_m: float = 2.0
    pulse_period_s: float = 1.0
    array: str = "cross"
    arm_m: float = 0.25
    mounting_rpy_deg: tuple[float, float, float] = (0.0, 90.0, 0.0)
    lever_arm_frd_m: tuple[float, float, float] = (0.05, 0.0, -0.20)
    chain: Literal["band_limited", "thesis"] = "band_limited"
    record_every: int = 10
    message_every: int = 20
    pre_trigger_samples: int = 448
    peak_counts_at_1m: float = 15_000.0
    noise_counts: float = 4.0
    accept_std_counts: float = 20.0
    link: str = "udp"
    errors: str = "nominal"
    faults: tuple[str, ...] = ()
    second_beacon_ned_m: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for fault in self.faults:
            parse_receiver_fault(fault, ARRAYS[self.array])

    @property
    def error_figures(self) -> AcousticErrors:
        """The figures that `errors` names."""
        return ERROR_SETS[self.errors]


_CHOICES = {"array": tuple(ARRAYS), "chain": CHAINS, "link": ("udp", "serial"), "errors": tuple(ERROR_SETS)}
_RANGES: dict[str, tuple[float, float]] = {
    "beacon_north_m": (-1.0e4, 1.0e4),
    "beacon_east_m": (-1.0e4, 1.0e4),
    "beacon_depth_m": (0.1, 1000.0),
    "pulse_period_s": (0.1, 60.0),
    "arm_m": (0.02, 5.0),
    "record_every": (0, 10_000),
    "message_every": (0, 10_000),
    "pre_trigger_samples": (0, 2000),
    "peak_counts_at_1m": (1.0, 1.0e6),
    "noise_counts": (0.0, 2000.0),
    "accept_std_counts": (0.0, 2000.0),
}


def parse_receiver_fault(text: str, receivers: int) -> tuple[str, tuple[int, ...]]:
    """What is wrong and with whom. Raises ConfigError."""
    kind, *who = text.split() or [""]
    numbers = tuple(int(part) for part in who if part.isdecimal())
    wanted = FAULT_KINDS.get(kind)
    if (
        wanted is None
        or len(numbers) != len(who)
        or len(set(numbers)) != wanted
        or max(numbers, default=receivers) >= receivers
    ):
        known = ", ".join(f"{name}{' N' * count}" for name, count in FAULT_KINDS.items())
        raise ConfigError(f"acoustics: fault '{text}' is none of {known} with receivers 0 to {receivers - 1}")
    return kind, numbers


def acoustic_plan_from_mapping(values: Mapping[str, object]) -> AcousticPlan:
    """A plan from a file's table. Raises ConfigError with the key and what is allowed."""
    known = {item.name: getattr(AcousticPlan(), item.name) for item in fields(AcousticPlan)}
    changes: dict[str, object] = {}
    for key, value in values.items():
        if key not in known:
            raise ConfigError(f"acoustics: unknown key '{key}'; allowed: {', '.join(known)}")
        changes[key] = _checked(key, value, known[key])
    return replace(AcousticPlan(), **changes)  # type: ignore[arg-type]


def _checked(key: str, value: object, default: object) -> object:
    if key in _CHOICES:
        if value not in _CHOICES[key]:
            raise ConfigError(f"acoustics: {key} must be one of {', '.join(_CHOICES[key])}, not {value!r}")
        return value
    if key == "faults":
        if not isinstance(value, list | tuple) or not all(isinstance(part, str) for part in value):
            raise ConfigError(f"acoustics: faults must be a list of texts, not {value!r}")
        return tuple(value)
    if isinstance(default, tuple) or key == "second_beacon_ned_m":
        if not isinstance(value, list | tuple) or len(value) != 3 or not all(_is_number(part) for part in value):
            raise ConfigError(f"acoustics: {key} must be three numbers, not {value!r}")
        return tuple(float(part) for part in value)
    wanted = type(default)
    if wanted is float and _is_number(value):
        value = float(str(value))
    if not isinstance(value, wanted) or isinstance(value, bool):
        raise ConfigError(f"acoustics: {key} must be a {wanted.__name__}, not {value!r}")
    low, high = _RANGES[key]
    if not low <= float(str(value)) <= high:
        raise ConfigError(f"acoustics: {key} must be {low:g}..{high:g}, not {value}")
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
