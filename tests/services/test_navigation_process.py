"""The worker as a real process: its death, its silence, its queue, its state on disk."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from bluerov_slam.errors import CommandError
from bluerov_slam.pipeline.navigator import NavigatorOptions
from bluerov_slam.records import NavMode
from bluerov_slam.services import navigation_process
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.navigation_messages import Done, Setup
from bluerov_slam.services.navigation_process import NavigationProcess, WorkerState
from patience import PATIENCE_S
from plausible_navigator import HANGING_SATELLITES, KILLER_SATELLITES
from samples import gps_fix, sensor_sample

PLAUSIBLE = "plausible_navigator:PlausibleNavigator"


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))


class Rig:
    """A worker, the hub that feeds it, and everything it answered."""

    def __init__(self, state_file: Path | None, navigator: str = PLAUSIBLE, boot: str = "boot", **options: Any) -> None:
        self.hub = Hub()
        self.answers: list[Done] = []
        self.changes: list[WorkerState] = []
        self.at_s = 100.0
        setup = Setup(navigator, NavigatorOptions(), None if state_file is None else str(state_file), boot)
        self.process = NavigationProcess(
            self.hub, lambda: setup, self.answers.append, self._changed, time.monotonic,
            **{"backoff_first_s": 0.01} | options,
        )  # fmt: skip

    def _changed(self) -> None:
        self.changes.append(self.process.facts().state)

    @property
    def states(self) -> list[Any]:
        return [placed.state for done in self.answers for placed in done.states]

    def say(self, satellites: int = 9, latitude_deg: float | None = 54.0) -> None:
        """One fix and one sample behind it."""
        self.at_s += 0.25
        self.hub.publish(gps_fix(measured_s=self.at_s, latitude_deg=latitude_deg, satellites=satellites))
        self.hub.publish(sensor_sample(measured_s=self.at_s, arrived_s=self.at_s))

    async def until(self, condition: Any) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                await asyncio.sleep(0.005)

    async def run(self) -> None:
        self.process.start()
        await self.until(lambda: self.process.facts().state is WorkerState.RUNNING)


@contextlib.asynccontextmanager
async def running(state_file: Path | None = None, **options: Any):
    rig = Rig(state_file, **options)
    await rig.run()
    try:
        yield rig
    finally:
        await rig.process.stop()


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "Z" not in Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]


async def test_records_go_in_and_states_come_out_in_order():
    async with running() as rig:
        for _ in range(20):
            rig.say()
        await rig.until(lambda: len(rig.states) == 20)
        times = [state.measured_s for state in rig.states]
        assert times == sorted(times)
        assert rig.states[-1].mode is NavMode.AIDED
        assert rig.process.facts().dropped == 0
        fixes = [fix for done in rig.answers for fix in done.fixes]
        assert [fix.accepted for fix in fixes] == [True] * 20


async def test_a_fix_far_away_is_told_as_rejected():
    async with running() as rig:
        rig.say()
        rig.say(latitude_deg=55.0)
        await rig.until(lambda: sum(len(done.fixes) for done in rig.answers) == 2)
        assert [fix.accepted for done in rig.answers for fix in done.fixes] == [True, False]


async def test_the_worker_yields_to_everything_else():
    async with running() as rig:
        assert os.getpriority(os.PRIO_PROCESS, rig.process.facts().pid) > os.getpriority(os.PRIO_PROCESS, 0)


async def test_a_crash_is_told_and_it_goes_on_from_the_saved_state(tmp_path):
    state_file = tmp_path / "navigation.json"
    async with running(state_file) as rig:
        first = rig.process.facts().pid
        rig.say()
        await rig.until(lambda: rig.states)
        await rig.until(state_file.exists)
        rig.say(satellites=KILLER_SATELLITES)
        await rig.until(lambda: WorkerState.RESTARTING in rig.changes)
        assert rig.process.facts().error == "killed by SIGKILL"
        await rig.until(lambda: rig.process.facts().state is WorkerState.RUNNING)
        facts = rig.process.facts()
        assert facts.restarts == 1
        assert facts.pid != first
        assert any(done.resumed and "saved position" in done.resumed for done in rig.answers)
        seen = len(rig.states)
        rig.say(latitude_deg=None)
        await rig.until(lambda: len(rig.states) > seen)
        assert rig.states[-1].reset_counter == 1
        assert rig.states[-1].position_ned_m is not None
        await rig.until(lambda: rig.process.facts().error is None)


async def test_a_worker_that_hangs_is_ended_and_begun_anew():
    async with running(hangs_after_s=0.5) as rig:
        rig.say(satellites=HANGING_SATELLITES)
        await rig.until(lambda: rig.process.facts().restarts == 1)
        assert "did not answer" in str(rig.process.facts().error)
        await rig.until(lambda: rig.process.facts().state is WorkerState.RUNNING)
        rig.say()
        await rig.until(lambda: rig.states)


async def test_one_that_cannot_even_start_is_tried_again_with_longer_pauses():
    rig = Rig(None, navigator="no_such_module:Nothing")
    rig.process.start()
    await rig.until(lambda: rig.process.facts().restarts >= 2)
    facts = rig.process.facts()
    assert facts.state is WorkerState.RESTARTING
    assert "exit code 1" in str(facts.error)
    with pytest.raises(CommandError, match="just starting"):
        await rig.process.ask("zero_depth", {})
    await rig.process.stop()
    assert rig.process.facts().state is WorkerState.OFF


async def test_a_flood_loses_the_oldest_and_counts_them():
    async with running(hangs_after_s=30.0) as rig:
        for _ in range(navigation_process.QUEUE_LENGTH):
            rig.say()
        assert rig.process.facts().dropped > 0
        assert rig.process.facts().waiting == navigation_process.QUEUE_LENGTH
        await rig.until(lambda: rig.process.facts().waiting == 0 and rig.states[-1].measured_s == rig.at_s)


async def test_actions_are_answered_refused_and_survive_a_crash():
    async with running() as rig:
        reply = await rig.process.ask("zero_depth", {})
        assert (reply.ok, reply.message) == (True, "zero_depth: done")
        reply = await rig.process.ask("set_origin", {})
        assert (reply.ok, reply.message) == (False, "no position yet: give latitude and longitude")
        reply = await rig.process.ask("start_calibration", {"kind": "nonsense"})
        assert (reply.ok, "nonsense" in reply.message) == (False, True)
        rig.say(satellites=KILLER_SATELLITES)
        reply = await rig.process.ask("zero_depth", {})
        assert (reply.ok, "ended" in reply.message) == (False, True)
    with pytest.raises(CommandError, match="switched off"):
        await rig.process.ask("zero_depth", {})


async def test_it_is_switched_off_and_on_again_and_nothing_outlives_it(tmp_path):
    state_file = tmp_path / "state" / "navigation.json"
    async with running(state_file) as rig:
        rig.say()
        await rig.until(lambda: rig.states)
        pid = rig.process.facts().pid
        await rig.process.stop()
        assert not is_alive(pid)
        document = json.loads(state_file.read_bytes())
        assert document["navigation"]["position_known"] is True
        assert rig.hub.queues == ()
        await rig.run()
        await rig.until(lambda: any(done.resumed for done in rig.answers))


async def test_after_another_boot_only_calibrations_are_taken_up(tmp_path):
    state_file = tmp_path / "navigation.json"
    async with running(state_file) as rig:
        rig.say()
        await rig.until(lambda: rig.states)
    async with running(state_file, boot="another") as rig:
        rig.say(latitude_deg=None)
        await rig.until(lambda: rig.states)
        assert rig.states[-1].position_ned_m is None
        assert not any(done.resumed for done in rig.answers)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b'{"version": 99}', b'{"version": 1, "navigation": {"at_s": "x"}}']
)
async def test_a_damaged_state_file_is_told_and_left_behind(tmp_path, content):
    state_file = tmp_path / "navigation.json"
    state_file.write_bytes(content)
    async with running(state_file) as rig:
        assert any(done.resumed and "anew" in done.resumed for done in rig.answers)
        rig.say()
        await rig.until(lambda: rig.states)
    assert json.loads(state_file.read_bytes())["navigation"]["position_known"] is True


async def test_a_state_that_cannot_be_saved_is_a_warning_and_it_goes_on(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    async with running(blocked / "navigation.json") as rig:
        rig.say()
        await rig.until(lambda: rig.states)
        await rig.until(lambda: rig.say() or any(done.save_error == "File exists" for done in rig.answers))
        assert (await rig.process.ask("zero_depth", {})).ok
        assert rig.process.facts().restarts == 0


def test_it_ends_with_a_parent_that_was_killed():
    """The parent is a process of its own, killed without warning; its worker must not go on."""
    script = """
import asyncio, sys, time
from bluerov_slam.pipeline.navigator import NavigatorOptions
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.navigation_messages import Setup
from bluerov_slam.services.navigation_process import NavigationProcess
async def main():
    setup = Setup("plausible_navigator:PlausibleNavigator", NavigatorOptions(), None)
    process = NavigationProcess(Hub(), lambda: setup, lambda done: None, lambda: None, time.monotonic)
    process.start()
    while process.facts().state != "running":
        await asyncio.sleep(0.01)
    print(process.facts().pid, flush=True)
    await asyncio.sleep(600)
asyncio.run(main())
"""
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    assert is_alive(worker)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    deadline = time.monotonic() + PATIENCE_S
    while is_alive(worker):
        assert time.monotonic() < deadline, "the worker outlived its parent"
        time.sleep(0.01)
