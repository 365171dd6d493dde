"""Turns changes of state into events a user can read: the port, faults, clocks, what the link sends unexpectedly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from bluerov_slam.clock import WallClock
from bluerov_slam.pipeline.health import FaultLevel, Health, PortState
from bluerov_slam.records import Channel, Event, EventLevel, GpsFix, UnknownFrame
from bluerov_slam.services.esp_link import EspLink
from bluerov_slam.services.hub import Hub

_LEVELS: Final = {
    FaultLevel.ERROR: EventLevel.ERROR,
    FaultLevel.WARNING: EventLevel.WARNING,
    FaultLevel.INFO: EventLevel.INFO,
}


class SystemEvents:
    """`wall_time` None: a replay, whose clock is not looked at."""

    def __init__(self, hub: Hub, link: EspLink, wall: WallClock, wall_time: Callable[[], float] | None) -> None:
        self._hub = hub
        self._link = link
        self._wall = wall
        self._wall_time = wall_time
        self._port_state: PortState | None = None
        self._titles: dict[str, str] = {}
        self._trusted: bool | None = None
        self._unknown_types: set[int] = set()
        self._checksums: dict[Channel, str | None] = {}
        hub.subscribe(self._on_gps, GpsFix, name="wall clock")
        hub.subscribe(self._on_unknown, UnknownFrame, name="unknown frames")

    def tick(self) -> None:
        """Once a second: was the wall clock set, did a sonar turn out to use the other checksum?"""
        self._watch_checksums()
        if self._wall_time is None:
            return
        step = self._wall.observe(self._wall_time(), self._link.source.now_s())
        if step is not None:
            self._tell(
                EventLevel.WARNING, f"the wall clock was set by {step.by_s:+.1f} s; order and ages are unaffected"
            )

    def link_changed(self) -> None:
        """The source's state changed."""
        facts = self._link.source.facts()
        if facts.state == self._port_state:
            return
        self._port_state = facts.state
        if facts.state is PortState.CONNECTED:
            self._tell(EventLevel.INFO, f"{facts.kind} link up: {facts.by_id or facts.port}, {facts.baud} baud")
        elif facts.state is PortState.FINISHED:
            self._tell(EventLevel.INFO, facts.detail)
        else:
            detail = f"{facts.detail}; " if facts.detail else ""
            self._tell(EventLevel.WARNING, f"no link: {detail}waiting for {facts.waiting_for or 'a port'}")

    def take_health(self, health: Health) -> None:
        """Say what is wrong now and was not, and what is right again."""
        titles = {fault.id: fault.title for fault in health.faults}
        if titles.keys() == self._titles.keys():
            return
        known, self._titles = self._titles, titles
        for fault in health.faults:
            if fault.id not in known:
                self._tell(_LEVELS[fault.level], f"{titles[fault.id]}. {fault.cause}")
        for key in known.keys() - titles.keys():
            self._tell(EventLevel.INFO, f"cleared: {known[key]}")

    def _on_unknown(self, frame: UnknownFrame) -> None:
        if frame.frame_type not in self._unknown_types:
            self._unknown_types.add(frame.frame_type)
            text = f"frames of type 0x{frame.frame_type:02x} mean nothing to this version; they are counted and skipped"
            self._tell(EventLevel.INFO, text)

    def _watch_checksums(self) -> None:
        for channel, sonar in self._link.counters.sonars.items():
            before = self._checksums.get(channel, sonar.checksum_in_use)
            self._checksums[channel] = sonar.checksum_in_use
            if before != sonar.checksum_in_use:
                news = f"sonar {channel} sends {sonar.checksum_in_use} checksums, not {before}"
                self._tell(EventLevel.WARNING, f"{news}: they are accepted from now on")

    def _on_gps(self, fix: GpsFix) -> None:
        if fix.utc_unix_s is None or fix.latitude_deg is None:
            return
        self._wall.note_gps(fix.utc_unix_s, fix.measured_s)
        trusted, offset_s = self._wall.is_trusted(), self._wall.gps_utc_offset_s
        if trusted != self._trusted and offset_s is not None:
            self._trusted = trusted
            verdict = "agrees with GPS time" if trusted else f"is wrong: GPS time is {offset_s:+.1f} s from it"
            self._tell(EventLevel.INFO if trusted else EventLevel.WARNING, f"the vehicle's clock {verdict}")

    def _tell(self, level: EventLevel, text: str) -> None:
        self._hub.publish(Event(self._link.source.now_s(), level, text))
