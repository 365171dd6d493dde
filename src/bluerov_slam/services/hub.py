"""Fan-out of records: cheap subscribers are called at once, the others get a bounded queue each."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bluerov_slam.records import Record
from bluerov_slam.sinks.bounded_queue import BoundedQueue

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Subscriber:
    """One callback and how often it failed."""

    name: str
    callback: Callable[[Any], None]
    record_types: tuple[type, ...]
    errors: int = 0


class Hub:
    """Hands each published record to every subscriber of its type, in the order of subscription.

    A subscriber that raises is counted, logged once and stays subscribed; the others never notice.
    """

    def __init__(self) -> None:
        self.published = 0
        self._subscribers: list[_Subscriber] = []
        self._by_type: dict[type, tuple[_Subscriber, ...]] = {}
        self._queues: list[BoundedQueue[Any]] = []

    def publish(self, record: Record) -> None:
        """Call every subscriber of this record's type; returns when the last one returned."""
        self.published += 1
        kind = type(record)
        subscribers = self._by_type.get(kind)
        if subscribers is None:
            subscribers = self._by_type[kind] = tuple(s for s in self._subscribers if _takes(s, kind))
        for subscriber in subscribers:
            try:
                subscriber.callback(record)
            except Exception:  # a sink must never take the link down with it
                self._count_error(subscriber, kind)

    def subscribe(
        self, callback: Callable[[Any], None], *record_types: type, name: str | None = None
    ) -> Callable[[], None]:
        """Call `callback` with each record of these types (none = all); returns the way to end it.

        The callback runs inside `publish`: it must be quick and must not wait.
        """
        label = name or str(getattr(callback, "__qualname__", callback))
        subscriber = _Subscriber(label, callback, record_types)
        self._subscribers.append(subscriber)
        self._by_type.clear()

        def unsubscribe() -> None:
            if subscriber in self._subscribers:
                self._subscribers.remove(subscriber)
                self._by_type.clear()

        return unsubscribe

    def open_queue(self, name: str, capacity: int, *record_types: type) -> BoundedQueue[Any]:
        """A new queue that receives each record of these types (none = all) until the queue is closed."""
        queue: BoundedQueue[Any] = BoundedQueue(name, capacity)
        self._queues.append(queue)
        self.subscribe(queue.put, *record_types, name=name)
        return queue

    def close_queue(self, queue: BoundedQueue[Any]) -> None:
        """Close a queue of `open_queue` and forget it."""
        queue.close()
        self._queues = [other for other in self._queues if other is not queue]
        self._subscribers = [s for s in self._subscribers if s.callback != queue.put]
        self._by_type.clear()

    @property
    def queues(self) -> tuple[BoundedQueue[Any], ...]:
        """Every open queue, for counters."""
        return tuple(self._queues)

    @property
    def errors_by_subscriber(self) -> dict[str, int]:
        """How often each failing subscriber raised."""
        return {s.name: s.errors for s in self._subscribers if s.errors}

    def _count_error(self, subscriber: _Subscriber, kind: type) -> None:
        subscriber.errors += 1
        if subscriber.errors == 1:
            _log.exception("%s failed on a %s; further failures are only counted", subscriber.name, kind.__name__)


def _takes(subscriber: _Subscriber, kind: type) -> bool:
    return not subscriber.record_types or issubclass(kind, subscriber.record_types)
