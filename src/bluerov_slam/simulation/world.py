"""A small seeded seabed: hills, ripples, patches of sediment, a wreck, rocks and a pipeline.

The seabed is one square tile that repeats in both directions, so a vehicle never leaves it. Heights are metres above
the nominal bottom, up positive; reflectivity is the amplitude of the back-scatter relative to sand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

CELL_M = 0.1
TILE_CELLS = 1024
TILE_M = CELL_M * TILE_CELLS

_HILL_RMS_M = 0.45
_TEXTURE_RMS_M = 0.02
_RIPPLE_HEIGHT_M = 0.035
_RIPPLES_PER_TILE = (152, 46)  # north, east: whole numbers keep the tile periodic; wavelength 0.64 m
_ROCKS = 60

FloatArray = NDArray[np.float64]
FloatMap = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class World:
    """The seabed tile; `height_m` and `reflectivity` are indexed [north cell, east cell]."""

    water_depth_m: float
    height_m: FloatMap
    reflectivity: FloatMap

    def bottom_depth_m(self, north_m: float, east_m: float) -> float:
        """Depth of the seabed below the surface at one point."""
        row = int(north_m / CELL_M // 1) % TILE_CELLS
        column = int(east_m / CELL_M // 1) % TILE_CELLS
        return self.water_depth_m - float(self.height_m[row, column])

    def profile(self, north_m: FloatArray, east_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Height and reflectivity along a line of points: (n,), (n,)."""
        rows = north_m / CELL_M
        columns = east_m / CELL_M
        row0 = np.floor(rows).astype(np.intp)
        column0 = np.floor(columns).astype(np.intp)
        down, right = rows - row0, columns - column0
        row0 %= TILE_CELLS
        column0 %= TILE_CELLS
        row1, column1 = (row0 + 1) % TILE_CELLS, (column0 + 1) % TILE_CELLS
        height = self.height_m
        upper = height[row0, column0] * (1.0 - right) + height[row0, column1] * right
        lower = height[row1, column0] * (1.0 - right) + height[row1, column1] * right
        return upper * (1.0 - down) + lower * down, self.reflectivity[row0, column0].astype(np.float64)


@lru_cache(maxsize=4)
def build_world(seed: int, water_depth_m: float) -> World:
    """The seabed of a seed; the last few are kept, because building one costs about half a second."""
    rng = np.random.default_rng([seed, 0x5EABED])
    wave_number = _wave_numbers()
    hills = _noise(rng, wave_number, low=0.0, high=0.35, slope=1.6) * _HILL_RMS_M
    texture = _noise(rng, wave_number, low=0.35, high=25.0, slope=0.9) * _TEXTURE_RMS_M
    sediment = _noise(rng, wave_number, low=0.0, high=0.9, slope=1.2)
    sand = np.clip(0.5 + 1.5 * sediment, 0.0, 1.0)
    reflectivity = 0.45 + 0.75 * sand + 0.05 * _noise(rng, wave_number, low=0.5, high=25.0, slope=0.4)
    height = hills + texture + _ripples(rng, sand)
    _add_pipeline(height, reflectivity)
    _add_rocks(rng, height, reflectivity)
    _add_wreck(rng, height, reflectivity)
    return World(water_depth_m, height.astype(np.float32), np.maximum(reflectivity, 0.05).astype(np.float32))


def _wave_numbers() -> FloatArray:
    rows = np.fft.fftfreq(TILE_CELLS, CELL_M)[:, None] * 2.0 * np.pi
    columns = np.fft.rfftfreq(TILE_CELLS, CELL_M)[None, :] * 2.0 * np.pi
    result: FloatArray = np.hypot(rows, columns)
    return result


def _noise(rng: np.random.Generator, wave_number: FloatArray, low: float, high: float, slope: float) -> FloatArray:
    """Periodic Gaussian noise of unit rms with a power-law spectrum between two wave numbers (rad/m)."""
    spectrum = np.fft.rfft2(rng.standard_normal((TILE_CELLS, TILE_CELLS)))
    inside = (wave_number > low) & (wave_number <= high)
    weight = np.zeros_like(wave_number)
    weight[inside] = wave_number[inside] ** -slope
    field: FloatArray = np.fft.irfft2(spectrum * weight, (TILE_CELLS, TILE_CELLS))
    return field / float(field.std())


