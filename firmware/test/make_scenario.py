"""Writes what a whole board hears, tick by tick, for the runner of firmware/xtensa (records: xtensa/scenario.h).

make_scenario.py FILE

Both sonars without a pause at their full rate, all other sensors, and a host that asks for the time; arranged so that
both pings' ends, the last bytes of IMU, GPS and EC, both I2C computations, STATUS and SENSORS meet in one tick.
"""

import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bluerov_slam.protocol.esp32_messages import ConfigKey, encode_config, encode_time_sync
from bluerov_slam.protocol.kogger_frame import build_frame
from bluerov_slam.simulation.board import SENSOR_BAUD, SONAR_BAUD, TICK_US, I2cInput, Port
from bluerov_slam.simulation.raw_sensors import (
    MS5837_PROM,
    TSYS01_PROM,
    ezo_line,
    ms5837_adc,
    nmea_second,
    tsys01_adc,
    witmotion_packets,
)
from bluerov_slam.simulation.sensors import GpsReading, ImuReading

BITS_PER_BYTE = 10
DURATION_MS = 2000
PING_MS = 50
# 22 chart frames of this many samples in all are 4608 bytes: what 921600 baud carries in 50 ms.
PING_SAMPLES, CHUNK_SAMPLES, CHART_ID = 4300, 200, 0x03
# Where the MS5837 has both values, and with the silences below the TSYS01 its one, in every period of theirs.
MEETING_MS = 8
TSYS01_SILENT_MS = (15, 530)
FIRST_MEETING_MS, SENSORS_PERIOD_MS = 1358, 250
BUS_FINE, TSYS01_SILENT = 0, 2
DEEP_AND_COLD_PA, DEEP_AND_COLD_DEGC = 1_600_000.0, 4.2


