"""What the filter estimates: the blocks of the error state, their places, and the nominal values they are errors of.

True = estimate + error for every block but the attitude, whose error is a rotation vector in NED on the left:
`R_true = Exp(error) R_estimate`. Blocks, their units and their order stand in docs/navigation.md, section 2.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.navigation.rotation import exp_so3, left_jacobian, log_so3

Array = NDArray[np.float64]

POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
ATTITUDE = slice(6, 9)
BLOCKS = (
    ("position", 3),
    ("velocity", 3),
    ("attitude", 3),
    ("gyro_bias", 3),
    ("accel_bias", 3),
    ("current", 2),
    ("thrust_scale", 2),
    ("compass", 3),
    ("compass_wander", 1),
    ("gps_wander", 2),
    ("depth_bias", 1),
    ("sound_speed_scale", 1),
    ("dvl", 2),
)
ALWAYS_PRESENT = frozenset(("position", "velocity", "attitude"))


@dataclass(frozen=True, slots=True)
class StateLayout:
    """Which blocks there are and where each lies in the error vector."""

    blocks: tuple[tuple[str, int], ...]
    places: Mapping[str, slice]
    size: int

    @classmethod
    def make(cls, without: Iterable[str] = (), extra: Iterable[tuple[str, int]] = ()) -> StateLayout:
        """The contract's blocks but those in `without`, then the `extra` ones."""
        left_out, added = frozenset(without), tuple(extra)
        if not left_out <= {name for name, _ in BLOCKS}:
            raise ValueError(f"no such blocks: {sorted(left_out - {name for name, _ in BLOCKS})}")
        if left_out & ALWAYS_PRESENT:
            raise ValueError(f"no filter without {sorted(left_out & ALWAYS_PRESENT)}")
        blocks = (*((name, size) for name, size in BLOCKS if name not in left_out), *added)
        places: dict[str, slice] = {}
        start = 0
        for name, size in blocks:
            if name in places or size < 1:
                raise ValueError(f"block {name!r} of size {size} is there twice or empty")
            places[name] = slice(start, start + size)
            start += size
        return cls(blocks, places, start)

    def __contains__(self, name: str) -> bool:
        return name in self.places

    def __getitem__(self, name: str) -> slice:
        """Where a block lies in the error vector; KeyError if this layout has none."""
        return self.places[name]

    def vector(self, **values: ArrayLike) -> Array:
        """A vector over all states from values by block (a number stands for all of a block), zero elsewhere."""
        vector = np.zeros(self.size)
        for name, value in values.items():
            vector[self.places[name]] = value
        return vector


class NavEstimate:
    """Nominal values at one instant. Mutable only inside a filter; whoever keeps one keeps a copy.

    `values` (n,) holds every block at its place in the layout, the attitude's three being unused (0).
    """

    __slots__ = ("at_s", "layout", "rotation_ned_frd", "values")

    def __init__(self, layout: StateLayout, at_s: float, rotation_ned_frd: Array | None = None, **blocks: ArrayLike):
        if "attitude" in blocks:
            raise ValueError("the attitude is given as rotation_ned_frd")
        self.layout = layout
        self.at_s = at_s
        self.rotation_ned_frd: Array = (
            np.eye(3) if rotation_ned_frd is None else np.array(rotation_ned_frd, dtype=float)
        )
        self.values: Array = layout.vector(**blocks)

    @property
    def position_ned_m(self) -> Array:
        """View (3,)."""
        return self.values[POSITION]

    @property
    def velocity_ned_mps(self) -> Array:
        """View (3,), over ground."""
        return self.values[VELOCITY]

    @property
    def blocks(self) -> Array:
        """View of everything behind the attitude."""
        return self.values[ATTITUDE.stop :]

    def block(self, name: str) -> Array:
        """View of one block; KeyError if the layout has none (and for the attitude, which is no vector)."""
        if name == "attitude":
            raise KeyError("the attitude is rotation_ned_frd")
        return self.values[self.layout.places[name]]

    def add_error(self, error: Array) -> None:
        """Move to estimate (+) error."""
        self.values += error
        self.values[ATTITUDE] = 0.0
        self.rotation_ned_frd = exp_so3(error[ATTITUDE]) @ self.rotation_ned_frd

    def difference(self, other: NavEstimate) -> Array:
        """The error that, added to `other`, gives this estimate."""
        error = self.values - other.values
        error[ATTITUDE] = log_so3(self.rotation_ned_frd @ other.rotation_ned_frd.T)
        return error

    def copy(self) -> NavEstimate:
        """An independent copy."""
        twin = NavEstimate.__new__(NavEstimate)
        twin.layout = self.layout
        twin.at_s = self.at_s
        twin.rotation_ned_frd = self.rotation_ned_frd.copy()
        twin.values = self.values.copy()
        return twin

    def is_finite(self) -> bool:
        """Whether every number is one."""
        return bool(np.isfinite(self.values).all() and np.isfinite(self.rotation_ned_frd).all())


def turn_of_correction(layout: StateLayout, error: Array, along: Array) -> Array:
    """How errors about an estimate become errors about the one moved by `error`: new = old + B (old attitude error).

    Returns B (n, 3). The attitude's own error turns by half the correction. What is known in the body, a velocity or
    the current as instruments on board see it, is v = R z in NED: an error of the heading turns it, and after it has
    moved by `along` (n,) the error turns the moved one. Without this a turn of heading, course and current together,
    which nothing on board can see, would point elsewhere after each correction, and noise would pass for knowledge.

    Source of the idea: Barrau and Bonnabel (2017), doi:10.1109/TAC.2016.2594085.
    """
    turn = np.zeros((layout.size, 3))
    turn[ATTITUDE] = left_jacobian(error[ATTITUDE])
    turn[6, 0] -= 1.0
    turn[7, 1] -= 1.0
    turn[8, 2] -= 1.0
    north, east, _, velocity_north, velocity_east = along[:5].tolist()
    turn[0, 2], turn[1, 2] = -east, north
    turn[3, 2], turn[4, 2] = -velocity_east, velocity_north
    if "current" in layout:
        place = layout.places["current"].start
        turn[place, 2], turn[place + 1, 2] = -along[place + 1], along[place]
    return turn
