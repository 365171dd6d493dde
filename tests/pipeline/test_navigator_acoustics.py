import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.acoustics.navigation_aid import BEACON, MOUNTING
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.rotation import euler_from_rotation, quaternion_from_rotation, rotation_from_euler
from bluerov_slam.pipeline.acoustic_options import AcousticOptions
from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.pipeline.navigator_options import NavigatorOptions
from bluerov_slam.pipeline.navigator_start import ACOUSTIC_LAYOUT, LAYOUT
from bluerov_slam.pipeline.smoothed_poses import LONGEST_GAP_S, SmoothedPoses
from bluerov_slam.records import AcousticFix, NavSensor, NavState, PositionFix, SensorTrust, VehicleAttitude

ORIGIN = LocalFrame(47.6, -2.7)
BEACON_NED = np.array((40.0, 30.0, 12.0))
ARRAY = ReceiverArray(np.vstack((ReceiverArray.cross().positions_m, (0.25, 0.0, 0.0))))
MOUNTING_RAD = (0.0, -math.pi / 2.0, 0.0)
SOUND = 1490.0
TIMING_S = 1e-6
HEADING_RAD = 0.6
REST_NED = np.array((5.0, -8.0, 0.0))


def place_deg(north_m: float, east_m: float) -> tuple[float, float]:
    latitude, longitude, _ = ORIGIN.to_geodetic(north_m, east_m)
    return latitude, longitude


FITTED = AcousticOptions(array=ARRAY, mounting=ArrayMounting(rotation_from_euler(*MOUNTING_RAD)))
PLACE_DEG = (*place_deg(40.0, 30.0), 12.0)


def attitude(at_s: float) -> VehicleAttitude:
    return VehicleAttitude(
        arrived_s=at_s,
        boot_ms=round(1000.0 * at_s),
        roll_rad=2e-3 * math.sin(3.0 * at_s),  # exactly the same for long would be a sensor that hangs
        pitch_rad=2e-3 * math.cos(2.0 * at_s),
        yaw_rad=HEADING_RAD,
        angular_rate_frd_radps=(0.0, 0.0, 0.0),
    )


def fix(at_s: float, north_m: float, east_m: float) -> PositionFix:
    latitude, longitude = place_deg(north_m, east_m)
    return PositionFix(at_s, at_s, "test", latitude, longitude, (0.25, 0.0, 0.25))


