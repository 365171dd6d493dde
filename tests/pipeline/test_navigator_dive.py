"""The navigator on short simulated dives, from the bytes of the link and of MAVLink on."""

import math
from dataclasses import replace
from functools import cache

import numpy as np

from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.records import LinkBytes, NavMode, NavState, Record, SensorTrust
from bluerov_slam.simulation.dive import DiveTruth, SimulatedDive
from bluerov_slam.simulation.dive_plan import DivePlan
from bluerov_slam.simulation.faults import fault_from_mapping
from pipeline.navigator_runs import Run, run

CHI2_99_2DOF = 9.21
SHORT = DivePlan("short", legs=2, leg_m=14.0, spacing_m=6.0, afloat_first_s=25.0, depth_m=3.0, rest_s=15.0, dvl=True)


@cache
def dive(seed: int, **changes: object) -> tuple[DiveTruth, tuple[Record, ...]]:
    """Truth, and the records that came out of the bytes."""
    simulated = SimulatedDive(replace(SHORT, conditions="calm", **changes), seed)  # type: ignore[arg-type]
    decoder = LinkDecoder()
    records: list[Record] = []
    for each in simulated.inputs():
        records += decoder.feed(each.data, each.arrived_s) if isinstance(each, LinkBytes) else [each]
    return simulated.truth, tuple(records)


def error_m(state: NavState, truth: DiveTruth) -> np.ndarray:
    """Estimate minus truth, north and east."""
    assert state.position_ned_m is not None
    frame, true = LocalFrame(*truth.origin_deg), truth.at(state.measured_s).position_ned_m
    north, east, _ = frame.to_ned_m(*state.origin_deg)
    return np.add(state.position_ned_m[:2], (north, east)) - true[:2]


def test_a_short_dive_is_followed_within_the_stated_error() -> None:
    truth, records = dive(3)
    result = run(records)
    assert {NavMode.AIDED, NavMode.DEAD_RECKONING} <= {state.mode for state in result.states}
    inside = []
    for state in result.states[150::20]:
        error = error_m(state, truth)
        inside.append(error @ np.linalg.solve(state.pose_covariance[:2, :2], error) < CHI2_99_2DOF)
        true = truth.at(state.measured_s)
        assert abs(state.depth_m - true.position_ned_m[2]) < 3.0 * state.depth_std_m
        assert np.abs(np.subtract(state.velocity_ned_mps, true.velocity_ned_mps)).max() < 0.3
        w, x, y, z = state.quaternion_ned_frd
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        off = math.remainder(heading - true.heading_rad, 2.0 * math.pi)
        assert abs(off) < 3.5 * math.sqrt(state.pose_covariance[5, 5])
    assert np.mean(inside) > 0.95
    used = {sensor.name for sensor in result.last.sensors if sensor.accepted}
    assert used == {"imu", "compass", "depth", "gps", "thrust", "dvl"}
    assert result.last.reset_counter == 0
    assert result.last.current_ne_mps is not None


def test_the_same_dive_twice_is_the_same_to_the_last_bit() -> None:
    _, records = dive(3)
    first, second = run(records[: len(records) // 3]), run(records[: len(records) // 3])
    assert [state.position_ned_m for state in first.states] == [state.position_ned_m for state in second.states]
    assert all(
        a.pose_covariance is b.pose_covariance is None or a.pose_covariance.tobytes() == b.pose_covariance.tobytes()
        for a, b in zip(first.states, second.states, strict=True)
    )


def test_smoothing_a_dive_makes_it_surer() -> None:
    truth, records = dive(3)
    navigator = Navigator()
    navigator.keep_for_smoothing()
    causal = run(records, navigator=navigator)
    smoothed = navigator.smoothed()
    before = np.mean([np.trace(state.velocity_covariance_m2ps2) for state in causal.states[300:]])
    after = np.mean([np.trace(state.velocity_covariance_m2ps2) for state in smoothed[60:-20]])
    assert after < 0.8 * before
    for state in smoothed[60::40]:
        error = error_m(state, truth)
        assert error @ np.linalg.solve(state.pose_covariance[:2, :2], error) < 2.0 * CHI2_99_2DOF


def test_an_imu_that_falls_silent_in_mid_dive_is_survived() -> None:
    silent = fault_from_mapping({"kind": "silent", "sensor": "imu", "at": 50.0, "duration": 12.0})
    truth, records = dive(3, faults=(silent,))
    result = Run(Navigator())
    during = None
    for record in records:
        result.take(result.navigator.feed(record))
        if result.states and result.last.measured_s < 54.5:
            during = result.last
    assert during is not None
    assert {sensor.name: sensor.trust for sensor in during.sensors}["imu"] is SensorTrust.IGNORED
    assert result.said("IMU has fallen silent")
    assert result.said("autopilot's attitude is used instead")
    assert {sensor.name: sensor.trust for sensor in result.last.sensors}["imu"] is SensorTrust.USED
    error = error_m(result.last, truth)
    assert error @ np.linalg.solve(result.last.pose_covariance[:2, :2], error) < CHI2_99_2DOF
