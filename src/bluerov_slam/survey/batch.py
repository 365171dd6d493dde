"""Runs independent jobs on all processors, or on a cluster: the only module that knows of Dask."""

from __future__ import annotations

import logging
import signal
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from bluerov_slam.errors import ConfigError, ExpectedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Item = TypeVar("Item")
Result = TypeVar("Result")

_CLOSE_TIMEOUT_S = 10.0
_CONNECT_TIMEOUT_S = 20.0
_LOOPBACK = "127.0.0.1"


class BatchError(ExpectedError):
    """Jobs of a batch could not be run."""


def run_batch(
    function: Callable[[Item], Result], items: Sequence[Item], workers: int, scheduler: str | None = None
) -> Iterator[tuple[Item, Result]]:
    """Pairs of item and result as they are ready, in any order.

    `function` and the items are pickled: a function of a module. With `scheduler` ("tcp://host:8786") its cluster does
    the work and must have this package installed; otherwise `workers` processes of this machine. An exception of a job
    is raised here and ends the batch; so does leaving the iteration, also by Ctrl-C: the workers are stopped.
    """
    try:
        from distributed import Client, LocalCluster, as_completed
    except ImportError as error:
        raise BatchError("Dask is not installed: pip install 'bluerov-slam[survey]'") from error
    if workers < 1:
        raise ConfigError(f"{workers} workers, expected at least 1")
    cluster = None
    if scheduler is None:
        with _deaf_to_ctrl_c():
            cluster = LocalCluster(
                n_workers=min(workers, max(1, len(items))),
                threads_per_worker=1,
                processes=True,
                host=_LOOPBACK,
                dashboard_address=f"{_LOOPBACK}:0",
                memory_limit=None,
                silence_logs=logging.ERROR,
            )
    try:
        try:
            client = Client(cluster if scheduler is None else scheduler, timeout=_CONNECT_TIMEOUT_S)
        except OSError as error:
            raise BatchError(f"no Dask scheduler answers at {scheduler}: {error}") from error
        futures = []
        try:
            # Impure: the same item twice is two jobs.
            futures = client.map(function, items, pure=False, batch_size=None, retries=0)
            of_future = {future.key: item for future, item in zip(futures, items, strict=True)}
            for future in as_completed(futures):
                yield of_future[future.key], future.result()
        finally:
            client.cancel(futures, force=True)
            client.close(timeout=_CLOSE_TIMEOUT_S)
    finally:
        if cluster is not None:
            cluster.close(timeout=_CLOSE_TIMEOUT_S)


def run_counted(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    scheduler: str | None,
    say: Callable[[str], None],
) -> list[tuple[Item, Result]]:
    """All of `run_batch`, in any order; `say` hears of every item that is ready, by what `str` makes of it."""
    progress = Progress(len(items), say)
    found = []
    for item, result in run_batch(function, items, workers, scheduler):
        found.append((item, result))
        progress.done(str(item))
    return found


class Progress:
    """One line for each finished job: how many of how many, and how long the rest may take."""

    def __init__(self, total: int, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._total = total
        self._say = say
        self._clock = clock
        self._started_s = clock()
        self._done = 0

    def done(self, what: str) -> None:
        """One job more is finished."""
        self._done += 1
        took_s = self._clock() - self._started_s
        left_s = took_s / self._done * (self._total - self._done)
        self._say(f"[{self._done}/{self._total}] {what}; {took_s:.0f} s so far, about {left_s:.0f} s left")


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Processes started inside never see a terminal's Ctrl-C: it is for the one that started them to end them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
