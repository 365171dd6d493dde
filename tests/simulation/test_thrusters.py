import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.navigation.vehicle_model import BLUEROV2, BLUEROV2_HEAVY, T200, ThrustModel
from bluerov_slam.simulation.thrusters import (
    FRAMES,
    NEUTRAL_US,
    VECTORED,
    VECTORED_6DOF,
    Battery,
    current_a,
    pwm_for_us,
    thrust_n,
)


def test_full_throttle_and_deadband_are_the_makers() -> None:
    assert thrust_n(1900, 16.0) == pytest.approx(5.25 * 9.80665)
    assert thrust_n(1100, 16.0) == pytest.approx(-4.10 * 9.80665)
    assert thrust_n(1900, 12.0) == pytest.approx(3.71 * 9.80665, rel=0.02)
    assert all(thrust_n(pwm, 16.0) == 0.0 for pwm in range(1465, 1536))


@given(st.floats(-39.0, 50.0))
def test_the_autopilots_output_gives_the_force_it_wants(force_n: float) -> None:
    pwm = pwm_for_us(force_n)
    assert 1100 <= pwm <= 1900
    if pwm != NEUTRAL_US:
        assert thrust_n(pwm, 16.0) == pytest.approx(force_n, abs=0.15)


@pytest.mark.parametrize("frame", FRAMES.values(), ids=lambda frame: frame.name)
def test_the_mixer_gives_what_is_asked_and_nothing_else(frame: object) -> None:
    assert isinstance(frame, type(VECTORED))
    effect, share = np.array(frame.effect), np.array(frame.share)
    mixed = effect.T @ share
    axes = [0, 1, 2, 3, 5] if frame is VECTORED else list(range(6))
    assert np.diag(mixed)[axes] == pytest.approx(1.0)
    horizontal = mixed[np.ix_([0, 1, 5], [0, 1, 5])]
    assert horizontal == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize(("frame", "layout"), [(VECTORED, BLUEROV2), (VECTORED_6DOF, BLUEROV2_HEAVY)])
def test_both_sides_read_the_outputs_alike(frame: object, layout: object) -> None:
    """Signs and axes are ArduSub's for simulator and estimator; the curves differ a little, as real thrusters do."""
    model = ThrustModel(layout)  # type: ignore[arg-type]
    for number, effect in enumerate(frame.effect):  # type: ignore[attr-defined]
        for pwm in (1250, 1680):
            pulses = [1500.0] * len(frame.effect)  # type: ignore[attr-defined]
            pulses[number] = pwm
            estimated = model.force_frd(pulses, 15.0)
            assert estimated is not None
            assert estimated == pytest.approx(thrust_n(pwm, 15.0) * np.array(effect[:3]), rel=0.08, abs=0.3)


def test_the_curve_is_near_that_of_the_public_data_but_not_the_estimators() -> None:
    differences = [abs(thrust_n(1500 + pulse, 16.0) - T200.thrust_n(pulse, 16.0)) for pulse in range(-400, 401, 20)]
    assert 0.2 < max(differences) < 2.5


def test_the_battery_sags_and_empties() -> None:
    battery = Battery(1.0)
    rested_v = battery.voltage_v
    battery.draw(60.0, 1.0)
    assert rested_v - battery.voltage_v == pytest.approx(1.8, abs=0.02)
    for _ in range(1800):
        battery.draw(18.0, 1.0)
    assert battery.charge_share == pytest.approx(0.5, abs=0.01)
    battery.draw(0.0, 1.0)
    assert battery.voltage_v < rested_v - 0.5
    assert current_a(51.0, 16.0) == pytest.approx(24.0, rel=0.03)
