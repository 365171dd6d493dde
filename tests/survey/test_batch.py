"""Batches on worker processes: results, faults, and an end in the middle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import psutil
import pytest

from bluerov_slam.errors import ConfigError
from bluerov_slam.survey import batch
from bluerov_slam.survey.batch import BatchError, Progress, run_batch

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'bluerov-slam[survey]'")


def test_every_job_is_run_once_in_other_processes() -> None:
    got = dict(run_batch(abs, [-3, 1, 2], workers=2))
    assert got == {-3: 3, 1: 1, 2: 2}


def test_a_fault_of_a_job_is_raised_here() -> None:
    with pytest.raises(ZeroDivisionError):
        list(run_batch((1).__truediv__, [1, 0], workers=1))


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "_CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(BatchError, match=r"tcp://127\.0\.0\.1:1"):
        list(run_batch(abs, [1], workers=1, scheduler="tcp://127.0.0.1:1"))


def test_no_workers_is_a_mistake() -> None:
    with pytest.raises(ConfigError, match="0 workers"):
        next(run_batch(abs, [1], workers=0))


def test_progress_says_how_much_is_left() -> None:
    lines: list[str] = []
    now_s = iter((0.0, 10.0, 20.0))
    progress = Progress(4, lines.append, lambda: next(now_s))
    progress.done("N2 seed 1")
    progress.done("N2 seed 2")
    assert lines == [
        "[1/4] N2 seed 1; 10 s so far, about 30 s left",
        "[2/4] N2 seed 2; 20 s so far, about 20 s left",
    ]


SLEEPER = """
    import signal
    import time
    from bluerov_slam.survey.batch import run_batch

    # Whoever started the tests in the background may have left SIGINT ignored.
    if __name__ == "__main__":
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            for item, _ in run_batch(time.sleep, [0.0, 600.0], workers=2):
                print("done", item, flush=True)
        except KeyboardInterrupt:
            print("stopped", flush=True)
"""


def test_ctrl_c_ends_the_batch_and_its_workers(tmp_path: Path) -> None:
    script = tmp_path / "sleeper.py"
    script.write_text(textwrap.dedent(SLEEPER))
    pipe = subprocess.PIPE
    process = subprocess.Popen([sys.executable, script], stdout=pipe, stderr=pipe, text=True, start_new_session=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "done 0.0\n"
    workers = psutil.Process(process.pid).children(recursive=True)
    assert workers
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    output, faults = process.communicate(timeout=120)
    assert output == "stopped\n"
    assert faults == ""
    assert process.returncode == 0
    deadline_s = time.monotonic() + 60.0
    while any(worker.is_running() for worker in workers) and time.monotonic() < deadline_s:
        time.sleep(0.1)
    assert not any(worker.is_running() for worker in workers)
