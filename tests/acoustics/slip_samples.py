"""Fixes as slips make them, with everything about them known."""

import numpy as np

from bluerov_slam.acoustics.slip_lattice import Cells, Fixes, lattice_mm, lattice_vectors_mm

RANGE_MM, WAVELENGTH_MM, SIDE_MM = 2500.0, 8.6, 353.6
CELLS_MM = lattice_mm(lattice_vectors_mm(RANGE_MM, 0.0, WAVELENGTH_MM, SIDE_MM), 6.0)
SD_MM = (5.0, 3.0)


def cell_probability(weights):
    """Weights of the nearest cells; the others are hardly ever there."""
    probability = np.full(len(CELLS_MM), 1e-4)
    probability[: len(weights)] = weights
    return probability / probability.sum()


def slipped_fixes(truth_mm, probability, rng):
    """Fixes (n, 2) of a track."""
    cells = rng.choice(len(CELLS_MM), len(truth_mm), p=probability)
    return truth_mm + CELLS_MM[cells] + rng.normal(0.0, SD_MM, truth_mm.shape)


def as_fixes(at_mm, probability, interval_s=3.0, turn_deg=None, displacement_mm=None):
    count = len(at_mm)
    return Fixes(
        at_mm,
        np.full(count, interval_s),
        np.zeros((count, 2)) if displacement_mm is None else displacement_mm,
        np.zeros((count, 3)) if turn_deg is None else turn_deg,
        RANGE_MM,
        Cells(CELLS_MM, probability, SD_MM),
    )
