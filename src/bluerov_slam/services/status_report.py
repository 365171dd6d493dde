"""The `status` topic: chips, faults and every counter, once a second and at once when a chip changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import orjson

from bluerov_slam import __version__
from bluerov_slam.clock import WallClock
from bluerov_slam.pipeline.health import (
    AcousticFacts,
    Health,
    HealthFacts,
    HealthMonitor,
    LinkFacts,
    MavlinkFacts,
    NavigationFacts,
    RecorderFacts,
)
from bluerov_slam.pipeline.health_memory import RecentIncrease
from bluerov_slam.pipeline.link_counters import LinkDecoderCounters, SonarCounters
from bluerov_slam.records import (
    Channel,
    CommandAck,
    CtdSample,
    DeviceStatus,
    GpsFix,
    ImuBurst,
    Ping,
    SensorSample,
)
from bluerov_slam.services.esp_link import EspLink
from bluerov_slam.services.hub import Hub
from bluerov_slam.sinks.udp_kogger import ForwardingCounters
from bluerov_slam.sinks.websocket import Broadcaster

PROTOCOL: Final = "binary_v4"
# Chips are looked at when sensors arrive, so that a change shows at once; more often than this is of no use.
GLANCE_PERIOD_S: Final = 0.25
BITS_PER_BYTE: Final = 10
_HEALTH_RECORDS: Final = (SensorSample, CtdSample, ImuBurst, GpsFix, Ping, DeviceStatus, CommandAck)


@dataclass(frozen=True, slots=True)
class StatusSources:
    """Whom the report asks, each time anew."""

    recorder: Callable[[], RecorderFacts]
    mavlink: Callable[[], MavlinkFacts]
    mavlink_counters: Callable[[], Mapping[str, Mapping[str, int]]]
    forwarding: Callable[[], Sequence[ForwardingCounters]]
    clients: Callable[[], int]
    navigation: Callable[[], NavigationFacts | None] = lambda: None
    acoustics: Callable[[], AcousticFacts | None] = lambda: None


class StatusReport:
    """Assesses health and publishes the status; `on_health` gets it at each assessment."""

    def __init__(
        self,
        hub: Hub,
        link: EspLink,
        wall: WallClock,
        sources: StatusSources,
        broadcaster: Broadcaster,
        *,
        simulated: bool,
        on_health: Callable[[Health], None] = lambda _health: None,
    ) -> None:
        self._link = link
        self._wall = wall
        self._sources = sources
        self._broadcaster = broadcaster
        self._simulated = simulated
        self._on_health = on_health
        self._monitor = HealthMonitor()
        self._health = Health((), ())
        self._device: DeviceStatus | None = None
        self._bytes = RecentIncrease(5.0)
        self._pings = {channel: RecentIncrease(5.0) for channel in Channel}
        self._glanced_s = float("-inf")
        hub.subscribe(self._monitor.observe, *_HEALTH_RECORDS, name="health")
        hub.subscribe(self._on_device, DeviceStatus, name="status")
        hub.subscribe(self._on_sensors, SensorSample, name="status")

    @property
    def health(self) -> Health:
        """Chips and faults as last assessed."""
        return self._health

    def chips(self) -> list[dict[str, Any]]:
        """The chips as last assessed, as the topic has them."""
        return _chips_json(self._health)

    def tick(self) -> None:
        """Once a second: assess and publish."""
        now_s = self._link.source.now_s()
        counters = self._link.counters
        self._bytes.observe(counters.link.bytes_received, now_s)
        for channel, sonar in counters.sonars.items():
            self._pings[channel].observe(sonar.pings, now_s)
        self._take(self._assessed(now_s, counters))
        self._publish()

    def glance(self) -> None:
        """Something changed: assess, and publish if a chip looks different now."""
        now_s = self._link.source.now_s()
        self._glanced_s = now_s
        before = self._chip_states()
        self._take(self._assessed(now_s, self._link.counters))
        if self._chip_states() != before:
            self._publish()

    def message(self) -> bytes:
        """The whole message of the topic, now."""
        t = round(self._wall.unix_s(self._link.source.now_s()), 3)
        return orjson.dumps({"topic": "status", "t": t, "data": self.data()})

    def data(self) -> dict[str, Any]:
        """The topic's object, now."""
        now_s = self._link.source.now_s()
        counters = self._link.counters
        health = self._health if self._health.chips else self._assessed(now_s, counters)
        mavlink = self._sources.mavlink()
        return {
            "chips": _chips_json(health),
            "faults": [asdict(fault) for fault in health.faults],
            "link": self._link_json(counters),
            "sonars": {channel.value: self._sonar_json(channel, counters, now_s) for channel in Channel},
            "recorder": asdict(self._sources.recorder()),
            "mavlink": {
                **asdict(mavlink),
                "by_message": self._sources.mavlink_counters(),
                "last_heard_s": None if mavlink.last_heard_s is None else now_s - mavlink.last_heard_s,
            },
            "clock": self._clock_json(),
            "firmware": self._firmware_json(),
            "clients": self._sources.clients(),
            "forwarding": [asdict(target) for target in self._sources.forwarding()],
            "versions": {"extension": __version__, "protocol": PROTOCOL},
            "simulated": self._simulated,
            "source": self._link.source.kind,
        }

    def _assessed(self, now_s: float, counters: LinkDecoderCounters) -> Health:
        facts = HealthFacts(
            link=self._link.source.facts(),
            recorder=self._sources.recorder(),
            mavlink=self._sources.mavlink(),
            counters=counters,
            wall_trusted=self._wall.is_trusted(),
            extension_version=__version__,
            navigation=self._sources.navigation(),
            acoustics=self._sources.acoustics(),
        )
        return self._monitor.assess(now_s, facts)

    def _take(self, health: Health) -> None:
        self._health = health
        self._on_health(health)

    def _chip_states(self) -> list[str]:
        return [chip.state for chip in self._health.chips]

    def _publish(self) -> None:
        if self._broadcaster.wants("status"):
            self._broadcaster.publish_text("status", self.message())

    def _on_device(self, status: DeviceStatus) -> None:
        self._device = status

    def _on_sensors(self, sample: SensorSample) -> None:
        if sample.arrived_s - self._glanced_s >= GLANCE_PERIOD_S:
            self.glance()

    def _link_json(self, counters: LinkDecoderCounters) -> dict[str, Any]:
        link, facts = counters.link, self._link.source.facts()
        bytes_per_s = self._bytes.rate_hz
        return {
            "port": facts.port,
            "by_id": facts.by_id,
            "baud": facts.baud,
            "connected": is_connected(facts),
            "bytes": link.bytes_received,
            "bytes_per_s": round(bytes_per_s, 1),
            "load_percent": round(100.0 * bytes_per_s * BITS_PER_BYTE / facts.baud, 1),
            "frames": link.frames_ok,
            "frames_by_type": {f"0x{kind:02x}": count for kind, count in sorted(link.frames_by_type.items())},
            "crc_errors": link.checksum_errors,
            "length_errors": link.length_errors,
            "bytes_skipped": link.bytes_skipped,
            "resyncs": link.resyncs,
            "unknown_types": sum(counters.unknown_types.values()),
            "reconnects": facts.reconnects,
            "waiting_for": facts.waiting_for,
        }

    def _sonar_json(self, channel: Channel, counters: LinkDecoderCounters, now_s: float) -> dict[str, Any]:
        sonar = counters.sonars.get(channel, SonarCounters())
        resolution_m, samples = sonar.resolution_m, sonar.samples
        range_m = None
        if resolution_m is not None and samples is not None:
            range_m = round(resolution_m * (samples + (sonar.first_sample or 0)), 3)
        whole = sonar.pings + sonar.pings_missed
        return {
            "alive": self._link.alive(channel) or _is_recent(sonar.last_ping_arrived_s, now_s),
            "pings": sonar.pings,
            "pings_per_s": round(self._pings[channel].rate_hz, 2),
            "bytes": sonar.bytes,
            "frames": sonar.frames,
            "checksum_errors": sonar.checksum_errors,
            "incomplete": sonar.pings_incomplete,
            "gaps_samples": sonar.gap_samples,
            "lost_percent": round(100.0 * sonar.pings_missed / whole, 2) if whole else None,
            "dropped_by_firmware": self._dropped_by_firmware(channel),
            "samples": samples,
            "resolution_mm": None if resolution_m is None else round(resolution_m * 1000),
            "range_m": range_m,
            "coding": sonar.coding,
            "checksum_in_use": sonar.checksum_in_use,
        }

    def _dropped_by_firmware(self, channel: Channel) -> int | None:
        if self._device is None:
            return None
        return self._device.a_pings_dropped if channel is Channel.A else self._device.b_pings_dropped

    def _clock_json(self) -> dict[str, Any]:
        clock = self._link.decoder.clock
        return {
            "device_offset_s": clock.offset_s,
            "drift_ppm": clock.drift_ppm,
            "wall_trusted": self._wall.is_trusted(),
            "gps_utc_offset_s": self._wall.gps_utc_offset_s,
            "steps": [asdict(step) for step in self._wall.steps],
        }

    def _firmware_json(self) -> dict[str, Any] | None:
        status = self._device
        if status is None:
            return None
        fields = asdict(status)
        for key in ("measured_s", "arrived_s", "echoed_host_us", "echo_device_us", "firmware_version", "uptime_ms"):
            del fields[key]
        return {
            "version": ".".join(map(str, status.firmware_version)),
            "uptime_s": status.uptime_ms / 1000.0,
            "boots": fields.pop("boot_count"),
            **fields,
        }


def is_connected(facts: LinkFacts) -> bool:
    """Whether bytes can come."""
    return facts.state == "connected"


def _chips_json(health: Health) -> list[dict[str, Any]]:
    return [{**asdict(chip), "age_s": None if chip.age_s is None else round(chip.age_s, 1)} for chip in health.chips]


def _is_recent(arrived_s: float | None, now_s: float) -> bool:
    return arrived_s is not None and now_s - arrived_s <= 2.0
