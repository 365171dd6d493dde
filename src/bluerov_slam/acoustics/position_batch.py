"""Many fixes at once: Gauss-Newton over arrays of fixes for a source whose depth is known.

Every receiver's arrival is taken as equally uncertain, so that the best weight of delays that share a reference is to
take the mean over all receivers (reference included, its delay being zero) out of the residuals. Two unknowns across
the depth's axis remain per fix; sums over receivers are plain array operations over fixes, in blocks that stay in the
processor's cache.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

BLOCK = 1024
MOST_ITERATIONS = 12
STEP_SHARE = 1e-10
"""The search of a block ends when no step is longer than this share of the depth."""


def solve_batch(
    receivers_m: ArrayLike,
    delays_s: ArrayLike,
    sound_speed_mps: float,
    depth: ArrayLike,
    *,
    down: ArrayLike = (0.0, 0.0, 1.0),
    front: ArrayLike = (1.0, 0.0, 0.0),
    rotations: ArrayLike | None = None,
) -> Array:
    """Sources (f, 3) relative to the array's origin; NaN where the delays and the depth have no common source.

    Args:
        receivers_m: (k, 3), reference first.
        delays_s: (f, k-1), `toa_reference - toa_i`.
        depth: (f,) or a number: distance of the source along `down` from the origin, taken as exact, m.
        down: The depth's axis, in the frame of the result.
        front: The side a flat array listens to, in the frame of the receivers.
        rotations: (f, 3, 3), frame of the result from that of the receivers; the same frame if left out.
    """
    receivers = np.asarray(receivers_m, dtype=np.float64)
    delays = np.asarray(delays_s, dtype=np.float64)
    count = len(delays)
    depths = np.broadcast_to(np.asarray(depth, dtype=np.float64), (count,))
    axis = np.asarray(down, dtype=np.float64)
    axis = axis / np.linalg.norm(axis)
    turns = None if rotations is None else np.asarray(rotations, dtype=np.float64)
    start = _FarField.make(receivers, np.asarray(front, dtype=np.float64))
    fixed = None if turns is not None else _basis(axis)
    found = np.empty((count, 3))
    for first in range(0, count, BLOCK):
        part = slice(first, min(first + BLOCK, count))
        paths = delays[part].T * sound_speed_mps
        if turns is None:
            assert fixed is not None
            placed = (receivers @ fixed)[:, :, None]
            across = _search(placed, paths, depths[part], fixed.T @ start.directions(paths))
            found[part] = (fixed @ across).T
        else:
            # Axes of the search (depth, across, across) seen from the array of each fix.
            axes = np.einsum("fji,jk->fik", turns[part], _basis(axis))
            placed = np.einsum("ni,fik->nkf", receivers, axes)
            across = _search(placed, paths, depths[part], np.einsum("fik,if->kf", axes, start.directions(paths)))
            found[part] = (_basis(axis) @ across).T
    return found


class _FarField:
    """The direction of a distant source, linear in the path differences but for its part along the array's normal."""

    def __init__(self, inverse: Array, normal: Array) -> None:
        self.inverse = inverse
        self.normal = normal

    @classmethod
    def make(cls, receivers: Array, front: Array) -> _FarField:
        _, _, axes = np.linalg.svd(receivers - receivers.mean(axis=0))
        normal = axes[2] if axes[2] @ front >= 0.0 else -axes[2]
        baselines = receivers[1:] - receivers[0]
        flat = baselines - np.outer(baselines @ normal, normal)
        return cls(np.linalg.pinv(flat, rcond=1e-9), normal)

    def directions(self, paths: Array) -> Array:
        inside = self.inverse @ paths
        length = np.minimum((inside * inside).sum(axis=0), 0.98)
        direction: Array = inside + self.normal[:, None] * np.sqrt(1.0 - length)
        return direction


def _basis(axis: Array) -> Array:
    """Orthonormal columns (3, 3), the first along an axis."""
    helper = np.eye(3)[int(np.abs(axis).argmin())]
    second = np.cross(axis, helper)
    second /= np.linalg.norm(second)
    return np.column_stack((axis, second, np.cross(axis, second)))


def _search(receivers: Array, paths: Array, depth: Array, direction: Array) -> Array:
    """Source (3, f) in axes whose first is the depth's; receivers (k, 3, 1 or f), path differences (k-1, f)."""
    count = len(receivers)
    toward = direction[0] * np.sign(depth)
    # Sideways and wrong-sided directions get the benefit of the doubt: 6 deg towards the depth. What then does not
    # come to rest is no source.
    stretch = np.abs(depth) / np.maximum(toward, 0.1)
    y, z = direction[1] * stretch, direction[2] * stretch
    gaps = [(depth - m[0]) ** 2 for m in receivers]
    share = 1.0 / count
    limit = STEP_SHARE * np.abs(depth)
    moving = np.zeros(len(depth), dtype=bool)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(MOST_ITERATIONS):
            sy = sz = sv = syy = szz = syz = syv = szv = 0.0
            for index in range(count):
                ay, az = y - receivers[index, 1], z - receivers[index, 2]
                way = np.sqrt(gaps[index] + ay * ay + az * az)
                inverse = 1.0 / way
                ay *= inverse
                az *= inverse
                if index:
                    way += paths[index - 1]
                sy, sz, sv = sy + ay, sz + az, sv + way
                syy, szz, syz = syy + ay * ay, szz + az * az, syz + ay * az
                syv, szv = syv + ay * way, szv + az * way
            hyy, hzz, hyz = syy - share * sy * sy, szz - share * sz * sz, syz - share * sy * sz
            gy, gz = syv - share * sy * sv, szv - share * sz * sv
            factor = 1.0 / (hyy * hzz - hyz * hyz)
            dy, dz = factor * (hzz * gy - hyz * gz), factor * (hyy * gz - hyz * gy)
            # No step turns the source by more than about 45 degrees at once.
            longest = np.maximum(np.abs(dy), np.abs(dz))
            bound = np.sqrt(depth * depth + y * y + z * z)
            shrink = np.minimum(1.0, bound / longest)
            y = y - dy * shrink
            z = z - dz * shrink
            moving = ~(longest <= limit)
            if not moving.any():
                break
    # Far away the last digits of a path difference are lost: a step that small is rest, too.
    restless = moving & ~(longest <= 1e-6 * bound)
    found = np.stack((np.asarray(depth, dtype=np.float64), y, z))
    found[:, restless] = np.nan
    return found
