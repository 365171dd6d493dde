"""The viewer service, wired: UDP in, pings out, commands down, scroll-back, contacts. Each part is its own module."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from typing import Any

import orjson

from bluerov_slam import __version__
from bluerov_slam.config import Settings
from bluerov_slam.protocol.waterfall_frame import pack_ping, seed_json
from bluerov_slam.records import Channel, Ping
from bluerov_slam.services.change_guard import ChangeGuard
from bluerov_slam.services.command_forwarder import CommandForwarder
from bluerov_slam.services.contacts import ContactBook
from bluerov_slam.services.http import WebServer, build_app, build_websocket_port_app
from bluerov_slam.services.kogger_gateway import KoggerGateway
from bluerov_slam.services.sonar_session import SonarSession, parse_one
from bluerov_slam.services.viewer_api import PAGE, ViewerApi
from bluerov_slam.services.viewer_channel import ViewerChannel
from bluerov_slam.services.viewer_link_client import LINK_PATH, TOKEN_FILE, LinkFacts, ViewerLinkClient
from bluerov_slam.sinks.ping_history import PingHistory
from bluerov_slam.sinks.websocket import Broadcaster
from bluerov_slam.sources.udp import UdpSource, open_udp_source

logger = logging.getLogger(__name__)

TOPICS = ("A", "B", "status", "sonar", "vehicle")
FLUSH_INTERVAL_S = 0.05
STATUS_INTERVAL_S = 1.0
RESTART_PAUSE_S = 1.0
CONTACT_RETRY_S = 30.0


class ViewerService:
    """`start`, then it runs by itself until `stop`."""

    def __init__(self, settings: Settings, extension_port: int | None = None) -> None:
        self._settings = settings
        self._facts = LinkFacts()
        port = extension_port or settings.http.port
        self.link = ViewerLinkClient(f"ws://127.0.0.1:{port}{LINK_PATH}", settings.state_folder / TOKEN_FILE)
        self._udp: dict[Channel, UdpSource] = {}
        self.channels = {channel: self._channel(channel) for channel in Channel}
        self.forwarder = CommandForwarder({channel: c.session for channel, c in self.channels.items()})
        self.history = PingHistory(settings.state_folder / "history", settings.viewer.history_mb * 1024 * 1024)
        self.contacts = ContactBook(settings.state_folder, self.link, lambda: self._facts.recording)
        self.pings = Broadcaster(TOPICS, greeting=self._greeting)
        self.waterfall = Broadcaster(("ping",))
        api = ViewerApi(self.channels, self.forwarder, self.history, self.contacts, self.pings, self.status)
        guard = ChangeGuard(lambda: settings.http.trusted_origins, lambda: settings.http.token)
        self.http = WebServer(build_app(PAGE, api.routes(), guard=guard, metrics=api.metrics))
        self.waterfall_http = WebServer(build_websocket_port_app("Sonar waterfall", self.waterfall.handle))
        self._block_full = asyncio.Event()
        self._sonar_changed = asyncio.Event()
        self._contacts_wanted = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []
        self._connect_parts()

    @property
    def udp_ports(self) -> dict[Channel, int]:
        """The ports in use, also when 0 was asked for."""
        return {channel: source.port for channel, source in self._udp.items()}

    async def start(self) -> None:
        """Open the ports and begin. Raises ExpectedError naming the setting when a port is taken."""
        host, viewer = self._settings.http.host, self._settings.viewer
        try:
            for channel, port in zip(Channel, (viewer.udp_port_a, viewer.udp_port_b), strict=True):
                self._udp[channel] = await open_udp_source(host, port, self.channels[channel].take_datagram)
            await self.http.start(host, viewer.port, "viewer.port")
            await self.waterfall_http.start(host, viewer.waterfall_ws_port, "viewer.waterfall_ws_port")
        except BaseException:
            await self.stop()
            raise
        for name, work in self._work().items():
            self._tasks.append(asyncio.create_task(_keep_running(name, work), name=name))
        logger.info("viewer on http://%s:%d", host, self.http.port)

    async def stop(self) -> None:
        """Close everything; what was not written is lost on purpose, scroll-back ends with the service."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for channel, source in self._udp.items():
            source.close()
            await self.channels[channel].gateway.close()
        await self.forwarder.close()
        await asyncio.gather(self.pings.close(), self.waterfall.close())
        await asyncio.gather(self.http.stop(), self.waterfall_http.stop())
        self.history.close()

    def status(self) -> dict[str, Any]:
        """The status topic."""
        return {
            "channels": {channel.value: state.status() for channel, state in self.channels.items()},
            "extension_link": self.link.connected,
            "link_message": self.link.message,
            "peers": [peer for state in self.channels.values() for peer in state.gateway.peers()],
            "history": {**{channel.value: self._span(channel) for channel in Channel}, "message": self.history.message},
            "recording": self._facts.recording,
            "contacts": {"unsent": self.contacts.unsent, "message": self.contacts.message},
            "simulated": self._simulated,
            "mirror": bool(self._facts.settings.get("mirror", self._settings.sonar.mirror)),
            "clients": self.pings.clients + self.waterfall.clients,
            "versions": {"viewer": __version__},
        }

    @property
    def _simulated(self) -> bool:
        return bool(self._facts.settings.get("simulated", False))

    def _channel(self, channel: Channel) -> ViewerChannel:
        settings = self._settings
        session = SonarSession(channel, self.link)
        route = settings.forwarding.route_a if channel is Channel.A else settings.forwarding.route_b
        gateway = KoggerGateway(channel, session, lambda data, peer: self._udp[channel].send(data, peer), route=route)
        gateway.settings_allowed = settings.sonar.kogger_app_may_change_settings
        gateway.on_setting = lambda frame_id: self.forwarder.setting_changed_elsewhere(channel, frame_id)
        state = ViewerChannel(
            channel,
            session,
            gateway,
            self._on_ping,
            checksum=settings.sonar.kogger_checksum,
            expected_samples=settings.sonar.expected_samples or None,
        )
        state.on_restart = lambda: self.forwarder.sonar_restarted(channel)
        return state

    def _connect_parts(self) -> None:
        self.link.listener.on_sonar_frame = self._on_sonar_frame
        self.link.listener.on_message = self._on_link_message
        self.link.listener.on_up = self._on_link_up
        self.link.listener.on_down = self._sonar_changed.set
        self.forwarder.on_change = self._sonar_changed.set

    def _work(self) -> dict[str, Callable[[], Awaitable[None]]]:
        work: dict[str, Callable[[], Awaitable[None]]] = {
            "viewer link": self.link.run,
            "ping flush": self._flush_pings,
            "status": self._publish_status,
            "sonar state": self._publish_sonar_state,
            "ping history": self._write_history,
            "contacts": self._send_contacts,
        }
        for channel, state in self.channels.items():
            work[f"sonar {channel} questions"] = state.session.run
            work[f"sonar {channel} settings"] = lambda channel=channel: self.forwarder.keep_fresh(  # type: ignore[misc]
                channel, lambda: self.link.connected
            )
        return work

    def _on_ping(self, ping: Ping) -> None:
        time_unix_s = time.time() - (time.monotonic() - ping.measured_s)
        packed = pack_ping(ping, time_unix_s, simulated=self._simulated)
        self.pings.publish_binary(ping.channel.value, packed)
        if ping.sub_channel == 0 and self.waterfall.wants("ping"):
            self.waterfall.publish_text("ping", orjson.dumps(seed_json(ping)))
        if self.history.append(ping.channel, ping.number, packed):
            self._block_full.set()

    def _on_sonar_frame(self, channel: Channel, data: bytes) -> None:
        frame = parse_one(data)
        self.channels[channel].take_answer(frame)
        self.forwarder.took(channel, frame)

    def _on_link_up(self) -> None:
        self._contacts_wanted.set()
        self._sonar_changed.set()
        self.forwarder.link_came_up()

    def _on_link_message(self, kind: str, message: dict[str, Any]) -> None:
        self._facts.take(kind, message)
        if kind == "vehicle":
            self._take_vehicle()
        elif kind == "recording":
            self._contacts_wanted.set()
        for state in self.channels.values():
            state.gateway.fed = self._facts.fed
            state.gateway.settings_allowed = bool(
                self._facts.settings.get("kogger_app_may_change_settings", state.gateway.settings_allowed)
            )

    def _take_vehicle(self) -> None:
        vehicle = self._facts.vehicle
        speed = vehicle.get("sound_speed_ctd_mps", vehicle.get("sound_speed_mps"))
        if speed != self.forwarder.sound_speed_ctd_mps:
            self.forwarder.sound_speed_ctd_mps = speed
            self._sonar_changed.set()
        if self.pings.wants("vehicle"):
            self.pings.publish_text("vehicle", _message("vehicle", vehicle))

    def _greeting(self) -> list[tuple[str, bytes]]:
        return [
            ("status", _message("status", self.status())),
            ("sonar", _message("sonar", self.forwarder.state())),
            ("vehicle", _message("vehicle", self._facts.vehicle)),
        ]

    def _span(self, channel: Channel) -> dict[str, int] | None:
        span = self.history.span(channel)
        return None if span is None else {"first": span[0], "last": span[1]}

    async def _flush_pings(self) -> None:
        while True:
            await asyncio.sleep(FLUSH_INTERVAL_S)
            for state in self.channels.values():
                state.flush()

    async def _publish_status(self) -> None:
        while True:
            await asyncio.sleep(STATUS_INTERVAL_S)
            if self.pings.wants("status"):
                self.pings.publish_text("status", _message("status", self.status()))

    async def _publish_sonar_state(self) -> None:
        while True:
            await self._sonar_changed.wait()
            self._sonar_changed.clear()
            if self.pings.wants("sonar"):
                self.pings.publish_text("sonar", _message("sonar", self.forwarder.state()))

    async def _write_history(self) -> None:
        while True:
            await self._block_full.wait()
            self._block_full.clear()
            await asyncio.to_thread(self.history.write_pending)

    async def _send_contacts(self) -> None:
        while True:
            try:
                async with asyncio.timeout(CONTACT_RETRY_S):
                    await self._contacts_wanted.wait()
            except TimeoutError:
                if not self.contacts.unsent:
                    continue
            self._contacts_wanted.clear()
            await self.contacts.send()
            await self.contacts.adopt()


async def _keep_running(name: str, work: Callable[[], Awaitable[None]]) -> None:
    while True:
        try:
            await work()
        except Exception:  # one part that fails must not end the others
            logger.exception("%s failed; it is started again", name)
        await asyncio.sleep(RESTART_PAUSE_S)


def _message(topic: str, data: dict[str, Any]) -> bytes:
    return orjson.dumps({"topic": topic, "data": data})
