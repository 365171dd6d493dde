"""The data-collection sequence: the published order of points, and what happens when something goes wrong."""

import numpy as np
import pytest

import real_data
from bluerov_slam.geometry.platform_stack import stack_tip_mm
from bluerov_slam.rig.collection import (
    PUBLISHED_TESTS,
    AwaitResult,
    Button,
    Close,
    Collection,
    CollectionPlan,
    Damaged,
    Discard,
    Finished,
    Hold,
    Keep,
    Motion,
    Move,
    Moved,
    Open,
    Pressed,
    Refused,
    Replied,
    Result,
    SendDepth,
    Session,
    Silent,
    Start,
    published_session,
    session_name,
)

RANGES = {"A": (2.0, 0.0), "X": (4.0, 0.0)}


def session(motion=Motion.GRADUAL, **changes):
    fields = {"name": "s", "transmitter_mm": (1426.0, 0.0, -694.0), "motion": motion, "ranges": RANGES, "order": "AX"}
    return Session(**(fields | changes))


class Rig:
    """Does what it is told: every platform turns as set, with a tilt of its own."""

    def __init__(self, plan, tilt_deg=(0.0, 0.0, 0.0), **collection):
        self.collection = Collection(plan, **collection)
        self.tilt = np.radians(tilt_deg)
        self.at = np.zeros(6)
        self.actions = []
        self.replies = {}  # number of the action that asks -> event instead of the good one

    def run(self, event=None):
        pending = self.collection.next(event or Start())
        while pending:
            answer = None
            for action in pending:
                self.actions.append(action)
                answer = self.do(action) or answer
            pending = self.collection.next(answer) if answer else []
        return self.actions

    def do(self, action):
        odd = self.replies.get(len(self.actions) - 1)
        match action:
            case SendDepth():
                return odd or Replied(1)
            case Move():
                if odd is None:
                    np.testing.assert_array_equal(action.start, self.at)
                    self.at = action.end
                return odd or Moved()
            case AwaitResult():
                return odd or self.result()

    def result(self):
        place = np.array((110.0, 0.0, -648.0))
        return Result(place, place, place, 4.0 * self.at[3:] + self.tilt)

    def of(self, kind):
        return [action for action in self.actions if isinstance(action, kind)]

    @property
    def points(self):
        return [action.point for action in self.of(Keep)]

    def place_of(self, kind, number):
        return [n for n, action in enumerate(self.actions) if isinstance(action, kind)][number]


def test_an_axis_goes_from_first_to_last_with_its_first_point_twice():
    rig = Rig(CollectionPlan([session()]))
    rig.run()
    labels = [(point.axis, point.label) for point in rig.points]
    assert labels == [("A", 3.0), ("A", 2.0), ("A", 1.0), ("A", 0.0), ("X", 6.0), ("X", 4.0), ("X", 2.0), ("X", 0.0)]
    np.testing.assert_allclose(np.degrees(rig.points[0].set_point), (0, 0, 0, 0.5, 0, 0))
    np.testing.assert_allclose(rig.points[0].set_point, rig.points[1].set_point)
    np.testing.assert_allclose(rig.points[4].set_point, (1.0, 0, 0, 0, 0, 0))
    assert [point.after_discard for point in rig.points] == [True, False, False, False] * 2
    assert [type(action) for action in rig.actions[:6]] == [Open, Discard, SendDepth, Move, AwaitResult, Keep]
    assert [action.reason for action in rig.of(Close) + rig.of(Finished)] == ["", ""]


def test_moves_take_the_published_number_of_steps():
    for motion, change, steps in ((Motion.GRADUAL, 24, 16), (Motion.RAPID, 20, 6)):
        rig = Rig(CollectionPlan([session(motion, ranges={"A": (8.0, 0.0)}, order="A")]))
        rig.run()
        assert [move.steps for move in rig.of(Move)][:3] == [change, steps, steps]


def test_a_stationary_session_only_listens():
    rig = Rig(CollectionPlan([session(Motion.STATIONARY, fixes=5)]))
    rig.run()
    assert not rig.of(Move)
    assert not rig.of(Discard)
    assert [point.label for point in rig.points] == [0.0] * 5


def test_the_last_point_is_done_twice_where_the_program_did():
    rig = Rig(CollectionPlan([session(order="A", repeats_last=True)]))
    rig.run()
    assert [point.label for point in rig.points] == [3.0, 2.0, 1.0, 1.0, 0.0]
    np.testing.assert_array_equal(rig.points[3].set_point, rig.points[4].set_point)


