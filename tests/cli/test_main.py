import os
import subprocess
import sys

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


@pytest.mark.parametrize(("given", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_linear_algebra_gets_one_thread_unless_told_otherwise(given, threads):
    told = {key: value for key, value in os.environ.items() if key not in main.THREAD_COUNTS} | given
    code = (
        "import os, sys; import bluerov_slam.cli.main as m; assert 'numpy' not in sys.modules\n"
        "m.cli = lambda: print(os.environ['OPENBLAS_NUM_THREADS']); m.main()"
    )
    output = subprocess.run([sys.executable, "-c", code], env=told, capture_output=True, text=True, check=True).stdout
    assert output.strip() == threads
