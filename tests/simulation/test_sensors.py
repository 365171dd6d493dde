import math
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.simulation import instrument_errors as errors_of
from bluerov_slam.simulation.place import metres_per_degree
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.scene import DifferencedMotion
from bluerov_slam.simulation.sensors import (
    ACCELERATION_LSB_MPS2,
    ANGULAR_RATE_LSB_RADPS,
    FIRST_FIX_S,
    Instruments,
)
from bluerov_slam.simulation.vehicle import VehicleState

SCENARIO = replace(Scenario(), conditions="hard", seed=4)


class Moored(DifferencedMotion):
    """Lies still, afloat unless told otherwise."""

    origin_latitude_deg, origin_longitude_deg = 47.6, -2.7

    def __init__(self, depth_m: float = 0.1) -> None:
        self.depth_m = depth_m
        self.awash_s: tuple[float, float] = (math.inf, math.inf)

    def state(self, mission_s: float) -> VehicleState:
        dry = self.depth_m < 0.2 and not self.awash_s[0] <= mission_s < self.awash_s[1]
        return VehicleState(10.0, -5.0, self.depth_m, 0.0, 0.0, 0.5, 0.0, dry)

    def ping(self, side: int, mission_s: float, samples: int, resolution_m: float, first_sample: int) -> np.ndarray:
        return np.zeros(samples, np.uint8)


