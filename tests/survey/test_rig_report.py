"""The report of a collection: groups of tests and motions, the thesis's table, and how good the truth is."""

from __future__ import annotations

import re

import pytest

from bluerov_slam.evaluation import rig_table
from bluerov_slam.evaluation.rig_experiment import SessionJob, run_session
from bluerov_slam.rig.collection import PUBLISHED_TESTS, Motion, published_session
from bluerov_slam.survey.rig_report import report_html

SEED = 4


@pytest.fixture(scope="module")
def third():
    """Test 3, which did C twice and no B, still and rapid, and one still session of test 1."""
    tests = [(PUBLISHED_TESTS[2], Motion.STATIONARY), (PUBLISHED_TESTS[2], Motion.RAPID)]
    tests.append((PUBLISHED_TESTS[0], Motion.STATIONARY))
    outcomes = []
    for number, (test, motion) in enumerate(tests):
        session = published_session(test, motion, fixes=6)
        outcomes.append((test.number, run_session(SessionJob(session, 100 * SEED + number, SEED))))
    return outcomes


@pytest.fixture(scope="module")
def scored(third):
    return [
        rig_table.collected(outcome.session, place, outcome.points, outcome.ours_mm, outcome.true_mm)
        for place, outcome in third
    ]


def rows_of(report: str, heading: str) -> dict[str, list[str]]:
    """Cells of the first table after a heading, by the group in the first one."""
    part = report[report.index(f"<h2>{heading}") :]
    part = part[part.index("<table>") : part.index("</table>")]
    rows = [re.findall(r"<td[^>]*>([^<]*)", row) for row in part.split("<tr>")]
    return {row[0]: row[1:] for row in rows if row}


def test_the_third_test_does_c_twice_and_no_b(third, scored):
    rapid = scored[1]
    axes = [point.axis for point in third[1][1].points]
    assert [axis for k, axis in enumerate(axes) if k == 0 or axis != axes[k - 1]] == list("ACXYZ")
    once = [point for point in third[1][1].points if point.axis == "C"]
    assert len(once) % 2 == 0
    assert [point.label for point in once[: len(once) // 2]] == [point.label for point in once[len(once) // 2 :]]
    # Each of its six axes begins anew with a point that is not scored.
    assert rapid.discarded == 6
    assert len(rapid.rows) == len(axes) - 6


def test_every_table_has_each_test_each_motion_and_all(scored):
    report = report_html(scored, "simulated", SEED)
    counts = {"test 1": 6, "test 3": 6 + len(scored[1].rows), "stationary": 12, "rapid": len(scored[1].rows)}
    counts["all"] = 12 + len(scored[1].rows)
    for heading in ("Errors, nothing left out", "How good the truth is"):
        rows = rows_of(report, heading)
        assert {group: int(cells[0]) for group, cells in rows.items()} == counts
    # The thesis's recipe drops rows; it never adds any.
    metric = rows_of(
        report, "The thesis&#x27;s metric" if "The thesis&#x27;s metric" in report else "The thesis's metric"
    )
    assert set(metric) == set(counts)
    assert all(0 < int(cells[0]) <= counts[group] for group, cells in metric.items())
    assert all(len(cells) == 9 for cells in metric.values())
    assert all(re.fullmatch(r"-?\d+\.\d ± \d+\.\d", cell) for cells in metric.values() for cell in cells[1:])


def test_the_truth_stands_with_what_it_states_of_itself(scored):
    rows = rows_of(report_html(scored, "simulated", SEED), "How good the truth is")
    quality = rig_table.truth_quality(scored, "rig")
    assert float(rows["all"][5]) == pytest.approx(quality.rms_mm, abs=0.05)
    assert float(rows["all"][6]) == pytest.approx(quality.stated_mm, abs=0.05)
    assert float(rows["all"][7]) == pytest.approx(quality.nees, abs=0.005)
    assert 0.2 < quality.nees / 3.0 < 3.5


def test_a_real_rigs_report_knows_no_real_place(scored):
    report = report_html(scored, "/dev/ttyUSB0")
    assert "Measured with the rig at /dev/ttyUSB0" in report
    assert "Simulated" not in report
    rows = rows_of(report, "How good the truth is")
    assert float(rows["test 3"][1]) == pytest.approx(rig_table.stated_truth_mm(scored[:2]), abs=0.05)