def pulse(at_s: float, vehicle: np.ndarray, noise: np.random.Generator | None = None, **changes: object) -> AcousticFix:
    frd = rotation_from_euler(0.0, 0.0, HEADING_RAD).T @ (BEACON_NED - vehicle)
    source = rotation_from_euler(*MOUNTING_RAD).T @ frd
    delays = ARRAY.delays_s(source, SOUND)
    if noise is not None:
        arrivals = TIMING_S * noise.standard_normal(5)
        delays = delays + arrivals[0] - arrivals[1:]
    made = AcousticFix(
        measured_s=at_s,
        arrived_s=at_s + 0.05,
        accepted=True,
        reason="",
        sound_speed_mps=SOUND,
        receivers=tuple(range(5)),
        delays_s=tuple(delays.tolist()),
        delay_covariance_s2=tuple(tuple(row) for row in (TIMING_S**2 * (np.eye(4) + 1.0)).tolist()),
        slip_probability=0.0,
        beacon_deg_m=PLACE_DEG,
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def navigator(options: AcousticOptions | None = FITTED) -> Navigator:
    return Navigator(NavigatorOptions(acoustics=options, declination_rad=0.0))


def track(
    options: AcousticOptions | None = FITTED, pulses_from_s: float = 40.0, until_s: float = 160.0, **changes: object
) -> tuple[Navigator, NavState]:
    """At rest at (5, -8): fixes for 30 s, then pulses alone."""
    made, vehicle, noise = navigator(options), np.array((5.0, -8.0, 0.0)), np.random.default_rng(1)
    newest: NavState | None = None
    for tick in range(round(until_s * 5.0)):
        at_s = 0.2 * tick
        outputs = made.feed(attitude(at_s))
        if tick % 5 == 0 and at_s < 30.0:
            outputs += made.feed(fix(at_s, 5.0, -8.0))
        if tick % 10 == 0 and at_s >= pulses_from_s:
            outputs += made.feed(pulse(at_s, vehicle, noise, **changes))
        newest = next((each for each in reversed(outputs) if isinstance(each, NavState)), newest)
    assert newest is not None
    return made, newest


def account(state: NavState) -> NavSensor:
    return next(sensor for sensor in state.sensors if sensor.name == "acoustics")


def horizontal_error_m(state: NavState) -> float:
    assert state.position_ned_m is not None
    assert state.origin_deg is not None
    north, east, _ = ORIGIN.to_ned_m(*state.origin_deg)
    return math.hypot(state.position_ned_m[0] + north - 5.0, state.position_ned_m[1] + east + 8.0)


def test_pulses_hold_a_position_that_would_drift() -> None:
    _, held = track()
    _, adrift = track(pulses_from_s=1e9)
    assert account(held).trust is SensorTrust.USED
    assert account(held).accepted > 50
    assert account(held).rejected <= 1
    assert held.pose_covariance is not None
    assert adrift.pose_covariance is not None
    assert np.sqrt(held.pose_covariance[:2, :2].trace()) < 0.5 * np.sqrt(adrift.pose_covariance[:2, :2].trace())
    assert horizontal_error_m(held) < 3.0 * np.sqrt(held.pose_covariance[:2, :2].trace())
    assert held.last_fix_s == pytest.approx(158.0, abs=2.1)


def test_without_an_array_nothing_is_carried() -> None:
    made, state = track(None, until_s=60.0)
    assert made.save().layout == LAYOUT.blocks
    assert "acoustics" not in {sensor.name for sensor in state.sensors}


def test_an_array_brings_its_states_and_they_are_saved_and_taken_up_again() -> None:
    made, _ = track(until_s=80.0)
    saved = made.save()
    assert saved.layout == ACOUSTIC_LAYOUT.blocks
    assert {MOUNTING, BEACON, "sound_speed_scale"} <= {name for name, _ in saved.layout}
    again = Navigator(NavigatorOptions(acoustics=FITTED, declination_rad=0.0), saved, saved_age_s=5.0)
    states = [each for tick in range(5) for each in again.feed(attitude(0.2 * tick)) if isinstance(each, NavState)]
    assert states[-1].position_ned_m is not None


def test_an_array_may_be_switched_on_and_off_in_mid_dive() -> None:
    made, state = track(until_s=80.0)
    assert state.position_ned_m is not None
    plain = Navigator(NavigatorOptions(declination_rad=0.0), made.save(), saved_age_s=0.0)
    states = [each for tick in range(5) for each in plain.feed(attitude(0.2 * tick)) if isinstance(each, NavState)]
    assert states[-1].position_ned_m == pytest.approx(state.position_ned_m, abs=0.5)
    aided = Navigator(NavigatorOptions(acoustics=FITTED, declination_rad=0.0), plain.save(), saved_age_s=0.0)
    states = [each for tick in range(5) for each in aided.feed(attitude(0.2 * tick)) if isinstance(each, NavState)]
    assert states[-1].position_ned_m == pytest.approx(state.position_ned_m, abs=1.0)
    assert aided.save().layout == ACOUSTIC_LAYOUT.blocks


def test_without_the_transmitters_place_the_pulses_wait() -> None:
    _, state = track(until_s=60.0, beacon_deg_m=None)
    assert account(state).trust is SensorTrust.WAITING
    assert "not known" in account(state).reason


def beacon_error_m(made: Navigator) -> float:
    """By how much the filter finds the transmitter elsewhere than stated."""
    saved = made.save()
    start = sum(size for _, size in saved.layout[: [name for name, _ in saved.layout].index(BEACON)])
    return math.hypot(*saved.values[start : start + 2])


def test_what_was_learned_of_a_transmitter_is_void_once_it_has_moved() -> None:
    """It is stated 12 m from where it is, which the pulses show; then it states its right place."""
    made, _ = track(replace(FITTED, beacon_std_m=20.0), until_s=120.0, beacon_deg_m=(*place_deg(30.0, 36.5), 12.0))
    learned = beacon_error_m(made)
    assert learned > 3.0
    right = pulse(120.4, np.array((5.0, -8.0, 0.0)), beacon_std_m=20.0)
    for record in (attitude(120.2), attitude(120.4), right, attitude(120.6)):
        made.feed(record)
    assert beacon_error_m(made) < 0.5 * learned


def test_a_refused_pulse_changes_nothing() -> None:
    _, state = track(until_s=50.0, accepted=False, reason="two transmitters")
    assert account(state).accepted == 0


def test_echoes_are_refused() -> None:
    made, _ = track(until_s=80.0)
    before = made.statistics["sensors"]["acoustics"]
    vehicle = np.array((5.0, -8.0, 0.0))
    echo = pulse(80.4, vehicle - 2.0 * (BEACON_NED - vehicle) * (0.0, 0.0, -1.0) + np.array((30.0, -40.0, 0.0)))
    made.feed(attitude(80.2))
    made.feed(attitude(80.4))
    made.feed(echo)
    after = made.statistics["sensors"]["acoustics"]
    assert after["rejected"] == before["rejected"] + 1


def test_the_first_position_may_come_from_the_transmitter() -> None:
    made, vehicle = navigator(), np.array((5.0, -8.0, 0.0))
    texts: list[str] = []
    state: NavState | None = None
    for tick in range(100):
        at_s = 0.2 * tick
        outputs = made.feed(attitude(at_s))
        if tick % 10 == 5:
            solved = {"position_deg": place_deg(5.0, -8.0), "covariance_ned_m2": np.diag((9.0, 9.0, 0.1)).tolist()}
            outputs += made.feed(pulse(at_s, vehicle, range_m=52.0, **solved))
        for output in outputs:
            if isinstance(output, NavState):
                state = output
            else:
                texts.append(output.text)
    assert state is not None
    assert "Position known, from the acoustic array" in texts
    assert horizontal_error_m(state) < 5.0


def far_off(first_pass: list[NavState]) -> list[NavState]:
    """At rest: fixes for 20 s, then adrift, then pulses from a place that is known to tens of metres only."""
    made = navigator()
    made.keep_for_smoothing(first_pass)
    for tick in range(900):
        at_s = 0.2 * tick
        made.feed(attitude(at_s))
        if tick % 5 == 0 and at_s < 20.0:
            made.feed(fix(at_s, 5.0, -8.0))
        if tick % 25 == 0 and at_s >= 120.0:
            made.feed(pulse(at_s, REST_NED))
    return made.smoothed()


def test_passes_over_a_recording_settle_as_gauss_newton_does() -> None:
    passes: list[list[NavState]] = [[]]
    for _ in range(3):
        passes.append(far_off(passes[-1]))
    places = [
        np.array([each.position_ned_m for each in states if each.position_ned_m is not None]) for states in passes[1:]
    ]
    second, third = (np.abs(after - before).max() for before, after in pairwise(places))
    assert second > 0.01
    assert third < 0.2 * second


def state_at(at_s: float, north_m: float, yaw_rad: float) -> NavState:
    known = next(state for state in reversed(run_of_one_second()) if state.position_ned_m is not None)
    turn = quaternion_from_rotation(rotation_from_euler(0.0, 0.0, yaw_rad))
    return replace(known, measured_s=at_s, position_ned_m=(north_m, 0.0, 0.0), quaternion_ned_frd=turn)


def run_of_one_second() -> list[NavState]:
    made = navigator()
    made.keep_for_smoothing()
    for tick in range(10):
        made.feed(attitude(0.2 * tick))
        made.feed(fix(0.2 * tick, 0.0, 0.0))
    return made.smoothed()


def test_between_states_place_and_turn_are_even_and_beyond_them_unknown() -> None:
    poses = SmoothedPoses([state_at(10.0, 0.0, 3.1), state_at(11.0, 4.0, -3.1), state_at(14.0, 5.0, 0.0)])
    pose = poses(10.25)
    assert pose is not None
    assert pose.position_ned_m[0] == pytest.approx(1.0)
    assert euler_from_rotation(pose.rotation_ned_frd)[2] == pytest.approx(3.1 + 0.25 * (2.0 * np.pi - 6.2))
    exact = poses(11.0)
    assert exact is not None
    assert exact.position_ned_m[0] == 4.0
    assert poses(9.99) is None
    assert poses(14.01) is None
    assert LONGEST_GAP_S < 14.0 - 11.0
    assert poses(12.0) is None
