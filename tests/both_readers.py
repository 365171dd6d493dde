"""The readers of the board twice: in C++ behind `reader_filter`, and the Python reference, with one script for both."""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

from bluerov_slam.protocol.esp32_messages import GpsFields
from bluerov_slam.protocol.sensor_frame import SensorFields, pack_sensors
from bluerov_slam.simulation.board_readers.derived import fill_derived
from bluerov_slam.simulation.board_readers.ezo_ec import EzoEcReader
from bluerov_slam.simulation.board_readers.i2c_device import CountedBus
from bluerov_slam.simulation.board_readers.ms5837 import Ms5837
from bluerov_slam.simulation.board_readers.nmea import NmeaReader
from bluerov_slam.simulation.board_readers.readings import ImuSample, unknown_fields
from bluerov_slam.simulation.board_readers.tsys01 import Tsys01
from bluerov_slam.simulation.board_readers.witmotion import WitMotionReader

Answer = Callable[[int, int | None, bytes | None], bytes | bool | None]


class BothReaders:
    """Runs the reference at once and writes down the script that the C++ filter has to follow.

    `answer(address, count, written)` plays the I2C devices: a write (count None) is acknowledged or not, a read gives
    bytes or None.
    """

    def __init__(self, answer: Answer = lambda address, count, written: False, boot_us: int = 0) -> None:
        self.script: list[str] = [f"start {boot_us}"]
        self.said: list[str] = []
        self._answer = answer
        self._bus_answers: list[str] = []
        self.imu, self.gps, self.ec = WitMotionReader(), NmeaReader(), EzoEcReader()
        self.depth, self.celsius = Ms5837(), Tsys01()
        self.bus = CountedBus(self)
        for reader in (self.imu, self.ec, self.depth, self.celsius):
            reader.start(boot_us)

    def feed(self, sensor: str, data: bytes, now_us: int, rate_mhz: int = 20_000) -> None:
        if not data:
            return
        rate = f" {rate_mhz}" if sensor == "imu" else ""
        self.script.append(f"{sensor} {now_us}{rate} {data.hex()}")
        if sensor == "imu":
            self.imu.feed(data, now_us, rate_mhz, self)
        elif sensor == "gps":
            self.gps.feed(data, now_us, self)
        else:
            self.ec.feed(data, now_us)

    def jobs(self, now_us: int, rate_mhz: int = 20_000) -> None:
        self.script.append(f"jobs {now_us} {rate_mhz}")
        self.imu.configure(now_us, rate_mhz, self)
        self.ec.configure(now_us, self)
        self.gps.tick(now_us, self)

    def rate_changed(self) -> None:
        self.script.append("rate")
        self.imu.rate_changed()

    def i2c(self, now_us: int) -> None:
        self._bus_answers = []
        self.depth.tick(now_us, self.bus)
        self.celsius.tick(now_us, self.bus)
        self.script.append(" ".join([f"i2c {now_us}", *self._bus_answers]))

    def fill(self, now_us: int) -> SensorFields:
        self.script.append(f"fill {now_us}")
        fields = unknown_fields()
        for reader in (self.imu, self.gps, self.ec, self.depth, self.celsius):
            reader.fill(fields, now_us)
        fill_derived(fields, self.ec, self.depth, self.celsius, now_us)
        sensors = SensorFields(**fields)
        bits = struct.pack(">d", self.celsius.temperature_degc).hex()
        errors = f"{self.imu.errors} {self.gps.errors} {self.ec.errors} {self.bus.errors}"
        self.said.append(f"fields {pack_sensors(sensors).hex()} {errors} {bits}")
        return sensors

    def check_against(self, program: Path) -> None:
        """The C++ readers say the same, line by line."""
        result = subprocess.run(
            [program], input="\n".join(self.script) + "\n", capture_output=True, text=True, check=False
        )
        assert result.returncode == 0, result.stderr
        lines = result.stdout.splitlines()
        for index, (ours, theirs) in enumerate(zip(self.said, lines, strict=False)):
            assert theirs == ours, f"line {index}"
        assert len(lines) == len(self.said)

    def imu_burst(self, t0_us: int, dt_us: int, samples: Sequence[ImuSample]) -> None:
        counts = [c for s in samples for c in (*s.acceleration, *s.angular_rate, *s.magnetic_field)]
        self.said.append(" ".join(map(str, ("burst", t0_us, dt_us, *counts))))

    def gps_report(self, report: GpsFields) -> None:
        r = report
        values = (r.t_us, r.fix, r.satellites, r.hdop_x100, r.latitude_e7, r.longitude_e7, r.altitude_mm)
        self.said.append(" ".join(map(str, ("gps", *values, r.speed_cmps, r.course_cdeg, r.utc_ms))))

    def port_write(self, port: int, data: bytes, now_us: int) -> None:
        self.said.append(f"port {int(port)} {now_us} {data.hex()}")

    def write(self, address: int, data: bytes) -> bool:
        self.said.append(f"write {address} {data.hex()}")
        acknowledged = bool(self._answer(address, None, data))
        self._bus_answers.append("A" if acknowledged else "N")
        return acknowledged

    def read(self, address: int, count: int) -> bytes | None:
        self.said.append(f"read {address} {count}")
        answer = self._answer(address, count, None)
        assert answer is None or isinstance(answer, bytes)
        self._bus_answers.append("N" if answer is None else answer.hex())
        return answer

    def recover(self) -> None:
        self.said.append("recover")
