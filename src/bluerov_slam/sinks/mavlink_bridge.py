"""Our sensors as MAVLink for QGroundControl, Cockpit and ArduSub, and the vehicle's own messages as records.

A guest on the vehicle's network: component 197, heartbeat as an onboard controller (never a ground station), no
parameter written unasked, nothing invalid sent, nothing sent before the user switches it on. Ground stations do not
tell the components of one vehicle apart when they draw the horizon and the GPS icon, so while the autopilot reports
its own ATTITUDE or GPS_RAW_INT, ours is held back (unless the user wants both).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.pipeline.health import Fault, FaultLevel, MavlinkFacts
from bluerov_slam.protocol import mavlink_map
from bluerov_slam.records import CtdSample, GpsFix, ImuBurst, Record, SensorSample
from bluerov_slam.sinks.mavlink_transport import Mavlink2RestTransport, OnMessage, Transport, UdpTransport

_log = logging.getLogger(__name__)

HEARTBEAT_PERIOD_S = 1.0
PEER_TIMEOUT_S = 5.0
# The autopilot's streams run at 2 Hz and more where they run at all.
AUTOPILOT_HOLD_S = 3.0
# After switching on we listen this long before we send what the autopilot may be sending too.
LISTEN_FIRST_S = 2.5
GPS_FRAME_HOLD_S = 5.0
RATE_MAX_AGE_S = 0.5
NAMED_VALUES_PERIOD_S = 1.0
AUTOPILOT_COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1
MAX_STATUS_TEXTS_PER_UPDATE = 5

_SEVERITY = {
    FaultLevel.ERROR: mavlink.MAV_SEVERITY_ERROR,
    FaultLevel.WARNING: mavlink.MAV_SEVERITY_WARNING,
    FaultLevel.INFO: mavlink.MAV_SEVERITY_INFO,
}


@dataclass(frozen=True, slots=True)
class MavlinkOptions:
    """What the user decided. `defer_to_autopilot`: ATTITUDE and GPS_RAW_INT wait while the autopilot sends its own."""

    enabled: bool = False
    target_host: str = "127.0.0.1"
    target_port: int = 14401
    system_id: int = 1
    component_id: int = 197
    send_attitude: bool = True
    send_scaled_pressure: bool = True
    send_gps_raw_int: bool = True
    send_named_values: bool = True
    send_status_text: bool = True
    defer_to_autopilot: bool = True
    mavlink2rest_url: str = ""

    def same_link(self, other: MavlinkOptions) -> bool:
        """Whether the socket and identity in use still fit: only switches differ."""
        return self._link() == other._link()

    def _link(self) -> tuple[object, ...]:
        return (
            self.enabled,
            self.target_host,
            self.target_port,
            self.system_id,
            self.component_id,
            self.mavlink2rest_url,
        )


class MavlinkBridge:
    """Hand it records with `on_record`; it publishes Vehicle* records. All times are host monotonic seconds."""

    def __init__(self, options: MavlinkOptions, publish: Callable[[Record], None], now_s: Callable[[], float]) -> None:
        self._options = options
        self._publish = publish
        self._now_s = now_s
        self._transport: Transport | None = None
        self._heartbeat: asyncio.Task[None] | None = None
        self._sent: Counter[str] = Counter()
        self._held_back: Counter[str] = Counter()
        self._received: Counter[str] = Counter()
        self._heard_s: float | None = None
        self._enabled_since_s: float | None = None
        self._autopilot_s: dict[str, float] = {}
        self._rates: tuple[float, tuple[float, float, float]] | None = None
        self._gps_frame_s = -math.inf
        self._named_s = -math.inf
        self._device_ms: int | None = None
        self._faults: dict[str, Fault] = {}
        self._status_text_id = 0
        self.listeners: list[OnMessage] = []

    @property
    def system_id(self) -> int:
        """The vehicle's MAVLink system, as which we speak too."""
        return self._options.system_id

    async def start(self) -> None:
        """Open the way out if MAVLink is switched on."""
        options = self._options
        if not options.enabled:
            return
        self._enabled_since_s = self._now_s()
        arguments = (options.system_id, options.component_id, self._on_message)
        if options.mavlink2rest_url:
            self._transport = Mavlink2RestTransport(options.mavlink2rest_url, *arguments)
        else:
            self._transport = UdpTransport(options.target_host, options.target_port, *arguments)
        await self._transport.start()
        self._heartbeat = asyncio.create_task(self._beat(), name="mavlink-heartbeat")
        _log.info("MAVLink to %s as system %d component %d", self._transport.peer, *arguments[:2])

    async def stop(self) -> None:
        """Close everything; nothing is sent afterwards."""
        if self._heartbeat is not None:
            self._heartbeat.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._heartbeat
            self._heartbeat = None
        if self._transport is not None:
            await self._transport.stop()
            self._transport = None
        self._enabled_since_s = self._heard_s = None
        self._autopilot_s.clear()
        self._faults.clear()

    async def apply(self, options: MavlinkOptions) -> None:
        """Take new options; the link is reopened only if it must be."""
        if options.same_link(self._options):
            self._options = options
            return
        await self.stop()
        self._options = options
        await self.start()

    def on_record(self, record: Record) -> None:
        """Send what this record has to say. Quick, never waits."""
        if self._transport is None:
            return
        if isinstance(record, SensorSample):
            self._on_sensors(record)
        elif isinstance(record, CtdSample):
            self._on_ctd(record)
        elif isinstance(record, GpsFix):
            self._gps_frame_s = self._now_s()
            self._send_gps(mavlink_map.gps_raw_int_fields(record))
        elif isinstance(record, ImuBurst) and len(record.angular_rate_radps):
            rates = record.angular_rate_radps.mean(axis=0)
            self._rates = (self._now_s(), (float(rates[0]), float(rates[1]), float(rates[2])))

    def send(self, name: str, fields: Mapping[str, Any]) -> bool:
        """Send a message of another part of the extension; false while MAVLink is off or has no way out."""
        if self._transport is None or not self._transport.send(name, fields):
            return False
        self._sent[name] += 1
        return True

    def update_faults(self, faults: Sequence[Fault]) -> None:
        """STATUSTEXT for each fault that came or went since the last call."""
        current = {fault.id: fault for fault in faults}
        known, self._faults = self._faults, current
        if self._transport is None or not self._options.send_status_text:
            return
        news = [(fault, f"SLAM: {fault.title}") for key, fault in current.items() if key not in known]
        for fault, text in news[:MAX_STATUS_TEXTS_PER_UPDATE]:
            self._send_status_text(text, _SEVERITY[fault.level])
        gone = [f"SLAM: cleared: {fault.title}" for key, fault in known.items() if key not in current]
        for text in gone[:MAX_STATUS_TEXTS_PER_UPDATE]:
            self._send_status_text(text, mavlink.MAV_SEVERITY_INFO)

    def facts(self) -> MavlinkFacts:
        """The bridge as the health page and the chips show it."""
        heard_s = self._heard_s
        return MavlinkFacts(
            enabled=self._options.enabled,
            target=self._options.mavlink2rest_url or f"{self._options.target_host}:{self._options.target_port}",
            sent=self._sent.total(),
            peer_alive=heard_s is not None and self._now_s() - heard_s < PEER_TIMEOUT_S,
            peer=self._transport.peer if self._transport is not None and heard_s is not None else None,
            last_heard_s=heard_s,
            received=self._received.total(),
            enabled_since_s=self._enabled_since_s,
            error=self._transport.error if self._transport is not None else None,
        )

    def counters(self) -> dict[str, dict[str, int]]:
        """Messages by name: sent, held back for the autopilot's own, received."""
        return {"sent": dict(self._sent), "held_back": dict(self._held_back), "received": dict(self._received)}

    def _on_sensors(self, sample: SensorSample) -> None:
        options = self._options
        self._device_ms = sample.device_ms
        if options.send_attitude and (fields := mavlink_map.attitude_fields(sample, self._fresh_rates())):
            self._send_unless_autopilot_does("ATTITUDE", fields)
        if options.send_scaled_pressure and (fields := mavlink_map.scaled_pressure_fields(sample)):
            self.send("SCALED_PRESSURE", fields)
        if self._now_s() - self._gps_frame_s > GPS_FRAME_HOLD_S:
            self._send_gps(mavlink_map.gps_raw_int_fields_of_sample(sample))

    def _on_ctd(self, ctd: CtdSample) -> None:
        now_s = self._now_s()
        if not self._options.send_named_values or now_s - self._named_s < NAMED_VALUES_PERIOD_S:
            return
        if self._device_ms is None:
            return
        self._named_s = now_s
        # Of the SENSORS frame it was computed from: all that we send counts from the start of the board.
        boot_ms = self._device_ms % mavlink_map.UINT32_RANGE
        for name, value in mavlink_map.named_values(ctd):
            self.send("NAMED_VALUE_FLOAT", {"time_boot_ms": boot_ms, "name": name.encode(), "value": value})

    def _send_gps(self, fields: Mapping[str, Any] | None) -> None:
        if fields and self._options.send_gps_raw_int:
            self._send_unless_autopilot_does("GPS_RAW_INT", fields)

    def _send_unless_autopilot_does(self, name: str, fields: Mapping[str, Any]) -> None:
        if self._options.defer_to_autopilot:
            now_s, since_s = self._now_s(), self._enabled_since_s
            listening = since_s is not None and now_s - since_s < LISTEN_FIRST_S
            if listening or now_s - self._autopilot_s.get(name, -math.inf) < AUTOPILOT_HOLD_S:
                self._held_back[name] += 1
                return
        self.send(name, fields)

    def _send_status_text(self, text: str, severity: int) -> None:
        chunks = mavlink_map.status_text_chunks(text)
        self._status_text_id = self._status_text_id % 65535 + 1
        for number, chunk in enumerate(chunks):
            fields = {
                "severity": severity,
                "text": chunk.encode(),
                "id": self._status_text_id if len(chunks) > 1 else 0,
                "chunk_seq": number,
            }
            self.send("STATUSTEXT", fields)

    def _fresh_rates(self) -> tuple[float, float, float] | None:
        if self._rates is None or self._now_s() - self._rates[0] > RATE_MAX_AGE_S:
            return None
        return self._rates[1]

    def _on_message(self, system_id: int, component_id: int, name: str, fields: Mapping[str, Any]) -> None:
        now_s = self._now_s()
        self._heard_s = now_s
        self._received[name] += 1
        from_autopilot = system_id == self._options.system_id and component_id == AUTOPILOT_COMPONENT
        if from_autopilot:
            self._autopilot_s[name] = now_s
        for listener in self.listeners:
            listener(system_id, component_id, name, fields)
        # Drivers of a DVL or an echo sounder speak with identities of their own (BlueOS's as 255/0); all else is the
        # autopilot's.
        if from_autopilot or name in ("VISION_POSITION_DELTA", "DISTANCE_SENSOR"):
            record = mavlink_map.vehicle_record(name, fields, now_s)
            if record is not None:
                self._publish(record)

    async def _beat(self) -> None:
        fields = {
            "type": mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
            "autopilot": mavlink.MAV_AUTOPILOT_INVALID,
            "base_mode": 0,
            "custom_mode": 0,
            "system_status": mavlink.MAV_STATE_ACTIVE,
            "mavlink_version": 3,
        }
        while True:
            self.send("HEARTBEAT", fields)
            await asyncio.sleep(HEARTBEAT_PERIOD_S)
