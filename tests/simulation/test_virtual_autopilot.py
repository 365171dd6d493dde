import itertools
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.protocol.mavlink_map import vehicle_record
from bluerov_slam.records import (
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleMotionDelta,
    VehicleServoOutput,
)
from bluerov_slam.simulation.dive import DiveTruth
from bluerov_slam.simulation.dive_plan import DIVE_PLANS
from bluerov_slam.simulation.virtual_autopilot import DVL_INTERVAL_S, DVL_NOISE_MPS, VirtualAutopilot

PLAN = replace(DIVE_PLANS["n4"], legs=2, leg_m=100.0, afloat_first_s=30.0, afloat_last_s=0.0, depth_m=5.0)


@pytest.fixture(scope="module")
def truth() -> DiveTruth:
    return DiveTruth(PLAN, 8)


def autopilot(truth: DiveTruth, dvl: bool = True) -> VirtualAutopilot:
    return VirtualAutopilot(truth.rows, truth.errors, 8, dvl=dvl)


def heard(truth: DiveTruth, until_s: float, dvl: bool = True) -> list[tuple[float, mavlink.MAVLink_message]]:
    decoder = mavlink.MAVLink(None)
    return [(at_s, decoder.decode(bytearray(data))) for at_s, data in autopilot(truth, dvl).advance(until_s)]


def records(truth: DiveTruth, kind: type, until_s: float = 300.0) -> list[object]:
    found = [vehicle_record(m.get_type(), m.to_dict(), at_s) for at_s, m in heard(truth, until_s)]
    return [record for record in found if isinstance(record, kind)]


def test_everything_comes_at_its_rate_in_order_as_mavlink_2(truth: DiveTruth) -> None:
    data = autopilot(truth).advance(60.0)
    assert all(frame[0] == 0xFD for _, frame in data)
    assert all(a <= b for (a, _), (b, _) in itertools.pairwise(data))
    counts = Counter(message.get_type() for _, message in heard(truth, 60.0))
    assert counts["ATTITUDE"] == pytest.approx(600, abs=2)
    assert counts["SERVO_OUTPUT_RAW"] == pytest.approx(600, abs=2)
    assert counts["BATTERY_STATUS"] == counts["HEARTBEAT"] == counts["SCALED_PRESSURE2"] == 60
    assert 240 < counts["VISION_POSITION_DELTA"] <= 300
    assert "VISION_POSITION_DELTA" not in {message.get_type() for _, message in heard(truth, 20.0, dvl=False)}


def test_slicing_changes_nothing(truth: DiveTruth) -> None:
    whole = autopilot(truth).advance(45.0)
    sliced, pilot = [], autopilot(truth)
    for number in range(1, 1_501):
        sliced += pilot.advance(0.03 * number)
    assert sliced == whole


def test_its_attitude_is_the_vehicles_within_its_own_errors(truth: DiveTruth) -> None:
    said = records(truth, VehicleAttitude)
    track = truth.track(np.array([r.arrived_s - 0.02 for r in said]))
    yaw = np.arctan2(track.rotation_ned_frd[:, 1, 0], track.rotation_ned_frd[:, 0, 0])
    off = np.degrees(np.remainder([r.yaw_rad for r in said] - yaw + math.pi, 2.0 * math.pi) - math.pi)
    assert np.abs(off).max() < 12.0
    roll = np.arctan2(track.rotation_ned_frd[:, 2, 1], track.rotation_ned_frd[:, 2, 2])
    assert np.degrees(np.std([r.roll_rad for r in said] - roll)) < 0.3


def test_outputs_battery_and_depth_are_those_of_the_flight(truth: DiveTruth) -> None:
    servo = records(truth, VehicleServoOutput)
    latency = [r.arrived_s - (r.boot_us * 1e-6 / (1.0 + 30e-6) - 95.0) for r in servo]
    assert 0.014 < np.median(latency) < 0.03
    measured = np.array([r.boot_us * 1e-6 / (1.0 + 30e-6) - 95.0 for r in servo])
    pwm = truth.track(measured + 1e-3).pwm_us
    assert np.mean([tuple(map(int, p)) == r.pwm_us[:6] for p, r in zip(pwm, servo, strict=True)]) > 0.97
    assert all(r.pwm_us[6:] == (0,) * 10 for r in servo)
    battery = records(truth, VehicleBattery)
    voltage = truth.track(np.array([r.arrived_s for r in battery])).voltage_v
    assert np.mean([r.voltage_v for r in battery] - voltage) == pytest.approx(0.0, abs=0.05)
    depth = records(truth, VehicleDepth)
    true_m = truth.track(np.array([r.arrived_s for r in depth])).position_ned_m[:, 2]
    shown_m = np.array([(r.pressure_pa or 0.0) for r in depth]) / (1025.5 * 9.81)
    assert np.std(shown_m - true_m) < 0.05


def test_the_dvl_has_its_noise_scale_and_mounting_error_and_gaps(truth: DiveTruth) -> None:
    said = records(truth, VehicleMotionDelta, 400.0)
    ends = np.array([r.boot_us * 1e-6 / (1.0 + 30e-6) - 95.0 for r in said])
    middle = truth.track(ends - DVL_INTERVAL_S / 2.0)
    body = np.einsum("nji,nj->ni", middle.rotation_ned_frd, middle.velocity_ned_mps)
    measured = np.array([r.displacement_frd_m for r in said]) / DVL_INTERVAL_S
    errors = autopilot(truth).dvl_errors
    cos, sin = math.cos(errors.yaw_rad), math.sin(errors.yaw_rad)
    expected = np.column_stack((cos * body[:, 0] + sin * body[:, 1], cos * body[:, 1] - sin * body[:, 0], body[:, 2]))
    noise = measured - (1.0 + errors.scale) * expected
    assert noise.std(axis=0) == pytest.approx(np.full(3, DVL_NOISE_MPS), rel=0.15)
    assert np.abs(noise.mean(axis=0)).max() < 0.002
    gaps = np.diff(ends)
    assert 1.0 < gaps.max() < 15.0
    assert all(r.confidence_percent == 90.0 for r in said)
