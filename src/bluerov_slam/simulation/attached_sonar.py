"""A sonar on its UART: pings on its own clock, commands from the board in, frames out at the pace of the line."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.records import Channel
from bluerov_slam.simulation.board import SONAR_BAUD
from bluerov_slam.simulation.kogger_sonar import KoggerSonar, SonarSettings
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.scene import Scene
from bluerov_slam.simulation.sensor_line import SensorLine
from bluerov_slam.simulation.sensors import Instruments
from bluerov_slam.simulation.sonar import PORT, STARBOARD
from bluerov_slam.simulation.timeline import Timeline
from bluerov_slam.simulation.wire import BITS_PER_BYTE

_FIRST_PING_S, _BETWEEN_SONARS_S = 0.02, 0.031
_ANSWER_DELAY_S = 0.002
_CUT_AT = 0.45  # of a ping's bytes; inside a frame
_SERIAL_NUMBER = 4_001


class AttachedSonar:
    """One `KoggerSonar` in the scene. `is_heard` says whether anything it sends or is sent gets through."""

    def __init__(
        self,
        channel: Channel,
        scenario: Scenario,
        scene: Scene,
        instruments: Instruments,
        timeline: Timeline,
        is_heard: Callable[[], bool],
    ) -> None:
        self.line = SensorLine(SONAR_BAUD)
        self._scenario = scenario
        self._scene = scene
        self._instruments = instruments
        self._timeline = timeline
        self._is_heard = is_heard
        self._sides: tuple[int, ...] = (STARBOARD,) if channel is Channel.A else (PORT,)
        if scenario.dual_channel_a and channel is Channel.A:
            self._sides = (PORT, STARBOARD)
        settings = SonarSettings(
            samples=scenario.samples,
            resolution_mm=scenario.resolution_mm,
            period_ms=scenario.ping_period_ms,
            mask=scenario.dataset_mask,
        )
        checksum = scenario.checksum_a if channel is Channel.A else scenario.checksum_b
        self._sonar = KoggerSonar(_SERIAL_NUMBER + channel.index, settings, checksum, self._echo)
        self._cut_next_ping = channel is Channel.B and scenario.b_starts_mid_ping
        self._turn = 0
        self._schedule_ping(_FIRST_PING_S + _BETWEEN_SONARS_S * channel.index)

    def command(self, data: bytes) -> None:
        """The board writes this now."""
        arrives_s = self._timeline.now_s + len(data) * BITS_PER_BYTE / SONAR_BAUD
        self._timeline.at(arrives_s, lambda: self._obey(data))

    def restart_mid_ping(self) -> None:
        """Switched off and on: the board hears the end of a ping, beginning inside a frame."""
        self._cut_next_ping = True
        self._schedule_ping(self._timeline.now_s)

    def _echo(self, samples: int, resolution_mm: int, first_sample: int) -> NDArray[np.uint8]:
        at_s = self._scenario.mission_start_s + self._timeline.now_s
        resolution_m = resolution_mm / 1000.0
        return np.stack([self._scene.ping(side, at_s, samples, resolution_m, first_sample) for side in self._sides])

    def _schedule_ping(self, at_s: float) -> None:
        self._turn += 1
        turn = self._turn
        self._timeline.at(at_s, lambda: self._ping(turn))

    def _ping(self, turn: int) -> None:
        if turn != self._turn:
            return
        now_s, settings = self._timeline.now_s, self._sonar.settings
        if settings.period_s is None:
            return
        self._schedule_ping(now_s + settings.period_s)
        if self._sonar.alive(now_s) and self._is_heard():
            state = self._instruments.state(now_s)
            roll, pitch, yaw = (round(math.degrees(a) * 100) for a in (state.roll_rad, state.pitch_rad, state.yaw_rad))
            water_degc = self._scenario.water.temperature_degc(state.depth_m)
            self._send(self._sonar.period(now_s, (roll, pitch, yaw), water_degc), now_s + settings.two_way_s)

    def _send(self, frames: list[bytes], ready_s: float) -> None:
        if frames and self._cut_next_ping:
            self._cut_next_ping = False
            stream = b"".join(frames)
            frames = [stream[int(len(stream) * _CUT_AT) :]]
        for frame in frames:
            self.line.send(frame, ready_s)

    def _obey(self, data: bytes) -> None:
        now_s = self._timeline.now_s
        if not self._sonar.alive(now_s) or not self._is_heard():
            return
        period_before = self._sonar.settings.period_s
        self._send(self._sonar.receive(data, now_s), now_s + _ANSWER_DELAY_S)
        if self._sonar.settings.period_s != period_before:
            self._schedule_ping(now_s + (self._sonar.settings.period_s or 0.0))
