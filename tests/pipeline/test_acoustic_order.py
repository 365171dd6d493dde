"""Receivers exchanged on opposite corners."""

import math

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.navigation.rotation import rotation_from_euler
from bluerov_slam.pipeline.acoustic_order import OrderWatch

CROSS = ReceiverArray.cross()
STALK = ReceiverArray(np.vstack((CROSS.positions_m, (0.25, 0.0, 0.0))))
UP = rotation_from_euler(0.0, math.radians(90.0), 0.0)


def found(
    array: ReceiverArray, swap: tuple[int, int] | None, turned_deg: float, echoes: bool = False
) -> tuple[tuple[int, int], ...]:
    """Twenty pulses from 25 m while the vehicle turns."""
    watch, noise = OrderWatch(array), np.random.default_rng(2)
    last: tuple[tuple[int, int], ...] = ()
    for k in range(20):
        rotation = rotation_from_euler(0.02, -0.03, math.radians(turned_deg * k / 19.0)) @ UP
        way = np.array((20.0 - 0.3 * k, 14.0, -3.0)) if not (echoes and k % 6 == 5) else np.array((-9.0, 4.0, 20.0))
        ranges = np.linalg.norm(rotation.T @ way - array.positions_m, axis=1) + noise.normal(0.0, 1e-3, len(array))
        if swap is not None:
            ranges[list(swap)] = ranges[list(swap[::-1])]
        last = watch.hear(ranges, rotation)
    return last


@pytest.mark.parametrize("array", [CROSS, STALK], ids=["cross", "stalk"])
@pytest.mark.parametrize("swap", [(0, 2), (1, 3)])
@pytest.mark.parametrize("echoes", [False, True])
def test_opposite_corners_are_told_by_turning(array: ReceiverArray, swap: tuple[int, int], echoes: bool) -> None:
    assert found(array, swap, 120.0, echoes) == ((0, 2), (1, 3))  # they mirror the level plane either way


@pytest.mark.parametrize("array", [CROSS, STALK], ids=["cross", "stalk"])
def test_the_right_order_is_never_doubted_and_a_straight_way_tells_nothing(array: ReceiverArray) -> None:
    for turned_deg in (0.0, 60.0, 200.0):
        assert found(array, None, turned_deg, echoes=True) == ()
    assert found(array, (0, 2), 0.0) == ()
