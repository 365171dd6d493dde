import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.position import IN_PLANE, solve_source
from bluerov_slam.acoustics.position_batch import solve_batch
from bluerov_slam.navigation.rotation import rotation_from_euler

SOUND = 343.0
CROSS = ReceiverArray.cross()
COVARIANCE = 1e-14 * (np.eye(3) + 1.0)  # 0.1 us on every receiver
BENCH = (1.0, 0.0, 0.0)  # the thesis's depth axis


@pytest.mark.parametrize("source", [(1.4, 0.1, -0.2), (3.9, 1.0, 0.5), (2.6, -1.5, 1.2), (50.0, 3.0, 10.0)])
def test_exact_delays_and_depth_give_the_source(source: tuple[float, float, float]) -> None:
    delays = CROSS.delays_s(source, SOUND)
    solution = solve_source(CROSS.positions_m, delays, COVARIANCE, SOUND, depth=(source[0], 5e-4), down=BENCH)
    assert solution.good
    assert solution.position_m == pytest.approx(source, abs=1e-8)
    assert solution.mirror is None


def test_a_contradicting_depth_leaves_the_direction_alone() -> None:
    attitude = rotation_from_euler(0.2, -0.3, 1.0)
    source = np.array((8.0, 2.0, 5.0))
    receivers = CROSS.positions_m @ attitude.T
    ways = np.linalg.norm(source - receivers, axis=1)
    solution = solve_source(
        receivers,
        (ways[0] - ways[1:]) / SOUND,
        COVARIANCE,
        SOUND,
        depth=(-5.0, 0.05),
        front=attitude[:, 0],
    )
    assert "depth" in solution.reason
    assert solution.position_m is None
    assert solution.direction == pytest.approx(source / np.linalg.norm(source), abs=1e-3)


def test_batch_and_single_agree() -> None:
    rng = np.random.default_rng(3)
    sources = np.column_stack((rng.uniform(1.3, 4.0, 50), rng.uniform(-1, 1, 50), rng.uniform(-1, 1, 50)))
    delays = np.array([CROSS.delays_s(source, SOUND) for source in sources]) + 1e-7 * rng.standard_normal((50, 3))
    batch = solve_batch(CROSS.positions_m, delays, SOUND, sources[:, 0], down=BENCH)
    for index in range(50):
        single = solve_source(
            CROSS.positions_m, delays[index], COVARIANCE, SOUND, depth=(sources[index, 0], 1e-6), down=BENCH
        )
        assert batch[index] == pytest.approx(single.position_m, abs=1e-6)


@pytest.mark.parametrize(("range_m", "bound_mm"), [(1.4, 2.5), (2.6, 8.5), (3.9, 19.0)])
def test_a_fifth_receiver_in_the_centre_gives_the_range_at_its_bound(range_m: float, bound_mm: float) -> None:
    array = ReceiverArray.cross(centre=True)
    covariance = 1e-14 * (np.eye(4) + 1.0)
    noise = np.linalg.cholesky(covariance)
    rng = np.random.default_rng(5)
    errors, stds, nees = [], [], []
    for _ in range(120):
        azimuth, elevation = np.radians(rng.uniform(-20, 20)), np.radians(rng.uniform(-8, 8))
        toward = np.array((np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)))
        delays = array.delays_s(range_m * toward, SOUND) + noise @ rng.standard_normal(4)
        solution = solve_source(array.positions_m, delays, covariance, SOUND)
        if solution.reason:  # one right fix in a thousand
            continue
        assert solution.position_m is not None
        assert solution.covariance_m2 is not None
        error = solution.position_m - range_m * toward
        errors.append(1e3 * float(error @ toward))
        stds.append(1e3 * float(np.sqrt(toward @ solution.covariance_m2 @ toward)))
        nees.append(float(error @ np.linalg.solve(solution.covariance_m2, error)))
    assert np.median(stds) == pytest.approx(bound_mm, rel=0.05)
    assert np.std(errors) == pytest.approx(bound_mm, rel=0.2)
    assert np.mean(nees) == pytest.approx(3.0, abs=0.7)