def test_the_receiver_is_told_the_x_it_will_have():
    rig = Rig(CollectionPlan([session(order="A")]), tilt_deg=(0.0, -3.0, 0.5))
    rig.run()
    told = [action.x_m for action in rig.of(SendDepth)]
    assert told[0] == pytest.approx(stack_tip_mm(np.zeros((1, 3)), np.radians([[2.0, 0.0, 0.0]]))[0, 0] / 1e3)
    here = stack_tip_mm(np.zeros((1, 3)), np.radians([[1.0, -3.0, 0.5]]))[0]
    assert told[2] == pytest.approx(here[0] / 1e3)
    np.testing.assert_allclose(rig.points[2].published_truth_mm, here)


@pytest.mark.data
def test_truth_as_published_is_that_of_the_real_logs():
    """Every row whose row before is known: its printed truth out of what the row before printed."""
    from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs

    logs = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs
    near, compared = 0, 0
    for log in logs:
        if not log.truth_valid or log.motion == "stationary":
            continue
        rows = log.rows
        for k in range(2, min(len(rows), 400)):
            chain = slice(k - 2, k + 1)
            plain = rows.whole[chain].all() and not rows.after_discard[chain].any()
            if not plain or len(set(rows.axis[chain])) > 1 or rows.line[k] - rows.line[k - 2] != 2:
                continue
            axis, values = str(rows.axis[k]), rows.setpoint[chain]
            if values[0] - values[1] != values[1] - values[2] or values[0] == values[1]:
                continue
            made = session(Motion(log.motion), ranges={axis: (values[0], values[2])}, order=axis)
            rig = Rig(CollectionPlan([made], largest_residual_rad=9.0))
            attitudes = iter(np.radians(rows.attitude_deg[[k - 2, k - 2, k - 1, k]]))
            rig.result = lambda attitudes=attitudes: Result(*[np.zeros(3)] * 3, next(attitudes))
            rig.run()
            miss = np.abs(rig.points[-1].published_truth_mm - rows.true_mm[k]).max()
            compared += 1
            near += miss <= 0.0101
    assert compared > 2500
    assert near / compared > 0.99


def test_a_wrong_checksum_is_sent_again_and_the_fourth_time_never():
    rig = Rig(CollectionPlan([session(order="A")]))
    rig.replies = {2: Replied(0), 3: Replied(0)}
    rig.run()
    assert [action.attempt for action in rig.of(SendDepth)][:3] == [1, 2, 3]
    assert not any(point.missing for point in rig.points)
    rig = Rig(CollectionPlan([session(order="A")]))
    rig.replies = {2: Replied(0), 3: Replied(0), 4: Replied(0)}
    rig.run()
    assert "wrong checksum in 3 tries" in rig.points[0].missing
    assert rig.points[0].result is None
    assert len(rig.points) == 4
    assert rig.points[1].after_discard


def test_a_depth_that_the_receiver_gives_up_costs_its_point_only():
    rig = Rig(CollectionPlan([session(order="A")]))
    rig.replies = {2: Replied(-1)}
    rig.run()
    assert "given up" in rig.points[0].missing
    assert [bool(point.missing) for point in rig.points] == [True, False, False, False]
    # The rig did not move for it, and the next point starts from where it is.
    assert len(rig.of(Move)) == 3


def test_a_silent_link_ends_the_collection_after_three_points():
    rig = Rig(CollectionPlan([session(order="A"), session(name="t", order="A")]))
    quiet = {n: Silent() for n in range(100)}
    rig.replies = quiet
    rig.run()
    assert not rig.of(Move)
    assert len(rig.of(SendDepth)) == 9
    assert [point.missing for point in rig.points] == ["the link to the receiver is silent"] * 3
    assert len(rig.of(Hold)) == 3
    assert "3 points in a row" in rig.of(Finished)[0].reason
    assert rig.collection.finished
    assert rig.collection.next(Moved()) == []


def test_a_result_that_does_not_come_is_missing_and_the_next_may_come():
    rig = Rig(CollectionPlan([session(order="A")]))
    rig.replies = {4: Silent()}
    rig.run()
    assert [bool(point.missing) for point in rig.points] == [True, False, False, False]


def test_a_damaged_line_is_missing_never_a_number():
    for bad in (Damaged("1.0,2.0"), Result(np.array((np.nan, 0.0, 0.0)), *[np.zeros(3)] * 3)):
        rig = Rig(CollectionPlan([session(order="A")]))
        rig.replies = {4: bad}
        rig.run()
        assert rig.points[0].result is None
        assert rig.points[0].missing
        assert rig.points[0].truth_mm is None