def _ripples(rng: np.random.Generator, sand: FloatArray) -> FloatArray:
    """Sand ripples, only where there is sand, with a slowly wandering phase."""
    north, east = _RIPPLES_PER_TILE
    step = 2.0 * np.pi / TILE_CELLS
    index = np.arange(TILE_CELLS)
    wander = 2.5 * np.sin(3 * step * index + rng.uniform(0, 2 * np.pi))
    phase = north * step * index[:, None] + (east * step * index + wander)[None, :]
    result: FloatArray = 0.5 * _RIPPLE_HEIGHT_M * np.sin(phase) * np.clip(2.0 * sand - 1.0, 0.0, 1.0)
    return result


def _local_grid(
    north_m: float, east_m: float, half_m: float, heading_rad: float
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], FloatArray, FloatArray]:
    """Index arrays of a square of the tile, and the along and across coordinates of a turned target in it."""
    cells = np.arange(-int(half_m / CELL_M), int(half_m / CELL_M) + 1)
    rows = (cells + round(north_m / CELL_M)) % TILE_CELLS
    columns = (cells + round(east_m / CELL_M)) % TILE_CELLS
    north, east = np.meshgrid(cells * CELL_M, cells * CELL_M, indexing="ij")
    along = north * np.cos(heading_rad) + east * np.sin(heading_rad)
    across = -north * np.sin(heading_rad) + east * np.cos(heading_rad)
    index = np.ix_(rows, columns)
    return (index[0], index[1]), along, across


def _add_wreck(rng: np.random.Generator, height: FloatArray, reflectivity: FloatArray) -> None:
    """A broken hull of 13 m: pointed outline, open hold with ribs, deckhouse, mast, debris around it."""
    index, along, across = _local_grid(30.0, 15.0, 11.0, np.deg2rad(24.0))
    half_length, half_beam = 6.5, 1.9
    outline = half_beam * np.sqrt(np.clip(1.0 - (along / half_length) ** 2, 0.0, 1.0)) ** 0.8
    hull = np.abs(across) < outline
    hold = hull & (np.abs(across) < outline - 0.35) & (along < 2.0) & (along > -4.5)
    ribs = hold & (np.mod(along, 1.1) < 0.25)
    deckhouse = (np.abs(across) < 1.1) & (along > 2.4) & (along < 4.4)
    mast = (np.abs(along - 1.2 - 0.4 * across) < 0.15) & (np.abs(across) < 5.0)
    rise = np.zeros_like(along)
    rise[mast] = 0.35
    rise[hull] = 1.5 + 0.12 * along[hull]
    rise[hold] = 0.35
    rise[ribs] = 0.9
    rise[deckhouse] = 2.6
    debris = (rng.random(along.shape) > 0.9985) & ~hull & (np.hypot(along, across) < 10.0)
    rise[debris] = rng.uniform(0.15, 0.5, int(debris.sum()))
    height[index] += rise
    metal = rise > 0.0
    patch = reflectivity[index]
    patch[metal] = np.where(hold[metal], 1.2, 3.0)
    reflectivity[index] = patch


def _add_rocks(rng: np.random.Generator, height: FloatArray, reflectivity: FloatArray) -> None:
    for _ in range(_ROCKS):
        radius_m = rng.uniform(0.2, 0.9)
        north_m, east_m, heading = rng.uniform(0.0, TILE_M), rng.uniform(0.0, TILE_M), rng.uniform(0.0, np.pi)
        index, along, across = _local_grid(north_m, east_m, 1.6 * radius_m, heading)
        dome = 1.0 - (along / (1.4 * radius_m)) ** 2 - (across / radius_m) ** 2
        rock = dome > 0.0
        height[index] += np.where(rock, 0.8 * radius_m * np.sqrt(np.clip(dome, 0.0, 1.0)), 0.0)
        reflectivity[index] = np.where(rock, 1.9, reflectivity[index])


def _add_pipeline(height: FloatArray, reflectivity: FloatArray) -> None:
    """A half-buried pipe of 0.6 m that winds along the tile from south to north, with a scour trench."""
    index = np.arange(TILE_CELLS)
    middle_m = 37.0 + 2.5 * np.sin(2.0 * np.pi * index / TILE_CELLS)
    across = (index * CELL_M)[None, :] - middle_m[:, None]
    trench = -0.12 * np.exp(-((np.abs(across) - 0.7) ** 2) / 0.12)
    pipe = np.abs(across) < 0.3
    height += trench
    height[pipe] += np.sqrt(0.09 - across[pipe] ** 2) + 0.12
    reflectivity[pipe] = 2.4
