from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.errors import BugError
from bluerov_slam.simulation import flight as columns
from bluerov_slam.simulation.conditions import conditions_of
from bluerov_slam.simulation.dive import DiveTruth
from bluerov_slam.simulation.dive_plan import DIVE_PLANS
from bluerov_slam.simulation.flight import STEP_S, Flight
from bluerov_slam.simulation.survey_route import SurveyRoute
from bluerov_slam.simulation.truth import TruthRows, _exp
from bluerov_slam.simulation.tumble import tumble_rows

SHORT = replace(DIVE_PLANS["n2"], legs=1, leg_m=55.0, afloat_first_s=60.0)


def strapdown(truth: DiveTruth, start_s: float, duration_s: float, step_s: float) -> tuple[float, float, float]:
    """Integrate perfect gyro and accelerometer by trapezoids: the errors of attitude (deg), velocity and position."""
    times = start_s + step_s * np.arange(int(duration_s / step_s) + 1)
    track = truth.track(times)
    gravity = np.array((0.0, 0.0, truth.gravity_mps2))
    force = np.einsum("nji,nj->ni", track.rotation_ned_frd, track.acceleration_ned_mps2 - gravity)
    rotation = track.rotation_ned_frd[0]
    velocity, position = track.velocity_ned_mps[0].copy(), track.position_ned_m[0].copy()
    for number in range(len(times) - 1):
        rate = 0.5 * (track.angular_rate_frd_radps[number] + track.angular_rate_frd_radps[number + 1])
        turned = rotation @ _exp(rate[None] * step_s)[0]
        before, after = rotation @ force[number] + gravity, turned @ force[number + 1] + gravity
        position += velocity * step_s + step_s**2 * (before / 3.0 + after / 6.0)
        velocity += 0.5 * step_s * (before + after)
        rotation = turned
    wrong = rotation.T @ track.rotation_ned_frd[-1]
    angle = np.degrees(np.arccos(np.clip(0.5 * (np.trace(wrong) - 1.0), -1.0, 1.0)))
    off = np.linalg.norm(velocity - track.velocity_ned_mps[-1]), np.linalg.norm(position - track.position_ned_m[-1])
    return float(angle), float(off[0]), float(off[1])


@pytest.mark.parametrize("family", ["nominal", "mismatched"])
def test_perfect_inertial_sensors_lead_back_to_the_truth(family: str) -> None:
    truth = DiveTruth(replace(SHORT, noise_family=family), 3)
    angle_deg, velocity_mps, position_m = strapdown(truth, 50.0137, 60.0, STEP_S / 4.0)
    assert angle_deg < 0.002
    assert velocity_mps < 0.02
    assert position_m < 0.3
    # At the link's 20 Hz the trapezoidal rule itself costs this much in a minute.
    angle_deg, velocity_mps, position_m = strapdown(truth, 50.0137, 60.0, 0.05)
    assert angle_deg < 0.04
    assert velocity_mps < 0.2
    assert position_m < 6.0


def test_velocity_is_the_motion_through_the_water_and_the_waters_own() -> None:
    truth = DiveTruth(SHORT, 5)
    times = np.arange(30.0, 130.0, 0.5)
    track = truth.track(times)
    through = np.einsum("nij,nj->ni", track.rotation_ned_frd, track.water_velocity_frd_mps)
    water = track.velocity_ned_mps - through
    assert (water - track.current_ned_mps).std() < 0.03  # what is left are the eddies
    moved = np.diff(track.position_ned_m, axis=0)
    fine = truth.track(np.arange(30.0, 129.5, 0.01)).velocity_ned_mps
    assert moved[:198].sum(axis=0) == pytest.approx(fine[:9900].sum(axis=0) * 0.01, abs=0.02)


def test_rows_between_and_at_grid_points_agree_with_single_questions() -> None:
    truth = DiveTruth(SHORT, 6)
    times = np.array((0.0, 0.05, 33.333, 77.7))
    track = truth.track(times)
    for index, at_s in enumerate(times.tolist()):
        state = truth.at(at_s)
        assert state.position_ned_m == pytest.approx(track.position_ned_m[index])
        assert state.compass_deviation_rad == pytest.approx(track.compass_deviation_rad[index])
        assert state.rotation_ned_frd.T @ state.rotation_ned_frd == pytest.approx(np.eye(3), abs=1e-9)
    rows = truth.rows.rows_at(np.array((33.35,)))[0]
    assert truth.at(33.35).position_ned_m == pytest.approx(rows[0, columns.POSITION], abs=1e-9)


def test_what_is_long_past_is_forgotten_and_the_end_is_an_end() -> None:
    flight = Flight(SurveyRoute(5.0), conditions_of("still"), 1)
    truth = TruthRows(flight.fly(2), 0.0, STEP_S, flight.fly, keep_s=10.0)
    early = truth.motion(np.array((1.0,))).position_ned_m
    assert truth.motion(np.array((60.0,))).times_s[0] == 60.0
    with pytest.raises(BugError, match="forgotten"):
        truth.place(1.0)
    assert early.shape == (1, 3)
    finished = TruthRows(flight.fly(10), 0.0, STEP_S)
    with pytest.raises(BugError, match="ends at"):
        finished.place(2.0)


def test_a_tumble_shows_every_face_and_turns_as_its_rates_say() -> None:
    rows = tumble_rows(3_000, 1, STEP_S)
    truth = TruthRows(rows, 0.0, STEP_S)
    motion = truth.motion(np.arange(0.0, 149.0, 0.05))
    down = motion.rotation_ned_frd[:, 2, :]
    for axis in range(3):
        assert down[:, axis].max() > 0.95
        assert down[:, axis].min() < -0.95
    rotation = motion.rotation_ned_frd[0]
    for rate in motion.angular_rate_frd_radps[:-1] * 0.5 + motion.angular_rate_frd_radps[1:] * 0.5:
        rotation = rotation @ _exp(rate[None] * 0.05)[0]
    assert rotation == pytest.approx(motion.rotation_ned_frd[-1], abs=0.01)
