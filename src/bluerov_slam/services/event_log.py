"""The last events a user should be able to read, on the page, on the hub and in the log."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import orjson

from bluerov_slam.records import Event, EventLevel
from bluerov_slam.services.hub import Hub
from bluerov_slam.sinks.websocket import Broadcaster

_log = logging.getLogger(__name__)

KEPT: Final = 500
_LOG_LEVELS: Final = {
    EventLevel.INFO: logging.INFO,
    EventLevel.WARNING: logging.WARNING,
    EventLevel.ERROR: logging.ERROR,
}


class EventLog:
    """Takes every Event of the hub: keeps it, logs it, sends it to the page."""

    def __init__(self, hub: Hub, broadcaster: Broadcaster, unix_s: Callable[[float], float]) -> None:
        self._events: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._broadcaster = broadcaster
        self._unix_s = unix_s
        hub.subscribe(self._take, Event, name="event log")

    def listing(self) -> list[dict[str, Any]]:
        """Oldest first, as GET /api/events answers."""
        return list(self._events)

    def _take(self, event: Event) -> None:
        _log.log(_LOG_LEVELS[event.level], "%s", event.text)
        entry = {"t": self._unix_s(event.at_s), "level": event.level, "text": event.text}
        self._events.append(entry)
        if self._broadcaster.wants("event"):
            self._broadcaster.publish_text("event", orjson.dumps({"topic": "event", **entry}))