def test_four_receivers_far_away_give_a_direction_and_no_position() -> None:
    source = np.array((50.0, 3.0, 10.0))
    solution = solve_source(CROSS.positions_m, CROSS.delays_s(source, SOUND), COVARIANCE, SOUND)
    assert solution.good
    assert solution.position_m is None
    assert solution.covariance_m2 is None
    assert solution.direction == pytest.approx(source / np.linalg.norm(source), abs=1e-5)
    # Behind a flat array lies a second direction with the same delays.
    assert solution.mirror == pytest.approx(solution.direction * (-1, 1, 1), abs=1e-6)


def test_the_start_says_on_which_side_of_a_flat_array_the_source_is() -> None:
    source = np.array((-30.0, 4.0, 5.0))
    delays = CROSS.delays_s(source, SOUND)
    assert solve_source(CROSS.positions_m, delays, COVARIANCE, SOUND).direction[0] > 0.0
    behind = solve_source(CROSS.positions_m, delays, COVARIANCE, SOUND, start=(-20.0, 0.0, 0.0))
    assert behind.direction == pytest.approx(source / np.linalg.norm(source), abs=1e-4)


def test_an_array_in_space_has_no_mirror() -> None:
    array = ReceiverArray(np.vstack((CROSS.positions_m, (0.2, 0.0, 0.0))))
    source = np.array((-30.0, 4.0, 5.0))
    solution = solve_source(array.positions_m, array.delays_s(source, SOUND), 1e-14 * (np.eye(4) + 1.0), SOUND)
    assert solution.mirror is None
    assert solution.direction == pytest.approx(source / np.linalg.norm(source), abs=1e-4)


def test_a_tilted_array_with_the_worlds_depth() -> None:
    """The depth runs along the world's down, not along an axis of the array: here they are 40 deg apart."""
    attitude = rotation_from_euler(0.5, -0.4, 2.0)
    source = np.array((9.0, -14.0, 6.0))
    receivers = CROSS.positions_m @ attitude.T
    ways = np.linalg.norm(source - receivers, axis=1)
    delays = (ways[0] - ways[1:]) / SOUND
    world = solve_source(receivers, delays, COVARIANCE, SOUND, depth=(6.0, 0.01), start=source + 2.0)
    assert world.position_m == pytest.approx(source, abs=1e-6)
    array = solve_source(
        CROSS.positions_m,
        delays,
        COVARIANCE,
        SOUND,
        depth=(6.0, 0.01),
        down=attitude.T @ (0.0, 0.0, 1.0),
        start=attitude.T @ (source + 2.0),
    )
    assert array.position_m is not None
    assert attitude @ array.position_m == pytest.approx(source, abs=1e-6)
    assert world.covariance_m2 is not None
    # The range comes from the depth alone: its error is that of the depth over the sine of the elevation, and more.
    assert np.sqrt(np.trace(world.covariance_m2)) > 0.01 * np.linalg.norm(source) / source[2]


def test_a_synchronised_clock_gives_the_range() -> None:
    source = np.array((2.5, 0.6, -0.3))
    solution = solve_source(
        CROSS.positions_m,
        CROSS.delays_s(source, SOUND),
        COVARIANCE,
        SOUND,
        range_=(float(np.linalg.norm(source)), 10e-6 * SOUND),
    )
    assert solution.position_m == pytest.approx(source, abs=1e-8)
    assert solution.covariance_m2 is not None
    toward = source / np.linalg.norm(source)
    assert np.sqrt(toward @ solution.covariance_m2 @ toward) == pytest.approx(3.43e-3, rel=1e-3)


