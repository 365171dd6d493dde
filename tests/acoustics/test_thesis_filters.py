"""The thesis's filters against the same equations with full matrices, and against what its receiver printed."""

import numpy as np
import pytest

import real_data
from bluerov_slam.acoustics import thesis_filters as filters
from bluerov_slam.acoustics.thesis_log import ThesisLog, ThesisRows
from bluerov_slam.acoustics.thesis_replay import TIMER_WRAPS_S, find_period_s, replay
from bluerov_slam.sources.isbl_thesis_log import read_thesis_logs

PERIOD_S = 1.0151


def six_state_filter(fixes_m, displacements_m, intervals_s, fused):
    """Chapter 5 of the thesis, equation by equation."""
    x, p = np.zeros(6), 10.0 * np.eye(6)
    q = np.diag([0.1] * 3 + [10.0] * 3)
    out = []
    for fix, moved, dt in zip(fixes_m, displacements_m, intervals_s, strict=True):
        f = np.eye(6) + dt * np.eye(6, k=3)
        x, p = f @ x, f @ p @ f.T + q
        h = np.diag([1.0] * 3 + [dt] * 3)[: 6 if fused else 3]
        r = np.diag([1000.0] * 3 + [10000.0] * 3)[: len(h), : len(h)]
        z = np.concatenate([fix, moved])[: len(h)]
        k = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
        x, p = x + k @ (z - h @ x), p - k @ h @ p
        out.append(x[:3])
    return np.array(out)


@pytest.fixture
def drive():
    """A platform that jumps to and fro: fixes, displacements (m) and intervals (s)."""
    rng = np.random.default_rng(3)
    fixes = np.cumsum(rng.normal(0.0, 0.02, (300, 3)), axis=0) + np.array([0.11, 0.0, -0.65])
    displacements = np.where(rng.random((300, 1)) < 0.5, rng.normal(0.0, 0.01, (300, 3)), 0.0)
    intervals = PERIOD_S * rng.choice([5, 5, 5, 5, 6, 7, 12], 300)
    return fixes, displacements, intervals


@pytest.mark.parametrize("fused", [False, True])
def test_steps_as_the_full_matrices_do(drive, fused):
    state, positions = filters.ThesisState(), []
    for fix, moved, dt_s in zip(*drive, strict=True):
        state = filters.step_fused(state, fix, moved, dt_s) if fused else filters.step(state, fix, dt_s)
        positions.append(state.position_m)
    np.testing.assert_allclose(positions, six_state_filter(*drive, fused), atol=1e-12)


@pytest.mark.parametrize(
    ("dt_s", "fused", "gain"), [(3.04, False, 0.546), (3.04, True, 0.534), (5.07, False, 0.642), (5.07, True, 0.619)]
)
def test_the_steady_gain_is_what_the_reference_says(dt_s, fused, gain):
    covariance = filters.steady_covariance(dt_s, fused=fused)
    prior = covariance.predicted(dt_s)
    found = filters.gain_of_fix_and_displacement(prior, dt_s) if fused else filters.gain_of_fix(prior)
    assert found.p_fix == pytest.approx(gain, abs=5e-4)


def printed(positions_m):
    return np.round(1e3 * np.asarray(positions_m), 2)


def as_log(fixes_m, displacements_m, intervals_s):
    """What the receiver would have printed of a drive."""
    raw_mm = printed(fixes_m)
    count = len(raw_mm)
    rows = ThesisRows(
        line=np.arange(count),
        whole=np.ones(count, dtype=bool),
        after_discard=np.zeros(count, dtype=bool),
        segment=np.ones(count, dtype=int),
        axis=np.full(count, "A"),
        setpoint=np.zeros(count),
        acoustic_mm=printed(six_state_filter(fixes_m, displacements_m, intervals_s, fused=False)),
        fused_mm=printed(six_state_filter(fixes_m, displacements_m, intervals_s, fused=True)),
        raw_mm=raw_mm,
        true_mm=np.zeros((count, 3)),
        attitude_deg=np.zeros((count, 3)),
    )
    return ThesisLog("test_x2645_y0_z-682_d_r", 2, "rapid", (2645.0, 0.0, -682.0), rows)