def readings(instruments: Instruments, duration_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    taken = [instruments.imu(0.05 * n, 0.05) for n in range(int(duration_s / 0.05))]
    force, rate = (np.array([getattr(r, name) for r in taken]) for name in ("acceleration", "angular_rate"))
    field = np.array([r.magnetic_field for r in taken])
    return force * ACCELERATION_LSB_MPS2, rate * ANGULAR_RATE_LSB_RADPS, field * 13.0


def allan_deviation(values: np.ndarray, samples: int) -> np.ndarray:
    means = values[: len(values) // samples * samples].reshape(-1, samples, values.shape[1]).mean(axis=1)
    return np.sqrt(0.5 * (np.diff(means, axis=0) ** 2).mean(axis=0))


def test_gyro_and_accelerometer_have_their_white_noise_and_their_steps() -> None:
    force, rate, field = readings(Instruments(SCENARIO, Moored()), 1_200.0)
    # White noise falls with the root of the averaging time: density = Allan deviation at 1 s. The gyro's steps of
    # 0.061 deg/s are twice its noise and change it a little.
    density = np.degrees(allan_deviation(rate, 20))
    assert np.all((density > 0.006) & (density < 0.016))
    assert allan_deviation(force, 20) == pytest.approx(
        np.full(3, errors_of.ACCELERATION_WHITE_MPS2 / math.sqrt(20.0)), rel=0.2
    )
    assert allan_deviation(force, 80) == pytest.approx(allan_deviation(force, 20) / 2.0, rel=0.25)
    white_nt = np.diff(field, axis=0).std(axis=0) / math.sqrt(2.0)
    assert white_nt == pytest.approx(np.full(3, errors_of.MAGNETIC_WHITE_NT), rel=0.05)


def test_the_imu_reads_what_happens_through_its_errors() -> None:
    instruments = Instruments(SCENARIO, Moored())
    errors = instruments.errors
    force, rate, _ = readings(instruments, 60.0)
    times = 0.05 * np.arange(1_200)
    upward = errors.acceleration_matrix @ np.array((0.0, 0.0, -9.8086))
    expected = upward + errors.acceleration_bias_mps2(times).mean(axis=0)
    assert force.mean(axis=0) == pytest.approx(expected, abs=0.004)
    assert np.degrees(rate.mean(axis=0)) == pytest.approx(
        np.degrees(errors.gyro_bias_radps(times).mean(axis=0)), abs=0.03
    )


def test_its_own_yaw_is_from_magnetic_north() -> None:
    instruments = Instruments(SCENARIO, Moored())
    yaw = np.mean([instruments.imu(0.05 * n, 0.05).angles_rad[2] for n in range(200)])
    declination = math.atan2(instruments.errors.field_ned_nt[1], instruments.errors.field_ned_nt[0])
    wander = float(instruments.errors.compass_wander_rad(np.array((5.0,)))[0])
    expected = 0.5 - declination + instruments.errors.deviation.at(0.5) + wander
    assert yaw == pytest.approx(expected, abs=math.radians(0.5))


def test_a_changed_rate_starts_a_new_block_at_the_right_time() -> None:
    a, b = Instruments(SCENARIO, Moored()), Instruments(SCENARIO, Moored())
    for instruments in (a, b):
        for n in range(30):
            instruments.imu(0.05 * n, 0.05)
    assert a.imu(1.7, 0.2) == b.imu(1.7, 0.2)
    assert a.imu(1.9, 0.2) == b.imu(1.9, 0.2)


def test_gps_errors_are_mostly_slow_and_of_the_stated_size() -> None:
    off = []
    for seed in range(12):
        instruments = Instruments(replace(SCENARIO, seed=seed), Moored())
        instruments.power_up(-100.0)
        fixes = [instruments.gps(float(n)) for n in range(1, 601)]
        north, east = metres_per_degree(47.6)
        off.append(
            [
                ((f.latitude_deg - 47.6) * north - 10.0, (f.longitude_deg + 2.7) * east + 5.0)
                if f.fix
                else (np.nan,) * 2
                for f in fixes
            ]
        )
    errors = np.array(off)
    assert np.nanstd(errors) == pytest.approx(1.5, rel=0.15)
    jump = errors[:, 1:] - errors[:, :-1]
    assert math.sqrt(np.nanmean(jump**2) / 2.0) == pytest.approx(errors_of.GPS_WHITE_M, rel=0.15)
    lag = 60
    correlation = np.nanmean(errors[:, lag:] * errors[:, :-lag]) / np.nanvar(errors)
    assert correlation == pytest.approx(0.77 * math.exp(-1.0), abs=0.15)
    assert 0.005 < np.isnan(errors[:, :, 0]).mean() < 0.12  # outages


def test_a_fix_needs_time_after_power_up_and_after_the_antenna_was_awash() -> None:
    scene = Moored()
    scene.awash_s = (100.0, 110.0)
    instruments = Instruments(replace(SCENARIO, seed=11), scene)
    fixes = {n: instruments.gps(float(n)) for n in range(1, 140)}
    assert all(fixes[n].fix == 0 for n in range(1, int(FIRST_FIX_S)))
    assert fixes[10].fix == 3
    assert fixes[100].fix == 3  # a wave over the antenna is bridged for a moment
    assert all(fixes[n].fix == 0 for n in range(103, 112))
    back = min(n for n in range(112, 140) if fixes[n].fix)
    assert fixes[back].hdop > fixes[60].hdop
    under = Instruments(SCENARIO, Moored(5.0))
    assert all(under.gps(float(n)).fix == 0 for n in range(2, 60))


def test_pressure_is_the_water_above_and_an_offset_that_stays() -> None:
    instruments = Instruments(SCENARIO, Moored(9.0))
    offset = instruments.errors.pressure_offset_pa
    values = np.array([instruments.pressure_pa(0.1 * n) for n in range(3_000)])
    density = SCENARIO.water.density_kg_per_m3
    light, heavy = (101_325.0 + 9.0 * 9.8086 * (density + more) for more in (0.0, 1.4))
    assert light < values.mean() - offset < heavy
    assert values.std() == pytest.approx(errors_of.PRESSURE_WHITE_PA, rel=0.4)


def test_the_same_seed_has_the_same_instruments() -> None:
    def read(seed: int) -> list[object]:
        instruments = Instruments(replace(SCENARIO, seed=seed), Moored())
        return [
            instruments.imu(0.0),
            instruments.gps(20.0),
            instruments.pressure_pa(1.0),
            instruments.conductivity(1.0),
        ]

    assert read(5) == read(5)
    assert read(5) != read(6)
