"""Runs services as child processes: starts them, restarts one that crashed, stops them all together."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import signal
from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from bluerov_slam.services.parent_death import end_with_parent

_log = logging.getLogger(__name__)

BACKOFF_FIRST_S: Final = 0.5
BACKOFF_LAST_S: Final = 10.0
# A crash after so long is not one of the start: the pauses begin anew.
SETTLED_AFTER_S: Final = 5.0
# A container gets ten seconds; recordings are closed within two.
STOP_TIMEOUT_S: Final = 4.0
# What a child ends with that could not start for a reason it named. How long it took to find out says nothing: a busy
# Raspberry Pi needs longer than that to import a service.
EXPECTED_FAILURE: Final = 1


class Service(Protocol):
    """What `serve` needs."""

    async def start(self) -> None: ...
    async def stop(self) -> None: ...


@dataclass(frozen=True, slots=True)
class ChildSpec:
    """One child process."""

    name: str
    arguments: tuple[str, ...]


async def serve(service: Service) -> None:
    """Start a service, wait for SIGINT or SIGTERM, stop it."""
    with stop_signals() as stop:
        await service.start()
        # What exists now stays: the collector need not walk through it again and again.
        gc.collect()
        gc.freeze()
        try:
            await stop.wait()
        finally:
            await service.stop()


@contextlib.contextmanager
def stop_signals() -> Iterator[asyncio.Event]:
    """An event that SIGINT and SIGTERM set."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    numbers = (signal.SIGINT, signal.SIGTERM)
    for number in numbers:
        loop.add_signal_handler(number, stop.set)
    try:
        yield stop
    finally:
        for number in numbers:
            loop.remove_signal_handler(number)


class Supervisor:
    """`run` returns the exit code: 0 after a signal, 1 when a child could not start for a reason it named."""

    def __init__(
        self, children: Sequence[ChildSpec], *, sleep: Callable[[float], Awaitable[None]] = asyncio.sleep
    ) -> None:
        self.restarts: dict[str, int] = {child.name: 0 for child in children}
        self._children = children
        self._sleep = sleep
        self._failed = asyncio.Event()

    async def run(self, stop: asyncio.Event) -> int:
        """Keep every child running until `stop` is set."""
        keepers = [asyncio.create_task(self._keep(child), name=child.name) for child in self._children]
        endings = [asyncio.create_task(stop.wait()), asyncio.create_task(self._failed.wait())]
        await asyncio.wait(endings, return_when=asyncio.FIRST_COMPLETED)
        for task in [*keepers, *endings]:
            task.cancel()
        await asyncio.gather(*keepers, *endings, return_exceptions=True)
        return EXPECTED_FAILURE if self._failed.is_set() else 0

    async def _keep(self, child: ChildSpec) -> None:
        backoff_s = BACKOFF_FIRST_S
        ever_settled = False
        while True:
            started_s = asyncio.get_running_loop().time()
            code = await _run_once(child)
            could_not_start = code == EXPECTED_FAILURE
            settled = not could_not_start and asyncio.get_running_loop().time() - started_s >= SETTLED_AFTER_S
            ever_settled = ever_settled or settled
            if could_not_start and not ever_settled:
                _log.error("%s could not start; stopping", child.name)
                self._failed.set()
                return
            backoff_s = BACKOFF_FIRST_S if settled else min(2 * backoff_s, BACKOFF_LAST_S)
            self.restarts[child.name] += 1
            _log.error("%s ended (%s); starting it again in %g s", child.name, _describe(code), backoff_s)
            await self._sleep(backoff_s)


async def _run_once(child: ChildSpec) -> int:
    """Run a child to its end; cancelled, it is asked to stop, and killed if it does not."""
    process = await asyncio.create_subprocess_exec(*child.arguments, preexec_fn=end_with_parent)
    try:
        return await process.wait()
    except asyncio.CancelledError:
        await _stop(process)
        raise


async def _stop(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
        try:
            async with asyncio.timeout(STOP_TIMEOUT_S):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()


def _describe(code: int) -> str:
    return f"exit code {code}" if code >= 0 else signal.Signals(-code).name
