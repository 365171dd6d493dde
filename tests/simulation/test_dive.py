import itertools
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.errors import ConfigError
from bluerov_slam.navigation.attitude.accelerometer_routine import AccelerometerRoutine
from bluerov_slam.navigation.attitude.magnetometer_routine import MagnetometerRoutine
from bluerov_slam.navigation.attitude.routine import InertialSample
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.records import (
    GpsFix,
    ImuBurst,
    LinkBytes,
    Record,
    SensorSample,
    VehicleAttitude,
    VehicleMotionDelta,
    VehicleServoOutput,
)
from bluerov_slam.simulation.dive import DiveTruth, SimulatedDive
from bluerov_slam.simulation.dive_plan import DIVE_PLANS, DivePlan, dive_plan_from_mapping

SHORT = replace(DIVE_PLANS["n4"], legs=1, leg_m=30.0, rest_s=20.0, afloat_first_s=20.0, depth_m=3.0)


def decoded(plan: DivePlan, seed: int) -> tuple[DiveTruth, list[Record]]:
    dive, decoder = SimulatedDive(plan, seed), LinkDecoder()
    records: list[Record] = []
    for item in dive.inputs():
        records += decoder.feed(item.data, item.arrived_s) if isinstance(item, LinkBytes) else [item]
    return dive.truth, records


@pytest.fixture(scope="module")
def short_dive() -> tuple[DiveTruth, list[Record]]:
    return decoded(SHORT, 5)


