"""What the health checks remember: the newest record of each kind, and how counters moved lately."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from bluerov_slam.pipeline.health_model import PortState
from bluerov_slam.protocol.esp32_messages import KNOWN_TYPES, MessageType
from bluerov_slam.records import (
    AckResult,
    Channel,
    CommandAck,
    CtdSample,
    DeviceStatus,
    GpsFix,
    ImuBurst,
    Ping,
    SensorSample,
)

if TYPE_CHECKING:
    from bluerov_slam.pipeline.health_model import HealthFacts
    from bluerov_slam.records import Record

WINDOW_S = 10.0
RESTART_SHOWN_S = 60.0
COMMAND_ERROR_SHOWN_S = 60.0
# A damaged frame passes the link's 8-bit check once in 256 times, and then looks like one in an unknown layout.
UNKNOWN_LAYOUTS_SHOWN = 3


class RecentIncrease:
    """By how much a counter grew within the last `window_s`."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        self._values: deque[tuple[float, int]] = deque()

    def observe(self, value: int, now_s: float) -> None:
        """Take the counter's value now; a counter that went back has started again."""
        if self._values and value < self._values[-1][1]:
            self._values.clear()
        self._values.append((now_s, value))
        while len(self._values) > 1 and self._values[1][0] <= now_s - self._window_s:
            self._values.popleft()

    @property
    def increase(self) -> int:
        """Newest minus oldest value of the window."""
        return self._values[-1][1] - self._values[0][1] if self._values else 0

    @property
    def rate_hz(self) -> float:
        """Increase per second over the window, 0 while that is too short to tell."""
        elapsed_s = self._values[-1][0] - self._values[0][0] if self._values else 0.0
        return self.increase / elapsed_s if elapsed_s > 0 else 0.0


class HealthMemory:
    """Filled by `observe` (records) and `take` (facts, at every assessment)."""

    def __init__(self) -> None:
        self.sensors: SensorSample | None = None
        self.ctd: CtdSample | None = None
        self.imu_burst: ImuBurst | None = None
        self.gps: GpsFix | None = None
        self.status: DeviceStatus | None = None
        self.pings: dict[Channel, Ping] = {}
        self.command_error: CommandAck | None = None
        self.restarted_s: float | None = None
        self.connected_s: float | None = None
        self.bytes_s: float | None = None
        self.frame_s: float | None = None
        self.sonar_packets_s: dict[Channel, float] = {}
        self.checksum_errors = RecentIncrease()
        self.frames = RecentIncrease()
        self.imu_packets = RecentIncrease()
        self.unknown_layouts = RecentIncrease()
        self.ping_rate = {channel: RecentIncrease() for channel in Channel}
        self.pings_dropped = {channel: RecentIncrease(30.0) for channel in Channel}
        self.pings_incomplete = {channel: RecentIncrease() for channel in Channel}
        self.sonar_errors = {channel: RecentIncrease() for channel in Channel}
        self._bytes = 0
        self._frames = 0
        self._resets = 0
        self._packets: dict[Channel, int] = {}

    def observe(self, record: Record) -> None:
        """Remember a record if it matters to health."""
        if isinstance(record, SensorSample):
            self._observe_sensors(record)
        elif isinstance(record, CtdSample):
            self.ctd = record
        elif isinstance(record, ImuBurst):
            self.imu_burst = record
        elif isinstance(record, GpsFix):
            self.gps = record
        elif isinstance(record, Ping):
            self.pings[record.channel] = record
        elif isinstance(record, DeviceStatus):
            self._observe_status(record)
        elif isinstance(record, CommandAck):
            self._observe_ack(record)

    def take(self, now_s: float, facts: HealthFacts) -> None:
        """Follow the counters."""
        link = facts.counters.link
        if facts.link.state is not PortState.CONNECTED:
            self.connected_s = None
        elif self.connected_s is None:
            self.connected_s = now_s
        if link.bytes_received != self._bytes:
            self._bytes, self.bytes_s = link.bytes_received, now_s
        if link.frames_ok != self._frames:
            self._frames, self.frame_s = link.frames_ok, now_s
        if facts.counters.device_resets != self._resets:
            self._resets = facts.counters.device_resets
            # A board that sends STATUS tells its restarts itself; only an old one is judged by its clock.
            self.restarted_s = now_s if self.status is None else self.restarted_s
        self.checksum_errors.observe(link.checksum_errors, now_s)
        self.frames.observe(link.frames_ok, now_s)
        self.unknown_layouts.observe(facts.counters.unknown_layouts, now_s)
        for channel, sonar in facts.counters.sonars.items():
            self.ping_rate[channel].observe(sonar.pings, now_s)
            self.pings_incomplete[channel].observe(sonar.pings_incomplete, now_s)
            self.sonar_errors[channel].observe(sonar.checksum_errors, now_s)

    @property
    def layout_is_unknown(self) -> bool:
        """Whether sonar data in an unknown layout is the rule, and not a damaged frame now and then."""
        pings = sum(rate.increase for rate in self.ping_rate.values())
        return self.unknown_layouts.increase >= max(UNKNOWN_LAYOUTS_SHOWN, pings)

    def restarted_ago_s(self, now_s: float) -> float | None:
        """Seconds since the board started again, None if that is long ago or never happened."""
        ago_s = None if self.restarted_s is None else now_s - self.restarted_s
        return ago_s if ago_s is not None and ago_s <= RESTART_SHOWN_S else None

    def _observe_sensors(self, sample: SensorSample) -> None:
        self.sensors = sample
        self.imu_packets.observe(sample.imu_packets, sample.arrived_s)
        for channel, packets in ((Channel.A, sample.a_packets), (Channel.B, sample.b_packets)):
            if packets and packets != self._packets.get(channel, packets):
                self.sonar_packets_s[channel] = sample.arrived_s
            self._packets[channel] = packets

    def _observe_status(self, status: DeviceStatus) -> None:
        if self.status is not None and status.boot_count != self.status.boot_count:
            self.restarted_s = status.arrived_s
        self.pings_dropped[Channel.A].observe(status.a_pings_dropped, status.arrived_s)
        self.pings_dropped[Channel.B].observe(status.b_pings_dropped, status.arrived_s)
        self.status = status

    def _observe_ack(self, ack: CommandAck) -> None:
        if ack.result is not AckResult.OK:
            self.command_error = ack
        elif self.command_error is not None and self.command_error.acked_type == ack.acked_type:
            self.command_error = None

    def command_error_text(self, now_s: float) -> str | None:
        """Which command was refused lately, and how."""
        ack = self.command_error
        if ack is None or now_s - ack.arrived_s > COMMAND_ERROR_SHOWN_S:
            return None
        known = ack.acked_type in KNOWN_TYPES
        name = MessageType(ack.acked_type).name if known else f"type 0x{ack.acked_type:02x}"
        return f"{name} was answered with {ack.result.name}"
