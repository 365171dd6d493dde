"""The one direct ray between two places in layered water: how long it takes and from where it arrives.

The water is cut into thin layers of constant speed. A ray keeps its horizontal slowness p = cos(grazing angle) / c
through all of them (Snell), so the ray that goes from one depth to the other covers sum h p c / sqrt(1 - p^2 c^2)
horizontally, which grows with p: bisection finds the one that fits. Rays that turn on their way are not looked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation.water import WaterProfile, sound_speed_mps

_LAYER_M = 0.05
_HALVINGS = 60

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Arrival:
    """`elevation_rad`: how far below the horizontal the sound comes from at the receiver; negative: from above."""

    travel_s: float
    elevation_rad: float
    sound_speed_mps: float  # at the receiver


class WaterColumn:
    """Sound speed over depth, ready for rays."""

    def __init__(self, water: WaterProfile, deepest_m: float) -> None:
        edges_m = np.arange(0.0, deepest_m + 2.0 * _LAYER_M, _LAYER_M)
        self._middles_m = 0.5 * (edges_m[:-1] + edges_m[1:])
        self._speeds_mps = np.array(
            [
                sound_speed_mps(water.temperature_degc(depth), water.salinity_psu(depth), depth)
                for depth in self._middles_m.tolist()
            ]
        )

    def speed_mps(self, depth_m: float) -> float:
        """Sound speed at a depth, that of the ends beyond them."""
        return float(np.interp(depth_m, self._middles_m, self._speeds_mps))

    def direct_ray(self, source_depth_m: float, receiver_depth_m: float, horizontal_m: float) -> Arrival:
        """The ray from one depth to another over this horizontal distance."""
        local_mps = self.speed_mps(receiver_depth_m)
        thickness_m, speeds_mps = self._between(source_depth_m, receiver_depth_m)
        down = math.copysign(1.0, source_depth_m - receiver_depth_m)
        if not len(thickness_m) or horizontal_m < 1e-6:
            travel_s = horizontal_m / local_mps + float((thickness_m / speeds_mps).sum())
            return Arrival(travel_s, down * 0.5 * math.pi if len(thickness_m) else 0.0, local_mps)
        # The ray is steepest where sound is slow; the parameter is its slope in the fastest layer, never 0.
        fastest = float(speeds_mps.max())
        low, high = 0.0, 0.5 * math.pi
        for _ in range(_HALVINGS):
            grazing = 0.5 * (low + high)
            cosine = math.cos(grazing) / fastest * speeds_mps
            if float((thickness_m * cosine / np.sqrt(1.0 - np.square(cosine))).sum()) > horizontal_m:
                low = grazing
            else:
                high = grazing
        slowness = math.cos(high) / fastest
        sines = np.sqrt(1.0 - np.square(slowness * speeds_mps))
        travel_s = float((thickness_m / (speeds_mps * sines)).sum())
        return Arrival(travel_s, down * math.acos(min(1.0, slowness * local_mps)), local_mps)

    def _between(self, one_m: float, other_m: float) -> tuple[FloatArray, FloatArray]:
        """Thickness and speed of the layers, or parts of them, between two depths."""
        top_m, bottom_m = max(0.0, min(one_m, other_m)), max(0.0, one_m, other_m)
        tops_m = self._middles_m - 0.5 * _LAYER_M
        thickness_m = np.minimum(bottom_m, tops_m + _LAYER_M) - np.maximum(top_m, tops_m)
        if bottom_m > tops_m[-1] + _LAYER_M:
            thickness_m[-1] += bottom_m - max(top_m, tops_m[-1] + _LAYER_M)
        inside = thickness_m > 0.0
        return thickness_m[inside], self._speeds_mps[inside]
