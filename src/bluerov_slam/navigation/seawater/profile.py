"""The water column as the vehicle found it: sound speed, density and true depth at any depth that was sampled.

Nodes are what `cast.py` made of the samples. Between neighbouring nodes temperature, salinity and pressure change in a
straight line over depth, and the formulas are applied to them. What was not sampled is unknown: above and below the
sampled stretch, and in a hole of it longer than `ColumnOptions.longest_gap_m`. `Extension.NEAREST` answers there, too.
Depth comes from pressure by integrating dp / (density * gravity) from the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater.density import density_kg_per_m3
from bluerov_slam.navigation.seawater.depth import gravity_mps2
from bluerov_slam.navigation.seawater.sound_speed import SoundSpeedFormula, sound_speed_by_mps

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from bluerov_slam.navigation.seawater.validity import Value

    Array = NDArray[np.float64]

_DERIVATIVE_STEP = 1e-3
# A pressure sensor at the surface may read up to 1 m of water too little.
_NOISE_ABOVE_SURFACE_PA = 1e4


class Extension(StrEnum):
    """What to answer where nothing was sampled."""

    NONE = "none"  # unknown
    NEAREST = "nearest"  # temperature and salinity of the nearest node, in a hole the straight line between its ends


@dataclass(frozen=True, slots=True)
class ColumnOptions:
    """How samples become nodes, and what the sensors may be off by in all of them alike.

    Sources: [maker] the makers' claims for TSYS01 and EZO EC; [choice] ours.
    """

    bin_pa: float = 1e4  # [choice] 1 dbar, about a metre
    samples_per_bin: int = 2  # [choice] fewer are no node
    sample_period_s: float = 0.2  # [choice] a sensor that is read faster repeats itself
    descent_pa_per_s: float = 200.0  # [choice] 2 cm/s: slower is hovering, in the vehicle's own wash
    longest_gap_m: float = 5.0  # [choice]
    temperature_accuracy_degc: float = 0.05  # [maker] 0.015 to 0.1, and the lag of its housing
    salinity_accuracy_share: float = 0.02  # [maker] 2 % of conductivity
    # Noise of single samples, where their scatter cannot show it.
    temperature_noise_degc: float = 0.02  # [choice]
    salinity_noise_psu: float = 0.05  # [choice]
    # Beyond what was sampled sound speed is less sure by so much for each metre: half a weak thermocline. [choice]
    growth_mps_per_m: float = 0.1
    formula: SoundSpeedFormula | None = None  # Mackenzie where all nodes allow it, else UNESCO


@dataclass(frozen=True, slots=True, eq=False)
class ColumnNodes:
    """What was measured, by increasing pressure: float64 (n,) each. Standard deviations: the random part."""

    sea_pressure_pa: Array
    temperature_degc: Array
    salinity_psu: Array
    temperature_std_degc: Array
    salinity_std_psu: Array
    samples: NDArray[np.int64]
    descending: NDArray[np.bool_]
    """Made from samples of the way down alone."""
    shallowest_pa: float
    deepest_pa: float


class WaterColumn:
    """Sound speed, density and depth over the sampled column; arrays by node are float64 (n,)."""

    def __init__(self, nodes: ColumnNodes, latitude_deg: float, options: ColumnOptions | None = None) -> None:
        """Nodes where no formula is valid are left out. Raises OutOfValidityError when none is left."""
        self.options = options or ColumnOptions()
        self.latitude_deg = latitude_deg
        self.formula = self.options.formula or _formula_for(nodes)
        self.nodes = _valid(nodes, self.formula)
        temperature, salinity, pressure = (
            self.nodes.temperature_degc,
            self.nodes.salinity_psu,
            self.nodes.sea_pressure_pa,
        )
        accuracy_psu = self.options.salinity_accuracy_share * salinity
        temperature_std = np.hypot(self.nodes.temperature_std_degc, self.options.temperature_accuracy_degc)
        salinity_std = np.hypot(self.nodes.salinity_std_psu, accuracy_psu)
        self.sound_speed_mps = self._speed(temperature, salinity, pressure)
        self.density_kg_per_m3 = density_kg_per_m3(temperature, salinity, pressure)
        self.sound_speed_std_mps = _propagated(
            self._speed, temperature, salinity, pressure, temperature_std, salinity_std
        )
        self.density_std_kg_per_m3 = _propagated(
            density_kg_per_m3, temperature, salinity, pressure, temperature_std, salinity_std
        )
        self._pressures_pa = np.concatenate(([0.0], pressure))
        self._depths_m = self._integrated()
        self.depth_m = self._depths_m[1:]
        first_m = float(np.interp(self.nodes.shallowest_pa, self._pressures_pa, self._depths_m))
        # The sensor never is at the surface itself: a short way up to it counts as sampled.
        self.shallowest_m = 0.0 if first_m <= self.options.longest_gap_m else first_m
        self.deepest_m = self._depth_below(np.array([self.nodes.deepest_pa]))[0]

    def sound_speed_at_mps(self, depth_m: Value, extend: Extension = Extension.NONE) -> Value:
        """Sound speed, m/s."""
        return self._answer(depth_m, extend, lambda at: self._speed(*self._water(at)))

    def sound_speed_std_at_mps(self, depth_m: Value, extend: Extension = Extension.NONE) -> Value:
        """Standard deviation of the sound speed, m/s; it grows with the distance from what was sampled."""
        return self._answer(depth_m, extend, self._speed_std)

    def density_at_kg_per_m3(self, depth_m: Value, extend: Extension = Extension.NONE) -> Value:
        """Density, kg/m3."""
        return self._answer(depth_m, extend, lambda at: density_kg_per_m3(*self._water(at)))

    def temperature_at_degc(self, depth_m: Value, extend: Extension = Extension.NONE) -> Value:
        """Temperature, degC."""
        return self._answer(depth_m, extend, lambda at: self._water(at)[0])

    def salinity_at_psu(self, depth_m: Value, extend: Extension = Extension.NONE) -> Value:
        """Practical salinity, PSU."""
        return self._answer(depth_m, extend, lambda at: self._water(at)[1])

    def mean_sound_speed_mps(self, from_m: float, to_m: float, extend: Extension = Extension.NONE) -> float:
        """Harmonic mean between two depths, m/s: path over travel time of a vertical ray.

        Raises OutOfValidityError when a part of the way is unknown.
        """
        at, speed = self._layers(from_m, to_m, extend)
        if len(at) == 1:
            return float(speed[0])
        # Within a layer the sound speed is linear: its slowness integrates to a logarithm.
        ratio = np.diff(speed) / speed[:-1]
        slowness = (
            np.where(np.abs(ratio) < 1e-9, 1.0, np.log1p(ratio) / np.where(ratio == 0.0, 1.0, ratio)) / speed[:-1]
        )
        return float((at[-1] - at[0]) / np.sum(np.diff(at) * slowness))

    def mean_sound_speed_std_mps(self, from_m: float, to_m: float, extend: Extension = Extension.NONE) -> float:
        """Standard deviation of that mean: all nodes are off together, as far as the sensors' accuracy goes."""
        at, _ = self._layers(from_m, to_m, extend)
        std = self._speed_std(at)
        if len(at) == 1:
            return float(std[0])
        return float(np.sum(0.5 * (std[1:] + std[:-1]) * np.diff(at)) / (at[-1] - at[0]))

    def depth_of_pressure_m(self, sea_pressure_pa: Value, extend: Extension = Extension.NONE) -> Value:
        """Depth from pressure above the atmosphere's, through the measured water, m.

        Unknown below the deepest sample, and everywhere when the first sample lies deeper than the longest gap.
        Holes are bridged: density hardly changes in them.
        """
        pressure = np.asarray(sea_pressure_pa, dtype=np.float64)
        known = (
            (pressure >= -_NOISE_ABOVE_SURFACE_PA) & (pressure <= self.nodes.deepest_pa) & (self.shallowest_m == 0.0)
        )
        allowed = known | ((pressure >= -_NOISE_ABOVE_SURFACE_PA) & (extend is Extension.NEAREST))
        depth = np.where(allowed, self._depth_below(np.atleast_1d(pressure)).reshape(pressure.shape), np.nan)
        if isinstance(sea_pressure_pa, np.ndarray):
            return depth
        if not np.isfinite(depth):
            sampled = f"{self.nodes.shallowest_pa:.6g}..{self.nodes.deepest_pa:.6g}"
            raise OutOfValidityError(f"sea pressure {sea_pressure_pa:.6g} Pa, sampled {sampled}")
        return float(depth)

    def depth_std_m(self, depth_m: Value) -> Value:
        """Standard deviation of a depth from pressure by the density of the nodes alone (not by the pressure), m."""
        return depth_m * float(np.mean(self.density_std_kg_per_m3 / self.density_kg_per_m3))

    def _answer(self, depth_m: Value, extend: Extension, compute: Callable[[Array], Array]) -> Value:
        at = np.asarray(depth_m, dtype=np.float64)
        allowed = self._known(at) if extend is Extension.NONE else at >= 0.0
        if isinstance(depth_m, np.ndarray):
            return np.where(allowed, compute(np.where(allowed, at, 0.0)), np.nan)
        value = float(compute(at)) if allowed else np.nan
        if not np.isfinite(value):
            raise OutOfValidityError(
                f"depth {depth_m:.6g} m, sampled {self.shallowest_m:.6g}..{self.deepest_m:.6g}"
                f" without holes above {self.options.longest_gap_m:g} m"
            )
        return value

    def _known(self, at: Array) -> NDArray[np.bool_]:
        """Whether these depths were sampled."""
        inside = (at >= self.shallowest_m) & (at <= self.deepest_m)
        after = np.searchsorted(self.depth_m, at)
        between = (after > 0) & (after < len(self.depth_m))
        gaps_m = np.diff(self.depth_m, prepend=self.depth_m[0])
        gap_m = gaps_m[np.clip(after, 0, len(self.depth_m) - 1)]
        on_node = np.isin(at, self.depth_m)
        known: NDArray[np.bool_] = inside & (on_node | ~between | (gap_m <= self.options.longest_gap_m))
        return known

    def _distance_m(self, at: Array) -> Array:
        """From what was sampled; 0 inside."""
        known = self._known(at)
        edges = np.concatenate((self.depth_m, [self.shallowest_m, self.deepest_m]))
        nearest = np.min(np.abs(np.asarray(at)[..., None] - edges), axis=-1)
        return np.where(known, 0.0, nearest)

    def _speed(self, temperature_degc: Array, salinity_psu: Array, sea_pressure_pa: Array) -> Array:
        return sound_speed_by_mps(self.formula, temperature_degc, salinity_psu, sea_pressure_pa)

    def _speed_std(self, at: Array) -> Array:
        inside = np.interp(at, self.depth_m, self.sound_speed_std_mps)
        return np.hypot(inside, self.options.growth_mps_per_m * self._distance_m(at))

    def _water(self, at: Array) -> tuple[Array, Array, Array]:
        """Temperature, salinity and sea pressure at depths; those of the outermost node beyond it."""
        temperature = np.interp(at, self.depth_m, self.nodes.temperature_degc)
        salinity = np.interp(at, self.depth_m, self.nodes.salinity_psu)
        pressure = np.interp(at, self._depths_m, self._pressures_pa)
        weight = self.density_kg_per_m3[-1] * gravity_mps2(self.latitude_deg, self._pressures_pa[-1])
        return np.asarray(temperature), np.asarray(salinity), pressure + weight * np.maximum(at - self.depth_m[-1], 0.0)

    def _layers(self, from_m: float, to_m: float, extend: Extension) -> tuple[Array, Array]:
        """Depths from the upper to the lower end with every node in between, and the sound speed there."""
        upper, lower = min(from_m, to_m), max(from_m, to_m)
        inner = self._depths_m[(self._depths_m > upper) & (self._depths_m < lower)]
        at = np.unique(np.concatenate(([upper], inner, [lower])))
        # Between two nodes may lie a hole: its middle tells.
        probes = np.concatenate((at, 0.5 * (at[:-1] + at[1:])))
        if not np.all(np.isfinite(self.sound_speed_at_mps(probes, extend))):
            raise OutOfValidityError(
                f"{upper:.6g} to {lower:.6g} m, sampled {self.shallowest_m:.6g}..{self.deepest_m:.6g}"
                f" without holes above {self.options.longest_gap_m:g} m"
            )
        return at, self.sound_speed_at_mps(at, extend)

    def _integrated(self) -> Array:
        """Depth of the surface and of each node; the water above the first one is as in it."""
        surface = density_kg_per_m3(self.nodes.temperature_degc[:1], self.nodes.salinity_psu[:1], np.zeros(1))
        density = np.concatenate((surface, self.density_kg_per_m3))
        per_pa = 1.0 / (density * gravity_mps2(self.latitude_deg, self._pressures_pa))
        return np.concatenate(([0.0], np.cumsum(0.5 * (per_pa[1:] + per_pa[:-1]) * np.diff(self._pressures_pa))))

    def _depth_below(self, pressure: Array) -> Array:
        """Depth, on below the last node and above the surface with the water there."""
        inside = np.interp(pressure, self._pressures_pa, self._depths_m)
        last_pa = self._pressures_pa[-1]
        if np.all((pressure >= 0.0) & (pressure <= last_pa)):
            return np.asarray(inside)  # no need for the formulas, which take half a millisecond
        more_pa = np.maximum(pressure - last_pa, 0.0)
        salt, warmth = self.nodes.salinity_psu[-1], self.nodes.temperature_degc[-1]
        middle_pa = last_pa + 0.5 * more_pa
        below = density_kg_per_m3(np.full_like(middle_pa, warmth), np.full_like(middle_pa, salt), middle_pa)
        top = density_kg_per_m3(self.nodes.temperature_degc[:1], self.nodes.salinity_psu[:1], np.zeros(1))
        depth: Array = (
            inside
            + more_pa / (below * gravity_mps2(self.latitude_deg, middle_pa))
            + np.minimum(pressure, 0.0) / (top * gravity_mps2(self.latitude_deg, 0.0))
        )
        return depth


