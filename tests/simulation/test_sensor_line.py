import math

import pytest

from bluerov_slam.simulation.sensor_line import SensorLine

BYTE_S = 10 / 9600


def test_messages_pass_one_behind_the_other_at_the_pace_of_the_line() -> None:
    line = SensorLine(9600)
    assert line.next_s == math.inf
    line.send(b"12345", 1.0)
    line.send(b"678", 1.0)
    passed = []
    while line.next_s < math.inf:
        passed.append((line.next_s, line.pop()))
    assert passed == [(pytest.approx(1.0 + 5 * BYTE_S), b"12345"), (pytest.approx(1.0 + 8 * BYTE_S), b"678")]


def test_a_message_that_is_ready_earlier_goes_first() -> None:
    line = SensorLine(9600)
    line.send(b"later", 2.0)
    line.send(b"sooner", 1.0)
    assert [line.pop(), line.pop()] == [b"sooner", b"later"]


def test_a_sensor_that_falls_silent_leaves_the_beginning_of_its_message() -> None:
    line = SensorLine(9600)
    line.send(b"12345", 1.0)
    line.send(b"never", 1.0)
    assert line.cut(1.0 + 2.5 * BYTE_S) == b"12"
    assert line.next_s == math.inf
    assert line.cut(2.0) == b""


def test_a_listener_who_comes_late_gets_the_end_of_the_message() -> None:
    line = SensorLine(9600)
    for message in (b"gone", b"12345", b"whole"):
        line.send(message, 1.0)
    line.skip(1.0 + 6.5 * BYTE_S)
    assert line.next_s == pytest.approx(1.0 + 9 * BYTE_S)
    assert line.pop() == b"345"
    assert line.next_s == pytest.approx(1.0 + 14 * BYTE_S)
    assert line.pop() == b"whole"


def test_a_new_rate_holds_from_the_next_message_on() -> None:
    line = SensorLine(9600)
    line.send(b"12345", 0.0)
    line.pop()
    line.baud = 96_000
    line.send(b"12345", 0.0)
    assert line.next_s == pytest.approx(5.5 * BYTE_S)
