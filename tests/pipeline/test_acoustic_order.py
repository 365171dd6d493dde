"""Receivers in another order than in the settings."""

import math
from itertools import permutations

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.navigation.rotation import rotation_from_euler
from bluerov_slam.pipeline.acoustic_callers import Expected
from bluerov_slam.pipeline.acoustic_order import OrderWatch

CROSS = ReceiverArray.cross()
STALK = ReceiverArray(np.vstack((CROSS.positions_m, (0.25, 0.0, 0.0))))
UP = rotation_from_euler(0.0, math.radians(90.0), 0.0)
AHEAD = np.eye(3)
RIGHT = (0, 1, 2, 3)
EITHER = "receivers 0 and 2 or 1 and 3 seem exchanged"


def found(
    array: ReceiverArray,
    order: tuple[int, ...] = RIGHT,
    *,
    turned_deg: float = 0.0,
    tilted_deg: float = 3.0,
    mounting: np.ndarray = UP,
    echoes: bool = False,
    known_to_m: float | None = None,
    place_off_m: float | None = None,
    first_m: tuple[float, float, float] = (20.0, 6.0, -3.0),
    seed: int = 2,
) -> str:
    """Twenty-four pulses from 25 m, one a second, while the vehicle goes on and turns; `order`: whose plug is where."""
    watch, noise = OrderWatch(array), np.random.default_rng(seed)
    plugs = [*order, *range(len(order), len(array))]
    last = ""
    for k in range(24):
        tilt = math.radians(tilted_deg) * np.array((math.sin(1.1 * k), math.cos(0.7 * k)))
        rotation = rotation_from_euler(*tilt, math.radians(turned_deg * k / 23.0)) @ mounting
        way = np.array(first_m) - (0.3 * k, 0.0, 0.0)
        echo = echoes and k % 6 == 5
        expected = None
        if known_to_m is not None:
            off = np.cross(way, (0.0, 0.0, 1.0))
            seen = way + (known_to_m if place_off_m is None else place_off_m) * off / np.linalg.norm(off)
            expected = Expected(seen / np.linalg.norm(seen), math.hypot(known_to_m / 25.0, math.radians(3.0)))
        # The water turns each direction by degrees.
        water = rotation_from_euler(*noise.normal(0.0, math.radians(2.0), 3))
        source = rotation.T @ water @ (np.array((-9.0, 4.0, 20.0)) if echo else way)
        ranges = np.linalg.norm(source - array.positions_m, axis=1) + noise.normal(0.0, 1e-3, len(array))
        last = watch.hear(float(k), ranges[plugs], rotation, expected)
    return last


@pytest.mark.parametrize(("order", "pair"), [((2, 1, 0, 3), "0 and 2"), ((0, 3, 2, 1), "1 and 3")])
@pytest.mark.parametrize("echoes", [False, True])
def test_opposite_corners_are_told_by_turning(order: tuple[int, ...], pair: str, echoes: bool) -> None:
    # A flat array never tells one diagonal from the other; a stalk does, tilted a little.
    assert found(CROSS, order, turned_deg=120.0, echoes=echoes) == EITHER
    assert pair in found(STALK, order, turned_deg=120.0, echoes=echoes)
    assert found(STALK, order, turned_deg=120.0, first_m=(16.0, 6.0, -14.0)) == f"receivers {pair} seem exchanged"


def test_where_the_place_is_known_turning_tells_which_diagonal_for_sure() -> None:
    assert found(CROSS, (2, 1, 0, 3), turned_deg=120.0, known_to_m=2.0) == "receivers 0 and 2 seem exchanged"


@pytest.mark.parametrize("array", [CROSS, STALK], ids=["cross", "stalk"])
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("turned_deg", [0.0, 60.0, 200.0])
def test_the_right_order_is_never_doubted(array: ReceiverArray, turned_deg: float, seed: int) -> None:
    for mounting in (UP, AHEAD):
        assert found(array, turned_deg=turned_deg, mounting=mounting, echoes=True, seed=seed) == ""
        assert found(array, turned_deg=turned_deg, mounting=mounting, tilted_deg=15.0, known_to_m=3.0, seed=seed) == ""


@pytest.mark.parametrize("array", [CROSS, STALK], ids=["cross", "stalk"])
def test_a_straight_way_without_a_place_tells_nothing(array: ReceiverArray) -> None:
    assert found(array, (2, 1, 0, 3), tilted_deg=0.5) == ""


def test_on_a_straight_way_a_known_place_tells_which_diagonal() -> None:
    said = found(CROSS, (2, 1, 0, 3), known_to_m=2.0)
    assert said == (
        "the sound does not come from where the transmitter should be, but would with receivers 0 and 2 exchanged"
    )
    said = found(CROSS, (0, 3, 2, 1), known_to_m=2.0)
    assert said.endswith("would with receivers 1 and 3 exchanged")


def test_both_diagonals_at_once_are_told_by_a_known_place_only() -> None:
    both = (2, 3, 0, 1)
    for turned_deg in (0.0, 120.0):
        assert found(CROSS, both, turned_deg=turned_deg, tilted_deg=15.0) == ""
        said = found(CROSS, both, turned_deg=turned_deg, known_to_m=2.0)
        assert said.endswith("would with receivers 0 and 2, 1 and 3 exchanged")


def test_a_stalk_tells_both_diagonals_while_the_array_is_tilted() -> None:
    assert found(STALK, (2, 3, 0, 1), tilted_deg=15.0) == "receivers 0 and 2, 1 and 3 seem exchanged"


def test_a_quarter_of_a_turn_is_told_by_tilting_not_by_turning() -> None:
    quarter = (1, 2, 3, 0)
    assert found(CROSS, quarter, turned_deg=120.0, tilted_deg=0.0) == ""
    said = found(CROSS, quarter, turned_deg=120.0, tilted_deg=20.0, first_m=(12.0, 6.0, -14.0))
    assert "0, 1, 2 and 3" in said or "0, 3, 2 and 1" in said


def test_every_order_is_told_where_the_place_is_known() -> None:
    for order in permutations(RIGHT):
        said = found(CROSS, order, known_to_m=1.0, tilted_deg=10.0)
        assert bool(said) == (order != RIGHT), order


def test_a_navigator_that_is_too_sure_by_a_dozen_degrees_raises_no_alarm() -> None:
    for off_m in (-5.0, 5.0):
        assert found(CROSS, known_to_m=0.3, place_off_m=off_m) == ""


def test_a_place_that_is_not_known_well_is_no_proof() -> None:
    assert found(CROSS, (2, 1, 0, 3), tilted_deg=0.5, known_to_m=40.0) == ""


def test_found_while_turning_it_stands_on_a_straight_way_until_turning_contradicts_it() -> None:
    watch, rng = OrderWatch(CROSS), np.random.default_rng(1)

    def hear(at_s: float, yaw_deg: float, order: tuple[int, ...]) -> str:
        rotation = rotation_from_euler(0.0, 0.0, math.radians(yaw_deg)) @ UP
        ranges = np.linalg.norm(rotation.T @ (20.0, 14.0, -3.0) - CROSS.positions_m, axis=1)
        return watch.hear(at_s, (ranges + rng.normal(0.0, 1e-3, 4))[list(order)], rotation, None)

    swapped = (2, 1, 0, 3)
    said = [hear(float(k), 5.0 * k, swapped) for k in range(24)]
    assert said[-1] == EITHER
    assert all(hear(24.0 + k, 120.0, swapped) == EITHER for k in range(30))
    cured = [hear(60.0 + k, 120.0 + 5.0 * k, RIGHT) for k in range(48)]
    assert cured[-1] == ""
