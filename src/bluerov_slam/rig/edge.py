"""A learnt guess of where a stack's reach ends: a small network from direction to length.

A pose is seen from home: place and turn (axis times angle), each coordinate over its spread among reachable poses:
a direction and a length. The network gives the length at which the edge lies in this direction. docs/rig-workspace.md
says how it was made and how far it is wrong; `edge_fit` makes it again.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats

SPREAD = np.array([84.0, 86.0, 37.0, 0.28, 0.28, 0.106])
"""Of x, y, z (mm) and turns (rad) among the poses of `StackWorkspace.sample`."""


@dataclass(frozen=True, slots=True)
class Edge:
    """Weights and offsets of its layers; all but the last cut below zero. The result is a logarithm."""

    weights: tuple[Floats, ...]
    offsets: tuple[Floats, ...]

    @staticmethod
    def unpacked(sizes: tuple[int, ...], text: str) -> Edge:
        """Of layers from the first size to the last, all weights and then all offsets as base 85 of half floats."""
        values = np.frombuffer(base64.b85decode(text), dtype="<f2").astype(np.float64)
        shapes = [*pairwise(sizes), *((size,) for size in sizes[1:])]
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
        parts = [part.reshape(shape) for part, shape in zip(np.split(values, ends[:-1]), shapes, strict=True)]
        return Edge(tuple(parts[: len(sizes) - 1]), tuple(parts[len(sizes) - 1 :]))

    def lengths(self, directions: Floats) -> Floats:
        """To the edge, in spreads, (...,), along unit vectors (..., 6)."""
        value = directions
        for weight, offset in zip(self.weights[:-1], self.offsets[:-1], strict=True):
            value = np.maximum(value @ weight + offset, 0.0)
        return np.asarray(np.exp((value @ self.weights[-1] + self.offsets[-1])[..., 0]))
