"""Records as a vehicle on a bench, or moving steadily at the surface, would give them. For faults that need no dive."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from bluerov_slam.records import (
    CtdSample,
    FixType,
    GpsFix,
    ImuBurst,
    PositionFix,
    Record,
    Sender,
    SensorSample,
    VehicleServoOutput,
)

LATITUDE_DEG, LONGITUDE_DEG = 35.25, -120.9
DECLINATION_RAD = math.radians(12.0)
DIP_RAD = math.radians(59.5)
FIELD_COUNTS = 3600.0
GRAVITY_MPS2 = 9.797
M_PER_DEG = 111_195.0


@dataclass
class Bench:
    """Steady motion: a heading, a speed over ground, a depth; noise from one seed."""

    seed: int = 1
    heading_rad: float = 0.6
    north_mps: float = 0.0
    east_mps: float = 0.0
    depth_m: float = 0.0
    imu_hz: float = 20.0
    burst: int = 4
    gps_std_m: float = 1.0
    start_s: float = 100.0
    upside_down: bool = False
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.gps_error = self.gps_std_m * self.rng.standard_normal(2)
        self.device_ms = 1000

    def records(self, duration_s: float) -> Iterator[Record]:
        """In order of arrival: SENSORS at 10 Hz, bursts, GPS at 1 Hz."""
        step_s = self.burst / self.imu_hz
        start_s, steps = self.start_s, range(round(duration_s / step_s))
        made: list[tuple[float, int, Record]] = [
            (start_s + (k + 1) * step_s, 0, self.imu(start_s + k * step_s)) for k in steps
        ]
        for k in range(round(duration_s * 10)):
            at_s = self.start_s + 0.1 * k
            made.append((at_s + 0.02, 1, self.sensors(at_s)))
        for k in range(round(duration_s)):
            at_s = self.start_s + k + 0.5
            made.append((at_s + 0.2, 2, self.gps(at_s)))
        self.start_s += duration_s
        made.sort(key=lambda each: each[:2])
        yield from (record for _, _, record in made)

    def imu(self, at_s: float) -> ImuBurst:
        n, interval_s = self.burst, 1.0 / self.imu_hz
        force = np.array([0.0, 0.0, -GRAVITY_MPS2]) + 0.02 * self.rng.standard_normal((n, 3))
        rate = np.array([0.002, -0.001, 0.0015]) + 0.001 * self.rng.standard_normal((n, 3))
        azimuth = DECLINATION_RAD - self.heading_rad
        unit = np.array(
            [math.cos(DIP_RAD) * math.cos(azimuth), math.cos(DIP_RAD) * math.sin(azimuth), math.sin(DIP_RAD)]
        )
        raw = FIELD_COUNTS * unit + 6.0 * self.rng.standard_normal((n, 3))
        if self.upside_down:
            turn = np.array([1.0, -1.0, -1.0])
            force, rate, raw = force * turn, rate * turn, raw * turn
        arrived_s = at_s + n * interval_s
        return ImuBurst(at_s, arrived_s, interval_s, force, rate, np.rint(raw).astype(np.int16))

    def place(self, at_s: float) -> tuple[float, float]:
        north, east = self.north_mps * (at_s - 100.0), self.east_mps * (at_s - 100.0)
        return LATITUDE_DEG + north / M_PER_DEG, LONGITUDE_DEG + east / (
            M_PER_DEG * math.cos(math.radians(LATITUDE_DEG))
        )

    def gps(self, at_s: float) -> GpsFix:
        self.gps_error = 0.98 * self.gps_error + 0.2 * self.gps_std_m * self.rng.standard_normal(2)
        latitude, longitude = self.place(at_s)
        speed = math.hypot(self.north_mps, self.east_mps) + abs(0.05 * float(self.rng.standard_normal()))
        course = math.atan2(self.east_mps, self.north_mps) % math.tau if speed > 0.3 else None
        fix = GpsFix(at_s, at_s + 0.2, FixType.FIX_3D, 10, 0.9, latitude, longitude, 5.0, speed, course, 1.79e9 + at_s)
        return moved(fix, *self.gps_error)

    def sensors(self, at_s: float) -> SensorSample:
        self.device_ms += 100
        pressure = 101_900.0 + 10_050.0 * self.depth_m + 18.0 * float(self.rng.standard_normal())
        return sensor_sample(at_s, pressure_pa=round(pressure), device_ms=self.device_ms)

    def servos(self, at_s: float, pwm_us: tuple[int, ...] = (1500,) * 16) -> VehicleServoOutput:
        return VehicleServoOutput(at_s + 0.01, int(at_s * 1e6), pwm_us)

    def fix(self, at_s: float, covariance: tuple[float, float, float] | None = (4.0, 0.0, 4.0)) -> PositionFix:
        latitude, longitude = self.place(at_s)
        return PositionFix(at_s, at_s + 0.1, "sbl", latitude, longitude, covariance)


def moved(fix: GpsFix, north_m: float, east_m: float) -> GpsFix:
    """The same fix somewhere else."""
    assert fix.latitude_deg is not None
    assert fix.longitude_deg is not None
    return replace(
        fix,
        latitude_deg=fix.latitude_deg + north_m / M_PER_DEG,
        longitude_deg=fix.longitude_deg + east_m / (M_PER_DEG * math.cos(math.radians(LATITUDE_DEG))),
    )


def sensor_sample(at_s: float, **known: object) -> SensorSample:
    """A SENSORS frame in which only `known` is known."""
    values: dict[str, object] = dict.fromkeys(SensorSample.__dataclass_fields__)
    values |= {
        "measured_s": at_s,
        "arrived_s": at_s + 0.02,
        "device_ms": round(at_s * 1000),
        "sender": Sender.FULL_RANGE,
        "imu_packets": 0,
        "imu_errors": 0,
        "imu_alive": False,
        "gps_satellites": 0,
        "gps_alive": False,
        "ec_alive": False,
        "depth_ok": True,
        "temperature_ok": False,
    }
    values |= dict.fromkeys(("a_packets", "a_bytes", "b_packets", "b_bytes"), 0)
    values |= known
    return SensorSample(**values)  # type: ignore[arg-type]


def ctd_sample(at_s: float, **known: object) -> CtdSample:
    """Sea water of which only `known` is known."""
    values: dict[str, object] = dict.fromkeys(CtdSample.__dataclass_fields__)
    values |= {"measured_s": at_s, "arrived_s": at_s + 0.02, "surface_pressure_pa": 101_325.0}
    return CtdSample(**(values | known))  # type: ignore[arg-type]
