"""Records and clocks for the tests of recording and replay."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bluerov_slam.records import (
    Channel,
    CtdSample,
    FixType,
    GpsFix,
    LinkBytes,
    NavMode,
    NavSensor,
    NavState,
    Ping,
    Record,
    Sender,
    SensorSample,
    SensorTrust,
)
from bluerov_slam.sinks.mcap_recorder import Clocks, Recorder, RecordingLimits

WALL_AT_START_NS = 1_700_000_000_000_000_000
NO_GUARD = RecordingLimits(min_free_bytes=0)


@dataclass(slots=True)
class FakeClocks:
    """Both clocks, moved by the test."""

    mono_ns: int = 5_000_000_000
    wall_offset_ns: int = WALL_AT_START_NS

    @property
    def now_s(self) -> float:
        return self.mono_ns / 1e9

    def advance(self, seconds: float) -> None:
        self.mono_ns += round(seconds * 1e9)

    def clocks(self) -> Clocks:
        return Clocks(lambda: self.mono_ns, lambda: self.mono_ns + self.wall_offset_ns)


def recorder(folder: Path, clock: FakeClocks, limits: RecordingLimits = NO_GUARD, **options: object) -> Recorder:
    """A recorder whose thread is not started: the test calls `cycle`."""
    return Recorder(folder, limits, clocks=clock.clocks(), **options)  # type: ignore[arg-type]


def sensor_sample(at_s: float, device_ms: int = 1000) -> SensorSample:
    """A plausible sample of a vehicle at sea."""
    return SensorSample(
        measured_s=at_s, arrived_s=at_s, device_ms=device_ms, sender=Sender.FULL_RANGE,
        roll_rad=0.01, pitch_rad=-0.02, yaw_rad=1.5, acceleration_frd_mps2=(0.0, 0.0, -9.81),
        imu_packets=10, imu_errors=0, imu_alive=True,
        gps_latitude_deg=None, gps_longitude_deg=None, gps_altitude_m=None, gps_satellites=0, gps_alive=True,
        conductivity_s_per_m=4.2, ec_salinity_psu=35.1, ec_alive=True,
        pressure_pa=151325.0, depth_sensor_temperature_degc=15.0, depth_ok=True,
        temperature_degc=15.2, temperature_ok=True,
        sound_speed_wire_mps=1507.9, depth_wire_m=5.0, salinity_wire_psu=None,
        a_packets=device_ms, a_bytes=100, b_packets=7, b_bytes=100,
    )  # fmt: skip


def ctd_sample(at_s: float) -> CtdSample:
    """The water of `sensor_sample`."""
    return CtdSample(at_s, at_s, 15.2, 4.2, 151325.0, 4.97, 35.2, 1507.9, 101325.0)


def gps_fix(at_s: float, utc_unix_s: float | None) -> GpsFix:
    """A 3-D fix off Brittany."""
    return GpsFix(at_s, at_s, FixType.FIX_3D, 9, 0.9, 48.1, -4.5, 2.0, 0.5, 1.0, utc_unix_s)


def ping(channel: Channel, at_s: float, number: int = 0, samples: int = 100) -> Ping:
    """A ping whose samples count up."""
    values = (np.arange(samples) + number).astype(np.uint8)
    return Ping(channel, 0, 0, number, at_s, at_s, 0.02, 0, values)


def nav_state(at_s: float, mode: NavMode = NavMode.AIDED, reset_counter: int = 0) -> NavState:
    """An estimate of a vehicle under way off Brittany."""
    rng = np.random.default_rng(round(at_s * 1000.0))
    spread = rng.standard_normal((6, 6))
    return NavState(
        measured_s=at_s, arrived_s=at_s + 0.01, mode=mode, origin_deg=(48.1, -4.5),
        position_ned_m=(10.0 + at_s, -3.25, 4.5), velocity_ned_mps=(0.5, 0.01, -0.02),
        quaternion_ned_frd=(0.9, 0.1, -0.1, 0.4), angular_rate_frd_radps=None,
        pose_covariance=spread @ spread.T, velocity_covariance_m2ps2=np.diag([0.01, 0.02, 0.03]),
        depth_m=4.5, depth_std_m=0.05, altitude_m=None, current_ne_mps=(0.1, -0.05), current_std_mps=(0.1, 0.1),
        last_fix_s=at_s - 1.0, distance_m=123.4, reset_counter=reset_counter,
        sensors=(
            NavSensor("imu", SensorTrust.USED, "", 1000, 0, at_s, None, 0),
            NavSensor("gps", SensorTrust.IGNORED, "under water", 20, 3, None, 1.1, 20),
        ),
    )  # fmt: skip


def feed(target: Recorder, clock: FakeClocks, seconds: float, block: bytes = b"\xaa\x55 link bytes") -> list[LinkBytes]:
    """Ten blocks, one sample and a ping of each sonar a second, with a cycle after each block."""
    blocks = []
    for step in range(round(seconds * 10)):
        clock.advance(0.1)
        sent = LinkBytes(block, clock.now_s)
        blocks.append(sent)
        batch: list[Record] = [sent]
        if step % 10 == 0:
            sample = sensor_sample(clock.now_s, clock.mono_ns // 1_000_000)
            batch += [sample, ctd_sample(clock.now_s), ping(Channel.A, clock.now_s), ping(Channel.B, clock.now_s)]
        for record in batch:
            target.observe(record)
        target.cycle()
    return blocks