def test_a_depth_near_the_level_of_the_array_gives_no_range() -> None:
    source = np.array((40.0, 3.0, 0.3))
    solution = solve_source(
        CROSS.positions_m,
        CROSS.far_delays_s(source / np.linalg.norm(source), SOUND),
        1e-10 * (np.eye(3) + 1.0),
        SOUND,
        depth=(0.3, 0.05),
    )
    assert solution.position_m is None
    assert "depth says too little" in solution.reason
    assert np.isfinite(solution.direction).all()


def test_one_slipped_receiver_breaks_the_closure_and_is_said() -> None:
    delays = CROSS.delays_s((2.5, 0.3, -0.2), SOUND) + np.array((0.0, 25e-6, 0.0))
    solution = solve_source(CROSS.positions_m, delays, COVARIANCE, SOUND, depth=(2.5, 5e-4), down=BENCH)
    assert not solution.good
    assert "do not fit one source" in solution.reason
    assert solution.position_m is None


@pytest.mark.parametrize(
    ("receivers", "delays", "what"),
    [
        (CROSS.positions_m, (2e-3, 0.0, 0.0), "the array allows"),
        (CROSS.positions_m, (np.nan, 0.0, 0.0), "not a number"),
        (CROSS.positions_m[:2], (1e-4,), "3 are needed"),
        (np.array([(0, 0, 0), (0, 0.2, 0), (0, 0.4, 0)], dtype=float), (1e-4, 2e-4), "on a line"),
    ],
)
def test_what_cannot_be_solved_is_said_in_words(receivers: np.ndarray, delays: tuple[float, ...], what: str) -> None:
    count = len(delays)
    solution = solve_source(receivers, delays, 1e-14 * (np.eye(count) + 1.0), SOUND)
    assert what in solution.reason
    assert not solution.good
    assert np.isnan(solution.direction).all()
    assert solution.position_m is None


def test_a_source_in_the_plane_of_a_flat_array_is_said_to_be_there() -> None:
    # Three receivers of the square, a fourth left out: no plane wave is as slow along it as these delays are.
    receivers = ReceiverArray.cross().positions_m[[0, 1, 2]]
    solution = solve_source(
        receivers, np.array((-236.6e-6, -266.2e-6)), np.array(((8.2, 6.8), (6.8, 6.7))) * 1e-12, 1500.0
    )
    assert solution.position_m is None
    assert solution.reason == IN_PLANE


def test_what_does_not_belong_together_is_our_mistake() -> None:
    with pytest.raises(ValueError, match="do not match"):
        solve_source(CROSS.positions_m, (0.0, 0.0), COVARIANCE, SOUND)
    with pytest.raises(ValueError, match="sound speed"):
        solve_source(CROSS.positions_m, (0.0, 0.0, 0.0), COVARIANCE, 0.0)


def test_batch_turns_every_fix_by_its_own_attitude() -> None:
    rng = np.random.default_rng(4)
    count = 40
    turns = np.array([rotation_from_euler(*rng.uniform(-0.3, 0.3, 2), rng.uniform(-3, 3)) for _ in range(count)])
    # In front of each array, below it.
    sources = np.array([turn @ (10.0, y, 6.0) for turn, y in zip(turns, rng.uniform(-3, 3, count), strict=True)])
    delays = np.empty((count, 3))
    for index in range(count):
        ways = np.linalg.norm(sources[index] - CROSS.positions_m @ turns[index].T, axis=1)
        delays[index] = (ways[0] - ways[1:]) / SOUND
    found = solve_batch(CROSS.positions_m, delays, SOUND, sources[:, 2], rotations=turns)
    assert found == pytest.approx(sources, abs=1e-6)


def test_batch_leaves_out_what_has_no_solution() -> None:
    source = np.array((3.0, 0.2, 1.0))
    delays = np.vstack((CROSS.delays_s(source, SOUND), np.full(3, np.nan), CROSS.delays_s(source, SOUND)))
    found = solve_batch(CROSS.positions_m, delays, SOUND, np.array((1.0, 1.0, -1.0)))
    assert found[0] == pytest.approx(source, abs=1e-6)
    assert np.isnan(found[1:]).any(axis=1).all()
