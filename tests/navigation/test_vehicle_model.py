"""Thrusters, drag and the velocity through the water."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation.attitude.quaternion import IDENTITY, rotate, turned
from bluerov_slam.navigation.vehicle_model import (
    BLUEROV2,
    BLUEROV2_HEAVY,
    T200,
    Hull,
    MovingVehicle,
    ThrustModel,
    scale_jacobian,
    speed_under,
)

KGF_N = 9.80665
STOP = [1500] * 8
FORWARD = [1400, 1400, 1600, 1600, 1500, 1500]

# Points of Blue Robotics' public performance data (September 2019) at 16 V: pulse in us, thrust in kgf.
PUBLIC_16_V = [(1100, -4.07), (1184, -2.94), (1308, -1.35), (1472, 0.0), (1500, 0.0), (1528, 0.0)]
PUBLIC_16_V += [(1624, 0.87), (1728, 2.22), (1840, 4.25), (1864, 4.71), (1900, 5.25)]
# The same data's full thrust, N, forward and reverse.
PUBLIC_FULL = [(12, 36.4, -28.6), (14, 44.4, -34.5), (16, 51.4, -39.9), (18, 59.0, -45.0), (20, 65.9, -49.4)]
# A cubic through the same data at 12 V, as users of the thruster publish it: pulse = c(thrust in kgf).
FORWARD_12_V = np.poly1d([3.771, -31.19, 159.9, 1540.0])
REVERSE_12_V = np.poly1d([7.359, 47.59, 199.2, 1461.0])


@pytest.mark.parametrize(("pwm_us", "thrust_kgf"), PUBLIC_16_V)
def test_thrust_is_the_data_sheets_at_16_volts(pwm_us: int, thrust_kgf: float) -> None:
    assert T200.thrust_n(pwm_us - 1500, 16.0) == pytest.approx(thrust_kgf * KGF_N, abs=0.9)


@pytest.mark.parametrize(("voltage_v", "forward_n", "reverse_n"), PUBLIC_FULL)
def test_full_thrust_follows_the_voltage(voltage_v: float, forward_n: float, reverse_n: float) -> None:
    assert T200.thrust_n(400.0, voltage_v) == pytest.approx(forward_n, abs=0.3)
    assert T200.thrust_n(-400.0, voltage_v) == pytest.approx(reverse_n, abs=0.3)


def test_thrust_in_between_is_the_data_sheets_at_12_volts() -> None:
    for thrust_kgf in np.linspace(0.3, 3.5, 17):
        assert T200.thrust_n(float(FORWARD_12_V(thrust_kgf)) - 1500, 12.0) == pytest.approx(thrust_kgf * KGF_N, abs=1.2)
    for thrust_kgf in np.linspace(-2.7, -0.3, 13):
        assert T200.thrust_n(float(REVERSE_12_V(thrust_kgf)) - 1500, 12.0) == pytest.approx(thrust_kgf * KGF_N, abs=1.2)


def test_thrust_never_falls_with_the_pulse_and_ends_at_full() -> None:
    for voltage_v in (10.0, 13.0, 16.8, 20.0):
        thrusts = [T200.thrust_n(pulse, voltage_v) for pulse in range(-450, 451)]
        assert all(b >= a for a, b in itertools.pairwise(thrusts))
        assert thrusts[0] == T200.thrust_n(-400, voltage_v)
        assert thrusts[-1] == T200.thrust_n(400, voltage_v)


@pytest.mark.parametrize(
    ("layout", "pwm_us", "axis", "sign"),
    [
        (BLUEROV2, FORWARD, 0, 1),
        (BLUEROV2, [1600, 1600, 1400, 1400, 1500, 1500], 0, -1),
        (BLUEROV2, [1600, 1400, 1600, 1400, 1500, 1500], 1, 1),
        (BLUEROV2, [1500, 1500, 1500, 1500, 1600, 1600], 2, 1),
        (BLUEROV2_HEAVY, [*FORWARD, 1500, 1500], 0, 1),
        (BLUEROV2_HEAVY, [1500, 1500, 1500, 1500, 1400, 1400, 1400, 1400], 2, -1),
    ],
)
def test_a_command_moves_along_its_axis_only(layout: object, pwm_us: list[int], axis: int, sign: int) -> None:
    moving = ThrustModel(layout).water_velocity_frd(pwm_us, 16.0)  # type: ignore[arg-type]
    assert moving is not None
    assert sign * moving.velocity_frd_mps[axis] > 0.1
    assert np.delete(moving.velocity_frd_mps, axis) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_turn_on_the_spot_pushes_nowhere() -> None:
    force = ThrustModel(BLUEROV2).force_frd([1600, 1400, 1400, 1600, 1500, 1500], 16.0)
    assert force is not None
    # Forward and reverse thrust differ by a quarter: the two sides still cancel, fore and aft.
    assert force == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_reversed_motors_are_mirrored_pulses() -> None:
    directions = [-1, -1, 1, 1, -1, 1, 1, -1]
    plain, turned = ThrustModel(BLUEROV2_HEAVY), ThrustModel(BLUEROV2_HEAVY.with_directions(directions))
    pwm = [1420, 1390, 1610, 1570, 1550, 1450, 1530, 1620]
    mirrored = [1500 + d * (p - 1500) for d, p in zip(directions, pwm, strict=True)]
    assert turned.force_frd(mirrored, 15.0) == pytest.approx(plain.force_frd(pwm, 15.0))
    for wrong in ([1, 1, 1], [1] * 7 + [0]):
        with pytest.raises(ValueError, match="directions"):
            BLUEROV2_HEAVY.with_directions(wrong)


def test_drag_balances_thrust_at_the_published_coefficients() -> None:
    model = ThrustModel()
    force = np.array([13.7 * 0.5 + 141.0 * 0.25, -217.0 * 0.09, 33.0 * 0.2 + 190.0 * 0.04])
    assert model.steady_velocity(force) == pytest.approx([0.5, -0.3, 0.2])


@given(st.floats(-500.0, 500.0), st.floats(0.0, 50.0), st.floats(1.0, 300.0))
def test_speed_solves_its_equation(force_n: float, linear: float, quadratic: float) -> None:
    u = speed_under(force_n, linear, quadratic)
    assert linear * u + quadratic * u * abs(u) == pytest.approx(force_n, abs=1e-9 * (1.0 + abs(force_n)))


def test_a_relative_thrust_error_makes_half_of_it_in_speed() -> None:
    model = ThrustModel()
    force = np.array([40.0, 0.0, 0.0])
    ratio = model.steady_velocity(1.2 * force)[0] / model.steady_velocity(force)[0]
    assert ratio - 1.0 == pytest.approx(0.11, abs=0.015)  # the survey's figure: 20 % of thrust is 11 % of speed


@pytest.mark.parametrize(
    ("pwm_us", "voltage_v"),
    [
        ([], 16.0),
        ([1500] * 5, 16.0),
        ([0] * 8, 16.0),
        ([1500, 1500, 1500, 0, 1500, 1500], 16.0),
        ([1500, 1500, 65535, 1500, 1500, 1500], 16.0),
        ([1500, 1500, math.nan, 1500, 1500, 1500], 16.0),
        (STOP, 0.0),
        (STOP, 60.0),
        (STOP, math.nan),
    ],
)
def test_a_senseless_command_or_voltage_gives_nothing(pwm_us: list[float], voltage_v: float) -> None:
    assert ThrustModel().water_velocity_frd(pwm_us, voltage_v) is None
    assert MovingVehicle(ThrustModel()).update(pwm_us, voltage_v, 0.1) is None


def test_without_a_voltage_the_error_is_wider() -> None:
    known, unknown = (ThrustModel().water_velocity_frd(FORWARD, v) for v in (16.0, None))
    assert known is not None
    assert unknown is not None
    assert unknown.velocity_frd_mps == pytest.approx(known.velocity_frd_mps)
    assert unknown.std_mps[0] > known.std_mps[0]
    model = ThrustModel()
    relative = model.force_std_n(np.array([1000.0, 0.0, 0.0]), None)[0] / 1000.0
    assert relative == pytest.approx(math.hypot(0.10, 1.16 * 1.5 / 16.0), rel=1e-3)


def test_the_error_is_what_wrong_forces_do_to_the_speed() -> None:
    model = ThrustModel()
    random = np.random.default_rng(21)
    for pwm in (STOP, FORWARD, [1200, 1200, 1800, 1800, 1700, 1700]):
        force = model.force_frd(pwm, 16.0)
        assert force is not None
        stated = model.velocity_std(force, 16.0)
        wrong = force + model.force_std_n(force, 16.0) * random.normal(size=(4000, 3))
        speeds = np.array([model.steady_velocity(f) for f in wrong]) + random.normal(0.0, 0.03, (4000, 3))
        rms = np.sqrt(((speeds - model.steady_velocity(force)) ** 2).mean(axis=0))
        less = model.steady_velocity(force) - model.steady_velocity(force - model.force_std_n(force, 16.0))
        assert (stated >= less).all()
        assert (stated > 0.9 * rms).all()
        assert (stated < 1.5 * rms).all()


def test_builds_up_to_the_steady_velocity_and_dies_away() -> None:
    model = ThrustModel()
    moving = MovingVehicle(model)
    steady = model.water_velocity_frd(FORWARD, 16.0)
    assert steady is not None
    speeds = [moving.update(FORWARD, 16.0, 0.05) for _ in range(200)]
    along = [s.velocity_frd_mps[0] for s in speeds if s is not None]
    assert len(along) == 200
    assert all(b > a for a, b in itertools.pairwise(along[:61]))
    assert along[-1] == pytest.approx(steady.velocity_frd_mps[0], rel=1e-3)
    for _ in range(600):
        stopped = moving.update(STOP, 16.0, 0.05)
    assert stopped is not None
    assert abs(stopped.velocity_frd_mps[0]) < 0.01


def test_the_interval_hardly_matters() -> None:
    ends = []
    for interval_s in (0.002, 0.05, 0.2):
        moving = MovingVehicle(ThrustModel())
        for _ in range(round(0.8 / interval_s)):
            state = moving.update(FORWARD, 16.0, interval_s)
        assert state is not None
        ends.append(state.velocity_frd_mps[0])
    assert ends[1:] == pytest.approx([ends[0]] * 2, rel=0.12)
    moving = MovingVehicle(ThrustModel())
    long_step = moving.update(FORWARD, 16.0, 1000.0)
    assert long_step is not None
    assert long_step.velocity_frd_mps[0] == pytest.approx(0.267, abs=0.005)


def test_a_turn_slips_sideways() -> None:
    moving = MovingVehicle(ThrustModel())
    for _ in range(400):
        state = moving.update([1300, 1300, 1700, 1700, 1500, 1500], 16.0, 0.05, (0.0, 0.0, math.radians(20.0)))
    assert state is not None
    u, v, _ = state.velocity_frd_mps
    # The water pushes from the outside of a right turn: m r u against 217 v^2.
    assert v == pytest.approx(-math.sqrt(19.9 * math.radians(20.0) * u / 217.0), rel=0.02)


@pytest.mark.parametrize("interval_s", [0.0, -1.0, math.nan, math.inf])
def test_a_senseless_interval_leaves_the_state(interval_s: float) -> None:
    moving = MovingVehicle(ThrustModel())
    moving.reset((0.4, 0.0, 0.0))
    assert moving.update(FORWARD, 16.0, interval_s) is None
    state = moving.update(FORWARD, 16.0, 1e-6)
    assert state is not None
    assert state.velocity_frd_mps[0] == pytest.approx(0.4, abs=1e-4)


def test_scale_jacobian_is_the_derivative() -> None:
    velocity = np.array([0.6, -0.2, 0.1])

    def true_velocity(scale: np.ndarray) -> np.ndarray:
        return velocity * (1.0 + np.array([scale[0], scale[1], 0.0]))

    step = 1e-6
    numeric = np.stack([(true_velocity(d) - true_velocity(-d)) / (2 * step) for d in step * np.eye(2)], axis=1)
    assert scale_jacobian(velocity) == pytest.approx(numeric)


def test_effort_is_the_share_of_full_current() -> None:
    effort = ThrustModel().effort([1500, 1520, 1900, 1100, 1700, 1300])
    assert effort is not None
    assert effort == pytest.approx([0.0, 0.0, 1.0, 1.0, (172 / 372) ** 2, (172 / 372) ** 2])
    assert ThrustModel().effort([1500, 1520]) is None


def test_without_drag_the_momentum_stays_where_it_points() -> None:
    """Turning about a skew axis: the velocity in the world is the same at the end (next to no drag, no added mass)."""
    nothing = (1e-9,) * 3
    hull = Hull(added_mass_kg=(0.0,) * 3, linear_drag_npmps=nothing, quadratic_drag_npm2ps2=nothing)
    moving = MovingVehicle(ThrustModel(hull=hull))
    moving.reset((0.5, -0.2, 0.3))
    rate, steps, interval_s = np.array([0.3, -0.5, 0.7]), 4000, 0.0005
    for _ in range(steps):
        state = moving.update(STOP, 16.0, interval_s, tuple(rate))
    assert state is not None
    attitude = turned(IDENTITY, tuple(rate * steps * interval_s))
    assert rotate(attitude, tuple(state.velocity_frd_mps)) == pytest.approx((0.5, -0.2, 0.3), abs=1e-3)
