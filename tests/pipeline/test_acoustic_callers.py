"""Who calls, by directions and times alone."""

import math

import numpy as np

from bluerov_slam.pipeline.acoustic_callers import OTHER_TEXT, PLACES_TEXT, TWO_TEXT, WRONG_TEXT, Callers, Expected
from bluerov_slam.records import AcousticMessage

OURS, OTHER = 0.2, 1.6


def toward(azimuth: float) -> np.ndarray:
    return np.array((math.cos(azimuth), math.sin(azimuth), 0.0))


def held(calls: list[tuple[float, float]], expected: Expected | None = None, range_m: float | None = 30.0) -> list[str]:
    callers = Callers()
    return [callers.hear(at_s, toward(azimuth), True, range_m, expected) for at_s, azimuth in calls]


def in_turn(count: int = 20, phase_s: float = 0.43) -> list[tuple[float, float]]:
    return [(k // 2 + phase_s * (k % 2), OTHER if k % 2 else OURS) for k in range(count)]


def test_one_transmitter_is_left_alone_with_its_echoes() -> None:
    calls = [(float(k), OURS + 0.01 * k) for k in range(40)]
    for k in (7, 12, 13, 30):  # came by the surface
        calls[k] = (k + 0.02, OTHER)
    assert set(held(calls)) == {""}


def test_a_direction_that_keeps_jumping_at_the_transmitters_own_pace_is_named_as_it_is() -> None:
    said = held([(float(k), OTHER if k % 3 == 1 else OURS) for k in range(20)])
    assert said[-1] == PLACES_TEXT


def test_two_are_told_by_pulses_that_follow_too_soon() -> None:
    said = held(in_turn())
    assert said[:3] == ["", "", ""]
    assert set(said[4:]) == {TWO_TEXT}


def test_slow_transmitters_are_told_too() -> None:
    said = held([(5.0 * at_s, azimuth) for at_s, azimuth in in_turn()])
    assert set(said[4:]) == {TWO_TEXT}


def test_the_one_where_ours_should_be_goes_on() -> None:
    said = held(in_turn(), Expected(toward(OURS + 0.1), math.radians(3.0)))
    assert said[4:] == ["", OTHER_TEXT] * 8
    unsure = held(in_turn(), Expected(toward(OURS + 0.1), math.radians(40.0)))
    assert set(unsure[4:]) == {TWO_TEXT}


def test_neither_is_taken_where_both_or_none_fits() -> None:
    for azimuth in (-1.0, 0.5 * (OURS + OTHER)):
        assert set(held(in_turn(), Expected(toward(azimuth), math.radians(3.0)))[6:]) == {TWO_TEXT}


def test_a_lone_wrong_one_is_held_while_it_contradicts() -> None:
    sure = Expected(toward(OURS + 1.0), math.radians(4.0))
    said = held([(float(k), OURS) for k in range(8)], sure)
    assert said == ["", "", *[WRONG_TEXT] * 6]
    unsure = Expected(toward(OURS + 1.0), math.radians(25.0))
    assert set(held([(float(k), OURS) for k in range(8)], unsure)) == {""}


def test_a_single_pulse_off_is_the_filters_to_judge() -> None:
    calls = [(float(k), OURS) for k in range(12)]
    calls[5] = (5.0, OTHER)
    assert set(held(calls, Expected(toward(OURS), math.radians(3.0)))) == {""}


def test_passing_close_by_is_no_second_transmitter() -> None:
    calls = [(float(k), math.atan2(3.0, 10.0 - k)) for k in range(20)]
    assert set(held(calls, range_m=4.0)) == {""}


def test_what_ours_said_is_kept_apart_from_what_the_other_said() -> None:
    callers = Callers()
    expected = Expected(toward(OURS), math.radians(3.0))
    for k, (at_s, azimuth) in enumerate(in_turn()):
        message = AcousticMessage(at_s, at_s, 0, b"ours" if azimuth == OURS else b"other") if k > 15 else None
        callers.hear(at_s, toward(azimuth), True, 30.0, expected, message)
    assert callers.ours is not None
    assert callers.ours.message is not None
    assert callers.ours.message.payload == b"ours"
