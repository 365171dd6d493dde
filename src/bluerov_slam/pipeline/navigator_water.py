"""The water that the vehicle has been through: what depth is reckoned with, and the profile that users ask for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater import (
    SEA_WATER_DENSITY_KG_PER_M3,
    STANDARD_GRAVITY_MPS2,
    CtdCast,
    Extension,
    depth_m,
    vehicle_depth,
)

if TYPE_CHECKING:
    from bluerov_slam.navigation.seawater import WaterColumn
    from bluerov_slam.records import CtdSample

# A probe in the air reads no salt at all: only what is under water says what the water is.
UNDER_WATER_PA = 0.5 * SEA_WATER_DENSITY_KG_PER_M3 * STANDARD_GRAVITY_MPS2
# A column is made anew so often, and more rarely the more samples it is made of.
FIRST_AFTER_S = 1.0
AGAIN_AFTER_S = 5.0
SAMPLES_PER_S = 200.0
USUAL_LATITUDE_DEG = 45.0
# Gravity from the equator to the pole, spread evenly: 0.53 % over the root of 12.
UNKNOWN_LATITUDE_RELATIVE_STD = 1.5e-3
# Water below the deepest sample: half of what changes from the surface to 500 m in most seas.
UNSAMPLED_RELATIVE_STD = 1e-3
_DECIMALS = {"depth_m": 2, "sound_speed_mps": 2, "sound_speed_std_mps": 2, "density_kg_per_m3": 3,
             "density_std_kg_per_m3": 3, "temperature_degc": 3, "salinity_psu": 3}  # fmt: skip


class Water:
    """CTD samples in; depths, and the column, out."""

    def __init__(self, unknown_relative_std: float) -> None:
        self._unknown_relative_std = unknown_relative_std
        self._cast = CtdCast()
        self._made_s = -math.inf
        self._began_s: float | None = None
        self.column: WaterColumn | None = None
        self.latitude_deg: float | None = None

    def take(self, record: CtdSample, surface_pressure_pa: float | None) -> None:
        """One sample, if it was taken under water; the column is made anew now and then."""
        if surface_pressure_pa is None or record.pressure_pa is None:
            return
        if not record.pressure_pa - surface_pressure_pa > UNDER_WATER_PA:
            return
        if self._cast.add_ctd(record, surface_pressure_pa):
            now_s = record.arrived_s
            self._began_s = now_s if self._began_s is None else self._began_s
            wait_s = FIRST_AFTER_S if self.column is None else max(AGAIN_AFTER_S, len(self._cast) / SAMPLES_PER_S)
            if now_s - max(self._made_s, self._began_s) >= wait_s:
                self._make(now_s)

    def rezero(self, sea_pressure_change_pa: float) -> None:
        """The surface pressure was found anew: everything lies deeper by so much."""
        self._cast.rezero(sea_pressure_change_pa)
        self._make(self._made_s)

    def depth(self, pressure_pa: float, surface_pressure_pa: float) -> tuple[float, float]:
        """Depth, m, and its standard deviation as a share of it, by the best that is known of the water above.

        Through the column, where it was sampled from the surface on; else by the water at this pressure (a start in
        mid-dive); else by the standard ocean.
        """
        sea_pressure_pa = pressure_pa - surface_pressure_pa
        latitude_deg = USUAL_LATITUDE_DEG if self.latitude_deg is None else self.latitude_deg
        gravity_std = UNKNOWN_LATITUDE_RELATIVE_STD if self.latitude_deg is None else 0.0
        column, temperature, salinity = self.column, None, None
        try:
            if column is not None and column.shallowest_m == 0.0:
                deep_m = column.depth_of_pressure_m(sea_pressure_pa, Extension.NEAREST)
                return deep_m, math.hypot(_column_relative_std(column, deep_m), gravity_std)
            if column is not None:
                nodes = column.nodes
                temperature = float(np.interp(sea_pressure_pa, nodes.sea_pressure_pa, nodes.temperature_degc))
                salinity = float(np.interp(sea_pressure_pa, nodes.sea_pressure_pa, nodes.salinity_psu))
            depth = vehicle_depth(pressure_pa, surface_pressure_pa, latitude_deg, temperature, salinity)
        except OutOfValidityError:
            return float(depth_m(pressure_pa, surface_pressure_pa)), self._unknown_relative_std
        return depth.depth_m, math.hypot(depth.relative_std, gravity_std)

    def make_now(self) -> WaterColumn | None:
        """The column of all samples up to now."""
        self._make(self._made_s)
        return self.column

    def _make(self, now_s: float) -> None:
        self._made_s = now_s
        try:
            self.column = self._cast.column(USUAL_LATITUDE_DEG if self.latitude_deg is None else self.latitude_deg)
        except OutOfValidityError:
            self.column = None


def _column_relative_std(column: WaterColumn, at_m: float) -> float:
    below_m = max(0.0, at_m - column.deepest_m)
    sampled_m = max(at_m - below_m, 1e-3)
    return math.hypot(column.depth_std_m(1.0), UNSAMPLED_RELATIVE_STD * below_m / (below_m + sampled_m))


def water_json(column: WaterColumn) -> dict[str, Any]:
    """The profile as the API and the report give it: one entry a node, from the surface down."""
    mean_mps, mean_std_mps = None, None
    try:
        mean_mps = round(column.mean_sound_speed_mps(column.shallowest_m, column.deepest_m), 2)
        mean_std_mps = round(column.mean_sound_speed_std_mps(column.shallowest_m, column.deepest_m), 2)
    except OutOfValidityError:
        pass  # a hole in it: nothing is known of the whole way
    nodes = column.nodes
    columns = {
        "depth_m": column.depth_m,
        "sound_speed_mps": column.sound_speed_mps,
        "sound_speed_std_mps": column.sound_speed_std_mps,
        "density_kg_per_m3": column.density_kg_per_m3,
        "density_std_kg_per_m3": column.density_std_kg_per_m3,
        "temperature_degc": nodes.temperature_degc,
        "salinity_psu": nodes.salinity_psu,
    }
    table: dict[str, list[Any]] = {
        name: [round(value, _DECIMALS[name]) for value in values.tolist()] for name, values in columns.items()
    }
    table["samples"] = nodes.samples.tolist()
    table["from_descent"] = nodes.descending.tolist()
    return {
        "formula": column.formula.value,
        "latitude_deg": column.latitude_deg,
        "shallowest_m": round(column.shallowest_m, 2),
        "deepest_m": round(float(column.deepest_m), 2),
        "mean_sound_speed_mps": mean_mps,
        "mean_sound_speed_std_mps": mean_std_mps,
        "nodes": [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)],
    }
