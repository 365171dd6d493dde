"""The viewer service, wired: UDP in, pings out, commands down, scroll-back, contacts. Each part is its own module."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from functools import partial

from bluerov_slam.config import Settings
from bluerov_slam.records import Channel
from bluerov_slam.services.change_guard import ChangeGuard
from bluerov_slam.services.command_forwarder import CommandForwarder
from bluerov_slam.services.contacts import ContactBook
from bluerov_slam.services.http import WebServer, build_app, build_websocket_port_app
from bluerov_slam.services.kogger_gateway import KoggerGateway
from bluerov_slam.services.sonar_session import SonarSession
from bluerov_slam.services.viewer_api import PAGE, ViewerApi
from bluerov_slam.services.viewer_channel import ViewerChannel
from bluerov_slam.services.viewer_desk import ViewerDesk
from bluerov_slam.services.viewer_link_client import LINK_PATH, TOKEN_FILE, LinkFacts, ViewerLinkClient
from bluerov_slam.services.viewer_outlets import ViewerOutlets
from bluerov_slam.sinks.ping_history import PingHistory
from bluerov_slam.sources.udp import UdpSource, open_udp_source

logger = logging.getLogger(__name__)

RESTART_PAUSE_S = 1.0


class ViewerService:
    """`start`, then it runs by itself until `stop`. `extension_port` where it differs from the settings."""

    def __init__(self, settings: Settings, extension_port: int | None = None) -> None:
        self._settings = settings
        state, facts = settings.state_folder, LinkFacts()
        port = extension_port or settings.http.port
        self.link = ViewerLinkClient(f"ws://127.0.0.1:{port}{LINK_PATH}", state / TOKEN_FILE)
        history = PingHistory(state / "history", settings.viewer.history_mb * 1024 * 1024)
        self.outlets = ViewerOutlets(history, lambda: self.desk.greeting())
        self.udp: dict[Channel, UdpSource] = {}
        self.channels = {channel: self._channel(channel) for channel in Channel}
        self.forwarder = CommandForwarder({channel: c.session for channel, c in self.channels.items()})
        self.contacts = ContactBook(state, self.link, lambda: facts.recording)
        self.desk = ViewerDesk(settings, self.link, facts, self.channels, self.forwarder, self.contacts, self.outlets)
        api = ViewerApi(self.channels, self.forwarder, self.contacts, self.outlets, self.desk.status)
        guard = ChangeGuard(lambda: settings.http.trusted_origins, lambda: settings.http.token)
        self.http = WebServer(build_app(PAGE, api.routes(), guard=guard, metrics=api.metrics))
        self.waterfall_http = WebServer(build_websocket_port_app("Sonar waterfall", self.outlets.waterfall.handle))
        self._tasks: list[asyncio.Task[None]] = []

    async def start(self) -> None:
        """Open the ports and begin. Raises ExpectedError naming the setting when a port is taken."""
        host, viewer = self._settings.http.host, self._settings.viewer
        try:
            for channel, port in zip(Channel, (viewer.udp_port_a, viewer.udp_port_b), strict=True):
                take, setting = self.channels[channel].take_datagram, f"viewer.udp_port_{channel.value.lower()}"
                self.udp[channel] = await open_udp_source(host, port, take, setting)
            await self.http.start(host, viewer.port, "viewer.port")
            await self.waterfall_http.start(host, viewer.waterfall_ws_port, "viewer.waterfall_ws_port")
        except BaseException:
            await self.stop()
            raise
        for name, work in self._work().items():
            self._tasks.append(asyncio.create_task(_keep_running(name, work), name=name))
        logger.info("viewer on http://%s:%d", host, self.http.port)

    async def stop(self) -> None:
        """End everything. Scroll-back ends with the service; contacts are on disk already."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for channel, source in self.udp.items():
            source.close()
            await self.channels[channel].gateway.close()
        await self.forwarder.close()
        await self.outlets.close()
        await asyncio.gather(self.http.stop(), self.waterfall_http.stop())

    def _channel(self, channel: Channel) -> ViewerChannel:
        forwarding, sonar = self._settings.forwarding, self._settings.sonar
        route = forwarding.route_a if channel is Channel.A else forwarding.route_b
        session = SonarSession(channel, self.link)
        gateway = KoggerGateway(channel, session, lambda data, peer: self.udp[channel].send(data, peer), route=route)
        gateway.settings_allowed = sonar.kogger_app_may_change_settings
        gateway.on_setting = lambda frame_id: self.forwarder.setting_changed_elsewhere(channel, frame_id)
        state = ViewerChannel(
            channel, session, gateway, self.outlets.show,
            checksum=sonar.kogger_checksum, expected_samples=sonar.expected_samples or None,
        )  # fmt: skip
        state.on_restart = lambda: self.forwarder.sonar_restarted(channel)
        return state

    def _work(self) -> dict[str, Callable[[], Awaitable[None]]]:
        work: dict[str, Callable[[], Awaitable[None]]] = {
            "viewer link": self.link.run,
            "ping flush": self.desk.flush_pings,
            "status": self.desk.publish_status,
            "sonar state": self.desk.publish_sonar,
            "contacts": self.desk.send_contacts,
            "ping history": self.outlets.write_history,
        }
        for channel, state in self.channels.items():
            work[f"sonar {channel} questions"] = state.session.run
            work[f"sonar {channel} settings"] = partial(self.forwarder.keep_fresh, channel, lambda: self.link.connected)
        return work


async def _keep_running(name: str, work: Callable[[], Awaitable[None]]) -> None:
    while True:
        try:
            await work()
        except Exception:  # one part that fails must not end the others
            logger.exception("%s failed; it is started again", name)
        await asyncio.sleep(RESTART_PAUSE_S)