def test_an_attitude_far_from_what_was_set_holds_and_ends_the_collection():
    rig = Rig(CollectionPlan([session(order="A")]), tilt_deg=(-12.0, 0.0, 0.0))
    rig.run()
    assert len(rig.points) == 2
    assert "roll is 12.0 degrees" in rig.points[0].missing
    assert "one servo at a time" in rig.of(Finished)[0].reason
    assert isinstance(rig.actions[-1], Finished)
    # Held where it was: no way home for a rig that does not do what it is told.
    assert len(rig.of(Move)) == 2


def test_the_tilt_at_home_is_no_residual():
    rig = Rig(CollectionPlan([session(order="A")], level_rad=(np.radians(-12.0), 0.0)), tilt_deg=(-12.0, 0.0, 30.0))
    rig.run()
    assert not any(point.missing for point in rig.points)


def test_a_place_out_of_reach_is_left_out_without_a_move():
    def reachable(set_point):
        return "servo 3 beyond its range" if set_point[3] > np.radians(0.4) else ""

    rig = Rig(CollectionPlan([session(order="A")]), reachable=reachable)
    rig.run()
    assert [point.missing for point in rig.points[:2]] == ["cannot be reached: servo 3 beyond its range"] * 2
    assert [bool(point.missing) for point in rig.points[2:]] == [False, False]
    assert len(rig.of(Move)) == 2
    assert not rig.of(Hold)


def test_nothing_within_reach_ends_without_a_motion():
    plan = CollectionPlan.published(fixes=3)
    rig = Rig(plan, reachable=lambda set_point: "blocked")
    rig.run()
    assert not rig.of(Move) + rig.of(SendDepth)
    assert len(rig.of(Open)) == len(rig.of(Close)) == 27
    assert all(point.missing for point in rig.points)


def test_a_refused_move_is_a_missing_point():
    rig = Rig(CollectionPlan([session(order="A")]))
    rig.replies = {3: Refused("leg 2 too long")}
    rig.run()
    assert "leg 2 too long" in rig.points[0].missing
    np.testing.assert_array_equal(rig.of(Move)[1].start, np.zeros(6))


def test_the_button_sends_the_rig_home_and_starts_the_axes_anew():
    collection = Collection(CollectionPlan([session(order="A")]))
    assert collection.next(Button()) == []
    collection.next(Start())
    collection.next(Replied(1))
    collection.next(Moved())
    home, pressed = collection.next(Button())
    np.testing.assert_array_equal(home.end, np.zeros(6))
    assert np.degrees(home.start[3]) == pytest.approx(0.5)
    assert pressed == Pressed(3)
    assert collection.next(Moved()) == []
    again = collection.next(Button())
    assert [type(action) for action in again] == [Discard, SendDepth]


def test_the_nine_tests_are_27_sessions_by_their_logs_names():
    plan = CollectionPlan.published()
    assert len(plan.sessions) == 27
    assert plan.sessions[0].name == "test_x1426_y0_z-694_s"
    assert {test.number for test in PUBLISHED_TESTS} == set(range(1, 10))
    assert session_name((2203.0, 762.0, -726.0), Motion.RAPID) == "test_x2203_y762_z-726_d_r"


@pytest.mark.data
def test_the_published_sessions_go_through_the_values_of_the_real_logs():
    """Each axis of each moving log within our range, and reaching both its ends but for a last value lost."""
    from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs

    logs = read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs
    for log in logs:
        if log.motion == "stationary":
            continue
        ours = published_session(PUBLISHED_TESTS[log.test - 1], Motion(log.motion))
        assert ours.name == log.name
        rows = log.rows.where(log.rows.whole & ~log.rows.after_discard)
        assert set(rows.axis) == set(ours.order)
        for axis in set(ours.order):
            begin, end = ours.ranges[axis]
            values = rows.setpoint[rows.axis == axis]
            step = 8.0 if log.motion == "rapid" else 2.0 if axis in "XYZ" else 1.0
            # Test 1 once went one step beyond the last value.
            assert begin - step <= values.max() <= begin, (log.name, axis)
            assert end - step <= values.min() <= end + step, (log.name, axis)


def test_truth_and_its_covariance_are_asked_for_at_the_point_itself():
    seen = []

    def truth(set_point, attitude):
        seen.append((set_point.copy(), attitude.copy()))
        return np.array((1.0, 2.0, 3.0)), 4.0 * np.eye(3)

    rig = Rig(CollectionPlan([session(order="A")]), tilt_deg=(1.0, 0.0, 0.0), truth=truth)
    rig.run()
    np.testing.assert_allclose(np.degrees(seen[2][1]), (2.0, 0.0, 0.0))
    np.testing.assert_allclose(np.degrees(seen[2][0][3]), 0.25)
    np.testing.assert_array_equal(rig.points[0].truth_covariance_mm2, 4.0 * np.eye(3))