def test_finds_period_intervals_and_displacements_of_a_known_drive(drive):
    _, displacements, intervals = drive
    found = replay(as_log(*drive))
    assert found.period_s == pytest.approx(PERIOD_S, abs=2e-5)
    assert found.replayed.mean() > 0.94
    wrong = found.replayed & (found.periods != np.round(intervals / PERIOD_S))
    assert not wrong[30:].any()
    known = np.isfinite(found.displacement_mm[:, 0]) & (np.arange(300) > 30)
    assert known.mean() > 0.8
    miss_mm = found.displacement_mm[known] - 1e3 * displacements[known]
    assert np.sqrt(np.mean(miss_mm**2)) < 0.4


def test_is_taken_up_again_behind_a_lost_line_and_across_a_wrapped_timer(drive):
    fixes, displacements, intervals = drive
    intervals = intervals.copy()
    intervals[100] = 21 * PERIOD_S - TIMER_WRAPS_S
    log = as_log(fixes, displacements, intervals)
    kept = np.arange(300) != 200
    log = ThesisLog(log.name, log.test, log.motion, log.transmitter_mm, log.rows.where(kept))
    found = replay(log)
    assert not found.replayed[100]
    assert found.interval_s[100] == pytest.approx(intervals[100], abs=0.01)
    assert found.replayed[101:199].all()
    assert not found.replayed[200]
    assert found.replayed[215:].all()


def test_a_log_that_the_filters_did_not_make_is_not_replayed(drive):
    log = as_log(*drive)
    noise = np.random.default_rng(1).normal(0.0, 1.0, log.rows.acoustic_mm.shape)
    rows = ThesisRows(
        **{name: getattr(log.rows, name) for name in ThesisRows.__slots__}
        | {"acoustic_mm": log.rows.acoustic_mm + noise}
    )
    found = replay(ThesisLog(log.name, log.test, log.motion, log.transmitter_mm, rows), PERIOD_S)
    assert found.replayed.mean() < 0.02


@pytest.fixture(scope="module")
def real_logs():
    return {log.name: log for log in read_thesis_logs(real_data.recording("isbl_thesis", "raw_logs.tar.gz")).logs}


def test_a_real_stationary_log_replays_to_its_print_and_tells_the_labels_apart(real_logs):
    log = real_logs["test_x2051_y610_z-702_s"]
    found = replay(log)
    assert found.replayed.mean() > 0.98
    assert np.sqrt(np.nanmean(found.acoustic_miss_mm**2)) <= 0.005
    assert np.sqrt(np.nanmean(found.still_miss_mm**2)) <= 0.005
    exchanged = {"acoustic_mm": log.rows.fused_mm, "fused_mm": log.rows.acoustic_mm}
    rows = ThesisRows(**{name: getattr(log.rows, name) for name in ThesisRows.__slots__} | exchanged)
    other = replay(ThesisLog(log.name, log.test, log.motion, log.transmitter_mm, rows), found.period_s)
    assert other.replayed.mean() < 0.1


def test_the_periods_of_a_day_agree(real_logs):
    periods = [find_period_s(real_logs[f"test_x2645_y457_z-708_{motion}"]) for motion in ("s", "d_r", "d_g")]
    assert max(periods) - min(periods) < 0.0015


@pytest.mark.long
def test_the_real_logs_replay_as_far_as_the_issue_asks(real_logs):
    found = [replay(log) for log in real_logs.values()]
    misses = np.concatenate([each.acoustic_miss_mm[each.replayed] for each in found])
    assert len(misses) / sum(len(each.periods) for each in found) >= 0.925
    assert np.sqrt(np.mean(misses**2)) <= 0.005
