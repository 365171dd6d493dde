"""Fit the guess of `rig/reach_guess` to solved poses of FO_SHIP (scripts/fit_reach_guess.py).

Twice: first to poses anywhere on rays from home, solved from an equal share of the turn; then, with that fit, to poses
near the edge, solved from both starts, the better kept. Every pose teaches its mirror image too. Some ten minutes of
one processor, by estimate. The stored fit was made in parts, poses first, with an earlier form of `ReachModel.evaluate`
that agreed to rounding: a whole run from the fixed seed gives one like it, not the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import IO, TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.agreement import on_rays
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.limits import FO_SHIP_LIMITS
from bluerov_slam.rig.reach import ReachModel, rotation_vector
from bluerov_slam.rig.reach_guess import LAYERS, MARGIN_SCALE, SPREAD, Network, ReachGuess, signature

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats
    from bluerov_slam.rig.stack import StackPose

SEED = 6
HIDDEN = 192
BATCH = 2000
FIRST, SECOND = (10, 40), (32, 200)
"""Batches of poses and rounds through them, of the two fits."""
TOP, ABOVE, PULL = 0.04, 0.012, 1e-4
"""Margin that is enough, how far above the bound margins are asked for, weight of the way from home (one answer)."""
MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Of x, y, z, roll, pitch, yaw: FO_SHIP is its own image across its x-z plane."""


@dataclass(frozen=True, slots=True)
class Solved:
    """Poses in spreads from home (n, 6), scaled set points (n, P, 6), the largest margin (n,), whether it settled."""

    way: Floats
    scaled: Floats
    margin: Floats
    good: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def solve(model: ReachModel, pose: StackPose, points: Floats, begin: int, steps: int) -> tuple[Floats, ...]:
    """Set points near the largest margin, that margin there, its bound, what is lacking (mm; a turn at 100 mm).

    Steps are long and softly damped first; from the twelfth on the level follows the bound. `begin` skips the first.
    """
    level = np.full(len(points), TOP)
    step = None
    for k in range(begin, begin + steps):
        reach = model.evaluate(points)
        step = model.step(reach, model.lacking(reach, pose), level, 1e-3 if k < 22 else 3e-4, PULL, 0.0, rounds=4)
        longest = 0.7 if k < 8 else (0.3 if k < 20 else 0.12)
        largest = np.abs(step.move).max(axis=(-1, -2), keepdims=True)
        if k >= 12:
            wanted = np.where(np.isfinite(step.bound), step.bound + ABOVE, TOP)
            level = level + 0.5 * (np.clip(wanted, -1.5, TOP) - level)
        points = points + step.move * np.minimum(1.0, longest / np.maximum(largest, 1e-12)) * model.scale
    assert step is not None
    reach = model.evaluate(points)
    lacking = np.abs(model.lacking(reach, pose))
    return (
        points,
        model.margin(reach),
        np.asarray(step.bound),
        np.maximum(lacking[:, :3].max(1), 100 * lacking[:, 3:].max(1)),
    )


def equal_share(model: ReachModel, pose: StackPose) -> Floats:
    """The turn shared by all platforms."""
    points = np.zeros((len(pose.position_mm), model.count, 6))
    points[..., 3:] = rotation_vector(pose.rotation)[:, None, :] / model.count
    return points


def solved_poses(model: ReachModel, batches: int, seed: int, guess: ReachGuess | None, size: int = BATCH) -> Solved:
    """Poses on rays with their solutions."""
    random = np.random.default_rng((seed, 0 if guess is None else 1))
    parts = []
    for _ in range(batches):
        rays = random.normal(size=(size, 6))
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        length = random.uniform(0.3, 6.0, size)
        if guess is not None:
            near, far = np.full(size, 1.0), np.full(size, 6.5)
            for _ in range(14):
                middle = 0.5 * (near + far)
                inside = guess(on_rays(model, rays * SPREAD, middle))[1] >= 0.0
                near, far = np.where(inside, middle, near), np.where(inside, far, middle)
            close = random.uniform(size=size) < 0.8
            length = near * np.where(close, random.uniform(0.92, 1.09, size), random.uniform(0.1, 1.9, size))
        pose = on_rays(model, rays * SPREAD, length)
        points, margin, bound, lacking = solve(model, pose, equal_share(model, pose), 0, 42)
        if guess is not None:
            others = solve(model, pose, guess(pose)[0], 18, 26)
            score = np.where(lacking < 0.05, margin, -9.0)
            better = np.where(others[3] < 0.05, others[1], -9.0) > score - 2e-3
            points = np.where(better[:, None, None], others[0], points)
            bound, lacking = np.where(better, others[2], bound), np.where(better, others[3], lacking)
        parts.append((rays * length[:, None], points / model.scale, np.minimum(bound, TOP), lacking < 0.05))
    return Solved(*(np.concatenate(one) for one in zip(*parts, strict=True)))


