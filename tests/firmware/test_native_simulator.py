"""`bluerov-slam simulate` on the native firmware: it says so, and neither outlives the other."""

import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from firmware_build import built

PATIENCE_S = 30.0


@contextlib.contextmanager
def simulating(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], psutil.Process, list[str]]]:
    """The simulator once its port is there, the firmware it runs, and the lines that it said."""
    command = [sys.executable, "-u", "-m", "bluerov_slam", "simulate", "--firmware", "native"]
    with subprocess.Popen(
        [*command, "--link", str(tmp_path / "esp32")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as simulator:
        try:
            assert simulator.stdout is not None
            lines = []
            for line in simulator.stdout:
                lines.append(line.strip())
                if "serial port" in line:
                    break
            [firmware] = psutil.Process(simulator.pid).children()
            yield simulator, firmware, lines
        finally:
            simulator.kill()


@pytest.fixture(autouse=True)
def program(monkeypatch: pytest.MonkeyPatch) -> Path:
    path = built("brov-firmware")
    monkeypatch.setenv("BLUEROV_SLAM_FIRMWARE", str(path))
    return path


def test_says_that_the_board_is_the_native_firmware(tmp_path: Path, program: Path) -> None:
    with simulating(tmp_path) as (_, firmware, lines):
        assert f"SIMULATED: board: native firmware core, {program}" in lines
        assert firmware.cmdline() == [str(program), "--lockstep"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_the_firmware_ends_with_the_simulator(tmp_path: Path, number: int) -> None:
    with simulating(tmp_path) as (simulator, firmware, _):
        simulator.send_signal(number)
        assert simulator.wait(PATIENCE_S) == (-number if number == signal.SIGKILL else 0)
        psutil.wait_procs([firmware], PATIENCE_S)
        assert not firmware.is_running()


def test_a_firmware_that_dies_ends_the_simulator_with_one_clear_line(tmp_path: Path, program: Path) -> None:
    with simulating(tmp_path) as (simulator, firmware, _):
        firmware.kill()
        _, complaints = simulator.communicate(timeout=PATIENCE_S)
        assert simulator.returncode == 1
        assert complaints == f"bluerov-slam: the native firmware {program} has ended with code -9\n"
    assert not (tmp_path / "esp32").is_symlink()
