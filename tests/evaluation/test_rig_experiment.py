"""The simulated experiment: what it collects, how it ends when the rig is broken, and the tables made of it."""

import numpy as np
import pytest

from bluerov_slam.evaluation import rig_table
from bluerov_slam.evaluation.rig_experiment import SessionJob, run_session
from bluerov_slam.rig.collection import PUBLISHED_TESTS, Hold, Motion, Session, published_session
from bluerov_slam.simulation.rig import ServoFault


@pytest.fixture(scope="module")
def rapid():
    session = Session("s", (1426.0, 0.0, -694.0), Motion.RAPID, {"A": (16.0, -16.0), "Z": (32.0, -32.0)}, "AZ")
    outcome = run_session(SessionJob(session, 5, 7))
    return outcome, rig_table.collected(session, 1, outcome.points, outcome.ours_mm, outcome.true_mm)


def test_every_point_has_a_result_and_its_truths(rapid):
    outcome, table = rapid
    assert outcome.reason == ""
    assert [point.missing for point in outcome.points] == [""] * 16
    assert len(table.rows) == 14
    assert table.discarded == 2
    assert set(table.rows.axis) == {"A", "Z"}
    assert outcome.true_mm.shape == outcome.ours_mm.shape == (16, 3)
    # The thesis states 21 mm at most for its rig; ours is of that kind.
    for truth in ("published", "rig"):
        assert rig_table.truth_quality([table], truth).most_mm < 30.0


def test_the_rigs_truth_says_how_good_it_is(rapid):
    _, table = rapid
    quality = rig_table.truth_quality([table], "rig")
    assert 1.0 < quality.stated_mm < 25.0
    assert quality.rms_mm < 3.0 * quality.stated_mm
    assert rig_table.stated_truth_mm([table]) == pytest.approx(quality.stated_mm)
    assert np.isnan(rig_table.truth_quality([table], "published").nees)


def test_our_chain_is_nearer_than_the_thesiss_on_the_same_pulses(rapid):
    _, table = rapid
    ours, raw = (rig_table.honest([table], name, "real") for name in ("ours", "raw"))
    assert ours.count + table.withheld == raw.count == 14
    assert ours.median_mm < raw.median_mm


def test_the_metric_of_the_thesis_stands_beside_it(rapid):
    _, table = rapid
    metric = rig_table.published_metric([table])
    assert set(metric) == {"test 1", "rapid", "all"}
    assert metric["all"].count <= 14
    assert "raw" in rig_table.published_metric([table], ours=True)["all"].cells


def test_the_first_stationary_test_is_not_left_out():
    session = published_session(PUBLISHED_TESTS[0], Motion.STATIONARY, fixes=3)
    outcome = run_session(SessionJob(session, 5, 7))
    table = rig_table.collected(session, 1, outcome.points, outcome.ours_mm, outcome.true_mm)
    assert rig_table.published_metric([table])["stationary"].count == 3


def test_a_stuck_servo_ends_the_session_with_its_points_missing():
    session = Session("s", (1426.0, 0.0, -694.0), Motion.RAPID, {"Z": (64.0, -64.0)}, "Z")
    faults = (ServoFault.parse("stuck 0 1"), ServoFault.parse("stuck 1 1"))
    outcome = run_session(SessionJob(session, 5, 7, faults))
    assert "one servo at a time" in outcome.reason
    assert outcome.points[-1].missing
    assert outcome.points[-1].result is None
    assert any(isinstance(action, Hold) for action in outcome.actions)
    table = rig_table.collected(session, 1, outcome.points, outcome.ours_mm, outcome.true_mm)
    assert sum(table.lost.values()) >= 2


def test_a_session_comes_again_from_its_seeds():
    session = Session("s", (1426.0, 0.0, -694.0), Motion.STATIONARY, fixes=2)
    first, again = (run_session(SessionJob(session, 5, 7)) for _ in range(2))
    np.testing.assert_array_equal(first.ours_mm, again.ours_mm)
    np.testing.assert_array_equal(first.points[1].result.raw_mm, again.points[1].result.raw_mm)
