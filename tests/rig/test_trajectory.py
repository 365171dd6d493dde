"""Set points in time: the published profiles to the step, and smooth ways within the servos' speed."""

from __future__ import annotations

import numpy as np
import pytest

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.rig.demo import axis_limits, circle
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.trajectory import SERVO_SPEED_RADPS, published_steps, smooth_path

PUBLISHED = [("gradual", False, 16), ("gradual", True, 24), ("rapid", False, 6), ("rapid", True, 20)]


@pytest.mark.parametrize(("kind", "change", "steps"), PUBLISHED)
def test_published_moves_take_the_published_steps(kind: str, change: bool, steps: int) -> None:
    start, end = np.zeros(6), np.array([4.0, 0.0, -8.0, 0.0, 0.1, 0.0])
    times, points = published_steps(kind, start, end, change)  # type: ignore[arg-type]
    assert len(times) == len(points) == steps + 1
    assert np.allclose(np.diff(times), 0.05)
    # moveSlowly: start + step / num_steps (end - start) for each step from zero, then the end itself
    assert np.array_equal(points, np.array([start + k / steps * (end - start) for k in range(steps)] + [end]))


@pytest.mark.parametrize("waypoints", [axis_limits(), circle()], ids=["axes", "circle"])
def test_smooth_ways_keep_speed_and_are_continuous_in_acceleration(waypoints: np.ndarray) -> None:
    coarse = smooth_path(waypoints, FO_SHIP, step_s=0.02)
    fine = smooth_path(waypoints, FO_SHIP, step_s=0.005)
    for path in (coarse, fine):
        speed = np.diff(path.servo_angles_rad, axis=0) / np.diff(path.times_s)[0]
        assert np.abs(speed).max() <= SERVO_SPEED_RADPS * (1.0 + 1e-6)
    assert np.array_equal(fine.set_points[0], waypoints[0])
    assert np.allclose(fine.set_points[-1], waypoints[-1], atol=1e-9)
    jumps = [_acceleration_step(path.servo_angles_rad, 0.02 if path is coarse else 0.005) for path in (coarse, fine)]
    assert jumps[1] < 0.45 * jumps[0]  # a jump of the acceleration would not shrink with the step
    assert coarse.bound_s < coarse.duration_s < 1.5 * coarse.bound_s


def test_smooth_ways_pass_every_waypoint() -> None:
    waypoints = circle(points=12)
    path = smooth_path(waypoints, FO_SHIP, step_s=0.002)
    for point in waypoints:
        assert np.abs(path.set_points - point).max(axis=(1, 2)).min() < 0.003


def test_a_way_through_a_limit_is_refused_by_name() -> None:
    waypoints = np.zeros((2, 4, 6))
    waypoints[1, 2, 0] = 9.0
    with pytest.raises(OutOfValidityError, match=r"platform 3 .* axis"):
        smooth_path(waypoints, FO_SHIP)


def test_degrees_are_recognised() -> None:
    with pytest.raises(OutOfValidityError, match="degrees"):
        published_steps("rapid", np.zeros(6), np.array([0.0, 0.0, 0.0, 15.0, 0.0, 0.0]))


def _acceleration_step(angles: np.ndarray, step_s: float) -> float:
    return float(np.abs(np.diff(angles, n=3, axis=0)).max() / step_s**2)
