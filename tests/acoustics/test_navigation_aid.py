import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.acoustics.navigation_aid import BEACON, MOUNTING, WANDER, AcousticDelays, AidOptions, Pose, Verdict
from bluerov_slam.navigation.ekf import ErrorStateFilter
from bluerov_slam.navigation.rotation import exp_so3, rotation_from_euler
from bluerov_slam.navigation.state import NavEstimate, StateLayout
from navigation.finite_differences import derivative, random_estimate, seeds

SOUND = 1500.0
ARRAY = ReceiverArray.cross(centre=True)
MOUNTED = ArrayMounting(rotation_from_euler(0.1, -0.3, 2.0), np.array((0.2, -0.1, 0.15)))
LAYOUT = StateLayout.make(extra=((MOUNTING, 3), (WANDER, 3), (BEACON, 3)))
TIMING = (0.3e-6) ** 2 * (np.eye(4) + 1.0)
PERIOD = 1.0 / 40e3


def pulse(beacon: tuple[float, float, float] = (30.0, -20.0, 12.0), **changes: object) -> AcousticDelays:
    made = AcousticDelays(
        100.0,
        ARRAY.positions_m,
        np.zeros(4),
        TIMING,
        SOUND,
        np.array(beacon),
        MOUNTED,
    )
    return replace(made, verdict=Verdict(), **changes)  # type: ignore[arg-type]


