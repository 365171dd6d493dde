import asyncio
import logging

import pytest

from bluerov_slam.records import Event, EventLevel, LinkBytes
from bluerov_slam.services.hub import Hub
from bluerov_slam.sinks.bounded_queue import BoundedQueue, QueueClosedError

BYTES = LinkBytes(b"\xaa\x55", 1.0)
EVENT = Event(2.0, EventLevel.INFO, "hello")


def test_delivers_only_the_types_asked_for():
    hub, events, everything = Hub(), [], []
    hub.subscribe(events.append, Event)
    hub.subscribe(everything.append)
    hub.publish(BYTES)
    hub.publish(EVENT)
    assert events == [EVENT]
    assert everything == [BYTES, EVENT]


def test_calls_subscribers_in_the_order_they_came():
    hub, order = Hub(), []
    for name in "abc":
        hub.subscribe(lambda _record, name=name: order.append(name))
    hub.publish(EVENT)
    assert order == ["a", "b", "c"]


def test_a_failing_subscriber_is_counted_logged_once_and_hurts_nobody(caplog):
    hub, seen = Hub(), []

    def broken(_record):
        raise RuntimeError("boom")

    hub.subscribe(broken, name="broken sink")
    hub.subscribe(seen.append)
    with caplog.at_level(logging.ERROR):
        for _ in range(5):
            hub.publish(EVENT)
    assert seen == [EVENT] * 5
    assert hub.errors_by_subscriber == {"broken sink": 5}
    assert [r.message for r in caplog.records] == ["broken sink failed on a Event; further failures are only counted"]


def test_unsubscribing_and_late_subscribing_take_effect_at_once():
    hub, first, second = Hub(), [], []
    stop = hub.subscribe(first.append)
    hub.publish(EVENT)
    stop()
    stop()
    hub.subscribe(second.append, Event)
    hub.publish(EVENT)
    assert (len(first), len(second)) == (1, 1)


def test_a_full_queue_drops_its_oldest_item_and_counts():
    queue: BoundedQueue[int] = BoundedQueue("q", 3)
    for number in range(5):
        queue.put(number)
    assert queue.take_all() == [2, 3, 4]
    assert (queue.accepted, queue.dropped, queue.highest) == (5, 2, 3)


async def test_get_many_waits_for_the_first_and_takes_no_more_than_asked():
    hub = Hub()
    queue = hub.open_queue("recorder", 10, Event)
    waiting = asyncio.create_task(queue.get_many(2))
    await asyncio.sleep(0)
    assert not waiting.done()
    for _ in range(3):
        hub.publish(EVENT)
    assert await waiting == [EVENT, EVENT]
    assert await queue.get() == EVENT
    assert len(queue) == 0


async def test_a_closed_queue_can_be_emptied_and_then_says_so():
    hub = Hub()
    queue = hub.open_queue("recorder", 10)
    hub.publish(EVENT)
    hub.close_queue(queue)
    hub.publish(EVENT)
    assert await queue.get() == EVENT
    with pytest.raises(QueueClosedError):
        await queue.get()
    assert hub.queues == ()


async def test_closing_wakes_a_waiting_consumer():
    queue: BoundedQueue[int] = BoundedQueue("q", 1)
    waiting = asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    queue.close()
    with pytest.raises(QueueClosedError):
        await waiting


def test_a_queue_without_room_is_refused():
    with pytest.raises(ValueError, match="capacity 0"):
        BoundedQueue("q", 0)
