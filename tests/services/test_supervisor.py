import asyncio
import os
import signal
import sys

import pytest

from bluerov_slam.services import supervisor
from bluerov_slam.services.supervisor import ChildSpec, Supervisor
from patience import PATIENCE_S

# Notes its process number, then waits until it is told to stop.
WAITS = """
import os, signal, sys
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
open(sys.argv[1], "a").write(f"{os.getpid()}\\n")
signal.pause()
"""
CRASHES_THEN_REFUSES = """
import os, sys
first = not os.path.exists(sys.argv[1])
open(sys.argv[1], "a").write(f"{os.getpid()}\\n")
sys.exit(70 if first else 1)
"""
STUBBORN = WAITS.replace("lambda *_: sys.exit(0)", "signal.SIG_IGN")


def child(tmp_path, name="child", code=WAITS):
    return ChildSpec(name, (sys.executable, "-c", code, str(tmp_path / name)))


async def pids(path, count):
    async with asyncio.timeout(PATIENCE_S):
        while not path.exists() or len(path.read_text().split()) < count:
            await asyncio.sleep(0.01)
    return [int(word) for word in path.read_text().split()]


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


async def at_once(_seconds):
    await asyncio.sleep(0)


async def test_stops_every_child_when_asked(tmp_path):
    stop = asyncio.Event()
    running = asyncio.create_task(Supervisor([child(tmp_path, "a"), child(tmp_path, "b")]).run(stop))
    [first], [second] = await pids(tmp_path / "a", 1), await pids(tmp_path / "b", 1)
    stop.set()
    async with asyncio.timeout(PATIENCE_S):
        assert await running == 0
    assert not is_running(first)
    assert not is_running(second)


async def test_a_crashed_child_is_started_again_and_the_others_stay(tmp_path):
    stop = asyncio.Event()
    keeper = Supervisor([child(tmp_path, "a"), child(tmp_path, "b")], sleep=at_once)
    running = asyncio.create_task(keeper.run(stop))
    [first], [other] = await pids(tmp_path / "a", 1), await pids(tmp_path / "b", 1)
    os.kill(first, signal.SIGKILL)
    _, second = await pids(tmp_path / "a", 2)
    assert second != first
    assert is_running(other)
    assert keeper.restarts == {"a": 1, "b": 0}
    stop.set()
    async with asyncio.timeout(PATIENCE_S):
        assert await running == 0


async def test_pauses_grow_while_a_child_crashes_at_once(monkeypatch):
    monkeypatch.setattr(supervisor, "SETTLED_AFTER_S", 1e6)  # a slow start of Python is no settled child
    stop, pauses = asyncio.Event(), []

    async def note(seconds):
        pauses.append(seconds)
        if len(pauses) == 6:
            stop.set()

    crashes = ChildSpec("crashes", (sys.executable, "-S", "-c", "import os; os._exit(3)"))
    async with asyncio.timeout(PATIENCE_S):
        assert await Supervisor([crashes], sleep=note).run(stop) == 0
    assert pauses[:6] == [1.0, 2.0, 4.0, 8.0, 10.0, 10.0]


async def test_a_child_that_cannot_start_for_a_named_reason_ends_everything(tmp_path):
    refuses = ChildSpec("refuses", (sys.executable, "-S", "-c", "import sys; sys.exit(1)"))
    async with asyncio.timeout(PATIENCE_S):
        assert await Supervisor([child(tmp_path, "a"), refuses]).run(asyncio.Event()) == 1
    if (tmp_path / "a").exists():  # it may have been stopped before it noted its number
        assert not any(is_running(int(pid)) for pid in (tmp_path / "a").read_text().split())


async def test_a_slow_start_does_not_make_a_named_reason_a_crash(tmp_path, monkeypatch):
    monkeypatch.setattr(supervisor, "SETTLED_AFTER_S", 0.0)  # as on a busy Raspberry Pi: it takes longer than that
    refuses = ChildSpec("refuses", (sys.executable, "-S", "-c", "import sys; sys.exit(1)"))
    async with asyncio.timeout(PATIENCE_S):
        assert await Supervisor([refuses]).run(asyncio.Event()) == 1


async def test_once_it_ran_a_child_is_started_again_whatever_it_says(tmp_path, monkeypatch):
    monkeypatch.setattr(supervisor, "SETTLED_AFTER_S", 0.0)
    stop = asyncio.Event()
    running = asyncio.create_task(Supervisor([child(tmp_path, code=CRASHES_THEN_REFUSES)], sleep=at_once).run(stop))
    await pids(tmp_path / "child", 3)
    stop.set()
    async with asyncio.timeout(PATIENCE_S):
        assert await running == 0


async def test_a_child_that_will_not_stop_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(supervisor, "STOP_TIMEOUT_S", 0.2)
    stop = asyncio.Event()
    running = asyncio.create_task(Supervisor([child(tmp_path, code=STUBBORN)]).run(stop))
    [pid] = await pids(tmp_path / "child", 1)
    stop.set()
    async with asyncio.timeout(PATIENCE_S):
        assert await running == 0
    assert not is_running(pid)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_signals_are_turned_into_an_event(number):
    with supervisor.stop_signals() as stop:
        os.kill(os.getpid(), number)
        async with asyncio.timeout(PATIENCE_S):
            await stop.wait()
