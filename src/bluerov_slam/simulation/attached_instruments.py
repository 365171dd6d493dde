"""IMU, GPS receiver, conductivity probe and both I2C sensors on their wires, each with its own clock and settings."""

from __future__ import annotations

import struct
from collections.abc import Callable

from bluerov_slam.simulation.board import SENSOR_BAUD, BusState, I2cInput, Port
from bluerov_slam.simulation.ezo_probe import EzoProbe
from bluerov_slam.simulation.raw_sensors import (
    MS5837_PROM,
    TSYS01_PROM,
    ms5837_adc,
    nmea_second,
    tsys01_adc,
    witmotion_packets,
)
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.sensor_line import SensorLine
from bluerov_slam.simulation.sensors import Instruments
from bluerov_slam.simulation.timeline import Timeline
from bluerov_slam.simulation.wire import BITS_PER_BYTE
from bluerov_slam.simulation.witmotion_imu import ImuSettings, WitMotionImu

_FIRST_IMU_SAMPLE_S = 0.013
_USUAL_IMU_RATE_HZ = 20.0
_GPS_LATENCY_S = 0.12
_EC_PERIOD_S, _FIRST_EC_S = 1.0, 0.01
_I2C_PERIOD_S = 0.1
_BUS_STATES = {
    (True, True): BusState.FINE,
    (False, True): BusState.MS5837_SILENT,
    (True, False): BusState.TSYS01_SILENT,
    (False, False): BusState.BOTH_SILENT,
}


class AttachedInstruments:
    """The small sensors. `is_heard(name)` says whether a sensor gets through, `tell_i2c` reaches the I2C devices."""

    def __init__(
        self,
        scenario: Scenario,
        instruments: Instruments,
        timeline: Timeline,
        is_heard: Callable[[str], bool],
        tell_i2c: Callable[[int, bytes], None],
    ) -> None:
        self.lines = {port: SensorLine(SENSOR_BAUD) for port in (Port.IMU, Port.GPS, Port.EC)}
        self._instruments = instruments
        self._timeline = timeline
        self._is_heard = is_heard
        self._tell_i2c = tell_i2c
        self._imu, self._ec = WitMotionImu(), EzoProbe()
        if not scenario.new_sensors:
            self._imu = WitMotionImu(ImuSettings(rate_hz=_USUAL_IMU_RATE_HZ))
            self._ec = EzoProbe(shown=("EC", "S"))
        self._imu_turn = 0
        self._schedule_imu(_FIRST_IMU_SAMPLE_S)
        # The receiver reports at whole seconds of UTC.
        timeline.at(1.0 - scenario.utc_start_unix_s % 1.0 + _GPS_LATENCY_S, self._report_position)
        timeline.at(_FIRST_EC_S, self._report_conductivity)
        timeline.at(_I2C_PERIOD_S, self._renew_i2c)

    def power_up(self) -> None:
        """The sensors got power again."""
        self._imu.power_up()
        self._schedule_imu(self._timeline.now_s + 1.0 / self._imu.settings.rate_hz)

    def command_imu(self, data: bytes) -> None:
        """The board writes to the IMU."""
        self._after(data, self._set_imu)

    def command_ec(self, data: bytes) -> None:
        """The board writes to the probe."""
        self._after(data, self._set_ec)

    def show_i2c(self) -> None:
        """The I2C devices hold what they hold, also for a board that has just booted."""
        self._tell_i2c(I2cInput.MS5837_PROM, struct.pack("<7H", *MS5837_PROM))
        self._tell_i2c(I2cInput.TSYS01_PROM, struct.pack("<8H", *TSYS01_PROM))
        self._measure_i2c()

    def show_i2c_bus(self, held_low: bool) -> None:
        """Who answers on the bus."""
        state = _BUS_STATES[self._is_heard("depth"), self._is_heard("celsius")]
        self._tell_i2c(I2cInput.BUS, bytes((BusState.HELD_LOW if held_low else state,)))

    def _after(self, data: bytes, action: Callable[[bytes], None]) -> None:
        """Do this when the last of these bytes has reached the sensor."""
        arrives_s = self._timeline.now_s + len(data) * BITS_PER_BYTE / SENSOR_BAUD
        self._timeline.at(arrives_s, lambda: action(data))

    def _set_imu(self, data: bytes) -> None:
        if self._is_heard("imu"):
            rate_hz = self._imu.settings.rate_hz
            self._imu.receive(data, self._timeline.now_s)
            if self._imu.settings.rate_hz != rate_hz:
                self._schedule_imu(self._timeline.now_s + 1.0 / self._imu.settings.rate_hz)

    def _set_ec(self, data: bytes) -> None:
        if self._is_heard("ec"):
            for answer in self._ec.receive(data):
                self.lines[Port.EC].send(answer, self._timeline.now_s + EzoProbe.ANSWER_S)

    def _schedule_imu(self, at_s: float) -> None:
        self._imu_turn += 1
        turn = self._imu_turn
        self._timeline.at(at_s, lambda: self._sample_imu(turn))

    def _sample_imu(self, turn: int) -> None:
        if turn != self._imu_turn:
            return
        now_s = self._timeline.now_s
        self._schedule_imu(now_s + 1.0 / self._imu.settings.rate_hz)
        if self._is_heard("imu"):
            for packet in self._imu.shown(
                witmotion_packets(self._instruments.imu(now_s, 1.0 / self._imu.settings.rate_hz))
            ):
                self.lines[Port.IMU].send(packet, now_s)

    def _report_position(self) -> None:
        now_s = self._timeline.now_s
        self._timeline.at(now_s + 1.0, self._report_position)
        if self._is_heard("gps"):
            for sentence in nmea_second(self._instruments.gps(now_s - _GPS_LATENCY_S)).splitlines(keepends=True):
                self.lines[Port.GPS].send(sentence, now_s)

    def _report_conductivity(self) -> None:
        now_s = self._timeline.now_s
        self._timeline.at(now_s + _EC_PERIOD_S, self._report_conductivity)
        if self._is_heard("ec"):
            self.lines[Port.EC].send(self._ec.line(*self._instruments.conductivity(now_s)), now_s)

    def _renew_i2c(self) -> None:
        self._timeline.at(self._timeline.now_s + _I2C_PERIOD_S, self._renew_i2c)
        self._measure_i2c()

    def _measure_i2c(self) -> None:
        """What the converters of both devices would give now."""
        now_s, instruments = self._timeline.now_s, self._instruments
        temperature_degc = instruments.depth_sensor_temperature_degc(now_s)
        adc = ms5837_adc(instruments.pressure_pa(now_s), temperature_degc)
        self._tell_i2c(I2cInput.MS5837_ADC, struct.pack("<2I", *adc))
        self._tell_i2c(I2cInput.TSYS01_ADC, struct.pack("<I", tsys01_adc(instruments.temperature_degc(now_s))))