def fit(solved: Solved, rounds: int, model: ReachModel, seed: int) -> Network:
    """Adam on squared errors of set points and Huber's of the margin, which counts less where it is clear."""
    way, scaled, margin = solved.way[solved.good], solved.scaled[solved.good], solved.margin[solved.good]
    way, scaled = np.concatenate([way, way * MIRROR]), np.concatenate([scaled, scaled * MIRROR])
    margin = np.clip(np.concatenate([margin, margin]), -0.25, TOP)
    inputs = way.astype(np.float32)
    wanted = np.concatenate([scaled.reshape(len(way), -1), MARGIN_SCALE * margin[:, None]], axis=1).astype(np.float32)
    weight = np.where(margin < -0.15, 0.2, 1.0).astype(np.float32)[:, None]
    of_margin = 4.0 * np.where(margin < -0.1, 0.3, np.where(margin > TOP - 1e-3, 0.5, 1.0)).astype(np.float32)
    random = np.random.default_rng((seed, 2))
    sizes = [6, *(HIDDEN,) * (LAYERS - 1), wanted.shape[1]]
    values = [(random.normal(size=s) * np.sqrt(2.0 / s[0])).astype(np.float32) for s in pairwise(sizes)]
    values[-1] *= 0.1
    values += [np.zeros(size, np.float32) for size in sizes[1:]]
    mean, square = [np.zeros_like(v) for v in values], [np.zeros_like(v) for v in values]
    batch, step = 512, 0
    total = rounds * (len(inputs) // batch)
    for _ in range(rounds):
        order = random.permutation(len(inputs))
        for begin in range(0, len(order) - batch + 1, batch):
            some = order[begin : begin + batch]
            outs, slopes = [inputs[some]], []
            for k in range(LAYERS - 1):
                z = outs[-1] @ values[k] + values[LAYERS + k]
                with np.errstate(over="ignore"):  # infinite: a share of nothing
                    share = 1.0 / (1.0 + np.exp(-z))
                outs.append(z * share)
                slopes.append(share * (1.0 + z * (1.0 - share)))
            error = outs[-1] @ values[LAYERS - 1] + values[-1] - wanted[some]
            back = error * weight[some]
            back[:, -1] = np.clip(error[:, -1], -0.3, 0.3) * of_margin[some]
            back /= batch
            step += 1
            rate = 1e-3 * (1.0 + np.cos(np.pi * step / total)) + 1e-6
            for k in reversed(range(LAYERS)):
                gradients = (outs[k].T @ back, back.sum(axis=0))
                if k:
                    back = (back @ values[k].T) * slopes[k - 1]
                for j, gradient in zip((k, LAYERS + k), gradients, strict=True):
                    mean[j] += 0.1 * (gradient - mean[j])
                    square[j] += 0.002 * (gradient**2 - square[j])
                    scale = np.sqrt(square[j] / (1.0 - 0.998**step)) + 1e-8
                    values[j] -= (rate * (mean[j] / (1.0 - 0.9**step)) / scale).astype(np.float32)
    whole = [v.astype(np.float16).astype(np.float64) for v in values]
    return Network(tuple(whole[:LAYERS]), tuple(whole[LAYERS:]), signature(model))


def train(first: tuple[int, int] = FIRST, second: tuple[int, int] = SECOND, seed: int = SEED) -> Network:
    """Both fits for FO_SHIP."""
    model = ReachModel(FO_SHIP, FO_SHIP_LIMITS)
    rough = fit(solved_poses(model, first[0], seed, None), first[1], model, seed)
    return fit(solved_poses(model, second[0], seed, ReachGuess(model, rough)), second[1], model, seed)


def write(network: Network, file: IO[bytes]) -> None:
    """As `rig/reach_guess` reads it, in half precision."""
    weights = {f"weights_{k}": w.astype(np.float16) for k, w in enumerate(network.weights)}
    offsets = {f"offsets_{k}": o.astype(np.float16) for k, o in enumerate(network.offsets)}
    np.savez_compressed(file, stack=network.stack, **weights, **offsets)  # type: ignore[arg-type]
