"""A first guess of what reach will say of a pose: set points near those of the largest margin, and that margin.

A small network (two hidden layers), fitted to solved poses of one stack (`evaluation/rig_reach_training`), stored
beside this file with the numbers of the stack it is of. It proves nothing: `workspace` starts its search at the set
points and takes the margin as one more sign that going on is hopeless. Any other stack has no guess.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import IO, TYPE_CHECKING

import numpy as np

from bluerov_slam.rig.reach import rotation_vector
from bluerov_slam.rig.stack import stack_pose

if TYPE_CHECKING:
    from bluerov_slam.rig.dimensions import Floats
    from bluerov_slam.rig.reach import ReachModel
    from bluerov_slam.rig.stack import StackPose

FILE = "reach_guess.npz"
LAYERS = 3
SPREAD = np.array([84.0, 86.0, 37.0, 0.28, 0.28, 0.106])
"""Of x, y, z (mm) and turns (rad) from home: makes the network's inputs alike. The spreads of `agreement`."""
MARGIN_SCALE = 12.0
"""What the network's margin is multiplied by, so that its error weighs like those of set points."""
_FURTHEST = 8.0
"""In spreads from home: nothing was fitted beyond, and nothing reached."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """Weights (inputs, outputs) and offsets of each layer, and the stack (`signature`) that they are of."""

    weights: tuple[Floats, ...]
    offsets: tuple[Floats, ...]
    stack: Floats

    def output(self, inputs: Floats) -> Floats:
        """Scaled set points and the scaled margin, (..., 6 P + 1)."""
        values = inputs
        for weights, offsets in zip(self.weights[:-1], self.offsets[:-1], strict=True):
            values = values @ weights + offsets
            values = values / (1.0 + np.exp(-values))
        return values @ self.weights[-1] + self.offsets[-1]


class ReachGuess:
    """Guesses for the poses of a stack."""

    def __init__(self, model: ReachModel, network: Network) -> None:
        home = stack_pose(np.zeros((model.count, 6)), model.dimensions)
        self._home, self._scale, self._network = home.position_mm, model.scale, network

    def __call__(self, pose: StackPose) -> tuple[Floats, Floats]:
        """Set points (..., P, 6) within the axis limits, and their margin (...), for poses (...)."""
        way = np.concatenate([pose.position_mm - self._home, rotation_vector(pose.rotation)], axis=-1)
        found = self._network.output(np.clip(way / SPREAD, -_FURTHEST, _FURTHEST))
        scaled = np.minimum(np.maximum(found[..., :-1], -1.0), 1.0).reshape(*found.shape[:-1], -1, 6)
        return scaled * self._scale, found[..., -1] / MARGIN_SCALE


def stored_guess(model: ReachModel) -> ReachGuess | None:
    """The stored guess, if it is of this stack."""
    network, stack = _stored(), signature(model)
    same = network.stack.shape == stack.shape and np.allclose(network.stack, stack, rtol=1e-9, atol=1e-9)
    return ReachGuess(model, network) if same else None


def signature(model: ReachModel) -> Floats:
    """All numbers of a stack that decide what it reaches."""
    dimensions = model.dimensions
    stack = [dimensions.foot_mm, dimensions.base_mm, dimensions.tool_mm, model.ranges]
    for platform, limits in zip(dimensions.platforms, model.limits, strict=True):
        stack += [platform.base_joints_mm, platform.plate_joints_mm, platform.arm_bearings_rad, platform.arm_mm]
        stack += [platform.rod_mm, np.array(platform.home_height_mm), np.array(limits.joint_tilt_rad)]
        stack += [limits.lowest_servo_rad, limits.highest_servo_rad]
    return np.concatenate([np.ravel(one) for one in stack])


def read(file: IO[bytes]) -> Network:
    """A network as `evaluation/rig_reach_training` writes it."""
    with np.load(file) as arrays:
        weights = tuple(arrays[f"weights_{k}"].astype(np.float64) for k in range(LAYERS))
        offsets = tuple(arrays[f"offsets_{k}"].astype(np.float64) for k in range(LAYERS))
        return Network(weights, offsets, arrays["stack"])


@cache
def _stored() -> Network:
    with files(__package__).joinpath(FILE).open("rb") as file:
        return read(file)
