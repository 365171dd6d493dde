"""How hard the simulated sea, vehicle and instruments are: the figures of docs/navigation.md section 4. Data only.

These are the simulator's own. The estimator has its own figures and must not take these, nor these come from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from bluerov_slam.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Conditions:
    """One sigma where nothing else is said. `still`, `calm` and `hard` are the sets that results are stated for.

    `current_*`: velocity of the water over ground per horizontal axis, and its walk. `speed_scale_std`: how far the
    hull's speed for a given thrust is from the nominal vehicle's, ahead; half of it sideways. `compass_total_rad`: root
    sum square of the deviation coefficients A, B and C. `unmodelled_velocity`: white velocity of the water around the
    vehicle, as position walk. `tether_share`: drag of 100 m of cable as a share of the hull's. `thruster_spread`:
    how far one thruster's strength is from the next. The second group is zero in the nominal family.
    """

    name: str
    current_std_mps: float
    current_walk_mps_per_root_s: float
    speed_scale_std: float
    compass_total_rad: float
    compass_wander_rad: float
    unmodelled_velocity_m_per_root_s: float
    thruster_field_nt_per_a: float
    tether_share: float
    thruster_spread: float = 0.005

    heavy_tails: bool = False
    gust_std_mps: float = 0.0
    shear_share: float = 0.0
    tide_mps: float = 0.0
    wave_height_m: float = 0.0
    instruments: float = 1.0
    """Size of what is wrong with the instruments, white noise apart; 0 for a recording, which brings its own errors."""


_DEGREE = 0.017453292519943295

CONDITIONS = {
    "still": Conditions("still", 0.0, 0.0, 0.05, 2.0 * _DEGREE, 0.7 * _DEGREE, 0.03, 6.0, 0.0),
    "calm": Conditions("calm", 0.05, 0.0005, 0.05, 2.0 * _DEGREE, 0.7 * _DEGREE, 0.05, 8.0, 0.02),
    "hard": Conditions("hard", 0.20, 0.001, 0.10, 3.0 * _DEGREE, 1.0 * _DEGREE, 0.05, 12.0, 0.03),
}
RECORDED = Conditions("recorded", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, instruments=0.0)
FAMILIES = ("nominal", "mismatched")


def conditions_of(name: str, family: str = "nominal") -> Conditions:
    """The figures of a set, in the nominal family or with everything that a filter does not expect."""
    if name not in CONDITIONS:
        raise ConfigError(f"conditions '{name}' are unknown; there are {', '.join(CONDITIONS)}")
    if family not in FAMILIES:
        raise ConfigError(f"noise family '{family}' is unknown; there are {', '.join(FAMILIES)}")
    chosen = CONDITIONS[name]
    if family == "nominal":
        return chosen
    return replace(
        chosen,
        heavy_tails=True,
        gust_std_mps=0.15 * chosen.current_std_mps + 0.005,
        thruster_spread=0.02,
        shear_share=0.10,
        tide_mps=0.25 * chosen.current_std_mps,
        wave_height_m=0.35,
        tether_share=2.5 * chosen.tether_share + 0.03,
    )
