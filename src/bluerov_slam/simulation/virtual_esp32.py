"""The ESP32 with everything wired to it, in virtual time: bytes on its USB serial line, and what the host says back.

The board itself is a `Board` (the native firmware core, or the Python reference) that runs in lockstep; this is what
surrounds it: sensors and sonars on their UARTs, the I2C devices, the USB line, power and reset, and scripted faults.
The same scenario and the same host bytes at the same times give the same bytes, however `advance` is sliced. For that
the board never runs ahead of an event of the surroundings, nor past a tick that takes bytes of the host: what it then
tells a sensor comes to that sensor in time.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from dataclasses import dataclass, replace

from bluerov_slam.protocol.kogger_bundle import Coding
from bluerov_slam.records import Channel
from bluerov_slam.simulation.acoustic_board import VirtualAcousticBoard, acoustic_board
from bluerov_slam.simulation.attached_instruments import AttachedInstruments
from bluerov_slam.simulation.attached_sonar import AttachedSonar
from bluerov_slam.simulation.board import ROM_BAUD, TICK_US, Board, BoardSettings, BootInfo, Output, Port, Sink
from bluerov_slam.simulation.boot_text import PROBE_BYTES, boot_text
from bluerov_slam.simulation.faults import Fault, FaultKind, WireFaults
from bluerov_slam.simulation.reference_board import ReferenceBoard
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.scene import Scene, SimulatedScene
from bluerov_slam.simulation.sensor_line import SensorLine
from bluerov_slam.simulation.sensors import Instruments
from bluerov_slam.simulation.timeline import Timeline
from bluerov_slam.simulation.wire import PacedWire

_ACOUSTICS_S = 0.02
BOOT_S = 0.6
BOOT_TEXT_AT_S = 0.02
_POWER_ON = 1  # reset reason
_HOST_PIECE_BYTES = 64
_SETTINGS = struct.Struct("<IIB")
_SONAR_SINKS = {Sink.SONAR_A: Channel.A, Sink.SONAR_B: Channel.B}
_SONAR_PORTS = {Channel.A: Port.SONAR_A, Channel.B: Port.SONAR_B}
_UART_SENSORS = {"imu": Port.IMU, "gps": Port.GPS, "ec": Port.EC, "a": Port.SONAR_A, "b": Port.SONAR_B}


@dataclass(frozen=True, slots=True)
class DeviceClock:
    """The board's timer: microseconds since `started_s`, at its crystal's own rate."""

    started_s: float
    rate: float

    def us(self, at_s: float) -> int:
        """Device time at this instant."""
        return math.floor((at_s - self.started_s) * self.rate * 1.0e6 + 1.0e-3)

    def seconds(self, device_us: int) -> float:
        """Virtual time of a device time."""
        return self.started_s + device_us / (self.rate * 1.0e6)


class VirtualEsp32:
    """One board and its surroundings. `advance` gives the bytes it has put on the wire; `receive` takes the host's."""

    def __init__(
        self,
        scenario: Scenario,
        baud: int = 115_200,
        scene: Scene | None = None,
        board: Board | None = None,
        instruments: Instruments | None = None,
    ) -> None:
        self.scenario = scenario
        self.scene = scene or SimulatedScene(scenario)
        self.board: Board = board or ReferenceBoard(legacy=scenario.legacy)
        self.instruments = instruments or Instruments(scenario, self.scene)
        self.plugged = True
        self._rate = 1.0 + scenario.clock_drift_ppm * 1.0e-6
        self._clock = DeviceClock(-scenario.uptime_s, self._rate)
        self._settings = BoardSettings(
            baud,
            scenario.sensors_rate_mhz,
            scenario.imu_rate_mhz,
            scenario.decimation,
            Coding[scenario.coding.upper()],
        )
        self._timeline = Timeline()
        self._wire = PacedWire(baud, self._rate)
        self._wire_faults = WireFaults(scenario.seed)
        self._faults: list[Fault] = []
        self._host_baud: int | None = None
        self._host_line = SensorLine(baud)
        self._host_ticks_us: deque[int] = deque()
        self._reached_us = 0
        self._boot_count = scenario.boot_count
        self._sonars = {channel: self._attach_sonar(channel) for channel in Channel}
        self._small = AttachedInstruments(scenario, self.instruments, self._timeline, self._is_heard, self._tell_i2c)
        self._lines = {_SONAR_PORTS[channel]: sonar.line for channel, sonar in self._sonars.items()} | self._small.lines
        self.acoustics = self._attach_acoustics()
        self.instruments.power_up(-scenario.uptime_s)
        self._start_firmware(_POWER_ON)
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
    def bytes_per_s(self) -> float:
        """What the board's line carries when it never rests, by true time."""
        return self._wire.bytes_per_s

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
            self._timeline.at(start_s + fault.duration_s, self.replug)
        elif fault.kind is FaultKind.MID_PING:
            sonar = self._sonars[Channel.A if fault.sensor == "a" else Channel.B]
            self._timeline.at(start_s, sonar.restart_mid_ping)
        elif fault.kind is FaultKind.PROBE:
            count = max(1, math.ceil(fault.duration_s * fault.rate))
            for index in range(count):
                self._timeline.at(start_s + index / max(fault.rate, 1.0e-3), lambda: self._hear_host(PROBE_BYTES))
        elif fault.kind in (FaultKind.SILENT, FaultKind.I2C_ERRORS):
            self._timeline.at(start_s, lambda: self._fall_silent(fault.sensor))
            self._timeline.at(start_s + fault.duration_s, self._show_i2c_bus)

    def let_speak(self, sensor: str) -> None:
        """End every scripted silence of this sensor now."""
        self._faults = [f for f in self._faults if f.kind is not FaultKind.SILENT or f.sensor != sensor]
        self._show_i2c_bus()

    def replug(self) -> None:
        """The cable is back, if it was pulled: the board gets power and boots."""
        if not self.plugged:
            self.plugged = True
            self.instruments.power_up(self.now_s)
            self._small.power_up()
            self._start_boot(_POWER_ON)

    def advance(self, until_s: float) -> bytes:
        """Run to this virtual time; the bytes whose last bit has left the board by then."""
        self._run(until_s)
        return self._wire.take(until_s)

    def receive(self, data: bytes, at_s: float) -> None:
        """Bytes that the host begins to send at this instant (not before the present)."""
        self._run(max(at_s, self.now_s))
        if self.plugged:
            mismatch = self._host_baud is not None and self._host_baud != self._wire.baud
            self._hear_host(self._wire_faults.garble(data) if mismatch else data)

    def close(self) -> None:
        """End the board, which may be a program of its own."""
        self.board.close()

    def _run(self, until_s: float) -> None:
        while True:
            event_s = self._timeline.next_s
            if self._running and not self._run_board(min(event_s, until_s)):
                continue
            if event_s > until_s:
                break
            self._timeline.run_next()
        self._timeline.now_s = max(self.now_s, until_s)

    def _run_board(self, until_s: float) -> bool:
        """Let the board run; whether it got there, and did not stop on the way to say something."""
        until_us = self._clock.us(until_s)
        while self._reached_us < until_us:
            tick_us = self._bring_host(until_us)
            stop_us = min(until_us, tick_us)
            if stop_us // TICK_US > self._reached_us // TICK_US:
                self._bring_sensors(stop_us)
                self._reached_us, outputs = self.board.run(stop_us)
                for output in outputs:
                    self._obey(output)
                if any(output.sink != Sink.LINK for output in outputs):
                    return False
            self._reached_us = max(self._reached_us, stop_us)
        return True

    def _bring_host(self, until_us: int) -> int:
        """Hand the next bytes of the host over; the tick that will take them, beyond which nothing is known."""
        while self._host_ticks_us and self._host_ticks_us[0] <= self._reached_us:
            self._host_ticks_us.popleft()
        if not self._host_ticks_us:
            end_s = self._host_line.next_s
            if end_s == math.inf or (at_us := self._clock.us(end_s)) > until_us:
                return until_us
            self.board.feed(Port.HOST, self._host_line.pop(), at_us)
            self._host_ticks_us.append(max(-(-at_us // TICK_US), self._reached_us // TICK_US + 1) * TICK_US)
        return self._host_ticks_us[0]

    def _bring_sensors(self, until_us: int) -> None:
        for port, line in self._lines.items():
            while (end_s := line.next_s) < math.inf and (at_us := self._clock.us(end_s)) <= until_us:
                self.board.feed(port, line.pop(), at_us)

    def _obey(self, output: Output) -> None:
        """What the board has put out goes where it belongs."""
        at_s = max(self._clock.seconds(output.at_us), self.now_s)
        if output.sink == Sink.LINK:
            self._send(output.data, at_s)
            return
        self._timeline.now_s = at_s
        if output.sink in _SONAR_SINKS:
            self._sonars[_SONAR_SINKS[Sink(output.sink)]].command(output.data)
        elif output.sink == Sink.IMU:
            self._small.command_imu(output.data)
        elif output.sink == Sink.EC:
            self._small.command_ec(output.data)
        elif output.sink == Sink.LINK_BAUD:
            self._set_baud(int.from_bytes(output.data, "little"))
        elif output.sink == Sink.SETTINGS:
            sensors_rate_mhz, imu_rate_mhz, decimation = _SETTINGS.unpack(output.data)
            self._settings = replace(
                self._settings, sensors_rate_mhz=sensors_rate_mhz, imu_rate_mhz=imu_rate_mhz, decimation=decimation
            )

    def _send(self, frame: bytes, at_s: float) -> None:
        if self._host_baud is not None and self._host_baud != self._wire.baud:
            frame = self._wire_faults.garble(frame)
        self._put(frame, at_s)

    def _put(self, data: bytes, at_s: float) -> None:
        self._wire.put(self._wire_faults.damage(data, at_s, self._faults), at_s)

    def _hear_host(self, data: bytes) -> None:
        for start in range(0, len(data), _HOST_PIECE_BYTES):
            self._host_line.send(data[start : start + _HOST_PIECE_BYTES], self.now_s)

    def _set_baud(self, baud: int) -> None:
        self._wire.baud = self._host_line.baud = baud

    def _start_firmware(self, reset_reason: int) -> None:
        self._running = True
        self._set_baud(self._settings.baud)
        for line in (self._host_line, *self._lines.values()):
            line.skip(self.now_s)
        self._host_ticks_us.clear()
        self._reached_us = self._clock.us(self.now_s)
        self.board.boot(BootInfo(self._reached_us, self._boot_count & 0xFFFF, reset_reason), self._settings)
        self._small.show_i2c()
        self._show_i2c_bus()

    def _reset(self, reason: int) -> None:
        if self.plugged:
            self._stop()
            self._start_boot(reason)

    def _start_boot(self, reason: int) -> None:
        """The boot ROM speaks, then the firmware starts; another reset before that calls it off."""
        self._clock = DeviceClock(self.now_s, self._rate)
        boot = self._boot_count
        self._timeline.at(self.now_s + BOOT_TEXT_AT_S, lambda: self._print_boot_text(boot, boot_text(reason)))
        self._timeline.at(self.now_s + BOOT_S, lambda: self._boot(boot, reason))

    def _stop(self) -> None:
        self._wire.cut(self.now_s)
        self._running = False
        self._boot_count += 1

    def _print_boot_text(self, boot: int, text: bytes) -> None:
        """The boot ROM always talks at 115200; a host at another rate reads nonsense."""
        if not self.plugged or boot != self._boot_count:
            return
        self._wire.baud = ROM_BAUD
        host_baud = self._host_baud or self._settings.baud
        self._put(text if host_baud == ROM_BAUD else self._wire_faults.garble(text), self.now_s)

    def _boot(self, boot: int, reason: int) -> None:
        if self.plugged and boot == self._boot_count:
            self._wire.cut(self.now_s)
            self._start_firmware(reason)

    def _unplug(self) -> None:
        self._stop()
        self.plugged = False

    def _attach_sonar(self, channel: Channel) -> AttachedSonar:
        def is_heard() -> bool:
            return self._is_heard(channel.lower())

        return AttachedSonar(channel, self.scenario, self.scene, self.instruments, self._timeline, is_heard)

    def _attach_acoustics(self) -> VirtualAcousticBoard | None:
        """The acoustic board whose frames the ESP32 passes on, stamped by its own clock."""
        plan = self.scenario.acoustics
        if plan is None or plan.link != "serial":
            return None
        self._timeline.at(_ACOUSTICS_S, self._pass_acoustics)
        return acoustic_board(self.scenario, self.scene, clock_us=lambda at_s: self._clock.us(at_s))

    def _pass_acoustics(self) -> None:
        self._timeline.at(self.now_s + _ACOUSTICS_S, self._pass_acoustics)
        assert self.acoustics is not None
        for _, frame in self.acoustics.advance(self.now_s):
            if self._running:
                self._send(frame, self.now_s)

    def _is_heard(self, sensor: str) -> bool:
        """Whether this sensor has power and no fault keeps it silent."""
        return self.plugged and not any(
            fault.kind is FaultKind.SILENT and fault.sensor == sensor and fault.active(self.now_s)
            for fault in self._faults
        )

    def _fall_silent(self, sensor: str) -> None:
        """A scripted silence begins: on a UART even in the middle of a message."""
        if sensor in _UART_SENSORS:
            port = _UART_SENSORS[sensor]
            came = self._lines[port].cut(self.now_s)
            if came and self._running:
                self.board.feed(port, came, self._clock.us(self.now_s))
        self._show_i2c_bus()

    def _show_i2c_bus(self) -> None:
        held = any(fault.kind is FaultKind.I2C_ERRORS and fault.active(self.now_s) for fault in self._faults)
        self._small.show_i2c_bus(held)

    def _tell_i2c(self, what: int, data: bytes) -> None:
        if self._running:
            self.board.i2c(what, data, self._clock.us(self.now_s))
