"""How the edge of a stack's reach is learnt: rays from home to the edge, found by search, then a small network fitted.

Offline and slow (minutes); everything is drawn from one seed. `scripts/fit-rig-edge` writes what comes out into
`edge_of_fo_ship.py`. The network is `edge.Edge`; its truth are searches, so it inherits what they miss.
"""

from __future__ import annotations

import base64
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.agreement import descend, on_rays
from bluerov_slam.rig.edge import SPREAD, Edge

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats
    from bluerov_slam.rig.reach import ReachModel

LONGEST = 9.0
COARSE_RAYS = 2000
_MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""y, roll and yaw change sign in a mirror at the plane x z, in which the stack is symmetric."""


def edge_lengths(model: ReachModel, directions: Floats, near: Floats, far: Floats, halvings: int) -> Floats:
    """Lengths (n,) of rays along directions (n, 6), in spreads, up to the edge between near and far.

    Each search starts from the set points that reached the last pose inside, carried on to the new length.
    """
    rays = directions * SPREAD
    near, far = near.copy(), far.copy()
    points = np.zeros((len(rays), model.count, 6))
    held = np.zeros(len(rays))
    for _ in range(halvings):
        length = 0.5 * (near + far)
        poses = on_rays(model, rays, length)
        start = points * np.where(held > 0.0, length / np.maximum(held, 1e-9), 0.0)[:, None, None]
        fresh = held == 0.0
        start[fresh, :, 3:] = (rays[fresh] * length[fresh, None])[:, None, 3:] / model.count
        reached, ends = descend(model, poses, start, 14)
        points[reached], held[reached] = ends[reached], length[reached]
        near, far = np.where(reached, length, near), np.where(reached, far, length)
    return 0.5 * (near + far)


def directions(random: np.random.Generator, count: int) -> Floats:
    """Unit vectors (count, 6), even over all directions of poses weighed by their spread."""
    drawn = random.normal(size=(count, 6))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1)[:, None])


def sample_edge(model: ReachModel, count: int, seed: int) -> tuple[Floats, Floats]:
    """Directions (count, 6) and lengths (count,) to the edge, to a quarter of a percent."""
    random = np.random.default_rng(seed)
    coarse = directions(random, COARSE_RAYS)
    lengths = edge_lengths(model, coarse, np.zeros(COARSE_RAYS), np.full(COARSE_RAYS, LONGEST), 11)
    guess = fit(coarse, lengths, (32,), 60, seed)
    fine = directions(random, count)
    middle = guess.lengths(fine)
    found = edge_lengths(model, fine, 0.85 * middle, 1.15 * middle, 7)
    return np.concatenate([coarse, fine]), np.concatenate([lengths, found])


def fit(units: Floats, lengths: Floats, hidden: tuple[int, ...], epochs: int, seed: int) -> Edge:
    """Adam on the squared error of the logarithm of the length, rays and their mirror images."""
    random = np.random.default_rng(seed)
    x = np.concatenate([units, units * _MIRROR])
    y = np.log(np.concatenate([lengths, lengths]))
    sizes = (6, *hidden, 1)
    weights = [random.normal(size=(a, b)) * np.sqrt(2.0 / a) for a, b in pairwise(sizes)]
    offsets = [np.zeros(b) for b in sizes[1:]]
    offsets[-1][:] = y.mean()
    values = [*weights, *offsets]
    first, second = [np.zeros_like(v) for v in values], [np.zeros_like(v) for v in values]
    count, step = len(x), 0
    size = 256
    total = epochs * (count // size)
    for _ in range(epochs):
        order = random.permutation(count)
        for begin in range(0, count - size + 1, size):
            pick = order[begin : begin + size]
            slopes = _slopes(weights, offsets, x[pick], y[pick])
            step += 1
            rate = 4e-3 * 0.5 * (1.0 + np.cos(np.pi * step / total)) + 1e-6
            for value, slope, a, b in zip(values, slopes, first, second, strict=True):
                a += 0.1 * (slope - a)
                b += 0.001 * (slope * slope - b)
                value -= rate * (a / (1.0 - 0.9**step)) / (np.sqrt(b / (1.0 - 0.999**step)) + 1e-8)
    return Edge(tuple(weights), tuple(offsets))


def _slopes(weights: list[Floats], offsets: list[Floats], x: Floats, y: Floats) -> list[Floats]:
    """Gradients of the mean squared error by weights, then offsets."""
    layers = [x]
    for weight, offset in zip(weights[:-1], offsets[:-1], strict=True):
        layers.append(np.maximum(layers[-1] @ weight + offset, 0.0))
    back = (layers[-1] @ weights[-1] + offsets[-1] - y[:, None]) * (2.0 / len(y))
    by_weight: list[Floats] = []
    by_offset: list[Floats] = []
    for i in range(len(weights) - 1, -1, -1):
        by_weight.insert(0, layers[i].T @ back)
        by_offset.insert(0, back.sum(axis=0))
        if i:
            back = (back @ weights[i].T) * (layers[i] > 0.0)
    return [*by_weight, *by_offset]


def as_text(edge: Edge) -> str:
    """The module `edge_of_fo_ship`, weights in half precision."""
    sizes = [len(edge.weights[0]), *(len(offset) for offset in edge.offsets)]
    values = np.concatenate([v.ravel() for v in (*edge.weights, *edge.offsets)]).astype("<f2")
    text = base64.b85encode(values.tobytes()).decode()
    lines = "\n".join(f"    {text[i : i + 110]!r}" for i in range(0, len(text), 110))
    return _MODULE.format(sizes=tuple(sizes), lines=lines)


_MODULE = '''"""The learnt edge of FO_SHIP within FO_SHIP_LIMITS: written by scripts/fit-rig-edge, not by hand."""

from __future__ import annotations

from functools import cache

from bluerov_slam.rig.edge import Edge

SIZES = {sizes}


@cache
def edge_of_fo_ship() -> Edge:
    """The network, unpacked at its first use."""
    return Edge.unpacked(SIZES, _WEIGHTS)


# fmt: off
_WEIGHTS = (
{lines}
)
# fmt: on
'''
