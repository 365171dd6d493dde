"""Layouts and the manifold of the estimate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from bluerov_slam.navigation.rotation import exp_so3, rotation_from_euler
from bluerov_slam.navigation.state import NavEstimate, StateLayout
from navigation.finite_differences import random_estimate, seeds


def test_the_whole_layout_is_that_of_the_contract():
    layout = StateLayout.make()
    assert layout.size == 29
    assert layout["position"] == slice(0, 3)
    assert layout["attitude"] == slice(6, 9)
    assert layout["dvl"] == slice(27, 29)


def test_blocks_left_out_and_added():
    layout = StateLayout.make(without=("current", "dvl", "gyro_bias"), extra=(("isbl_mounting", 3),))
    assert layout.size == 29 - 2 - 2 - 3 + 3
    assert layout["accel_bias"] == slice(9, 12)
    assert layout["isbl_mounting"] == slice(22, 25)
    assert "current" not in layout
    with pytest.raises(KeyError):
        layout["current"]


@pytest.mark.parametrize(
    "arguments",
    [
        {"without": ("attitude",)},
        {"without": ("curent",)},
        {"extra": (("current", 2),)},
        {"extra": (("empty", 0),)},
    ],
)
def test_impossible_layouts_are_refused(arguments):
    with pytest.raises(ValueError):
        StateLayout.make(**arguments)


def test_a_block_is_a_view_and_a_copy_is_none():
    estimate = NavEstimate(StateLayout.make(), 5.0, current=(0.1, 0.2), depth_bias=0.3)
    twin = estimate.copy()
    estimate.block("current")[0] = 9.0
    estimate.position_ned_m[:] = 1.0
    assert estimate.values[estimate.layout["current"]].tolist() == [9.0, 0.2]
    assert estimate.values[:3].tolist() == [1.0] * 3
    assert twin.block("current").tolist() == [0.1, 0.2]
    assert twin.block("depth_bias").tolist() == [0.3]
    assert twin.blocks.size == 20
    with pytest.raises(KeyError):
        estimate.block("attitude")
    with pytest.raises(ValueError, match="rotation_ned_frd"):
        NavEstimate(estimate.layout, 0.0, attitude=(0, 0, 0))


@given(seeds)
def test_difference_undoes_add_error(seed):
    estimate = random_estimate(StateLayout.make(), seed)
    error = np.random.default_rng(seed + 1).uniform(-1.0, 1.0, 29)
    moved = estimate.copy()
    moved.add_error(error)
    np.testing.assert_allclose(moved.difference(estimate), error, atol=1e-12)
    back = moved.copy()
    back.add_error(estimate.difference(moved))
    np.testing.assert_allclose(back.difference(estimate), 0.0, atol=1e-12)


def test_the_attitudes_error_is_a_turn_in_ned():
    """An error about down turns the bow to starboard whatever the roll."""
    estimate = NavEstimate(StateLayout.make(), 0.0, rotation_from_euler(0.8, 0.0, 0.0))
    error = estimate.layout.vector(attitude=(0.0, 0.0, 0.1))
    estimate.add_error(error)
    np.testing.assert_allclose(estimate.rotation_ned_frd, rotation_from_euler(0.8, 0.0, 0.1), atol=1e-15)


def test_is_finite():
    estimate = NavEstimate(StateLayout.make(), 0.0, exp_so3((0.1, 0.2, 0.3)))
    assert estimate.is_finite()
    estimate.velocity_ned_mps[1] = np.nan
    assert not estimate.is_finite()
