"""Keeps the navigation worker running: hands it records, takes its answers, begins it anew when it crashed or hangs.

One request is under way at a time, and what arrives meanwhile waits in one bounded queue: a worker that is too slow
loses the oldest records, counted, and can never fall behind by more than that queue.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import os
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from bluerov_slam.errors import CommandError
from bluerov_slam.records import (
    AcousticMessage,
    AcousticRecord,
    CtdSample,
    GpsFix,
    ImuBurst,
    PositionFix,
    SensorSample,
    TimeDifferenceReading,
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleMotionDelta,
    VehicleRange,
    VehicleServoOutput,
)
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.navigation_messages import LENGTH, Ask, Done, Reply, Setup, Work, body_length, pack, unpack
from bluerov_slam.sinks.bounded_queue import BoundedQueue

_log = logging.getLogger(__name__)

# Ten seconds of everything: as much as comes while the worker starts anew.
QUEUE_LENGTH: Final = 600
# So many records are a few milliseconds of work: answers stay prompt while it catches up.
BATCH: Final = 64
IDLE_S: Final = 1.0
START_TIMEOUT_S: Final = 60.0
# A request takes milliseconds; a Raspberry Pi that swaps may need seconds.
HANGS_AFTER_S: Final = 20.0
ASK_TIMEOUT_S: Final = 10.0
STOP_TIMEOUT_S: Final = 2.0
BACKOFF_FIRST_S: Final = 0.5
BACKOFF_LAST_S: Final = 30.0
SETTLED_AFTER_S: Final = 30.0
NAVIGATION_RECORDS: Final = (
    ImuBurst, SensorSample, CtdSample, GpsFix, PositionFix, VehicleAttitude, VehicleServoOutput, VehicleBattery,
    VehicleMotionDelta, VehicleDepth, VehicleRange, TimeDifferenceReading, AcousticRecord, AcousticMessage,
)  # fmt: skip


class WorkerState(StrEnum):
    """What the worker is doing."""

    OFF = "off"
    STARTING = "starting"
    RUNNING = "running"
    RESTARTING = "restarting"


@dataclass(frozen=True, slots=True)
class WorkerFacts:
    """The worker as its keeper sees it. `error`: how it ended last, None once it runs well again."""

    state: WorkerState
    pid: int | None
    restarts: int
    dropped: int
    waiting: int
    error: str | None


class NavigationProcess:
    """`start`, then every answer goes to `on_done` until `stop`; `on_change` is called when the state changes."""

    def __init__(
        self,
        hub: Hub,
        setup: Callable[[], Setup],
        on_done: Callable[[Done], None],
        on_change: Callable[[], None],
        now_s: Callable[[], float],
        *,
        hangs_after_s: float = HANGS_AFTER_S,
        backoff_first_s: float = BACKOFF_FIRST_S,
    ) -> None:
        self._hub = hub
        self._setup = setup
        self._on_done = on_done
        self._on_change = on_change
        self._now_s = now_s
        self._hangs_after_s = hangs_after_s
        self._backoff_first_s = backoff_first_s
        self._state = WorkerState.OFF
        self._error: str | None = None
        self._restarts = 0
        self._dropped_before = 0
        self._pid: int | None = None
        self._queue: BoundedQueue[Any] | None = None
        self._task: asyncio.Task[None] | None = None
        self._numbers = itertools.count(1)
        self._asks: list[Ask] = []
        self._waiting: dict[int, asyncio.Future[Reply]] = {}

    def facts(self) -> WorkerFacts:
        """State and counters."""
        queue = self._queue
        return WorkerFacts(
            self._state,
            self._pid,
            self._restarts,
            self._dropped_before + (queue.dropped if queue is not None else 0),
            len(queue) if queue is not None else 0,
            self._error,
        )

    def is_behind(self) -> bool:
        """Whether a replay should wait for it; a link cannot."""
        alive = self._state in (WorkerState.STARTING, WorkerState.RUNNING)
        return alive and self._queue is not None and len(self._queue) > QUEUE_LENGTH // 2

    def start(self) -> None:
        """Begin, if it is not running already."""
        if self._task is not None:
            return
        self._queue = self._hub.open_queue("navigation", QUEUE_LENGTH, *NAVIGATION_RECORDS)
        self._error = None
        self._change(WorkerState.STARTING)
        self._task = asyncio.get_running_loop().create_task(self._keep(), name="navigation")

    async def stop(self) -> None:
        """Let it save its state, and end it."""
        if self._task is None:
            return
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        self._task = None
        if self._queue is not None:
            self._dropped_before += self._queue.dropped
            self._hub.close_queue(self._queue)
            self._queue = None
        self._refuse_asks("navigation was switched off")
        self._change(WorkerState.OFF)

    async def ask(self, action: str, arguments: Mapping[str, Any]) -> Reply:
        """Have the navigator do something. Raises CommandError when it cannot be asked or does not answer."""
        if self._queue is None:
            raise CommandError("navigation is switched off; switch it on under Settings, navigation")
        if self._state is not WorkerState.RUNNING:
            raise CommandError("the estimator is just starting; try again in a few seconds")
        ask = Ask(next(self._numbers), action, arguments)
        answer: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        self._waiting[ask.number] = answer
        self._asks.append(ask)
        self._queue.put(None)  # wakes it; of no matter if it is lost in a full queue
        try:
            async with asyncio.timeout(ASK_TIMEOUT_S):
                return await answer
        except TimeoutError:
            raise CommandError("the estimator did not answer; try again") from None
        finally:
            self._waiting.pop(ask.number, None)

    async def _keep(self) -> None:
        backoff_s = self._backoff_first_s
        loop = asyncio.get_running_loop()
        while True:
            begun_s = loop.time()
            self._error = await self._live_once() or "it ended by itself"
            self._restarts += 1
            self._refuse_asks("the estimator ended; it is starting anew")
            settled = loop.time() - begun_s >= SETTLED_AFTER_S
            backoff_s = self._backoff_first_s if settled else min(2.0 * backoff_s, BACKOFF_LAST_S)
            _log.error("the navigation worker ended (%s); starting it again in %g s", self._error, backoff_s)
            self._change(WorkerState.RESTARTING)
            await asyncio.sleep(backoff_s)

    async def _live_once(self) -> str | None:
        """From its start to its end; how it ended."""
        try:
            process = await asyncio.create_subprocess_exec(
                *_COMMAND, str(os.getpid()), stdin=PIPE, stdout=PIPE, env=_environment()
            )
        except OSError as error:
            return f"it cannot be started: {error.strerror or error}"
        self._pid = process.pid
        try:
            return await self._converse(process)
        except TimeoutError:
            return f"it did not answer for {self._hangs_after_s:g} s"
        except (asyncio.IncompleteReadError, ConnectionError):
            return None if await _ended(process) is None else _how(process.returncode)
        except asyncio.CancelledError:
            await _end_in_order(process)
            raise
        finally:
            await _kill(process)
            self._pid = None

    async def _converse(self, process: Process) -> str:
        assert process.stdin is not None
        assert process.stdout is not None
        await self._exchange(process, self._setup(), START_TIMEOUT_S)
        self._change(WorkerState.RUNNING)
        while True:
            work = await self._next_work()
            await self._exchange(process, work, self._hangs_after_s)
            self._error = None

    async def _exchange(self, process: Process, message: Setup | Work, timeout_s: float) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        async with asyncio.timeout(timeout_s):
            process.stdin.write(pack(message))
            await process.stdin.drain()
            header = await process.stdout.readexactly(LENGTH.size)
            done: Done = unpack(await process.stdout.readexactly(body_length(header)))
        for reply in done.replies:
            waiting = self._waiting.get(reply.number)
            if waiting is not None and not waiting.done():
                waiting.set_result(reply)
        try:
            self._on_done(done)
        except Exception:  # a fault in what follows must not end a worker that is well
            _log.exception("an answer of the navigation worker could not be used")

    async def _next_work(self) -> Work:
        assert self._queue is not None
        try:
            async with asyncio.timeout(IDLE_S):
                items = await self._queue.get_many(BATCH)
        except TimeoutError:
            return Work(expire_s=self._now_s())
        asks, self._asks = tuple(self._asks), []
        return Work(tuple(item for item in items if item is not None), asks)

    def _refuse_asks(self, why: str) -> None:
        self._asks = []
        for number, waiting in tuple(self._waiting.items()):
            if not waiting.done():
                waiting.set_result(Reply(number, False, why))

    def _change(self, state: WorkerState) -> None:
        if state is not self._state:
            self._state = state
            self._on_change()


_COMMAND: Final = (sys.executable, "-m", "bluerov_slam.services.navigation_worker")


def _environment() -> dict[str, str]:
    # Matrices of thirty rows gain nothing from threads, and each thread costs memory and wakes a core.
    return os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}


async def _end_in_order(process: Process) -> None:
    """Its input's end tells it to save and go."""
    if process.stdin is not None:
        process.stdin.close()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(STOP_TIMEOUT_S):
            await process.wait()


async def _ended(process: Process) -> int | None:
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(STOP_TIMEOUT_S):
            return await process.wait()
    return None


async def _kill(process: Process) -> None:
    if process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _how(code: int | None) -> str:
    if code is None:
        return "it ended"
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}; its log has the details"