def exact_delays(estimate: NavEstimate, beacon: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """The contract's words in another way: receivers carried into NED, distances there."""
    lasting = [estimate.block(name) for name in (MOUNTING, WANDER) if name in estimate.layout]
    turn = exp_so3(np.sum(lasting, axis=0)) if lasting else np.eye(3)
    frd = MOUNTED.lever_arm_frd_m + ARRAY.positions_m @ (turn @ MOUNTED.rotation_frd_array).T
    # The mounting's error turns the array about its own centre.
    ned = estimate.position_ned_m + frd @ estimate.rotation_ned_frd.T
    ways = np.linalg.norm(beacon - ned, axis=1)
    return (ways[0] - ways[1:]) / (SOUND * scale)


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_jacobian_is_the_derivative_of_the_prediction(seed: int) -> None:
    """Straight and bent rays alike."""
    estimate = random_estimate(LAYOUT, seed)
    beacon = tuple(np.random.default_rng(seed).uniform(-60.0, 60.0, 3))
    bend = 0.03 * (seed % 2)
    innovation = pulse(beacon, bend_rad=bend).evaluate(estimate, LAYOUT)
    if innovation is None:
        return

    def predicted(at: NavEstimate) -> np.ndarray:
        found = pulse(beacon, bend_rad=bend).evaluate(at, LAYOUT)
        assert found is not None
        return -found.residual

    assert innovation.jacobian == pytest.approx(derivative(predicted, estimate, 1e-5), rel=1e-5, abs=1e-11)


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_prediction_is_that_of_receivers_carried_into_the_world(seed: int) -> None:
    estimate = random_estimate(LAYOUT, seed)
    beacon = np.array((25.0, 60.0, 10.0))
    innovation = pulse(tuple(beacon), options=AidOptions(direction_std_rad=0.0)).evaluate(estimate, LAYOUT)
    assert innovation is not None
    scale = 1.0 + float(estimate.block("sound_speed_scale")[0])
    expected = exact_delays(estimate, beacon + estimate.block(BEACON), scale)
    assert -innovation.residual == pytest.approx(expected, abs=1e-12)


def test_noise_has_timing_and_a_direction_of_its_own() -> None:
    estimate = random_estimate(LAYOUT, 4)
    bare = pulse(options=AidOptions(direction_std_rad=0.0)).evaluate(estimate, LAYOUT)
    with_floor = pulse(options=AidOptions(direction_std_rad=0.05)).evaluate(estimate, LAYOUT)
    assert bare is not None
    assert with_floor is not None
    assert bare.noise == pytest.approx(TIMING)
    added = with_floor.noise - TIMING
    # Two directions of error, not four, but for the square of the angle; as large as the array is wide times it.
    assert np.linalg.matrix_rank(added, tol=1e-2 * float(added.max())) == 2
    assert math.sqrt(added.max()) == pytest.approx(0.05 * 0.4 / SOUND, rel=0.5)


def test_an_uncertain_transmitter_counts_as_noise_where_it_is_no_state() -> None:
    layout = StateLayout.make(extra=((MOUNTING, 3),))
    estimate = random_estimate(layout, 5)
    sure = pulse().evaluate(estimate, layout)
    unsure = pulse(beacon_covariance_m2=4.0 * np.eye(3)).evaluate(estimate, layout)
    assert sure is not None
    assert unsure is not None
    by_beacon = sure.jacobian[:, :3]
    assert unsure.noise - sure.noise == pytest.approx(4.0 * by_beacon @ by_beacon.T)


def known(position_std_m: float = 1.0, attitude_std_rad: float = 0.01) -> ErrorStateFilter:
    layout = StateLayout.make(extra=((MOUNTING, 3),))
    std = layout.vector(
        position=position_std_m,
        velocity=0.1,
        attitude=attitude_std_rad,
        gyro_bias=1e-3,
        accel_bias=1e-2,
        current=0.1,
        thrust_scale=0.1,
        compass=0.01,
        compass_wander=0.01,
        gps_wander=1.0,
        depth_bias=0.01,
        sound_speed_scale=0.002,
        dvl=0.01,
        isbl_mounting=0.01,
    )
    return ErrorStateFilter(NavEstimate(layout, 100.0, rotation_from_euler(0.05, 0.1, 0.7)), std)


BEACON_NED = np.array((30.0, -20.0, 12.0))


def exact(filter_: ErrorStateFilter, **changes: object) -> AcousticDelays:
    delays = exact_delays(filter_.estimate, BEACON_NED)
    made = pulse(delays_s=delays, covariance_of=lambda: filter_.covariance, **changes)
    return made


def test_the_prediction_picks_the_right_carrier_cell() -> None:
    filter_ = known(0.3, 0.003)
    precise = AidOptions(direction_std_rad=math.radians(0.3))
    right = exact(filter_, options=precise).delays_s
    slipped = right.copy()
    slipped[1] += PERIOD
    chosen = exact(filter_, options=precise)
    chosen = replace(chosen, delays_s=slipped, alternatives=((right, 0.3),))
    innovation = chosen.evaluate(filter_.estimate, filter_.layout)
    assert innovation is not None
    assert chosen.verdict.hypothesis == 1
    assert innovation.residual == pytest.approx(np.zeros(4), abs=1e-8)


def test_an_ambiguous_pulse_is_left_out() -> None:
    filter_ = known(position_std_m=8.0, attitude_std_rad=0.1)
    measured = exact(filter_)
    far = measured.delays_s + PERIOD * np.array((1.0, 0.0, 0.0, 0.0))
    doubtful = replace(measured, alternatives=((measured.delays_s + 1e-7, 0.4), (far, 0.05)))
    assert doubtful.evaluate(filter_.estimate, filter_.layout) is None
    assert doubtful.verdict.hypothesis == -1


def test_an_echo_is_refused_by_the_gate() -> None:
    filter_ = known()
    measured = exact(filter_)
    mirrored = exact_delays(filter_.estimate, BEACON_NED * (1.0, 1.0, -1.5))
    before = filter_.estimate.position_ned_m.copy()
    result = filter_.update(replace(measured, delays_s=mirrored))
    assert result is not None
    assert not result.accepted
    assert measured.verdict.direct_probability < 0.1
    assert filter_.estimate.position_ned_m == pytest.approx(before)


def test_a_doubtful_pulse_weighs_less() -> None:
    filter_ = known(position_std_m=1.0)
    odd = AidOptions(direction_std_rad=math.radians(3.0), outlier_share=0.3)
    measured = exact(filter_, options=odd)
    turned = exact_delays(filter_.estimate, BEACON_NED + np.array((4.0, 6.0, -2.5)))
    doubtful = replace(measured, delays_s=turned)
    sure = doubtful.evaluate(filter_.estimate, filter_.layout)
    plain = replace(doubtful, covariance_of=None).evaluate(filter_.estimate, filter_.layout)
    assert sure is not None
    assert plain is not None
    assert 0.5 < doubtful.verdict.direct_probability < 0.95
    assert sure.noise == pytest.approx(plain.noise / doubtful.verdict.direct_probability)


def test_pulses_pull_the_position_to_the_truth() -> None:
    """Attitude known, array 20 m above the transmitter: bearing and depression give the place."""
    rng = np.random.default_rng(2)
    filter_ = known(position_std_m=2.0, attitude_std_rad=0.002)
    filter_.covariance[filter_.layout[MOUNTING], filter_.layout[MOUNTING]] = 1e-6 * np.eye(3)
    truth = filter_.estimate.copy()
    truth.values[:3] = (1.0, -1.5, 0.0)
    filter_.covariance[2, 2] = 1e-4
    options = AidOptions(direction_std_rad=math.radians(0.5))
    beacon = np.array((12.0, 9.0, 20.0))
    noise = np.linalg.cholesky(TIMING)
    for _ in range(60):
        base = exact_delays(truth, beacon)
        # One direction error for all receivers, and timing noise.
        tilted = truth.copy()
        tilted.rotation_ned_frd = exp_so3(math.radians(0.5) * rng.standard_normal(3)) @ truth.rotation_ned_frd
        delays = exact_delays(tilted, beacon) + noise @ rng.standard_normal(4)
        assert delays == pytest.approx(base, abs=3e-5)
        filter_.update(
            replace(
                pulse(tuple(beacon), delays_s=delays, options=options, covariance_of=lambda: filter_.covariance),
            )
        )
    error = truth.position_ned_m - filter_.estimate.position_ned_m
    std = filter_.std("position")
    # The array sees the transmitter nearly edge-on: the sound speed's uncertainty decides how well.
    assert (std[:2] < 0.4).all()
    assert (np.abs(error[:2]) < 3.0 * std[:2]).all()


def test_a_transmitter_inside_the_array_is_no_measurement() -> None:
    filter_ = known()
    inside = filter_.estimate.rotation_ned_frd @ (MOUNTED.lever_arm_frd_m + np.array((0.1, 0.1, 0.0)))
    assert pulse(tuple(inside)).evaluate(filter_.estimate, filter_.layout) is None


def test_about_a_better_pose_the_prediction_is_that_pose_s_and_linear() -> None:
    estimate = random_estimate(LAYOUT, 8)
    better = estimate.copy()
    error = np.zeros(LAYOUT.size)
    error[:3], error[6:9] = (0.8, -1.2, 0.3), (0.02, -0.01, 0.05)
    better.add_error(-error)
    about = Pose(better.position_ned_m.copy(), better.rotation_ned_frd.copy())
    there = pulse().evaluate(better, LAYOUT)
    linear = pulse(about=about).evaluate(estimate, LAYOUT)
    straight = pulse().evaluate(estimate, LAYOUT)
    assert there is not None
    assert linear is not None
    assert straight is not None
    assert linear.jacobian == pytest.approx(there.jacobian)
    assert linear.residual == pytest.approx(there.residual - there.jacobian @ error, abs=1e-15)
    # To first order it is what the estimate itself predicts.
    assert linear.residual == pytest.approx(straight.residual, abs=2e-6)
    assert not np.allclose(linear.residual, straight.residual, atol=1e-9)


def test_an_unsure_refraction_leaves_the_azimuth_alone() -> None:
    estimate = random_estimate(LAYOUT, 9, tilt=0.1)
    exact = AidOptions(direction_std_rad=0.0)
    sure = pulse(options=exact).evaluate(estimate, LAYOUT)
    unsure = pulse(options=exact, bend_std_rad=0.1).evaluate(estimate, LAYOUT)
    assert sure is not None
    assert unsure is not None
    added = unsure.noise - sure.noise
    toward = np.array((30.0, -20.0, 12.0)) + estimate.block(BEACON) - estimate.position_ned_m
    down = np.array((-toward[0] * toward[2], -toward[1] * toward[2], toward[0] ** 2 + toward[1] ** 2))
    down /= math.hypot(toward[0], toward[1])
    by_place = -sure.jacobian[:, :3]
    assert added == pytest.approx(0.01 * np.outer(by_place @ down, by_place @ down), rel=1e-9, abs=1e-20)


def test_what_all_pulses_share_does_not_average_out() -> None:
    """A hundred pulses leave half of what half a degree is at 26 m; without the lasting error they leave less."""
    beacon, shared = np.array((12.0, 9.0, 20.0)), math.radians(0.5)
    across_m = float(np.linalg.norm(beacon)) * shared
    stated = []
    for wander in (shared, 0.0):
        layout = StateLayout.make(extra=((WANDER, 3),))
        std = layout.vector(position=(2.0, 2.0, 0.01), attitude=1e-4, isbl_wander=wander)
        filter_ = ErrorStateFilter(NavEstimate(layout, 100.0), std)
        for _ in range(100):
            delays = exact_delays(filter_.estimate, beacon)
            filter_.update(pulse(tuple(beacon), delays_s=delays, options=AidOptions(direction_std_rad=0.01)))
        stated.append(math.sqrt(float(np.linalg.eigvalsh(filter_.covariance[:2, :2])[0])))
    assert stated[0] > 0.5 * across_m
    assert stated[1] < 0.25 * across_m