def imu(records: list[Record]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    bursts = [r for r in records if isinstance(r, ImuBurst)]
    times = np.concatenate([b.measured_s + b.interval_s * np.arange(len(b.acceleration_mps2)) for b in bursts])
    force = np.concatenate([b.acceleration_mps2 for b in bursts])
    rate = np.concatenate([b.angular_rate_radps for b in bursts])
    return times, force, rate, np.concatenate([b.magnetic_field_raw for b in bursts])


def test_the_same_plan_and_seed_give_the_same_inputs() -> None:
    plan = replace(SHORT, leg_m=5.0)
    first = list(SimulatedDive(plan, 3).inputs())
    assert first == list(SimulatedDive(plan, 3).inputs())
    assert first != list(SimulatedDive(plan, 4).inputs())


def test_everything_arrives_in_order_at_the_rates_of_link_and_autopilot(
    short_dive: tuple[DiveTruth, list[Record]],
) -> None:
    truth, records = short_dive
    arrived = [r.arrived_s for r in records]
    assert all(a <= b for a, b in itertools.pairwise(arrived))
    counts = {kind: sum(isinstance(r, kind) for r in records) for kind in (SensorSample, VehicleAttitude, GpsFix)}
    assert counts[SensorSample] == pytest.approx(2.0 * truth.end_s, abs=4)
    assert counts[VehicleAttitude] == pytest.approx(10.0 * truth.end_s, abs=4)
    assert counts[GpsFix] == pytest.approx(truth.end_s, abs=3)
    assert any(isinstance(r, VehicleMotionDelta) for r in records)
    times, *_ = imu(records)
    assert len(times) == pytest.approx(20.0 * truth.end_s, abs=8)
    assert np.diff(times) == pytest.approx(0.05, abs=0.004)


def test_what_comes_over_the_link_is_the_truth_with_the_stated_errors(
    short_dive: tuple[DiveTruth, list[Record]],
) -> None:
    truth, records = short_dive
    times, force, rate, field = imu(records)
    track = truth.track(times)
    rotation = track.rotation_ned_frd
    felt = track.acceleration_ned_mps2 - np.array((0.0, 0.0, truth.gravity_mps2))
    expected = np.einsum("nji,nj->ni", rotation, felt) @ truth.errors.acceleration_matrix.T
    # Samples are stamped when their first byte comes: the sensor's filter and the line make them 10 to 20 ms old.
    assert (force - expected - track.accel_bias_mps2).mean(axis=0) == pytest.approx(np.zeros(3), abs=0.01)
    assert np.degrees((rate - track.angular_rate_frd_radps - track.gyro_bias_radps).mean(axis=0)) == pytest.approx(
        np.zeros(3), abs=0.05
    )
    level = np.einsum("nij,nj->ni", rotation, field)
    declination = np.arctan2(truth.errors.field_ned_nt[1], truth.errors.field_ned_nt[0])
    off = declination - np.arctan2(level[:, 1], level[:, 0])
    assert np.degrees((off - track.compass_deviation_rad).mean()) == pytest.approx(0.0, abs=0.1)
    samples = [r for r in records if isinstance(r, SensorSample) and r.pressure_pa]
    depths = truth.track(np.array([r.measured_s for r in samples])).position_ned_m[:, 2]
    pressures = np.array([r.pressure_pa for r in samples]) - truth.errors.pressure_offset_pa
    assert (pressures - 101_325.0) / (1025.3 * 9.808) == pytest.approx(depths, abs=0.06)
    servo = [r for r in records if isinstance(r, VehicleServoOutput)]
    assert {len(r.pwm_us) for r in servo} == {16}


@pytest.mark.parametrize(
    ("name", "dives", "afloat_at_the_end"), [("n2", True, False), ("n3", True, True), ("n4", True, True)]
)
def test_the_plans_of_the_targets_are_as_the_contract_says(name: str, dives: bool, afloat_at_the_end: bool) -> None:
    plan = DIVE_PLANS[name]
    route = plan.route()
    assert plan.duration_s - plan.track_start_s == pytest.approx(1960.0)
    depths = [route.target(plan.track_start_s + t).depth_m for t in range(0, 1960, 10)]
    first = next(index for index, depth in enumerate(depths) if depth is not None) * 10
    assert first == pytest.approx(400.0 if name == "n2" else 60.0, abs=11.0)
    assert (depths[-3] is None) == afloat_at_the_end
    if afloat_at_the_end:
        last = 1960 - max(index for index, depth in enumerate(depths) if depth is not None) * 10
        assert last == pytest.approx(60.0, abs=11.0)
    assert max(depth or 0.0 for depth in depths) == plan.depth_m
    assert plan.dvl == (name == "n4")


def test_a_tumble_on_deck_calibrates_accelerometer_and_magnetometer() -> None:
    truth, records = decoded(DIVE_PLANS["tumble"], 6)
    accelerometer, magnetometer = AccelerometerRoutine(truth.gravity_mps2), MagnetometerRoutine()
    for at_s, force, rate, field in zip(*imu(records), strict=True):
        sample = InertialSample(at_s, tuple(rate), tuple(force), tuple(field.astype(float)))
        accelerometer.feed(sample)
        magnetometer.feed(sample)
    found = accelerometer.finish()
    true_matrix = np.linalg.inv(truth.errors.acceleration_matrix)
    assert np.diag(np.array(found.matrix)) == pytest.approx(np.diag(true_matrix), abs=0.003)
    bias = truth.errors.acceleration_bias_mps2(np.array((30.0,)))[0]
    assert np.array(found.offset_frd_mps2) == pytest.approx(bias, abs=0.03)
    iron = magnetometer.finish()
    assert 13.0 * np.array(iron.offset_raw) == pytest.approx(truth.errors.hard_iron_nt, abs=600.0)


def test_a_swing_sees_every_heading_and_has_fixes() -> None:
    truth = DiveTruth(DIVE_PLANS["compass_swing"], 7)
    track = truth.track(np.arange(0.0, truth.end_s, 0.5))
    heading = np.unwrap(np.arctan2(track.rotation_ned_frd[:, 1, 0], track.rotation_ned_frd[:, 0, 0]))
    assert abs(heading[-1] - heading[0]) > 3.9 * np.pi
    assert sum(truth.scene.state(float(t)).fix_possible for t in range(int(truth.end_s))) > 0.9 * truth.end_s
    assert abs(truth.compass.b_rad) + abs(truth.compass.c_rad) > np.radians(3.0)  # as delivered


def test_plans_come_from_files_and_wrong_ones_are_named() -> None:
    plan = dive_plan_from_mapping(
        {"base": "n3", "depth_m": 5, "noise_family": "mismatched", "water": {"density_kg_per_m3": 1010.0}}
    )
    assert (plan.depth_m, plan.noise_family, plan.water.density_kg_per_m3) == (5.0, "mismatched", 1010.0)
    for wrong, named in (
        ({"base": "n9"}, "n9"),
        ({"deep": 3}, "deep"),
        ({"conditions": "stormy"}, "stormy"),
        ({"legs": "many"}, "legs"),
        ({"thrusters": 7}, "thrusters"),
    ):
        with pytest.raises(ConfigError, match=named):
            dive_plan_from_mapping(wrong)
