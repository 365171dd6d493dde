"""Link bytes to records: the one path of live operation, replay and batch.

The same (data, arrived_s) blocks always give the same records. Calling `flush` in between, or not, changes when an
overdue ping comes out and nothing else.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from bluerov_slam.clock import DeviceClock
from bluerov_slam.pipeline.acoustic_frames import AcousticFrames
from bluerov_slam.pipeline.link_counters import LinkDecoderCounters
from bluerov_slam.pipeline.sea_water_watch import SeaWaterWatch
from bluerov_slam.pipeline.sonar_channel import SonarChannel
from bluerov_slam.protocol.esp32_messages import (
    KNOWN_TYPES,
    Esp32FrameDecoder,
    ImuScale,
    MessageType,
    unpack_command_ack,
    unpack_gps,
    unpack_imu_burst,
    unpack_kogger_raw,
    unpack_status,
)
from bluerov_slam.protocol.esp32_records import device_status, gps_fix, imu_burst
from bluerov_slam.protocol.even_bundle import expand_even
from bluerov_slam.protocol.kogger_bundle import UnknownLayout, expand
from bluerov_slam.protocol.sensor_frame import unpack_sensors
from bluerov_slam.records import Channel, CommandAck, UnknownFrame

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bluerov_slam.protocol.kogger_frame import ChecksumChoice
    from bluerov_slam.records import Record, SensorSample

# SENSORS come at least every 2 s from any healthy board: a longer silence means that the link was down.
LINK_DOWN_S = 3.0
SONAR_ALIVE_S = 2.0


class SonarActivity:
    """`alive` of both sonars for the sensor JSON: a packet counter of SENSORS advanced within the last 2 s."""

    def __init__(self) -> None:
        self._packets: dict[Channel, int] = {}
        self._advanced_s: dict[Channel, float] = {}
        self._now_s = 0.0

    def observe(self, sample: SensorSample) -> None:
        """Take the counters of one sample."""
        self._now_s = sample.arrived_s
        for channel, packets in ((Channel.A, sample.a_packets), (Channel.B, sample.b_packets)):
            if channel in self._packets and packets != self._packets[channel]:
                self._advanced_s[channel] = sample.arrived_s
            self._packets[channel] = packets

    def alive(self, channel: Channel) -> bool:
        """Whether the sonar sent anything up to 2 s before the newest sample."""
        advanced_s = self._advanced_s.get(channel)
        return advanced_s is not None and self._now_s - advanced_s <= SONAR_ALIVE_S


class LinkDecoder:
    """Everything that comes up the link, as records. Nothing in the bytes makes it raise."""

    def __init__(
        self,
        kogger_checksum: ChecksumChoice = "auto",
        surface_pressure_pa: float = 101_325.0,
        expected_samples: Mapping[Channel, int] | None = None,
    ) -> None:
        expected = expected_samples or {}
        self.clock = DeviceClock()
        self.activity = SonarActivity()
        self.sea_water = SeaWaterWatch(surface_pressure_pa)
        self._frames = Esp32FrameDecoder()
        self._sonars = {channel: SonarChannel(channel, kogger_checksum, expected.get(channel)) for channel in Channel}
        self._sonars_in_order = tuple(self._sonars.values())
        self._acoustics = AcousticFrames(self.clock)
        self._last_arrived_s: float | None = None
        self._last_echo_us = 0
        self._unknown_types: Counter[int] = Counter()
        self._undecoded: Counter[int] = Counter()
        self._malformed: Counter[int] = Counter()
        self._unknown_layouts = 0
        self._unknown_layout_reason = ""
        self._handlers = {
            MessageType.SENSORS.value: self._on_sensors,
            MessageType.KOGGER_RAW_A.value: self._on_raw_a,
            MessageType.KOGGER_RAW_B.value: self._on_raw_b,
            MessageType.KOGGER_COMPRESSED.value: self._on_compressed,
            MessageType.IMU_BURST.value: self._on_imu_burst,
            MessageType.STATUS.value: self._on_status,
            MessageType.COMMAND_ACK.value: self._on_command_ack,
            MessageType.GPS.value: self._on_gps,
            **self._acoustics.handlers,
        }

    @property
    def bytes_wanted(self) -> int:
        """Bytes still missing of the AA55 frame being received, 0 when none is open."""
        return self._frames.bytes_wanted

    @property
    def counters(self) -> LinkDecoderCounters:
        """A snapshot of all counts since this decoder was made."""
        return LinkDecoderCounters(
            link=self._frames.counters,
            sonars={channel: sonar.counters for channel, sonar in self._sonars.items()},
            unknown_types=dict(self._unknown_types),
            undecoded=dict(self._undecoded),
            malformed=dict(self._malformed),
            unknown_layouts=self._unknown_layouts,
            unknown_layout_reason=self._unknown_layout_reason,
            acoustic_records=self._acoustics.counters,
            sender=self.sea_water.sender,
            device_resets=self.clock.resets,
            conductivity_distrusted=self.sea_water.conductivity_distrusted,
            pressure_distrusted=self.sea_water.pressure_distrusted,
        )

    def feed(self, data: bytes, arrived_s: float) -> list[Record]:
        """Take the bytes of one read; returns the records they complete, in stream order."""
        records = self.flush(arrived_s)
        if self._last_arrived_s is not None and arrived_s - self._last_arrived_s > LINK_DOWN_S:
            self.sea_water.reconnected()
        self._last_arrived_s = arrived_s
        self._dispatch(self._frames.feed(data), arrived_s, records)
        return records

    def flush(self, now_s: float) -> list[Record]:
        """Pings and acoustic records whose end is overdue at `now_s`; call it now and then while nothing arrives."""
        records: list[Record] = []
        for sonar in self._sonars_in_order:
            sonar.expire(now_s, records)
        self._acoustics.expire(now_s, records)
        return records

    def finish(self) -> list[Record]:
        """The stream has ended: frames inside an incomplete one, the open pings and the open acoustic record."""
        records: list[Record] = []
        self._dispatch(self._frames.flush(), self._last_arrived_s or 0.0, records)
        for sonar in self._sonars_in_order:
            sonar.finish(records)
        self._acoustics.finish(records)
        return records

    def _dispatch(self, frames: list[tuple[int, bytes]], arrived_s: float, records: list[Record]) -> None:
        handlers = self._handlers
        for frame_type, payload in frames:
            handler = handlers.get(frame_type)
            if handler is None:
                self._on_other(frame_type, payload, arrived_s, records)
            elif not handler(payload, arrived_s, records):
                self._malformed[frame_type] += 1

    # Each handler returns False when the frame's content does not add up.

    def _on_sensors(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        fields = unpack_sensors(payload)
        if fields is None:
            return False
        resets = self.clock.resets
        measured_s = self.clock.map_ms32(fields.device_ms, arrived_s)
        if self.clock.resets != resets:
            self.sea_water.reconnected()
        sample, ctd = self.sea_water.samples(fields, measured_s, arrived_s)
        self.activity.observe(sample)
        records += (sample, ctd)
        return True

    def _on_raw_a(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        return self._on_raw(Channel.A, payload, arrived_s, records)

    def _on_raw_b(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        return self._on_raw(Channel.B, payload, arrived_s, records)

    def _on_raw(self, channel: Channel, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        fields = unpack_kogger_raw(payload)
        if fields is None:
            return False
        measured_s = self.clock.map_us32(fields.t_us, arrived_s)
        self._sonars[channel].feed_raw(fields.frames, measured_s, arrived_s, records)
        return True

    def _on_compressed(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        bundle = expand_even(payload) or expand(payload)
        if isinstance(bundle, UnknownLayout):
            self._unknown_layouts += 1
            self._unknown_layout_reason = bundle.reason
            return True
        measured_s = self.clock.map_us32(bundle.t_us, arrived_s)
        self._sonars[bundle.channel].feed_bundle(bundle, len(payload), measured_s, arrived_s, records)
        return True

    def _on_imu_burst(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        fields = unpack_imu_burst(payload)
        if fields is None or fields.scale != ImuScale.HWT905_RAW:
            return False
        records.append(imu_burst(fields, self.clock.map_us32(fields.t0_us, arrived_s), arrived_s))
        return True

    def _on_status(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        fields = unpack_status(payload)
        if fields is None:
            return False
        measured_s = self.clock.map_ms32(fields.uptime_ms, arrived_s)
        if fields.echoed_host_us not in (0, self._last_echo_us):
            self._last_echo_us = fields.echoed_host_us
            self.clock.note_echo(fields.echoed_host_us / 1e6, fields.echo_device_us)
        records.append(device_status(fields, measured_s, arrived_s))
        return True

    def _on_command_ack(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        fields = unpack_command_ack(payload)
        if fields is None:
            return False
        records.append(CommandAck(arrived_s, fields.acked_type, fields.sequence, fields.result))
        return True

    def _on_gps(self, payload: bytes, arrived_s: float, records: list[Record]) -> bool:
        fields = unpack_gps(payload)
        if fields is None:
            return False
        records.append(gps_fix(fields, self.clock.map_us32(fields.t_us, arrived_s), arrived_s))
        return True

    def _on_other(self, frame_type: int, payload: bytes, arrived_s: float, records: list[Record]) -> None:
        known = frame_type in KNOWN_TYPES
        (self._undecoded if known else self._unknown_types)[frame_type] += 1
        records.append(UnknownFrame(arrived_s, frame_type, len(payload)))
