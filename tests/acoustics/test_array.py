import numpy as np
import pytest

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.errors import ArrayGeometryError

SOUND = 343.0


def test_the_cross_is_the_thesis_array() -> None:
    array = ReceiverArray.cross()
    h = 0.25 / np.sqrt(2.0)
    assert array.positions_m == pytest.approx(np.array([(0.0, -h, -h), (0.0, -h, h), (0.0, h, h), (0.0, h, -h)]))
    assert array.rank == 2
    assert np.linalg.norm(array.positions_m[0] - array.positions_m[1]) == pytest.approx(0.35355, abs=1e-5)


def test_largest_delays_are_side_and_diagonal() -> None:
    array = ReceiverArray.cross()
    limits = dict(zip(map(tuple, array.pairs.tolist()), array.largest_delay_s(SOUND), strict=True))
    assert limits[(0, 1)] == pytest.approx(1.0308e-3, abs=1e-7)
    assert limits[(0, 2)] == pytest.approx(1.4577e-3, abs=1e-7)


def test_a_near_receiver_hears_first_and_has_a_positive_delay() -> None:
    array = ReceiverArray.cross()
    delays = array.delays_s((2.0, 1.0, 1.0), SOUND)
    assert delays[1] > 0.0  # receiver 2 is at right and down, as the source


def test_far_delays_are_the_limit_of_near_ones() -> None:
    array = ReceiverArray.cross(centre=True)
    direction = np.array((0.8, 0.36, -0.48))
    assert array.delays_s(1e6 * direction, SOUND, 2) == pytest.approx(array.far_delays_s(direction, SOUND, 2), abs=1e-9)


def test_closures_of_any_source_are_zero() -> None:
    array = ReceiverArray.cross(centre=True)
    arrival = array.arrival_s((1.5, 0.2, -0.4), SOUND)
    delays = arrival[array.pairs[:, 0]] - arrival[array.pairs[:, 1]]
    assert array.closures @ delays == pytest.approx(np.zeros(len(array.closures)), abs=1e-18)
    assert len(array.closures) == len(array.pairs) - (len(array) - 1)


@pytest.mark.parametrize(
    ("positions", "what"),
    [
        (np.eye(3)[:2], "3 or more"),
        (np.array([(0, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0.0005)], dtype=float), "receivers 1 and 3"),
        (np.array([(0, 0, 0), (0, 1, 0), (0, 0, np.nan)]), "not a number"),
    ],
)
def test_what_is_no_array_is_named(positions: np.ndarray, what: str) -> None:
    with pytest.raises(ArrayGeometryError, match=what):
        ReceiverArray(positions)


def test_rank_tells_line_plane_and_space() -> None:
    line = ReceiverArray(np.array([(0, 0, 0), (0, 0.1, 0), (0, 0.3, 0.001)]))
    space = ReceiverArray(np.vstack((ReceiverArray.cross().positions_m, (0.1, 0.0, 0.0))))
    assert (line.rank, ReceiverArray.cross(centre=True).rank, space.rank) == (1, 2, 3)


def test_a_mounting_turns_array_axes_into_the_body() -> None:
    down_looking = np.array([(0, 0, -1), (0, 1, 0), (1, 0, 0)], dtype=float)
    mounting = ArrayMounting(down_looking, np.array((0.1, 0.0, 0.2)))
    assert mounting.direction_frd((1.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0))
    assert mounting.positions_frd_m(ReceiverArray.cross()).mean(axis=0) == pytest.approx((0.1, 0.0, 0.2))


def test_a_left_handed_mounting_is_refused() -> None:
    with pytest.raises(ArrayGeometryError, match="left-handed"):
        ArrayMounting(np.diag((1.0, -1.0, 1.0)))


def test_a_stalk_stands_an_arm_before_the_cross_and_spans_space() -> None:
    stalk = ReceiverArray.cross(0.3, stalk=True)
    assert len(stalk) == 5
    assert stalk.positions_m[4].tolist() == [0.3, 0.0, 0.0]
    assert (stalk.rank, ReceiverArray.cross(0.3, centre=True).rank) == (3, 2)
