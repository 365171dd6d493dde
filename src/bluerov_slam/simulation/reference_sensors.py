"""The small sensors of the reference board: its readers side by side, and what SENSORS says of them."""

from __future__ import annotations

from typing import Protocol

from bluerov_slam.protocol.sensor_frame import SensorFields
from bluerov_slam.simulation.board import I2cBus, Port
from bluerov_slam.simulation.board_readers.derived import fill_derived
from bluerov_slam.simulation.board_readers.ezo_ec import EzoEcReader
from bluerov_slam.simulation.board_readers.i2c_device import CountedBus
from bluerov_slam.simulation.board_readers.ms5837 import Ms5837
from bluerov_slam.simulation.board_readers.nmea import NmeaReader
from bluerov_slam.simulation.board_readers.readings import Hal, ReportSink, unknown_fields
from bluerov_slam.simulation.board_readers.tsys01 import Tsys01
from bluerov_slam.simulation.board_readers.witmotion import WitMotionReader


class SensorHost(Hal, ReportSink, Protocol):
    """What the sensors' readers write to."""


class BoardSensors:
    """IMU, GPS, conductivity probe, and the two I2C sensors."""

    def __init__(self, bus: I2cBus, boot_us: int, host: SensorHost) -> None:
        self.imu = WitMotionReader()
        self.gps = NmeaReader()
        self.ec = EzoEcReader()
        self.bus = CountedBus(bus)
        self._host = host
        self._depth = Ms5837()
        self._celsius = Tsys01()
        for reader in (self.imu, self.ec, self._depth, self._celsius):
            reader.start(boot_us)

    def feed(self, port: Port, data: bytes, now_us: int, imu_rate_mhz: int) -> None:
        """Take a batch of the IMU, the GPS receiver or the probe."""
        if port is Port.IMU:
            self.imu.feed(data, now_us, imu_rate_mhz, self._host)
        elif port is Port.GPS:
            self.gps.feed(data, now_us, self._host)
        else:
            self.ec.feed(data, now_us)

    def run_jobs(self, now_us: int, imu_rate_mhz: int) -> None:
        """I2C, configuration of IMU and probe, GPS silence."""
        self._depth.tick(now_us, self.bus)
        self._celsius.tick(now_us, self.bus)
        self.imu.configure(now_us, imu_rate_mhz, self._host)
        self.ec.configure(now_us, self._host)
        self.gps.tick(now_us, self._host)

    def next_us(self) -> int:
        """When one of the jobs has something to do."""
        return min(
            self._depth.next_us,
            self._celsius.next_us,
            self.imu.next_us,
            self.ec.next_us,
            self.gps.next_us,
        )

    def fields(self, now_us: int) -> SensorFields:
        """SENSORS of this instant; time and sonars are left to the caller."""
        fields = unknown_fields()
        for reader in (self.imu, self.gps, self.ec, self._depth, self._celsius):
            reader.fill(fields, now_us)
        fill_derived(fields, self.ec, self._depth, self._celsius, now_us)
        return SensorFields(**fields)
