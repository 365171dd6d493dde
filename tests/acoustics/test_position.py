import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.position import solve_source
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
