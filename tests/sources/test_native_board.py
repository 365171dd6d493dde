import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bluerov_slam.errors import LinkError
from bluerov_slam.simulation.board import BoardSettings, BootInfo
from bluerov_slam.sources import native_board
from bluerov_slam.sources.native_board import NativeBoard


def is_running(pid: int) -> bool:
    """Whether this process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_missing_program_is_named_with_the_cure(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="make firmware"):
        NativeBoard(tmp_path / "brov-firmware")


def test_a_file_that_is_no_program_is_an_error(tmp_path: Path) -> None:
    program = tmp_path / "brov-firmware"
    program.write_bytes(b"\x7fELF of another machine")
    program.chmod(0o755)
    with pytest.raises(LinkError, match="cannot be started"):
        NativeBoard(program)


def test_a_program_that_dies_says_how_and_why() -> None:
    board = NativeBoard(Path("/bin/sh"), ("-c", "read -r line; echo out of luck >&2; exit 3"))
    board.boot(BootInfo(), BoardSettings())
    board.feed(0, b"\n" * 60_000, 0)
    with pytest.raises(LinkError, match="code 3: out of luck"):
        board.run(1000)
    with pytest.raises(LinkError, match="ended"):
        board.run(2000)


def test_a_program_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_board, "PATIENCE_S", 0.2)
    monkeypatch.setattr(native_board, "_END_PATIENCE_S", 0.2)
    board = NativeBoard(Path("/bin/sleep"), ("1000",))
    with pytest.raises(LinkError, match="has not answered"):
        board.run(1000)
    assert not is_running(board.pid)


def test_another_program_is_no_firmware() -> None:
    board = NativeBoard(Path("/bin/cat"), ())
    with pytest.raises(LinkError, match="is not a native firmware"):
        board.run(1000)
    board.close()


def test_nothing_is_left_of_a_program_that_was_closed_or_forgotten() -> None:
    closed, forgotten = NativeBoard(Path("/bin/cat"), ()), NativeBoard(Path("/bin/cat"), ())
    pids = closed.pid, forgotten.pid
    closed.close()
    closed.close()
    del forgotten
    assert not any(is_running(pid) for pid in pids)


def test_the_program_ends_with_a_parent_that_was_killed() -> None:
    script = (
        "import sys, time; from pathlib import Path; from bluerov_slam.sources.native_board import NativeBoard\n"
        "board = NativeBoard(Path('/bin/cat'), ()); print(board.pid, flush=True); time.sleep(1000)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        assert is_running(pid)
        os.kill(parent.pid, signal.SIGKILL)
    deadline_s = time.monotonic() + 10.0
    while is_running(pid):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
