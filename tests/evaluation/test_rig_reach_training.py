"""The fit of the guess of reach: solved poses are solved, a fit learns from them, what is written is read."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from bluerov_slam.evaluation.rig_reach_training import MIRROR, fit, solved_poses, write
from bluerov_slam.rig.agreement import on_rays
from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.limits import FO_SHIP_LIMITS
from bluerov_slam.rig.reach import ReachModel
from bluerov_slam.rig.reach_guess import MARGIN_SCALE, SPREAD, read, signature

MODEL = ReachModel(FO_SHIP, FO_SHIP_LIMITS)
SOLVED = solved_poses(MODEL, 1, 13, None, size=700)


def test_good_solutions_make_their_poses_with_no_more_than_the_margin() -> None:
    assert SOLVED.good.mean() > 0.5
    reach = MODEL.evaluate(SOLVED.scaled[SOLVED.good] * MODEL.scale)
    wanted = on_rays(MODEL, SOLVED.way[SOLVED.good] * SPREAD, np.ones(int(SOLVED.good.sum())))
    assert np.abs(MODEL.lacking(reach, wanted)[:, :3]).max() < 0.05
    inside = SOLVED.margin[SOLVED.good] >= 0.04
    assert (MODEL.margin(reach)[inside] > -0.05).all()
    assert (MODEL.margin(reach) < SOLVED.margin[SOLVED.good] + 0.01)[~inside].mean() > 0.95


def test_the_stack_is_its_own_mirror_image() -> None:
    points = SOLVED.scaled[:50] * MODEL.scale
    one, other = MODEL.evaluate(points), MODEL.evaluate(points * MIRROR)
    assert np.allclose(np.sort(one.legs, axis=-1), np.sort(other.legs, axis=-1))
    assert np.allclose(one.position_mm * MIRROR[:3], other.position_mm)


def test_a_fit_knows_more_than_the_mean_and_is_the_same_for_the_same_seed() -> None:
    network = fit(SOLVED, 30, MODEL, 13)
    told = network.output(SOLVED.way)[:, -1] / MARGIN_SCALE
    known = np.clip(SOLVED.margin, -0.25, 0.04)
    assert np.abs(told - known)[SOLVED.good].mean() < 0.5 * np.abs(known - known.mean())[SOLVED.good].mean()
    file = BytesIO()
    write(network, file)
    file.seek(0)
    again = read(file)
    assert np.array_equal(again.output(SOLVED.way), network.output(SOLVED.way))
    assert np.array_equal(again.stack, signature(MODEL))
    twice = fit(SOLVED, 1, MODEL, 13), fit(SOLVED, 1, MODEL, 13)
    assert np.array_equal(twice[0].output(SOLVED.way), twice[1].output(SOLVED.way))
