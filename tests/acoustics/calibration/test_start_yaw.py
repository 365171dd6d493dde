import math

import numpy as np
import pytest

from bluerov_slam.acoustics.calibration.start_yaw import YawHold, average_yaw, needed_s, share_kept
from bluerov_slam.simulation.yaw_wobble import yaw_session


def test_share_of_a_wobble_that_an_average_keeps() -> None:
    """A minute keeps 74 % of the variance of a wobble of a minute: the formula against drawn processes."""
    assert share_kept(60.0, 60.0) == pytest.approx(2.0 * math.exp(-1.0), rel=1e-12)
    rng = np.random.default_rng(0)
    decay, draws, count = math.exp(-1.0 / 60.0), 3000, 180
    value = rng.standard_normal(draws)
    total = np.zeros(draws)
    for _ in range(count):
        total += value
        value = decay * value + math.sqrt(1.0 - decay**2) * rng.standard_normal(draws)
    assert np.var(total / count) == pytest.approx(share_kept(180.0, 60.0), rel=0.08)


def test_time_needed_is_the_inverse() -> None:
    assert share_kept(needed_s(0.5, 0.3), 60.0) == pytest.approx(0.36, rel=1e-9)
    assert needed_s(0.2, 0.3) == 0.0


def test_start_yaw_is_good_to_three_tenths_of_a_degree_and_says_so_honestly() -> None:
    errors, stated = [], []
    for seed in range(300):
        session = yaw_session(seed, 240, 1.0)
        found = average_yaw(session.times_s, session.compass_rad)
        errors.append(math.remainder(found.yaw_rad - session.true_rad[-1], math.tau))
        stated.append(found.std_rad)
    rms = float(np.sqrt(np.mean(np.square(errors))))
    assert math.degrees(rms) < 0.3
    assert np.mean(np.square(np.array(errors) / np.array(stated))) == pytest.approx(1.0, abs=0.3)


def test_a_short_average_says_that_it_is_short() -> None:
    session = yaw_session(1, 40, 1.0)
    found = average_yaw(session.times_s, session.compass_rad)
    assert "at least 60 s" in found.reason
    minute = yaw_session(1, 61, 1.0)
    assert "averages out" in average_yaw(minute.times_s, minute.compass_rad).reason
    assert "no yaw" in average_yaw([], []).reason


def test_north_is_no_seam_and_a_turn_told_by_the_gyro_is_taken_out() -> None:
    times = np.arange(200.0)
    turned = np.linspace(0.0, 1.0, 200)
    yaw = (math.pi - 0.1 + turned + 0.002 * np.sin(times) + math.pi) % math.tau - math.pi
    yaw[7] = math.nan
    found = average_yaw(times, yaw, turned)
    assert math.remainder(found.yaw_rad - (math.pi - 0.1 + 1.0), math.tau) == pytest.approx(0.0, abs=1e-3)


def test_a_held_yaw_does_not_follow_the_wobble() -> None:
    held, followed = [], []
    for seed in range(60):
        session = yaw_session(seed, 500, 1.0)
        hold = YawHold(float(session.compass_rad[0]))
        for index in range(500):
            turned = float(session.gyro_turn_rad[index])
            (hold.rest if index < 200 else hold.turn)(turned, 1.0)
            hold.compass(float(session.compass_rad[index]))
            if index >= 240:
                held.append(math.remainder(hold.yaw_rad - session.true_rad[index], math.tau))
                followed.append(math.remainder(session.compass_rad[index] - session.true_rad[index], math.tau))
        assert math.degrees(hold.std_rad) < 0.5
    assert math.degrees(np.sqrt(np.mean(np.square(held)))) < 0.3
    assert np.std(held) < 0.7 * np.std(followed)


def test_a_reference_sets_the_yaw() -> None:
    hold = YawHold(1.0)
    hold.compass(1.02)
    hold.reference(0.98, 1e-4)
    assert hold.yaw_rad == pytest.approx(0.98, abs=1e-5)
    assert hold.std_rad < 1.1e-4
