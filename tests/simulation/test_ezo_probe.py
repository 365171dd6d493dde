import pytest

from bluerov_slam.simulation.ezo_probe import EzoProbe


def test_shows_everything_as_from_the_factory_and_what_it_is_told() -> None:
    probe = EzoProbe()
    assert probe.line(38_764.0, 35.123) == b"38760,20930,35.12,1.026\r"
    assert probe.receive(b"O,TDS,0\rO,S") == [b"*OK\r"]
    assert probe.receive(b"G,0\rO,S,1\rC,1\r") == [b"*OK\r", b"*OK\r", b"*OK\r"]
    assert probe.line(38_764.0, 35.123) == b"38760,35.12\r"


@pytest.mark.parametrize("command", [b"O,XY,1\r", b"O,EC,2\r", b"O,EC\r", b"\xff\xfe\r", b"\r"])
def test_answers_an_error_to_what_it_does_not_know(command: bytes) -> None:
    probe = EzoProbe(shown=("EC", "S"))
    assert probe.receive(command) == [b"*ER\r"]
    assert probe.line(50.0, 0.1) == b"50.00,0.10\r"
