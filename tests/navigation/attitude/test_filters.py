"""Madgwick, Mahony and the sensor's own angles: against a public implementation, the truth and bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bluerov_slam.navigation.attitude.ekf_attitude import EkfAttitude
from bluerov_slam.navigation.attitude.filter import AttitudeFilter
from bluerov_slam.navigation.attitude.madgwick import (
    Madgwick,
    ThesisMadgwick,
    fast_inverse_root,
    gradient,
    thesis_start_yaw,
)
from bluerov_slam.navigation.attitude.mahony import Mahony
from bluerov_slam.navigation.attitude.own_angles import OwnAngles
from bluerov_slam.navigation.attitude.quaternion import (
    IDENTITY,
    angle_between,
    conjugate,
    from_euler,
    normalised,
    rotate,
    to_euler,
)
from bluerov_slam.navigation.process import ProcessNoise
from inertial_samples import FIELD_NED, Samples, samples_of, wobble

LEVEL_FORCE = (0.0, 0.0, -9.81)


def run(attitude: AttitudeFilter, samples: Samples, bias: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> list[float]:
    """Angles to the truth, rad."""
    errors = []
    for truth, rate, force, field in zip(
        samples.quaternion_ned_frd, samples.rate + bias, samples.force, samples.field, strict=True
    ):
        attitude.update(rate, force, field, samples.interval_s)
        errors.append(angle_between(truth, attitude.quaternion_ned_frd))
    return errors


def noisy(samples: Samples, seed: int) -> Samples:
    random = np.random.default_rng(seed)
    return Samples(
        samples.interval_s,
        samples.quaternion_ned_frd,
        samples.rate + random.normal(0.0, 0.01, samples.rate.shape),
        samples.force + random.normal(0.0, 0.2, samples.force.shape),
        samples.field + random.normal(0.0, 0.01, samples.field.shape),
    )


def test_madgwick_is_the_public_implementation_to_the_last_digits() -> None:
    filters = pytest.importorskip("ahrs.filters", reason="the package ahrs is not installed")
    samples = noisy(samples_of(wobble, 20.0), seed=3)
    public = filters.Madgwick(gain=0.11)
    ours = Madgwick(beta_radps=0.11, zeta_radps2=0.0, published_order=True)
    q = np.array(IDENTITY)
    for rate, force, field in zip(samples.rate, samples.force, samples.field, strict=True):
        q = public.updateMARG(q, gyr=rate, acc=-force, mag=field, dt=samples.interval_s)
        ours.update(rate, force, field, samples.interval_s)
        assert ours.quaternion_ned_frd == pytest.approx(q, abs=1e-10)


def test_madgwick_without_a_field_is_the_public_implementation() -> None:
    filters = pytest.importorskip("ahrs.filters", reason="the package ahrs is not installed")
    samples = noisy(samples_of(wobble, 10.0), seed=4)
    public = filters.Madgwick(gain=0.05)
    ours = Madgwick(beta_radps=0.05, zeta_radps2=0.0, published_order=True)
    q = np.array(IDENTITY)
    for rate, force in zip(samples.rate, samples.force, strict=True):
        q = public.updateIMU(q, gyr=rate, acc=-force, dt=samples.interval_s)
        ours.update(rate, force, None, samples.interval_s)
        assert ours.quaternion_ned_frd == pytest.approx(q, abs=1e-10)


def test_mahony_is_the_public_implementation_to_the_last_digits() -> None:
    filters = pytest.importorskip("ahrs.filters", reason="the package ahrs is not installed")
    samples = noisy(samples_of(wobble, 20.0), seed=5)
    public = filters.Mahony(k_P=0.7, k_I=0.05)
    # Its magnetic reference lies along y, ours along x: a quarter turn, which is a declination of 90 degrees.
    ours = Mahony(kp_radps=0.7, ki_radps2=0.05, declination_rad=math.pi / 2.0, published_order=True)
    q = np.array(IDENTITY)
    ours.initialise(IDENTITY)
    for rate, force, field in zip(samples.rate, samples.force, samples.field, strict=True):
        q = public.updateMARG(q, gyr=rate, acc=-force, mag=field, dt=samples.interval_s)
        ours.update(rate, force, field, samples.interval_s)
        assert ours.quaternion_ned_frd == pytest.approx(np.asarray(q), abs=1e-10)
    assert ours.gyro_bias_frd_radps == pytest.approx(public.b, abs=1e-10)


def test_the_error_state_filter_follows_and_learns_the_bias_within_its_stated_error() -> None:
    bias = (math.radians(0.3), math.radians(-0.2), math.radians(0.4))
    ekf = EkfAttitude(noise=ProcessNoise(gyro_noise_rad_per_sqrt_s=0.01 / math.sqrt(50.0)))
    ekf.initialise(from_euler(0.05, -0.05, 0.2))
    errors = run(ekf, noisy(samples_of(wobble, 120.0, rate_hz=50.0), seed=12), bias)
    assert max(errors[-2000:]) < math.radians(1.5)
    assert ekf.gyro_bias_frd_radps == pytest.approx(bias, abs=math.radians(0.08))
    stated = math.sqrt(sum(std * std for std in ekf.std_ned_rad))
    assert float(np.sqrt(np.mean(np.square(errors[-2000:])))) < 2.0 * stated
    assert stated < math.radians(1.0)


def test_the_step_is_the_gradient_of_what_it_claims_to_minimise() -> None:
    random = np.random.default_rng(8)
    for _ in range(20):
        q = random.normal(size=4)
        q /= np.linalg.norm(q)
        down, field = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
        north, east, vertical = rotate(tuple(q), tuple(field))
        reference = (math.hypot(north, east), 0.0, vertical)

        def half_square(
            p: np.ndarray, down: np.ndarray = down, field: np.ndarray = field, b: tuple[float, ...] = reference
        ) -> float:
            # Madgwick's f keeps q0 out of the diagonal (1 - 2 q1^2 - 2 q2^2): valid on the unit sphere only.
            w, x, y, z = p
            rows = np.array(
                [
                    [1 - 2 * y * y - 2 * z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                    [2 * (x * y + w * z), 1 - 2 * x * x - 2 * z * z, 2 * (y * z - w * x)],
                    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * x * x - 2 * y * y],
                ]
            )
            f = np.concatenate([rows.T @ (0.0, 0.0, 1.0) - down, rows.T @ np.array(b) - field])
            return 0.5 * float(f @ f)

        step = 1e-6
        numeric = [(half_square(q + d) - half_square(q - d)) / (2 * step) for d in step * np.eye(4)]
        assert gradient(tuple(q), tuple(down), tuple(field), 1.0) == pytest.approx(numeric, abs=1e-7)


@pytest.mark.parametrize("attitude", [Madgwick(0.1, 0.0), Mahony(3.0, 0.0)], ids=["madgwick", "mahony"])
def test_follows_a_lively_motion_from_a_wrong_start(attitude: AttitudeFilter) -> None:
    attitude.initialise(from_euler(0.5, -0.4, 1.5))
    errors = run(attitude, samples_of(wobble, 60.0))
    assert errors[0] > 1.0
    assert max(errors[-1000:]) < math.radians(0.1)


@pytest.mark.parametrize("attitude", [Madgwick(0.05, 0.004), Mahony(0.5, 0.05)], ids=["madgwick", "mahony"])
def test_learns_the_gyro_bias(attitude: AttitudeFilter) -> None:
    bias = (math.radians(0.6), math.radians(-0.4), math.radians(0.8))
    attitude.initialise(from_euler(*wobble(0.0)))
    errors = run(attitude, samples_of(wobble, 240.0, rate_hz=50.0), bias)
    assert attitude.gyro_bias_frd_radps == pytest.approx(bias, abs=math.radians(0.02))
    assert max(errors[-2000:]) < math.radians(0.2)


@pytest.mark.parametrize("kind", [Madgwick, Mahony])
def test_the_published_order_lags_by_one_sample_and_ours_does_not(kind: type[Madgwick] | type[Mahony]) -> None:
    samples = samples_of(lambda t: (0.0, 0.0, 1.05 * t), 60.0, rate_hz=20.0)  # 60 deg/s at the rate of the real link
    lag = 1.05 * samples.interval_s
    gains = (0.1, 0.0) if kind is Madgwick else (3.0, 0.0)
    published, ours = kind(*gains, published_order=True), kind(*gains)
    assert np.mean(run(published, samples)[-200:]) > 0.5 * lag
    assert np.mean(run(ours, samples)[-200:]) < 0.1 * lag


@pytest.mark.parametrize("kind", [Madgwick, Mahony])
def test_looks_towards_true_north_with_the_declination(kind: type[Madgwick] | type[Mahony]) -> None:
    attitude = kind(declination_rad=0.2)
    attitude.initialise(IDENTITY)
    for _ in range(8000):
        attitude.update((0.0, 0.0, 0.0), LEVEL_FORCE, FIELD_NED, 0.02)
    # Madgwick's step does not shrink: at rest it dances by beta dt.
    assert to_euler(attitude.quaternion_ned_frd) == pytest.approx((0.0, 0.0, 0.2), abs=4e-3)


@pytest.mark.parametrize(
    "attitude",
    [Madgwick(), ThesisMadgwick(), Mahony(), EkfAttitude(field_std_rad=100.0)],
    ids=["madgwick", "thesis", "mahony", "ekf"],
)
def test_turns_by_the_rate_alone_while_nothing_else_is_usable(attitude: AttitudeFilter) -> None:
    attitude.initialise(IDENTITY)
    for force in ((0.0, 0.0, 0.0), (math.nan, 0.0, -9.8), (math.inf, 0.0, -9.8)):
        for _ in range(100):
            attitude.update((0.0, 0.0, 0.1), force, FIELD_NED, 0.01)
    # The thesis's normalisation is 0.17 % short; a rotation of 0.3 rad comes out that much long at most.
    assert to_euler(attitude.quaternion_ned_frd) == pytest.approx((0.0, 0.0, 0.3), abs=2e-3)


@pytest.mark.parametrize(
    "attitude",
    [Madgwick(), ThesisMadgwick(), Mahony(), EkfAttitude()],
    ids=["madgwick", "thesis", "mahony", "ekf"],
)
def test_a_field_that_is_not_one_leaves_gravity_at_work(attitude: AttitudeFilter) -> None:
    for field in ((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (math.inf, 1.0, 0.0)):
        attitude.initialise(from_euler(0.3, 0.0, 1.0))
        for _ in range(3000):
            attitude.update((0.0, 0.0, 0.0), LEVEL_FORCE, field, 0.01)
        roll, pitch, yaw = to_euler(attitude.quaternion_ned_frd)
        assert (roll, pitch, yaw) == pytest.approx((0.0, 0.0, 1.0), abs=0.02)


@pytest.mark.parametrize(
    "attitude",
    [Madgwick(), ThesisMadgwick(), Mahony(), OwnAngles(), EkfAttitude()],
    ids=["madgwick", "thesis", "mahony", "own", "ekf"],
)
@pytest.mark.parametrize(
    ("rate", "interval_s"),
    [
        ((math.nan, 0.0, 0.0), 0.01),
        ((0.0, math.inf, 0.0), 0.01),
        ((0.1, 0.0, 0.0), 0.0),
        ((0.1, 0.0, 0.0), -0.01),
        ((0.1, 0.0, 0.0), 2.0),
        ((0.1, 0.0, 0.0), math.nan),
    ],
)
def test_a_senseless_rate_or_interval_changes_nothing(
    attitude: AttitudeFilter, rate: tuple[float, float, float], interval_s: float
) -> None:
    start = from_euler(0.1, 0.2, 0.3)
    attitude.initialise(start)
    before = attitude.quaternion_ned_frd
    attitude.update(rate, LEVEL_FORCE, FIELD_NED, interval_s)
    assert attitude.quaternion_ned_frd == before
    assert before == pytest.approx(start)


def test_the_thesis_lets_the_magnetometer_pull_half_as_hard() -> None:
    q = from_euler(0.0, 0.0, 0.02)  # only the heading is wrong: gravity is silent
    field = normalised((0.0, *FIELD_NED))[1:]

    def pull(length: float) -> float:
        """Rate about the vertical that the step asks for."""
        s = np.array(gradient(q, (0.0, 0.0, 1.0), field, length))
        w, x, y, z = conjugate(q)
        return float(2.0 * (w * s[3] + x * s[2] - y * s[1] + z * s[0]))

    assert pull(0.5) == pytest.approx(0.5 * pull(1.0), rel=1e-9)


def test_the_thesis_needs_many_seconds_from_the_identity() -> None:
    samples = noisy(samples_of(lambda t: (0.1, -0.05, 2.0), 40.0, rate_hz=208.0), seed=6)
    errors = run(ThesisMadgwick(), samples)
    assert errors[5 * 208] > 0.5
    assert max(errors[-2000:]) < math.radians(1.0)


def test_the_thesis_root_is_short_by_a_sixth_of_a_percent() -> None:
    ratios = [fast_inverse_root(x) * math.sqrt(x) for x in np.geomspace(1e-6, 1e6, 5000)]
    assert 0.998 < min(ratios) < 0.9985
    assert max(ratios) <= 1.0 + 1e-7


def test_the_thesis_start_yaw_is_wrong_where_the_vehicle_is_tilted() -> None:
    assert thesis_start_yaw(from_euler(0.0, 0.0, 0.7)) == pytest.approx(-0.7)
    tilted = thesis_start_yaw(from_euler(math.radians(20.0), math.radians(15.0), 0.7))
    assert abs(tilted + 0.7) > math.radians(2.0)


def test_own_angles_are_taken_and_carried_on_by_the_rate() -> None:
    own = OwnAngles(declination_rad=0.1)
    own.take(0.2, -0.1, 1.0)
    assert to_euler(own.quaternion_ned_frd) == pytest.approx((0.2, -0.1, 1.1))
    own.take(None, 0.0, 0.0)
    own.take(0.0, math.nan, 0.0)
    assert to_euler(own.quaternion_ned_frd) == pytest.approx((0.2, -0.1, 1.1))
    own.initialise(IDENTITY, (0.0, 0.0, 0.05))
    for _ in range(10):
        own.update((0.0, 0.0, 0.25), LEVEL_FORCE, None, 0.1)
    assert to_euler(own.quaternion_ned_frd) == pytest.approx((0.0, 0.0, 0.2))


def test_rates_between_angles_are_exact_over_any_turn() -> None:
    samples = samples_of(wobble, 5.0, rate_hz=10.0)
    own = OwnAngles()
    own.initialise(from_euler(*wobble(0.0)))
    assert max(run(own, samples)) < 1e-9
