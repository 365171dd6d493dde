"""The ESP32 with everything wired to it, in virtual time: bytes on its USB serial line, and what the host says back.

The board is a list of timed events (sensor polls, sonar bytes, reports) and one line that carries ten bits per byte.
Whenever the line is free, the most urgent waiting frame starts; nothing is ever interrupted in the middle of a frame.
The same scenario and the same host bytes at the same times give the same bytes, however `advance` is sliced.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.protocol.esp32_messages import (
    ConfigKey,
    Esp32FrameDecoder,
    MessageType,
    StatusFields,
    config_allowed,
    pack_status,
    unpack_config,
    unpack_kogger_command,
    unpack_time_sync,
)
from bluerov_slam.protocol.kogger_bundle import PAYLOAD_LIMIT_115200, PAYLOAD_LIMIT_921600, Coding
from bluerov_slam.protocol.kogger_frame import FrameType, KoggerFrameDecoder, KoggerId
from bluerov_slam.records import AckResult, Channel
from bluerov_slam.simulation.board_sensors import BoardSensors
from bluerov_slam.simulation.faults import Fault, FaultKind, WireFaults
from bluerov_slam.simulation.kogger_sonar import KoggerSonar, SonarSettings
from bluerov_slam.simulation.reports import PROBE_BYTES, ImuBurstCollector, boot_text, gps_payload
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.scene import Scene, SimulatedScene
from bluerov_slam.simulation.send_queue import Priority, SendQueue
from bluerov_slam.simulation.sensors import Instruments
from bluerov_slam.simulation.sonar import PORT, STARBOARD
from bluerov_slam.simulation.sonar_port import HeardPing, SonarPort
from bluerov_slam.simulation.timeline import Timeline
from bluerov_slam.simulation.wire import BITS_PER_BYTE, PacedWire

FIRMWARE_VERSION = (0, 1, 0)
ROM_BAUD = 115_200
SONAR_BAUD = 921_600
BAUD_TRIAL_S = 5.0
BOOT_S = 0.6
BOOT_TEXT_AT_S = 0.02
_PING_SILENCE_S = 0.008
_GPS_LATENCY_S = 0.12
_COMMAND_SILENCE_S = 0.3
_MAX_COMMANDS_PENDING = 8
_MAX_SONAR_BACKLOG_S = 0.15
_RAW_ENTER_LOAD, _RAW_LEAVE_LOAD = 0.75, 0.85
_OTHER_LOAD_BYTES_PER_S = 1_500.0
_ANSWER_DELAY_S = 0.002
_I2C_RETRIES_PER_S = 20
_U32 = 0xFFFFFFFF


class VirtualEsp32:
    """One board. `advance` gives the bytes it has put on the wire; `receive` takes the host's."""

    def __init__(self, scenario: Scenario, baud: int = 115_200, scene: Scene | None = None) -> None:
        self.scenario = scenario
        self.scene = scene or SimulatedScene(scenario)
        self.instruments = Instruments(scenario, self.scene)
        self.instruments.power_up(-scenario.uptime_s)
        self.plugged = True
        self._default_baud = baud
        self._wire = PacedWire(baud)
        self._wire_faults = WireFaults(scenario.seed)
        self._faults: list[Fault] = []
        self._host_baud: int | None = None
        self._timeline = Timeline()
        self._boot_count = scenario.boot_count
        self._reset_reason = 1
        self._booted_s = -scenario.uptime_s
        self._sonars = {channel: self._make_sonar(channel) for channel in Channel}
        self._sonar_turn = dict.fromkeys(Channel, 0)
        self._cut_next_ping = {Channel.A: False, Channel.B: scenario.b_starts_mid_ping}
        self._start_firmware()
        for channel in Channel:
            self._schedule_ping(channel, 0.02 + 0.031 * channel.index)
        for fault in scenario.faults:
            self.add_fault(fault)

    @property
    def now_s(self) -> float:
        """Virtual time."""
        return self._timeline.now_s

    @property
    def baud(self) -> int:
        """The rate the board's line runs at right now."""
        return self._wire.baud

    @property
    def unplug_faults(self) -> list[Fault]:
        """The scripted times without a cable."""
        return [fault for fault in self._faults if fault.kind is FaultKind.UNPLUG]

    def set_host_baud(self, baud: int | None) -> None:
        """The rate the host's side is set to; None = whatever the board uses."""
        self._host_baud = baud

    def add_fault(self, fault: Fault) -> None:
        """Script one more fault; one whose time has passed starts now."""
        start_s = max(fault.at_s, self.now_s)
        fault = replace(fault, at_s=start_s)
        self._faults.append(fault)
        if fault.kind is FaultKind.RESET:
            self._timeline.at(start_s, lambda: self._reset(fault.reason))
        elif fault.kind is FaultKind.UNPLUG:
            self._timeline.at(start_s, self._unplug)
            self._timeline.at(start_s + fault.duration_s, self._replug)
        elif fault.kind is FaultKind.MID_PING:
            self._timeline.at(start_s, lambda: self._restart_mid_ping(Channel.A if fault.sensor == "a" else Channel.B))
        elif fault.kind is FaultKind.PROBE:
            count = max(1, math.ceil(fault.duration_s * fault.rate))
            for index in range(count):
                self._timeline.at(start_s + index / max(fault.rate, 1.0e-3), lambda: self._take(PROBE_BYTES))

    def advance(self, until_s: float) -> bytes:
        """Run to this virtual time; the bytes whose last bit has left the board by then."""
        self._run(until_s)
        return self._wire.take(until_s)

    def receive(self, data: bytes, at_s: float) -> None:
        """Bytes that reach the board from the host at this instant (not before the present)."""
        self._run(max(at_s, self.now_s))
        if self.plugged:
            mismatch = self._host_baud is not None and self._host_baud != self._wire.baud
            self._take(self._wire_faults.garble(data) if mismatch else data)

    def _run(self, until_s: float) -> None:
        while True:
            event_s = self._timeline.next_s
            send_s = max(self._wire.free_at_s, self.now_s) if self._queue else math.inf
            if min(event_s, send_s) > until_s:
                break
            if event_s <= send_s:
                self._timeline.run_next()
            else:
                self._timeline.now_s = send_s
                self._send_next()
        self._timeline.now_s = max(self.now_s, until_s)

    def _at_while_running(self, at_s: float, action: Callable[[], None]) -> None:
        """Like `_at`, but forgotten when the board restarts before."""
        boot = self._boot_count
        self._timeline.at(at_s, lambda: action() if boot == self._boot_count and self._running else None)

    def _every(self, period_s: Callable[[], float], action: Callable[[], None], first_s: float) -> None:
        def tick() -> None:
            due_s = self.now_s
            action()
            self._at_while_running(due_s + period_s(), tick)

        self._at_while_running(first_s, tick)

    def _device_us(self, at_s: float) -> int:
        drift = 1.0 + self.scenario.clock_drift_ppm * 1.0e-6
        return int((at_s - self._booted_s) * drift * 1.0e6 + 0.5)

    def _start_firmware(self) -> None:
        self._running = True
        self._queue = SendQueue(self._wire.bytes_per_s * _MAX_SONAR_BACKLOG_S)
        self._decoder = Esp32FrameDecoder()
        self._ports = {channel: SonarPort(channel) for channel in Channel}
        self._pending_commands: dict[Channel, list[float]] = {channel: [] for channel in Channel}
        self._config = {
            ConfigKey.SENSORS_RATE_MHZ: self.scenario.sensors_rate_mhz,
            ConfigKey.IMU_RATE_MHZ: self.scenario.imu_rate_mhz,
            ConfigKey.DECIMATION: self.scenario.decimation,
        }
        self._sensors = BoardSensors(self.instruments, self._is_silent, self.scenario.legacy)
        self._imu_burst = ImuBurstCollector()
        self._bad_commands = 0
        self._i2c_errors = 0
        self._tx_bytes = 0
        self._load_mark = (self.now_s, 0)
        self._load_percent = 0
        self._raw_mode = False
        self._baud_trial = 0
        now_s = self.now_s
        self._every(lambda: 1000.0 / self._config[ConfigKey.SENSORS_RATE_MHZ], self._send_sensors, now_s + 0.05)
        self._every(lambda: 1000.0 / self._config[ConfigKey.IMU_RATE_MHZ], self._sample_imu, now_s + 0.013)
        self._every(lambda: 1.0, self._sample_gps, math.floor(now_s) + 1.0 + _GPS_LATENCY_S)
        self._every(lambda: 1.0, self._sensors_poll, now_s + 0.01)
        if not self.scenario.legacy:
            self._every(lambda: 1.0, self._send_status, now_s + 0.2)

    def _reset(self, reason: int) -> None:
        if self.plugged:
            self._stop()
            self._start_boot(reason)

    def _start_boot(self, reason: int) -> None:
        self._reset_reason = reason
        self._booted_s = self.now_s
        text = boot_text(reason)
        self._timeline.at(self.now_s + BOOT_TEXT_AT_S, lambda: self._print_boot_text(text))
        self._timeline.at(self.now_s + BOOT_S, self._boot)

    def _stop(self) -> None:
        self._wire.cut(self.now_s)
        self._queue.clear()
        self._running = False
        self._boot_count += 1

    def _print_boot_text(self, text: bytes) -> None:
        """The boot ROM always talks at 115200; a host at another rate reads nonsense."""
        if not self.plugged:
            return
        self._wire.baud = ROM_BAUD
        host_baud = self._host_baud or self._default_baud
        self._put(text if host_baud == ROM_BAUD else self._wire_faults.garble(text))

    def _boot(self) -> None:
        if self.plugged and not self._running:
            self._wire.cut(self.now_s)
            self._wire.baud = self._default_baud
            self._start_firmware()

    def _unplug(self) -> None:
        self._stop()
        self.plugged = False

    def _replug(self) -> None:
        self.plugged = True
        self.instruments.power_up(self.now_s)
        self._start_boot(1)

    def _is_silent(self, sensor: str) -> bool:
        return any(
            fault.kind is FaultKind.SILENT and fault.sensor == sensor and fault.active(self.now_s)
            for fault in self._faults
        )

    def _send_sensors(self) -> None:
        payload = self._sensors.payload(self.now_s, self._device_us(self.now_s) // 1000 & _U32, self._ports)
        self._queue.put(Priority.SENSORS, MessageType.SENSORS, payload)

    def _sensors_poll(self) -> None:
        self._sensors.poll_conductivity(self.now_s)
        failing = [f for f in self._faults if f.kind is FaultKind.I2C_ERRORS and f.active(self.now_s)]
        silent = sum(self._is_silent(sensor) for sensor in ("depth", "celsius"))
        self._sensors.i2c_failing = bool(failing)
        errors = sum(int(fault.rate) for fault in failing) + _I2C_RETRIES_PER_S * silent
        self._i2c_errors = (self._i2c_errors + errors) & 0xFFFF

    def _sample_imu(self) -> None:
        reading = self._sensors.poll_imu(self.now_s)
        interval_s = 1000.0 / self._config[ConfigKey.IMU_RATE_MHZ]
        payload = self._imu_burst.add(reading, self._device_us(self.now_s) & _U32, interval_s)
        if payload is not None and not self.scenario.legacy:
            self._queue.put(Priority.REPORTS, MessageType.IMU_BURST, payload)

    def _sample_gps(self) -> None:
        report = self._sensors.poll_gps(self.now_s - _GPS_LATENCY_S)
        if report is not None and not self.scenario.legacy:
            payload = gps_payload(report, self._device_us(self.now_s) & _U32)
            self._queue.put(Priority.REPORTS, MessageType.GPS, payload)

    def _send_status(self, echoed_host_us: int = 0) -> None:
        self._measure_load()
        port_a, port_b = self._ports[Channel.A], self._ports[Channel.B]
        device_us = self._device_us(self.now_s)
        dropped = self._queue.pings_dropped
        fields = StatusFields(
            1,
            *FIRMWARE_VERSION,
            uptime_ms=device_us // 1000 & _U32,
            boot_count=self._boot_count & 0xFFFF,
            reset_reason=self._reset_reason,
            link_load_percent=self._load_percent,
            tx_bytes=self._tx_bytes & _U32,
            a_pings_dropped=dropped[Channel.A],
            b_pings_dropped=dropped[Channel.B],
            a_frame_errors=port_a.frame_errors,
            b_frame_errors=port_b.frame_errors,
            a_overflow_bytes=port_a.overflow_bytes,
            b_overflow_bytes=port_b.overflow_bytes,
            i2c_errors=self._i2c_errors,
            imu_errors=0,
            gps_errors=0,
            ec_errors=0,
            bad_commands=self._bad_commands & 0xFFFF,
            echoed_host_us=echoed_host_us,
            echo_device_us=device_us & _U32 if echoed_host_us else 0,
        )
        self._queue.put(Priority.REPORTS, MessageType.STATUS, pack_status(fields))

    def _measure_load(self) -> None:
        since_s, bytes_then = self._load_mark
        elapsed_s = self.now_s - since_s
        if elapsed_s >= 0.5:
            load = (self._tx_bytes - bytes_then) / (elapsed_s * self._wire.bytes_per_s)
            self._load_percent = min(100, round(100 * load))
            self._load_mark = (self.now_s, self._tx_bytes)

    def _make_sonar(self, channel: Channel) -> KoggerSonar:
        scenario = self.scenario
        settings = SonarSettings(
            samples=scenario.samples,
            resolution_mm=scenario.resolution_mm,
            period_ms=scenario.ping_period_ms,
            mask=scenario.dataset_mask,
        )
        side = STARBOARD if channel is Channel.A else PORT
        sides = (PORT, STARBOARD) if scenario.dual_channel_a and channel is Channel.A else (side,)

        def echo(samples: int, resolution_mm: int, first_sample: int) -> NDArray[np.uint8]:
            at_s = scenario.mission_start_s + self.now_s
            return np.stack([self.scene.ping(s, at_s, samples, resolution_mm / 1000.0, first_sample) for s in sides])

        checksum = scenario.checksum_a if channel is Channel.A else scenario.checksum_b
        return KoggerSonar(4_001 + channel.index, settings, checksum, echo)

    def _schedule_ping(self, channel: Channel, at_s: float) -> None:
        self._sonar_turn[channel] += 1
        turn = self._sonar_turn[channel]
        self._timeline.at(at_s, lambda: self._ping(channel, turn))

    def _ping(self, channel: Channel, turn: int) -> None:
        if turn != self._sonar_turn[channel]:
            return
        sonar = self._sonars[channel]
        period_s = sonar.settings.period_s
        if period_s is not None:
            self._schedule_ping(channel, self.now_s + period_s)
            if sonar.alive(self.now_s) and self.plugged and not self._is_silent(channel.lower()):
                state = self.instruments.state(self.now_s)
                angles = [round(math.degrees(a) * 100) for a in (state.roll_rad, state.pitch_rad, state.yaw_rad)]
                water_degc = self.scenario.water.temperature_degc(state.depth_m)
                frames = sonar.period(self.now_s, (angles[0], angles[1], angles[2]), water_degc)
                self._deliver(channel, frames, self.now_s + sonar.settings.two_way_s)

    def _deliver(self, channel: Channel, frames: list[bytes], start_s: float) -> None:
        """Bring a sonar's bytes to the board at the pace of its UART."""
        if frames and self._cut_next_ping[channel]:
            # Switched on in the middle of a ping: the board hears the rest, beginning inside a frame.
            self._cut_next_ping[channel] = False
            stream = b"".join(frames)
            frames = [stream[int(len(stream) * 0.45) :]]
        at_s = start_s
        for frame in frames:
            at_s += len(frame) * BITS_PER_BYTE / SONAR_BAUD
            self._at_while_running(at_s, lambda data=frame: self._hear(channel, data))  # type: ignore[misc]
        self._at_while_running(at_s + _PING_SILENCE_S, lambda: self._end_ping(channel))

    def _hear(self, channel: Channel, data: bytes) -> None:
        port = self._ports[channel]
        t_us = self._device_us(self.now_s - len(data) * BITS_PER_BYTE / SONAR_BAUD) & _U32
        pings, others = port.feed(data, self.now_s, t_us)
        for ping in pings:
            self._send_ping(port, ping)
        if others:
            self._pending_commands[channel].clear()
            if not self.scenario.legacy:
                for frame_type, payload in port.raw(others, t_us, self._payload_limit):
                    port.overflow_bytes += self._queue.put(Priority.SONAR_RAW, frame_type, payload)

    def _end_ping(self, channel: Channel) -> None:
        port = self._ports[channel]
        for ping in port.close_after_silence(self.now_s, _PING_SILENCE_S):
            self._send_ping(port, ping)

    def _send_ping(self, port: SonarPort, ping: HeardPing) -> None:
        if self._choose_raw():
            frames = port.raw(ping.frames, ping.t_us, self._payload_limit)
        else:
            coding = Coding.PEAK if self.scenario.coding == "peak" else Coding.MEAN
            frames = port.compressed(ping, self._config[ConfigKey.DECIMATION], coding, self._payload_limit)
        self._queue.put_ping(port.channel, frames)

    def _choose_raw(self) -> bool:
        """Whole pings go untouched where the link has room for both sonars, with hysteresis."""
        wanted = sum(port.raw_bytes_per_s for port in self._ports.values()) + _OTHER_LOAD_BYTES_PER_S
        limit = _RAW_LEAVE_LOAD if self._raw_mode else _RAW_ENTER_LOAD
        known = all(port.raw_bytes_per_s > 0.0 or port.bytes == 0 for port in self._ports.values())
        fast = self._wire.baud > ROM_BAUD
        self._raw_mode = fast and known and not self.scenario.legacy and wanted < limit * self._wire.bytes_per_s
        return self._raw_mode

    def _restart_mid_ping(self, channel: Channel) -> None:
        self._cut_next_ping[channel] = True
        self._schedule_ping(channel, self.now_s)

    @property
    def _payload_limit(self) -> int:
        return PAYLOAD_LIMIT_115200 if self._wire.baud <= ROM_BAUD else PAYLOAD_LIMIT_921600

    def _send_next(self) -> None:
        frame = self._queue.pop()
        self._tx_bytes += len(frame)
        if self._host_baud is not None and self._host_baud != self._wire.baud:
            frame = self._wire_faults.garble(frame)
        self._put(frame)

    def _put(self, data: bytes) -> None:
        self._wire.put(self._wire_faults.damage(data, self.now_s, self._faults), self.now_s)

    def _take(self, data: bytes) -> None:
        if not self._running or self.scenario.legacy:
            return
        before = self._decoder.counters
        frames = self._decoder.feed(data)
        after = self._decoder.counters
        bad = after.checksum_errors + after.length_errors - before.checksum_errors - before.length_errors
        self._bad_commands += bad or int(after.bytes_skipped > before.bytes_skipped)
        for frame_type, payload in frames:
            self._baud_trial = 0
            self._obey(frame_type, payload)

    def _obey(self, frame_type: int, payload: bytes) -> None:
        if frame_type in (MessageType.KOGGER_COMMAND_A, MessageType.KOGGER_COMMAND_B):
            self._relay(frame_type, payload)
        elif frame_type == MessageType.CONFIG:
            self._configure(payload)
        elif frame_type == MessageType.TIME_SYNC:
            sync = unpack_time_sync(payload)
            if sync is not None:
                self._send_status(sync.host_us)
        else:
            self._bad_commands += 1
            if frame_type >= MessageType.KOGGER_COMMAND_A:
                self._queue.acknowledge(frame_type, payload[0] if payload else 0, AckResult.UNKNOWN)

    def _relay(self, frame_type: int, payload: bytes) -> None:
        command = unpack_kogger_command(frame_type, payload)
        if command is None:
            self._bad_commands += 1
            return
        result = self._judge(command.channel, command.frame)
        self._queue.acknowledge(frame_type, command.sequence, result)
        if result is not AckResult.OK:
            self._bad_commands += 1
            return
        self._pending_commands[command.channel].append(self.now_s)
        sonar = self._sonars[command.channel]
        arrives_s = self.now_s + len(command.frame) * BITS_PER_BYTE / SONAR_BAUD
        self._timeline.at(arrives_s, lambda: self._sonar_command(command.channel, sonar, command.frame))

    def _judge(self, channel: Channel, frame: bytes) -> AckResult:
        frames = KoggerFrameDecoder("mod256").feed(frame)
        if len(frames) != 1 or len(frames[0].raw) != len(frame):
            return AckResult.BAD_INNER_CHECKSUM
        if frames[0].frame_id == KoggerId.UART and frames[0].frame_type == FrameType.SETTING:
            return AckResult.REJECTED  # another baud rate would cut the board off from its sonar
        pending = [sent_s for sent_s in self._pending_commands[channel] if self.now_s - sent_s < _COMMAND_SILENCE_S]
        self._pending_commands[channel] = pending
        return AckResult.BUSY if len(pending) >= _MAX_COMMANDS_PENDING else AckResult.OK

    def _sonar_command(self, channel: Channel, sonar: KoggerSonar, frame: bytes) -> None:
        if not sonar.alive(self.now_s) or self._is_silent(channel.lower()):
            return
        period_before = sonar.settings.period_s
        answers = sonar.receive(frame, self.now_s)
        if answers:
            self._deliver(channel, answers, self.now_s + _ANSWER_DELAY_S)
        if sonar.settings.period_s != period_before:
            self._schedule_ping(channel, self.now_s + (sonar.settings.period_s or 0.0))

    def _configure(self, payload: bytes) -> None:
        config = unpack_config(payload)
        if config is None or not all(config_allowed(key, value) for key, value in config.pairs):
            self._bad_commands += 1
            self._queue.acknowledge(MessageType.CONFIG, payload[0] if payload else 0, AckResult.REJECTED)
            return
        self._queue.acknowledge(MessageType.CONFIG, config.sequence, AckResult.OK)
        for key, value in config.pairs:
            if key != ConfigKey.BAUD:
                self._config[ConfigKey(key)] = value
            elif value != self._wire.baud:
                self._queue.after_acks(lambda baud=value: self._try_baud(baud))  # type: ignore[misc]

    def _try_baud(self, baud: int) -> None:
        """Change the rate behind the acknowledgement, and back unless the host is heard at the new one."""
        before, self._baud_trial = self._wire.baud, baud
        self._set_baud(baud)

        def revert() -> None:
            if self._baud_trial == baud:
                self._baud_trial = 0
                self._set_baud(before)

        self._at_while_running(self.now_s + BAUD_TRIAL_S, revert)

    def _set_baud(self, baud: int) -> None:
        self._wire.baud = baud
        self._queue.set_ping_limit(self._wire.bytes_per_s * _MAX_SONAR_BACKLOG_S)
