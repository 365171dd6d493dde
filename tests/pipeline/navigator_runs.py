"""Feeding a navigator in tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.records import Event, NavSensor, NavState, Record

Change = Callable[[Record], Record | list[Record] | None]


@dataclass
class Run:
    """What a navigator said."""

    navigator: Navigator
    states: list[NavState] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)

    def feed(self, records: Iterable[Record], change: Change | None = None) -> Run:
        """All of them, each changed first; None drops it."""
        for record in records:
            changed = record if change is None else change(record)
            for each in changed if isinstance(changed, list) else [changed]:
                if each is not None:
                    self.take(self.navigator.feed(each))
        return self

    def take(self, results: list[NavState | Event]) -> None:
        for result in results:
            (self.events if isinstance(result, Event) else self.states).append(result)  # type: ignore[arg-type]

    @property
    def last(self) -> NavState:
        return self.states[-1]

    def sensor(self, name: str) -> NavSensor:
        """As in the newest state."""
        return next(sensor for sensor in self.last.sensors if sensor.name == name)

    def said(self, words: str) -> bool:
        return any(words in event.text for event in self.events)


def run(records: Iterable[Record], change: Change | None = None, navigator: Navigator | None = None) -> Run:
    return Run(navigator or Navigator()).feed(records, change)
