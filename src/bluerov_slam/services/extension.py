"""The extension service, wired: link to hub, hub to every sink, pages and API around them."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from bluerov_slam.clock import WallClock
from bluerov_slam.config import Settings
from bluerov_slam.errors import LinkError
from bluerov_slam.pipeline.health import Health, RecorderFacts, RecorderState
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.records import (
    AcousticBytes,
    Channel,
    CtdSample,
    Event,
    EventLevel,
    GpsFix,
    ImuBurst,
    Record,
    SensorSample,
    SonarFrames,
)
from bluerov_slam.services.acoustics_api import AcousticsApi
from bluerov_slam.services.acoustics_service import AcousticsService
from bluerov_slam.services.change_guard import ChangeGuard
from bluerov_slam.services.esp_link import EspLink, LinkSource
from bluerov_slam.services.event_log import EventLog
from bluerov_slam.services.extension_api import PAGE, ExtensionApi
from bluerov_slam.services.extension_metrics import StatusCollector, metrics_page
from bluerov_slam.services.http import WebServer, build_app, build_websocket_port_app
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.map_tiles import FOLDER as TILES_FOLDER
from bluerov_slam.services.map_tiles import MapTiles
from bluerov_slam.services.navigation_api import NavigationApi
from bluerov_slam.services.navigation_messages import Setup
from bluerov_slam.services.navigation_service import NavigationService
from bluerov_slam.services.navigation_settings import (
    NAVIGATOR,
    changes_estimator,
    navigator_options,
    recorded_settings,
)
from bluerov_slam.services.navigation_state_file import boot_id
from bluerov_slam.services.navigation_vehicle import NavigationVehicle
from bluerov_slam.services.recording_api import recording_routes
from bluerov_slam.services.recordings import RecordingStore
from bluerov_slam.services.sensor_feed import SensorFeed
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.services.status_report import StatusReport, StatusSources
from bluerov_slam.services.system_events import SystemEvents
from bluerov_slam.services.viewer_link import TOKEN_FILE, ViewerFacts, ViewerLink
from bluerov_slam.sinks.mavlink_bridge import MavlinkBridge, MavlinkOptions
from bluerov_slam.sinks.mcap_recorder import Recorder, RecordingLimits
from bluerov_slam.sinks.udp_kogger import UdpKogger
from bluerov_slam.sinks.websocket import Broadcaster
from bluerov_slam.sources.replay import ReplaySource
from bluerov_slam.sources.serial_port import SerialPort

_log = logging.getLogger(__name__)

TOPICS: Final = ("sensors", "status", "event", "navigation", "acoustics")
TICK_S: Final = 1.0
_MEGABYTE: Final = 1_000_000


class Extension:
    """`start`, then it runs by itself until `stop`.

    `source` None: the serial port of the settings. With another one (a replay) nothing is recorded; `decoder` and
    `wall` then bring the recording's own settings and clock.
    """

    def __init__(
        self,
        store: SettingsStore,
        source: LinkSource | None = None,
        *,
        decoder: LinkDecoder | None = None,
        wall: WallClock | None = None,
        wall_time: Callable[[], float] = time.time,
        simulated: bool = False,
        simulated_autopilot: str | None = None,
        navigator: str = NAVIGATOR,
    ) -> None:
        settings = store.settings
        self._navigator = navigator
        self.store = store
        self.hub = Hub()
        self.simulated = simulated
        source = source or SerialPort(settings.serial.port, settings.serial.baud)
        decoder = decoder or LinkDecoder(**decoder_settings(settings))
        if isinstance(source, SerialPort):
            source.frames_understood = lambda: decoder.counters.link.frames_ok
        elif isinstance(source, ReplaySource):
            source.on_vehicle = self._take_recorded
        self.wall = wall or WallClock(wall_time(), source.now_s())
        self._observed_wall_time = None if wall else wall_time
        self.recorder = self._make_recorder(settings) if source.kind == "serial" else None
        self.link = EspLink(source, decoder, self.hub, swap=settings.sonar.swap_a_b)
        self.topics = Broadcaster(TOPICS, greeting=self._greeting)
        self.bare = Broadcaster(("sensors",))
        self.recordings = RecordingStore(settings.recordings_folder, self._active_recording)
        self.udp = UdpKogger(
            {Channel.A: settings.viewer.udp_port_a, Channel.B: settings.viewer.udp_port_b},
            on_addresses=lambda _addresses: self.viewer_link.tell_fed(),
            stamps_wanted=lambda: self.viewer_link.viewers > 0,
            unix_s=self.wall.unix_s,
        )
        self.hub.subscribe(self.udp.take, SonarFrames, name="UDP forwarding")
        self.mavlink = MavlinkBridge(mavlink_options(settings), self.hub.publish, source.now_s)
        self.hub.subscribe(self.mavlink.on_record, SensorSample, CtdSample, GpsFix, ImuBurst, name="MAVLink bridge")
        self._simulated_autopilot: MavlinkBridge | None = None
        if simulated_autopilot is not None:
            options = listening_options(simulated_autopilot)
            self._simulated_autopilot = MavlinkBridge(options, self.hub.publish, source.now_s)
        self.events = EventLog(self.hub, self.topics, self.wall.unix_s)
        self.system_events = SystemEvents(self.hub, self.link, self.wall, self._observed_wall_time)
        self.vehicle = NavigationVehicle(
            self.mavlink,
            self.hub,
            lambda: store.settings,
            source.now_s,
            replay=source.kind == "replay",
            simulated=simulated,
        )
        self.navigation = NavigationService(
            self.hub,
            self.topics,
            self._navigation_setup,
            now_s=source.now_s,
            unix_s=self.wall.unix_s,
            simulated=simulated,
            odometry=self.vehicle.odometry,
            on_change=lambda: self.status.glance(),
        )
        self.acoustics = AcousticsService(
            self.hub,
            self.topics,
            lambda: store.settings,
            now_s=source.now_s,
            unix_s=self.wall.unix_s,
            simulated=simulated,
        )
        if isinstance(source, ReplaySource):
            source.is_too_fast = self.navigation.process.is_behind
        self.viewer_link = self._make_viewer_link(settings)
        self.status = self._make_status()
        self.sensors = SensorFeed(
            self.hub, self.bare, self.topics, alive=self.link.alive, unix_s=self.wall.unix_s, now_s=source.now_s
        )
        self.api = ExtensionApi(self, self.sensors)
        guard = ChangeGuard(lambda: store.settings.http.trusted_origins, lambda: store.settings.http.token)
        metrics = metrics_page(StatusCollector(self.status.data, self._metrics_extra, self.navigation.gauges))
        routes = [
            *self.api.routes(),
            *NavigationApi(self.navigation, self.vehicle.parameters, wall_time).routes(),
            *AcousticsApi(self.acoustics).routes(),
            *MapTiles(store.settings.state_folder / TILES_FOLDER).routes(),
            *recording_routes(self.recordings, self.recorder),
        ]
        self.http = WebServer(build_app(PAGE, routes, guard=guard, metrics=metrics))
        self.sensor_http = WebServer(build_websocket_port_app("Sensor data", self.bare.handle))
        self._ticker: asyncio.Task[None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._changing = asyncio.Lock()

    async def start(self) -> None:
        """Open the ports, then the link. Raises ExpectedError naming the setting when a port is taken."""
        http = self.store.settings.http
        self._loop = asyncio.get_running_loop()
        try:
            # The ports come first: a second extension must fail here, before it touches anything of the first one.
            await self.http.start(http.host, http.port, "http.port")
            await self.sensor_http.start(http.host, http.sensor_ws_port, "http.sensor_ws_port")
            self._write_token()
            if self.recorder is not None:
                self.recorder.start()
            self._aim_forwarding()
            await self.mavlink.start()
            await self._listen_to_acoustics()
            await self._hear_simulated_autopilot(settings_enabled=self.store.settings.mavlink.enabled)
        except BaseException:
            await self.stop()
            raise
        if self.store.settings.navigation.enabled:
            self.navigation.process.start()
        self.link.start(self._on_link_change)
        self._ticker = self._loop.create_task(self._tick(), name="status")
        for notice in self.store.notices:
            self.tell(EventLevel.WARNING, notice)
        _log.info("dashboard on http://%s:%d, sensor data on :%d", http.host, self.http.port, self.sensor_http.port)

    async def stop(self) -> None:
        """Take in what is left, write it down and close everything."""
        if self._ticker is not None:
            self._ticker.cancel()
        await self.link.stop()
        self.acoustics.input.stop()
        await asyncio.gather(
            self.topics.close(),
            self.bare.close(),
            self.viewer_link.close(),
            self.udp.stop(),
            self.mavlink.stop(),
            self._simulated_autopilot.stop() if self._simulated_autopilot is not None else asyncio.sleep(0),
            self.navigation.process.stop(),
            asyncio.to_thread(self.recorder.stop) if self.recorder is not None else asyncio.sleep(0),
        )
        await asyncio.gather(self.http.stop(), self.sensor_http.stop())

    async def _hear_simulated_autopilot(self, *, settings_enabled: bool) -> None:
        """Only while no other vehicle can be heard."""
        bridge = self._simulated_autopilot
        if bridge is not None:
            await bridge.stop()
            if not settings_enabled:
                await bridge.start()

    def tell(self, level: EventLevel, text: str) -> None:
        """Publish an event for the user."""
        self.hub.publish(Event(self.link.source.now_s(), level, text))

    async def change_settings(self, change: Callable[[], frozenset[str]]) -> None:
        """Carry out a change of the store, which writes a file, and put into force what can be at once.

        One after the other: two pages that change something at the same moment must not undo each other.
        """
        async with self._changing:
            await self._change_settings(change)

    async def _change_settings(self, change: Callable[[], frozenset[str]]) -> None:
        changed = await asyncio.to_thread(change)
        groups = {key.split(".", 1)[0] for key in changed}
        settings = self.store.settings
        if changed:
            self.tell(EventLevel.INFO, f"settings changed: {', '.join(sorted(changed))}")
        self.link.swap = settings.sonar.swap_a_b
        if isinstance(self.link.source, SerialPort) and "serial" in groups:
            self.link.source.aim(settings.serial.port, settings.serial.baud)
        if "forwarding" in groups:
            self._aim_forwarding()
        if "mavlink" in groups:
            await self.mavlink.apply(mavlink_options(settings))
            await self._hear_simulated_autopilot(settings_enabled=settings.mavlink.enabled)
        if groups & {"navigation", "acoustics"}:
            await self._apply_navigation(changed)
        if "acoustics" in groups:
            await self._apply_acoustics()
        if self.recorder is not None and "recording" in groups:
            self.recorder.set_limits(recording_limits(settings))
            if "recording.enabled" in changed:
                (self.recorder.request_start if settings.recording.enabled else self.recorder.request_stop)()
        self.viewer_link.tell_settings()
        self.status.glance()

    async def _apply_navigation(self, changed: frozenset[str]) -> None:
        process = self.navigation.process
        if changes_estimator(changed) or not self.store.settings.navigation.enabled:
            await process.stop()
        if self.store.settings.navigation.enabled:
            process.start()

    async def _listen_to_acoustics(self) -> None:
        """A replay brings its datagrams itself."""
        acoustics = self.store.settings.acoustics
        wanted = acoustics.enabled and self.link.source.kind == "serial"
        await self.acoustics.input.listen((acoustics.udp_host, acoustics.udp_port) if wanted else None)

    async def _apply_acoustics(self) -> None:
        try:
            await self._listen_to_acoustics()
        except LinkError as error:
            self.tell(EventLevel.ERROR, f"acoustics: {error}")
        self.acoustics.apply_settings()

    def recorder_facts(self) -> RecorderFacts:
        """The recorder; switched off in a replay."""
        return self.recorder.facts() if self.recorder is not None else RecorderFacts(RecorderState.OFF)

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            try:
                self.link.tick(self.link.source.now_s())
                self.system_events.tick()
                self.vehicle.tick()
                self.navigation.tick()
                self.acoustics.tick()
                self.status.tick()
                self.viewer_link.tick()
            except Exception:  # the next second may be better
                _log.exception("the periodic work failed")

    def _take_recorded(self, record: Record) -> None:
        """What a replay brings beside the link."""
        if isinstance(record, AcousticBytes):
            self.acoustics.input.take(record)
        else:
            self.hub.publish(record)

    def _on_link_change(self) -> None:
        self.system_events.link_changed()
        self.status.glance()

    def _navigation_setup(self) -> Setup:
        """A replay keeps and resumes nothing; a simulated vehicle is somewhere else than the real one."""
        settings = self.store.settings
        name = "navigation-simulated.json" if self.simulated else "navigation.json"
        kept = self.link.source.kind == "serial"
        state_file = str(settings.state_folder.absolute() / name) if kept else None
        return Setup(self._navigator, navigator_options(settings), state_file, boot_id())

    def _aim_forwarding(self) -> None:
        forwarding = self.store.settings.forwarding
        routes = {Channel.A: forwarding.route_a, Channel.B: forwarding.route_b}
        self.udp.configure(forwarding.targets, routes, forwarding.mod255_targets)

    def _write_token(self) -> None:
        try:
            self.viewer_link.write_token()
        except OSError as error:
            folder = self.store.settings.state_folder
            self.tell(
                EventLevel.ERROR,
                f"{folder} cannot be written ({error.strerror}): the viewer cannot send commands; make it writable",
            )

    def _make_recorder(self, settings: Settings) -> Recorder:
        recorder = Recorder(
            settings.recordings_folder,
            recording_limits(settings),
            enabled=settings.recording.enabled,
            simulated=self.simulated,
            decoder_settings=_plain(decoder_settings(settings)),
            navigation_settings=lambda: recorded_settings(self.store.settings),
            on_event=self._tell_from_thread,
        )
        self.hub.subscribe(recorder.observe, name="recorder")
        return recorder

    def _make_viewer_link(self, settings: Settings) -> ViewerLink:
        return ViewerLink(
            self.hub,
            settings.state_folder / TOKEN_FILE,
            self.link.command,
            self.recordings,
            ViewerFacts(
                lambda: self.udp.addresses,
                self._viewer_settings,
                self._active_recording,
                lambda: self.status.chips(),
            ),
        )

    def _make_status(self) -> StatusReport:
        sources = StatusSources(
            recorder=self.recorder_facts,
            mavlink=self.mavlink.facts,
            mavlink_counters=self.mavlink.counters,
            forwarding=lambda: self.udp.counters,
            clients=lambda: self.topics.clients + self.bare.clients,
            navigation=self.navigation.facts,
            acoustics=self.acoustics.facts,
        )
        return StatusReport(
            self.hub,
            self.link,
            self.wall,
            sources,
            self.topics,
            simulated=self.simulated,
            on_health=self._take_health,
        )

    def _take_health(self, health: Health) -> None:
        self.system_events.take_health(health)
        self.mavlink.update_faults(health.faults)

    def _viewer_settings(self) -> dict[str, Any]:
        sonar = self.store.settings.sonar
        return {
            "swap_a_b": sonar.swap_a_b,
            "mirror": sonar.mirror,
            "kogger_app_may_change_settings": sonar.kogger_app_may_change_settings,
            "simulated": self.simulated,
            "source": self.link.source.kind,
        }

    def _active_recording(self) -> str | None:
        return self.recorder.active_name if self.recorder is not None else None

    def _greeting(self) -> list[tuple[str, bytes]]:
        return [
            ("status", self.status.message()),
            ("navigation", self.navigation.message()),
            ("acoustics", self.acoustics.message()),
        ]

    def _metrics_extra(self) -> dict[str, float]:
        return {
            "websocket_dropped": self.topics.counters.dropped + self.bare.counters.dropped,
            "websocket_sent": self.topics.counters.sent + self.bare.counters.sent,
            "http_refused": self.http.refused + self.sensor_http.refused,
            "forwarding_refused_chunks": self.udp.refused_chunks,
            "subscriber_errors": sum(self.hub.errors_by_subscriber.values()),
            **self.navigation.counters(),
            **self.acoustics.counters(),
        }

    def _tell_from_thread(self, level: EventLevel, text: str) -> None:
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self.tell, level, text)


def decoder_settings(settings: Settings) -> dict[str, Any]:
    """What the decoder needs; a recording keeps it so that a replay decodes alike."""
    expected = settings.sonar.expected_samples
    return {
        "kogger_checksum": settings.sonar.kogger_checksum,
        "surface_pressure_pa": settings.sensors.surface_pressure_pa,
        "expected_samples": dict.fromkeys(Channel, expected) if expected else None,
    }


def recording_limits(settings: Settings) -> RecordingLimits:
    """The recorder's limits in its own units."""
    recording = settings.recording
    return RecordingLimits(
        max_file_bytes=recording.max_file_mb * _MEGABYTE,
        max_file_s=recording.max_file_minutes * 60.0,
        min_free_bytes=recording.min_free_mb * _MEGABYTE,
    )


def listening_options(address: str) -> MavlinkOptions:
    """A simulator's autopilot is told that somebody listens, and nothing else."""
    host, _, port = address.rpartition(":")
    return MavlinkOptions(
        enabled=True,
        target_host=host,
        target_port=int(port),
        send_attitude=False,
        send_scaled_pressure=False,
        send_gps_raw_int=False,
        send_named_values=False,
        send_status_text=False,
    )


def mavlink_options(settings: Settings) -> MavlinkOptions:
    """The bridge's options: the settings of its group, name by name."""
    return MavlinkOptions(**settings.mavlink.model_dump())


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    expected = values.get("expected_samples")
    return {**values, "expected_samples": {c.value: n for c, n in expected.items()} if expected else None}