def _formula_for(nodes: ColumnNodes) -> SoundSpeedFormula:
    """One formula for the whole column: two would leave a step between them that no water has."""
    speeds = sound_speed_by_mps(
        SoundSpeedFormula.MACKENZIE, nodes.temperature_degc, nodes.salinity_psu, nodes.sea_pressure_pa
    )
    return SoundSpeedFormula.MACKENZIE if np.all(np.isfinite(speeds)) else SoundSpeedFormula.UNESCO


def _valid(nodes: ColumnNodes, formula: SoundSpeedFormula) -> ColumnNodes:
    water = (nodes.temperature_degc, nodes.salinity_psu, nodes.sea_pressure_pa)
    good = np.isfinite(sound_speed_by_mps(formula, *water)) & np.isfinite(density_kg_per_m3(*water))
    if not np.any(good):
        raise OutOfValidityError(f"no sample of this column lies where {formula} is valid")
    if np.all(good):
        return nodes
    kept = nodes.sea_pressure_pa[good]
    return ColumnNodes(
        sea_pressure_pa=kept,
        temperature_degc=nodes.temperature_degc[good],
        salinity_psu=nodes.salinity_psu[good],
        temperature_std_degc=nodes.temperature_std_degc[good],
        salinity_std_psu=nodes.salinity_std_psu[good],
        samples=nodes.samples[good],
        descending=nodes.descending[good],
        shallowest_pa=nodes.shallowest_pa if good[0] else float(kept[0]),
        deepest_pa=nodes.deepest_pa if good[-1] else float(kept[-1]),
    )


def _propagated(
    formula: Callable[[Array, Array, Array], Array],
    temperature: Array,
    salinity: Array,
    pressure: Array,
    temperature_std: Array,
    salinity_std: Array,
) -> Array:
    """Standard deviation of a formula's value. At the edge of its range the derivative is taken inwards."""
    value = formula(temperature, salinity, pressure)

    def slope(dt: float, ds: float) -> Array:
        ahead = formula(temperature + dt, salinity + ds, pressure)
        behind = formula(temperature - dt, salinity - ds, pressure)
        return np.where(np.isfinite(ahead), ahead - value, value - behind) / _DERIVATIVE_STEP

    return np.hypot(slope(_DERIVATIVE_STEP, 0.0) * temperature_std, slope(0.0, _DERIVATIVE_STEP) * salinity_std)
