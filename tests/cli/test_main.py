import click
import pytest

from bluerov_slam.cli import main
from bluerov_slam.errors import ConfigError


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (ConfigError("serial.baud = 5"), 1, "bluerov-slam: serial.baud = 5\n"),
        (ZeroDivisionError("ours"), 70, "Traceback"),
    ],
)
def test_a_named_reason_and_a_fault_of_ours_end_with_different_codes(monkeypatch, capsys, error, code, text):
    @click.command()
    def fails():
        raise error

    monkeypatch.setattr(main, "cli", lambda: fails(args=[], standalone_mode=True))
    with pytest.raises(SystemExit) as ended:
        main.main()
    assert ended.value.code == code
    assert capsys.readouterr().err.startswith(text)
