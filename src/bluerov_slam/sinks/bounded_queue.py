"""A queue between the link and one consumer: putting never waits, the oldest item gives way and is counted."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")


class QueueClosedError(Exception):
    """The queue was closed and everything in it has been taken."""


class BoundedQueue(Generic[Item]):
    """Single-consumer queue of at most `capacity` items, for one event loop."""

    def __init__(self, name: str, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"capacity {capacity}, expected at least 1")
        self.name = name
        self.capacity = capacity
        self.accepted = 0
        self.dropped = 0
        self.highest = 0
        self._items: deque[Item] = deque()
        self._closed = False
        self._waiter: asyncio.Future[None] | None = None

    def __len__(self) -> int:
        return len(self._items)

    @property
    def closed(self) -> bool:
        """True once `close` was called; what is still inside can be taken."""
        return self._closed

    def put(self, item: Item) -> None:
        """Append without waiting; a full queue loses its oldest item. After `close` the item is ignored."""
        if self._closed:
            return
        self.accepted += 1
        if len(self._items) >= self.capacity:
            self._items.popleft()
            self.dropped += 1
        self._items.append(item)
        if len(self._items) > self.highest:
            self.highest = len(self._items)
        self._wake()

    async def get(self) -> Item:
        """The oldest item; waits for one. Raises QueueClosedError when closed and empty."""
        await self._wait()
        return self._items.popleft()

    async def get_many(self, limit: int) -> list[Item]:
        """Between 1 and `limit` items, oldest first; waits for the first. Raises QueueClosedError as `get` does."""
        await self._wait()
        count = min(limit, len(self._items))
        return [self._items.popleft() for _ in range(count)]

    def take_all(self) -> list[Item]:
        """Everything inside, at once, without waiting."""
        items = list(self._items)
        self._items.clear()
        return items

    def close(self) -> None:
        """Accept nothing more and wake the consumer, which may still take what is inside."""
        self._closed = True
        self._wake()

    async def _wait(self) -> None:
        while not self._items:
            if self._closed:
                raise QueueClosedError(self.name)
            self._waiter = asyncio.get_running_loop().create_future()
            try:
                await self._waiter
            finally:
                self._waiter = None

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)