@dataclass
class Scenario:
    """What arrives before each tick."""

    name: str
    baud: int
    coding: int
    decimation: int = 4
    arrivals: dict[int, dict[int, bytearray]] = field(default_factory=dict)
    news: dict[int, list[tuple[int, bytes]]] = field(default_factory=dict)

    def at_once(self, port: int, data: bytes, tick: int) -> None:
        self.arrivals.setdefault(tick, {}).setdefault(port, bytearray()).extend(data)

    def paced(self, port: int, data: bytes, baud: int, *, ends_us: int) -> None:
        """Bytes one behind the other, the last of which has come at `ends_us`."""
        for index, byte in enumerate(data):
            out_us = ends_us - (len(data) - 1 - index) * BITS_PER_BYTE * 1_000_000 / baud
            if out_us > 0:
                self.at_once(port, bytes((byte,)), -int(-out_us // TICK_US))

    def i2c(self, what: int, data: bytes, tick: int) -> None:
        self.news.setdefault(tick, []).append((what, data))

    def records(self) -> Iterator[bytes]:
        name = self.name.encode()
        yield b"N" + bytes((len(name),)) + name
        yield b"B" + struct.pack("<IBB", self.baud, self.decimation, self.coding)
        for tick in range(1, DURATION_MS + 1):
            for what, data in self.news.get(tick, ()):
                yield b"I" + bytes((what, len(data))) + data
            for port, arrived in sorted(self.arrivals.get(tick, {}).items()):
                yield b"F" + struct.pack("<BH", port, len(arrived)) + arrived
            yield b"T"


def ping(rng: np.random.Generator) -> bytes:
    """Speckle over a decaying seabed, in chart frames."""
    slant = np.arange(PING_SAMPLES)
    level = 190.0 * np.exp(-slant / 2500.0) * (1.0 + 0.3 * np.sin(slant / 130.0))
    samples = np.clip(rng.rayleigh(level / 1.2533), 0, 255).astype(np.uint8).tobytes()
    return b"".join(
        build_frame(CHART_ID, struct.pack("<HHH", start, 20, 0) + samples[start : start + CHUNK_SAMPLES])
        for start in range(0, PING_SAMPLES, CHUNK_SAMPLES)
    )


def small_sensors(scenario: Scenario, rng: np.random.Generator) -> None:
    """Good readings of everything, at depth, with every period's last byte in the tick where all meet."""
    scenario.i2c(I2cInput.MS5837_PROM, struct.pack("<7H", *MS5837_PROM), 1)
    scenario.i2c(I2cInput.TSYS01_PROM, struct.pack("<8H", *TSYS01_PROM), 1)
    adc = ms5837_adc(DEEP_AND_COLD_PA, DEEP_AND_COLD_DEGC)
    scenario.i2c(I2cInput.MS5837_ADC, struct.pack("<2I", *adc), 1)
    scenario.i2c(I2cInput.TSYS01_ADC, struct.pack("<I", tsys01_adc(DEEP_AND_COLD_DEGC)), 1)
    for tick in TSYS01_SILENT_MS:
        scenario.i2c(I2cInput.BUS, bytes((TSYS01_SILENT,)), tick)
        scenario.i2c(I2cInput.BUS, bytes((BUS_FINE,)), tick + 1)
    for end_ms in range(MEETING_MS, DURATION_MS + 1, 50):
        raw = [tuple(int(value) for value in rng.integers(-3000, 3000, 3)) for _ in range(3)]
        reading = ImuReading(raw[0], raw[1], raw[2], (0.02, -0.05, 1.3))
        scenario.paced(Port.IMU, witmotion_packets(reading), SENSOR_BAUD, ends_us=end_ms * 1000)
    for second, end_ms in enumerate(range(FIRST_MEETING_MS - 1000, DURATION_MS + 1, 1000)):
        utc = 1_760_000_000.0 + second
        lines = nmea_second(GpsReading(3, 11, 0.8, 59.437_12, 24.753_51, 3.2, 0.7, 1.1, utc))
        report = lines[: lines.index(b"$GNGSA")]  # RMC and GGA are the report; GSA follows
        scenario.paced(Port.GPS, report, SENSOR_BAUD, ends_us=end_ms * 1000)
        rest = lines[len(report) :]
        scenario.paced(Port.GPS, rest, SENSOR_BAUD, ends_us=end_ms * 1000 + len(rest) * 1_000_000 * 10 // SENSOR_BAUD)
        scenario.paced(Port.EC, ezo_line(52_340.0, 34.66), SENSOR_BAUD, ends_us=end_ms * 1000)


def host(scenario: Scenario) -> None:
    """Moves SENSORS to where all meet, and asks for a STATUS there."""
    change = encode_config(1, {ConfigKey.SENSORS_RATE_MHZ: 1_000_000 // SENSORS_PERIOD_MS})
    scenario.at_once(Port.HOST, change, FIRST_MEETING_MS - SENSORS_PERIOD_MS)
    for number, tick in enumerate(range(FIRST_MEETING_MS, DURATION_MS + 1, SENSORS_PERIOD_MS)):
        scenario.at_once(Port.HOST, encode_time_sync(number, 10**15 + tick), tick)


def both_sonars(scenario: Scenario, rng: np.random.Generator) -> None:
    """Pings without a pause between them; where all meet, the first chart of each next ping ends the one before."""
    first_chart_us = (6 + 8 + CHUNK_SAMPLES) * BITS_PER_BYTE * 1_000_000 // SONAR_BAUD
    for port in (Port.SONAR_A, Port.SONAR_B):
        for start_ms in range(MEETING_MS, DURATION_MS, PING_MS):
            end_us = start_ms * 1000 - first_chart_us - 20 + PING_MS * 1000
            scenario.paced(port, ping(rng), SONAR_BAUD, ends_us=end_us)


def full_rate(name: str, baud: int, coding: int) -> Scenario:
    rng = np.random.default_rng(20_251_003)
    scenario = Scenario(name, baud, coding)
    small_sensors(scenario, rng)
    host(scenario)
    both_sonars(scenario, rng)
    return scenario


def after_a_stall(name: str, baud: int) -> Scenario:
    """All rings are full at once, as behind a loop that stood still."""
    scenario = full_rate(name, baud, 0)
    rng = np.random.default_rng(7)
    stream = b"".join(ping(rng) for _ in range(4))
    sync = encode_time_sync(1, 10**15)
    for tick in (1600,):
        for port in (Port.SONAR_A, Port.SONAR_B):
            scenario.at_once(port, stream[:16_384], tick)
        scenario.at_once(Port.HOST, sync * (2048 // len(sync)), tick)
        scenario.at_once(Port.IMU, bytes(rng.integers(0, 256, 512, dtype=np.uint8)), tick)
        scenario.at_once(Port.GPS, b"$GPGGA,*00\r\n" * 42, tick)
        scenario.at_once(Port.EC, b"52340,34.66\r" * 42, tick)
    return scenario


def main(target: Path) -> None:
    scenarios = [
        full_rate("full_rate_921600_mean", 921_600, 0),
        full_rate("full_rate_115200_mean", 115_200, 0),
        full_rate("full_rate_115200_peak", 115_200, 1),
        full_rate("full_rate_115200_coded", 115_200, 2),
        after_a_stall("after_a_stall_115200", 115_200),
        after_a_stall("after_a_stall_921600", 921_600),
    ]
    target.write_bytes(b"".join(record for scenario in scenarios for record in scenario.records()))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
