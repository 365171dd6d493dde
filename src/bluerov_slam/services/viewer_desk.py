"""What the viewer makes of the extension's messages, and what it tells the pages about itself."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from typing import Any

from bluerov_slam import __version__
from bluerov_slam.config import Settings
from bluerov_slam.records import Channel
from bluerov_slam.services.command_forwarder import CommandForwarder
from bluerov_slam.services.contacts import ContactBook
from bluerov_slam.services.sonar_session import parse_one
from bluerov_slam.services.viewer_channel import ViewerChannel
from bluerov_slam.services.viewer_link_client import LinkFacts, ViewerLinkClient
from bluerov_slam.services.viewer_outlets import ViewerOutlets

# Only pings whose end was lost wait for it.
FLUSH_INTERVAL_S = 0.2
STATUS_INTERVAL_S = 1.0
CONTACT_RETRY_S = 30.0
# The extension tells twice a second where the vehicle is, as long as it knows.
VEHICLE_FRESH_S = 3.0


class ViewerDesk:
    """Passes on what arrives over the viewer link, and publishes status and settings."""

    def __init__(
        self,
        settings: Settings,
        link: ViewerLinkClient,
        facts: LinkFacts,
        channels: Mapping[Channel, ViewerChannel],
        forwarder: CommandForwarder,
        contacts: ContactBook,
        outlets: ViewerOutlets,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._now_s = now_s
        self._vehicle_s: float | None = None
        self._settings = settings
        self._link = link
        self._facts = facts
        self._channels = channels
        self._forwarder = forwarder
        self._contacts = contacts
        self._outlets = outlets
        self._sonar_changed = asyncio.Event()
        self._contacts_wanted = asyncio.Event()
        self._started_unix_s = round(time.time(), 3)
        forwarder.on_change = self._sonar_changed.set
        link.listener.on_up = self._on_link_up
        link.listener.on_down = self._sonar_changed.set
        link.listener.on_sonar_frame = self._on_sonar_frame
        link.listener.on_message = self._on_message

    def status(self) -> dict[str, Any]:
        """The status topic."""
        return {
            "channels": {channel.value: state.status() for channel, state in self._channels.items()},
            "extension_link": self._link.connected,
            "link_message": self._link.message,
            "chips": self._facts.chips if self._link.connected else [],
            "peers": [peer for state in self._channels.values() for peer in state.gateway.peers()],
            "history": self._outlets.history_status(),
            "recording": self._facts.recording,
            "contacts": {"unsent": self._contacts.unsent, "message": self._contacts.message},
            "simulated": self._outlets.simulated,
            "source": self._facts.settings.get("source"),
            "mirror": bool(self._facts.settings.get("mirror", self._settings.sonar.mirror)),
            "clients": self._outlets.clients,
            "dashboard_port": self._settings.http.port,
            # Ping numbers begin anew with each start.
            "started_unix_s": self._started_unix_s,
            "versions": {"viewer": __version__},
        }

    def greeting(self) -> dict[str, dict[str, Any]]:
        """What a page gets when it connects."""
        return {"status": self.status(), "sonar": self._forwarder.state(), "vehicle": self._facts.vehicle}

    async def flush_pings(self) -> None:
        """Show pings whose end was lost; until cancelled."""
        while True:
            await asyncio.sleep(FLUSH_INTERVAL_S)
            for state in self._channels.values():
                state.flush()

    async def publish_status(self) -> None:
        """Once a second; until cancelled."""
        while True:
            await asyncio.sleep(STATUS_INTERVAL_S)
            self.forget_old_vehicle()
            self._outlets.tell("status", self.status)

    def forget_old_vehicle(self) -> None:
        """What the extension said a while ago says nothing about now: neither depth nor sound speed."""
        if self._vehicle_s is None or self._now_s() - self._vehicle_s <= VEHICLE_FRESH_S:
            return
        self._vehicle_s = None
        self._facts.vehicle = dict.fromkeys(self._facts.vehicle)
        self._take_vehicle()

    async def publish_sonar(self) -> None:
        """Whenever asked or read-back settings change; until cancelled."""
        while True:
            await self._sonar_changed.wait()
            self._sonar_changed.clear()
            self._outlets.tell("sonar", self._forwarder.state)

    async def send_contacts(self) -> None:
        """Whenever link or recording come up, and now and then while some are unsent; until cancelled."""
        while True:
            try:
                async with asyncio.timeout(CONTACT_RETRY_S):
                    await self._contacts_wanted.wait()
            except TimeoutError:
                if not self._contacts.unsent:
                    continue
            self._contacts_wanted.clear()
            await self._contacts.send()
            await self._contacts.adopt()

    def _on_link_up(self) -> None:
        self._sonar_changed.set()
        self._contacts_wanted.set()
        self._forwarder.link_came_up()

    def _on_sonar_frame(self, channel: Channel, data: bytes) -> None:
        frame = parse_one(data)
        self._channels[channel].take_answer(frame)
        self._forwarder.took(channel, frame)

    def _on_message(self, kind: str, message: dict[str, Any]) -> None:
        self._facts.take(kind, message)
        if kind == "vehicle":
            self._vehicle_s = self._now_s()
            self._take_vehicle()
        elif kind == "recording":
            self._contacts_wanted.set()
        elif kind == "fed":
            for state in self._channels.values():
                state.gateway.fed = self._facts.fed
        elif kind == "settings":
            self._take_settings(self._facts.settings)

    def _take_settings(self, settings: Mapping[str, Any]) -> None:
        self._outlets.simulated = bool(settings.get("simulated", False))
        for state in self._channels.values():
            gateway = state.gateway
            gateway.settings_allowed = bool(settings.get("kogger_app_may_change_settings", gateway.settings_allowed))

    def _take_vehicle(self) -> None:
        self._take_sound_speed()
        self._outlets.track.add(self._outlets.newest_ping_s, self._facts.vehicle)
        self._outlets.tell("vehicle", lambda: self._facts.vehicle)

    def _take_sound_speed(self) -> None:
        vehicle = self._facts.vehicle
        speed_mps = vehicle.get("sound_speed_ctd_mps", vehicle.get("sound_speed_mps"))
        if speed_mps != self._forwarder.sound_speed_ctd_mps:
            self._forwarder.sound_speed_ctd_mps = speed_mps
            self._sonar_changed.set()
