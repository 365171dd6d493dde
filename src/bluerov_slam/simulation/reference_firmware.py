"""One life of the reference board, from boot to the next: inputs, jobs and transmitter of every tick.

`docs/firmware-core.md` says what happens; this is its plainest form in Python, there to check the native core.
`next_us` names the first instant at which a tick without new input would do anything, so that idle ticks cost nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bluerov_slam.protocol.esp32_messages import (
    ConfigKey,
    GpsFields,
    ImuBurstFields,
    ImuScale,
    MessageType,
    StatusFields,
    pack_gps,
    pack_imu_burst,
    pack_status,
)
from bluerov_slam.protocol.kogger_bundle import Coding, compress_ping
from bluerov_slam.protocol.sensor_frame import pack_sensors
from bluerov_slam.records import AckResult, Channel
from bluerov_slam.simulation.board import BoardSettings, BootInfo, I2cBus, Output, Port, Sink
from bluerov_slam.simulation.board_readers.readings import ImuSample
from bluerov_slam.simulation.reference_commands import HostCommands
from bluerov_slam.simulation.reference_legacy import as_legacy
from bluerov_slam.simulation.reference_queue import SendQueue, Urgency
from bluerov_slam.simulation.reference_sensors import BoardSensors
from bluerov_slam.simulation.reference_sonar import HeardPing, SonarPort
from bluerov_slam.simulation.reference_transmitter import Transmitter

FIRMWARE_VERSION = (0, 2, 0)
_SENSORS_PHASE_US, _STATUS_PHASE_US = 50_000, 200_000
_STATUS_PERIOD_US = 1_000_000
_SHORTEST_MARK_US = 500_000
_OTHER_BYTES_PER_S = 1_500  # until it was measured
_ENTER_RAW_PERCENT, _LEAVE_RAW_PERCENT = 75, 85
_T_US_BYTES = 4
_U16, _U32 = 0xFFFF, 0xFFFFFFFF
_SONAR_PORTS = {Port.SONAR_A: Channel.A, Port.SONAR_B: Channel.B}


@dataclass(slots=True)
class _Job:
    """Something that is due every so often."""

    due_us: int

    def due(self, now_us: int, period_us: int) -> bool:
        """Whether it is due; the next time is then set."""
        if now_us < self.due_us:
            return False
        self.due_us += period_us
        if self.due_us <= now_us:
            self.due_us = now_us + period_us
        return True


@dataclass(slots=True)
class _Load:
    """What the line carried since the last mark."""

    mark_us: int
    bytes_then: int = 0
    other_bytes_then: int = 0
    percent: int = 0
    other_bytes_per_s: int = _OTHER_BYTES_PER_S

    def measure(self, now_us: int, line: Transmitter) -> None:
        elapsed_us = now_us - self.mark_us
        if elapsed_us < _SHORTEST_MARK_US:
            return
        capacity = elapsed_us * line.bytes_per_s
        self.percent = min(100, (200_000_000 * (line.bytes_sent - self.bytes_then) + capacity) // (2 * capacity))
        self.other_bytes_per_s = (line.other_bytes_sent - self.other_bytes_then) * 1_000_000 // elapsed_us
        self.mark_us, self.bytes_then, self.other_bytes_then = now_us, line.bytes_sent, line.other_bytes_sent


class Firmware:
    """Everything the board knows between two boots. `legacy`: SENSORS and 0x04 only, fields that wrap, deaf."""

    def __init__(self, info: BootInfo, settings: BoardSettings, bus: I2cBus, legacy: bool) -> None:
        self.settings = settings
        self._info = info
        self._legacy = legacy
        self._outputs: list[Output] = []
        self._now_us = info.boot_us
        self._queue = SendQueue()
        self._line = Transmitter(self._queue, settings.baud)
        self._load = _Load(info.boot_us)
        self._commands = HostCommands()
        self._ports = {channel: SonarPort(channel) for channel in Channel}
        self._ping_numbers = dict.fromkeys(Channel, 0)
        self._raw = False
        self._sensors = BoardSensors(bus, info.boot_us, self)
        self._sensors_job = _Job(info.boot_us + _SENSORS_PHASE_US)
        self._status_job = _Job(info.boot_us + _STATUS_PHASE_US)
        self.ring_overflow_bytes = dict.fromkeys(Channel, 0)

    def tick(self, now_us: int, taken: Mapping[int, bytes]) -> list[Output]:
        """One tick with the batch of each port that has one; what it put out."""
        self._now_us = now_us
        self._outputs = []
        if taken:
            self._take(taken)
        self._sensors.run_jobs(now_us, self.settings.imu_rate_mhz)
        for channel, port in self._ports.items():
            if now_us >= port.silence_us:
                self._send_ping(channel, port.end_ping(now_us))
        if self._sensors_job.due(now_us, self._sensors_period_us):
            self._send_sensors()
        if self._status_job.due(now_us, _STATUS_PERIOD_US):
            self.send_status(0, 0)
        self._line.tick(now_us, self._outputs)
        return self._outputs

    def next_us(self) -> int:
        """No tick before this has anything to do unless bytes arrive."""
        return min(
            self._sensors.next_us(),
            self._ports[Channel.A].silence_us,
            self._ports[Channel.B].silence_us,
            self._sensors_job.due_us,
            self._status_job.due_us,
            self._line.next_us(),
        )

    def _take(self, taken: Mapping[int, bytes]) -> None:
        for port in Port:
            data = taken.get(port)
            if not data:
                continue
            if port in _SONAR_PORTS:
                self._hear(_SONAR_PORTS[port], data)
            elif port is Port.HOST:
                if not self._legacy:
                    self._commands.feed(data, self._now_us, self)
            else:
                self._sensors.feed(port, data, self._now_us, self.settings.imu_rate_mhz)

    def _hear(self, channel: Channel, data: bytes) -> None:
        port = self._ports[channel]
        pings, others = port.feed(data, self._now_us)
        for ping in pings:
            self._send_ping(channel, ping)
        if others:
            self._commands.answered(channel)
            if not self._legacy:
                for frame_type, payload in port.raw_payloads(others, self._line.payload_limit):
                    self._queue.put(Urgency.SONAR_OTHER, frame_type, payload)

    def _send_ping(self, channel: Channel, ping: HeardPing) -> None:
        limit = self._line.payload_limit
        if self._choose_raw() and max(map(len, ping.frames)) + _T_US_BYTES <= limit:
            frames = [(frame, ping.time_us) for frame in ping.frames]
            payloads = self._ports[channel].raw_payloads(frames, limit)
        else:
            self._ping_numbers[channel] += 1
            compressed = compress_ping(
                channel,
                ping.chunks,
                ping_number=self._ping_numbers[channel],
                t_us=ping.time_us,
                version=ping.version,
                mark=ping.mark,
                decimation=self.settings.decimation,
                coding=Coding(self.settings.coding),
                payload_limit=limit,
            )
            payloads = [(int(MessageType.KOGGER_COMPRESSED), payload) for payload in compressed]
        self._queue.put_ping(channel, payloads, self._line.bytes_per_s)

    def _choose_raw(self) -> bool:
        """Whole pings go untouched where the line has room for both sonars, with hysteresis."""
        ports = self._ports.values()
        wanted = sum(port.rate_bytes_per_s or 0 for port in ports) + self._load.other_bytes_per_s
        percent = _LEAVE_RAW_PERCENT if self._raw else _ENTER_RAW_PERCENT
        known = all(port.rate_bytes_per_s is not None or port.bytes == 0 for port in ports)
        self._raw = not self._legacy and known and wanted * 100 < percent * self._line.bytes_per_s
        return self._raw

    def _send_sensors(self) -> None:
        fields = replace(
            self._sensors.fields(self._now_us),
            device_ms=self._now_us // 1000 & _U32,
            a_packets=self._ports[Channel.A].packets & _U32,
            a_bytes=self._ports[Channel.A].bytes & _U32,
            b_packets=self._ports[Channel.B].packets & _U32,
            b_bytes=self._ports[Channel.B].bytes & _U32,
        )
        payload = pack_sensors(as_legacy(fields) if self._legacy else fields)
        self._queue.put(Urgency.SENSORS, MessageType.SENSORS, payload)

    def note_recovery(self) -> None:
        """The I2C bus was recovered."""
        self._outputs.append(Output(Sink.I2C_RECOVERY, self._now_us, b""))

    @property
    def _sensors_period_us(self) -> int:
        return 1_000_000_000 // self.settings.sensors_rate_mhz

    # What commands ask for.

    def heard_host(self) -> None:
        self._line.heard_host()

    def acknowledge(self, acked_type: int, sequence: int, result: AckResult) -> None:
        self._queue.acknowledge(acked_type, sequence, result)

    def write_sonar(self, channel: Channel, frame: bytes) -> None:
        self._outputs.append(Output(Sink.SONAR_A if channel is Channel.A else Sink.SONAR_B, self._now_us, frame))

    def configure(self, pairs: Sequence[tuple[int, int]]) -> None:
        before = self.settings
        for key, value in pairs:
            if key == ConfigKey.SENSORS_RATE_MHZ:
                self.settings = replace(self.settings, sensors_rate_mhz=value)
            elif key == ConfigKey.IMU_RATE_MHZ:
                self.settings = replace(self.settings, imu_rate_mhz=value)
            elif key == ConfigKey.DECIMATION:
                self.settings = replace(self.settings, decimation=value)
            else:
                self._line.change_baud(value)
        if self.settings.sensors_rate_mhz != before.sensors_rate_mhz:
            self._sensors_job.due_us = self._now_us + self._sensors_period_us
        if self.settings.imu_rate_mhz != before.imu_rate_mhz:
            self._sensors.imu.rate_changed()
        if self.settings != before:
            self._outputs.append(Output(Sink.SETTINGS, self._now_us, pack_saved_settings(self.settings)))

    def send_status(self, echoed_host_us: int, echo_device_us: int) -> None:
        self._load.measure(self._now_us, self._line)
        if self._legacy:
            return
        port_a, port_b = self._ports[Channel.A], self._ports[Channel.B]
        overflow = {c: self.ring_overflow_bytes[c] + self._queue.lost_sonar_bytes[c] & _U32 for c in Channel}
        fields = StatusFields(
            1,
            *FIRMWARE_VERSION,
            uptime_ms=self._now_us // 1000 & _U32,
            boot_count=self._info.boot_count & _U16,
            reset_reason=self._info.reset_reason,
            link_load_percent=self._load.percent,
            tx_bytes=self._line.bytes_sent & _U32,
            a_pings_dropped=self._queue.pings_dropped[Channel.A],
            b_pings_dropped=self._queue.pings_dropped[Channel.B],
            a_frame_errors=port_a.frame_errors & _U32,
            b_frame_errors=port_b.frame_errors & _U32,
            a_overflow_bytes=overflow[Channel.A],
            b_overflow_bytes=overflow[Channel.B],
            i2c_errors=self._sensors.bus.errors & _U16,
            imu_errors=self._sensors.imu.errors & _U16,
            gps_errors=self._sensors.gps.errors & _U16,
            ec_errors=self._sensors.ec.errors & _U16,
            bad_commands=self._commands.bad & _U16,
            echoed_host_us=echoed_host_us,
            echo_device_us=echo_device_us & _U32,
        )
        self._queue.put(Urgency.REPORTS, MessageType.STATUS, pack_status(fields))

    # What the sensors' readers report and write.

    def imu_burst(self, t0_us: int, dt_us: int, samples: Sequence[ImuSample]) -> None:
        if not self._legacy:
            rows = [(*sample.acceleration, *sample.angular_rate, *sample.magnetic_field) for sample in samples]
            burst = ImuBurstFields(t0_us, dt_us, ImuScale.HWT905_RAW, np.array(rows, np.int16))
            self._queue.put(Urgency.REPORTS, MessageType.IMU_BURST, pack_imu_burst(burst))

    def gps_report(self, report: GpsFields) -> None:
        if not self._legacy:
            self._queue.put(Urgency.REPORTS, MessageType.GPS, pack_gps(report))

    def port_write(self, port: int, data: bytes, now_us: int) -> None:
        self._outputs.append(Output(port, now_us, data))


def pack_saved_settings(settings: BoardSettings) -> bytes:
    """What survives power-off, as `Sink.SETTINGS` carries it."""
    rates = settings.sensors_rate_mhz.to_bytes(4, "little") + settings.imu_rate_mhz.to_bytes(4, "little")
    return rates + bytes((settings.decimation,))
