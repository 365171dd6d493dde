"""Where the receivers are: the array in its own frame, and how it sits on the vehicle.

Array frame: origin at the centre, x along the normal (forward on the thesis's rig), y right, z down, right-handed.
Delays as on the wire: `delay_i = toa_reference - toa_i`, so a receiver nearer to the source than the reference has a
positive one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.errors import ArrayGeometryError

Array = NDArray[np.float64]

LEAST_SEPARATION_M = 1e-3
"""Receivers nearer than a millimetre are one receiver entered twice."""

FLAT_SHARE = 0.02
"""An extent below this share of the largest one is none: what it tells drowns in the error of the positions."""

THESIS_RANK_SKEW_S = 21.0 / 50e6
"""One conversion (8.5 + 12.5 cycles at 50 MHz): receivers 1 and 3 of the thesis's board are sampled so much later."""


@dataclass(frozen=True, eq=False)
class ReceiverArray:
    """Receivers (n, 3) in the array's frame (m), and how much later than its record says each is sampled (n,)."""

    positions_m: Array
    sample_skew_s: Array = field(default_factory=lambda: np.zeros(0))
    name: str = "array"

    def __post_init__(self) -> None:
        positions = np.array(self.positions_m, dtype=np.float64)
        if positions.ndim != 2 or positions.shape[1] != 3 or len(positions) < 3:
            raise ArrayGeometryError(f"{self.name}: positions of shape {positions.shape}, expected 3 or more rows of 3")
        if not np.isfinite(positions).all():
            raise ArrayGeometryError(f"{self.name}: a receiver's position is not a number")
        skew = np.array(self.sample_skew_s, dtype=np.float64)
        if skew.size == 0:
            skew = np.zeros(len(positions))
        if skew.shape != (len(positions),) or not np.isfinite(skew).all():
            raise ArrayGeometryError(f"{self.name}: {skew.size} sample skews for {len(positions)} receivers")
        object.__setattr__(self, "positions_m", positions)
        object.__setattr__(self, "sample_skew_s", skew)
        for first, second in self.pairs:
            apart = float(np.linalg.norm(positions[first] - positions[second]))
            if apart < LEAST_SEPARATION_M:
                raise ArrayGeometryError(
                    f"{self.name}: receivers {first} and {second} are {1e3 * apart:.2f} mm apart, expected 1 mm or more"
                )

    @classmethod
    def cross(
        cls,
        arm_m: float = 0.25,
        centre: bool = False,
        sample_skew_s: ArrayLike = (),
        name: str = "",
        *,
        stalk: bool = False,
    ) -> ReceiverArray:
        """The thesis's X: receivers 0..3 at (0,-h,-h) (0,-h,h) (0,h,h) (0,h,-h); on demand a fifth in the middle, or on
        a stalk of the arm's length before it, which tells front from back and sees flat directions.
        """
        h = arm_m / math.sqrt(2.0)
        places = [(0.0, -h, -h), (0.0, -h, h), (0.0, h, h), (0.0, h, -h)]
        if centre:
            places.append((0.0, 0.0, 0.0))
        if stalk:
            places.append((arm_m, 0.0, 0.0))
        return cls(
            np.array(places),
            np.asarray(sample_skew_s, dtype=np.float64),
            name or ("cross" + " with centre" * centre + " with stalk" * stalk),
        )

    def __len__(self) -> int:
        return len(self.positions_m)

    @property
    def pairs(self) -> NDArray[np.intp]:
        """All pairs (m, 2) of receivers, the lower index first."""
        first, second = np.triu_indices(len(self.positions_m), 1)
        return np.stack((first, second), axis=1)

    @property
    def closures(self) -> NDArray[np.intp]:
        """Independent triangles (q, m): each row times the delays of all pairs (toa_first - toa_second) is zero."""
        pairs = [tuple(pair) for pair in self.pairs.tolist()]
        rows = []
        for first, second in pairs:
            if first == 0:
                continue
            row = [0] * len(pairs)
            row[pairs.index((0, first))] = 1
            row[pairs.index((first, second))] = 1
            row[pairs.index((0, second))] = -1
            rows.append(row)
        return np.array(rows, dtype=np.intp)

    def largest_delay_s(self, sound_speed_mps: float) -> Array:
        """The longest delay (m,) that each pair can have: its distance over the speed of sound."""
        pairs = self.pairs
        apart: Array = np.linalg.norm(self.positions_m[pairs[:, 0]] - self.positions_m[pairs[:, 1]], axis=1)
        return apart / sound_speed_mps

    @property
    def rank(self) -> int:
        """1: on a line (a cone of directions), 2: in a plane (a mirrored solution behind it), 3: in space."""
        return rank_of(self.positions_m)

    def subset(self, receivers: Sequence[int]) -> Array:
        """Positions (k, 3) of some receivers in that order: what `solve_source` takes, the reference first."""
        chosen: Array = self.positions_m[list(receivers)]
        return chosen

    def arrival_s(self, source_m: ArrayLike, sound_speed_mps: float) -> Array:
        """Travel times (n,) from a source in the array's frame."""
        way: Array = np.linalg.norm(np.asarray(source_m, dtype=np.float64) - self.positions_m, axis=1)
        return way / sound_speed_mps

    def delays_s(self, source_m: ArrayLike, sound_speed_mps: float, reference: int = 0) -> Array:
        """`toa_reference - toa_i` (n-1,) of a source in the array's frame, ascending without the reference."""
        arrival = self.arrival_s(source_m, sound_speed_mps)
        return np.delete(arrival[reference] - arrival, reference)

    def far_delays_s(self, direction: ArrayLike, sound_speed_mps: float, reference: int = 0) -> Array:
        """The same for a source far away in the direction of a unit vector."""
        along = self.positions_m @ np.asarray(direction, dtype=np.float64)
        return np.delete(along - along[reference], reference) / sound_speed_mps


@dataclass(frozen=True, eq=False)
class ArrayMounting:
    """How the array sits on the vehicle: `v_frd = rotation_frd_array @ v_array`, its centre at the lever arm (m)."""

    rotation_frd_array: Array = field(default_factory=lambda: np.eye(3))
    lever_arm_frd_m: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation_frd_array, dtype=np.float64)
        lever = np.array(self.lever_arm_frd_m, dtype=np.float64)
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
            raise ArrayGeometryError("the array's mounting is no rotation")
        if np.linalg.det(rotation) < 0.0:
            raise ArrayGeometryError("the array's mounting is left-handed: two of its axes are exchanged")
        if lever.shape != (3,) or not np.isfinite(lever).all():
            raise ArrayGeometryError(f"the array's lever arm is {lever}, expected three numbers in metres")
        object.__setattr__(self, "rotation_frd_array", rotation)
        object.__setattr__(self, "lever_arm_frd_m", lever)

    def direction_frd(self, direction_array: ArrayLike) -> Array:
        """A direction seen by the array, in the body's axes."""
        turned: Array = self.rotation_frd_array @ np.asarray(direction_array, dtype=np.float64)
        return turned

    def positions_frd_m(self, array: ReceiverArray) -> Array:
        """The receivers (n, 3) in the body's frame."""
        turned: Array = self.lever_arm_frd_m + array.positions_m @ self.rotation_frd_array.T
        return turned


def rank_of(positions_m: Array) -> int:
    """How many dimensions receivers (n, 3) span: 0 to 3."""
    spread = np.linalg.svd(positions_m - positions_m.mean(axis=0), compute_uv=False)
    return int((spread > max(FLAT_SHARE * spread[0], LEAST_SEPARATION_M)).sum())
