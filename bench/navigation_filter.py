"""What navigation's filter costs: a step, an hour smoothed, a late measurement; and two published filters beside it.

Time is the processor time of this thread, so that other programs do not count.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.navigation_plain import FilterpyRun, NavlieRun, Nominal, PlainModel
from bluerov_slam.navigation.delay_buffer import DelayBuffer
from bluerov_slam.navigation.ekf import ErrorStateFilter, Measurement
from bluerov_slam.navigation.measurements import (
    BlockValue,
    CompassHeading,
    Depth,
    GravityDirection,
    GroundVelocity,
    HorizontalPosition,
    WaterVelocity,
)
from bluerov_slam.navigation.process import Earth, ImuSample, ProcessModel, ProcessNoise
from bluerov_slam.navigation.rotation import euler_from_rotation
from bluerov_slam.navigation.smoother import StepRecorder, smooth
from bluerov_slam.navigation.state import BLOCKS, NavEstimate, StateLayout

INTERVAL_S = 0.05
FULL = StateLayout.make()
COMPARED = StateLayout.make(without=[name for name, _ in BLOCKS[5:]])
COMPARISON_S, ROUNDS = 300.0, 3
STEPS_S = 120.0
FIX_STD_M = 1.5
RTS_STEPS = 300

STEP_MEAN_MUST_MS, STEP_P99_MUST_MS, SMOOTHING_MUST_S, LATE_MUST_MS = 0.25, 1.0, 30.0, 10.0
EQUAL_ACCURACY = 1.02


class Second(NamedTuple):
    """An IMU sample and what else is measured at its end."""

    sample: ImuSample
    measurements: list[Measurement]
    truth_ned_m: np.ndarray


def dive(seconds: float, seed: int = 1) -> Iterator[Second]:
    """A winding run with the IMU's noise and the sensors of a whole vehicle at the rates they come at."""
    layout = StateLayout.make(without=[name for name, _ in BLOCKS[3:]])
    random, noise, model = np.random.default_rng(seed), ProcessNoise(), ProcessModel(layout, earth=Earth())
    truth = NavEstimate(layout, 0.0)
    root, gravity = math.sqrt(INTERVAL_S), model.earth.gravity_mps2
    for step in range(1, round(seconds / INTERVAL_S) + 1):
        t = step * INTERVAL_S
        rate = np.array([0.05 * math.sin(0.7 * t), 0.04 * math.cos(0.5 * t), 0.3 * math.sin(0.05 * t)])
        along = np.array([0.1 * math.cos(0.3 * t), 0.05 * math.sin(0.4 * t), 0.02 * math.sin(0.2 * t)])
        force = along - 0.05 * truth.rotation_ned_frd.T @ truth.velocity_ned_mps
        force -= truth.rotation_ned_frd.T @ model.earth.gravity_ned_mps2
        model.strapdown(truth, force, rate, INTERVAL_S)
        force = force + noise.accel_noise_mps_per_sqrt_s / root * random.normal(size=3)
        rate = rate + noise.gyro_noise_rad_per_sqrt_s / root * random.normal(size=3)
        found: list[Measurement] = []
        body = truth.rotation_ned_frd.T @ truth.velocity_ned_mps
        if step % 2 == 0:
            heading = euler_from_rotation(truth.rotation_ned_frd)[2]
            found.append(Depth(t, truth.values[2] + 0.02 * random.normal(), 0.02))
            found.append(CompassHeading(t, heading + 0.03 * random.normal(), 0.03))
            found.append(WaterVelocity(t, body + 0.1 * random.normal(size=3), 0.1))
        if step % 4 == 0:
            found.append(GroundVelocity(t, body + 0.015 * random.normal(size=3), 2.25e-4 * np.eye(3), rate))
        if step % 10 == 0:
            found.append(GravityDirection(t, force, gravity))
        if step % 20 == 0:
            north, east = truth.position_ned_m[:2] + FIX_STD_M * random.normal(size=2)
            found.append(HorizontalPosition(t, north, east, FIX_STD_M**2 * np.eye(2)))
        yield Second(ImuSample(t, INTERVAL_S, force, rate), found, truth.position_ned_m.copy())


def full_filter(recorder: StepRecorder | None = None) -> ErrorStateFilter:
    """All 29 states."""
    std = FULL.vector(
        position=2.0, velocity=0.1, attitude=(0.01, 0.01, 0.1), gyro_bias=0.002, accel_bias=0.05, current=0.2,
        thrust_scale=0.1, compass=0.03, compass_wander=0.017, gps_wander=1.4, depth_bias=0.05,
        sound_speed_scale=0.01, dvl=(0.005, 0.02),
    )  # fmt: skip
    return ErrorStateFilter(NavEstimate(FULL, 0.0), std, earth=Earth(60.0), recorder=recorder)


def step_times_ms(inputs: list[Second]) -> np.ndarray:
    """One prediction and every update that is due with it."""
    core, times = full_filter(), []
    for sample, measurements, _ in inputs:
        begin = time.thread_time_ns()
        core.predict_strapdown(sample)
        for measurement in measurements:
            core.update(measurement)
        times.append(time.thread_time_ns() - begin)
    return np.array(times) * 1e-6


def dense_step_times_ms(inputs: list[Second]) -> np.ndarray:
    """The reference: only the covariance algebra of the same steps, with whole matrices as the textbook writes it."""
    size = FULL.size
    transition, noise, covariance, times = np.eye(size), 1e-6 * np.eye(size), np.eye(size), []
    transition[:9, :15] += 1e-3
    for _, measurements, _ in inputs:
        begin = time.thread_time_ns()
        covariance = transition @ covariance @ transition.T + noise
        for measurement in measurements:
            observe = np.eye(_components(measurement), size)
            covariance = _joseph(covariance, observe)
        times.append(time.thread_time_ns() - begin)
        covariance = np.eye(size)
    return np.array(times) * 1e-6


def _components(measurement: Measurement) -> int:
    return {Depth: 1, CompassHeading: 1, HorizontalPosition: 2}.get(type(measurement), 3)


def _joseph(covariance: np.ndarray, observe: np.ndarray) -> np.ndarray:
    noise = np.eye(len(observe))
    gain = covariance @ observe.T @ np.linalg.inv(observe @ covariance @ observe.T + noise)
    left = np.eye(len(covariance)) - gain @ observe
    result: np.ndarray = left @ covariance @ left.T + gain @ noise @ gain.T
    return result


def smoothing() -> tuple[float, float, float, int]:
    """Seconds for one hour, its recorded megabytes, seconds by the textbook's recursion, states smoothed."""
    recorder = StepRecorder()
    core = full_filter(recorder)
    for sample, measurements, _ in dive(3600.0):
        core.predict_strapdown(sample)
        for measurement in measurements:
            core.update(measurement)
    megabytes = sum(_bytes(step) for step in recorder.steps) * 1e-6
    begin = time.thread_time()
    states = smooth(recorder.steps)
    ours_s = time.thread_time() - begin
    size = FULL.size
    transition, later, smoothed = np.eye(size), 2.0 * np.eye(size), np.eye(size)
    begin = time.thread_time()
    for _ in range(RTS_STEPS):
        filtered = np.eye(size)
        predicted = transition @ filtered @ transition.T + 1e-3 * np.eye(size)
        gain = np.linalg.solve(predicted, transition @ filtered).T
        smoothed = filtered + gain @ (later - predicted) @ gain.T
    textbook_s = (time.thread_time() - begin) * 3600.0 / INTERVAL_S / RTS_STEPS
    if not (math.isfinite(float(smoothed.sum())) and np.linalg.eigvalsh(states[0].covariance)[0] > 0.0):
        raise AssertionError("smoothing lost its covariance")
    return ours_s, megabytes, textbook_s, len(states)


def _bytes(step: object) -> int:
    names = getattr(type(step), "__slots__", ())
    values = [getattr(step, name) for name in names]
    return sum(value.nbytes if isinstance(value, np.ndarray) else _bytes(value) for value in values)


def late_measurements(inputs: list[Second]) -> tuple[float, float, float]:
    """Milliseconds of a fix that is 1 s late, of a step through the buffer, and of a step without it."""
    buffer, late, steps = DelayBuffer(full_filter()), [], []
    for sample, measurements, truth in inputs:
        begin = time.thread_time_ns()
        buffer.predict_strapdown(sample)
        for measurement in measurements:
            buffer.update(measurement)
        steps.append(time.thread_time_ns() - begin)
        if len(steps) % 20 == 0:
            fix = HorizontalPosition(sample.at_s - 0.96, *truth[:2], 4.0 * np.eye(2), "position", wanders=False)
            begin = time.thread_time_ns()
            buffer.update(fix)
            late.append(time.thread_time_ns() - begin)
    return float(np.mean(late[2:])) * 1e-6, float(np.mean(steps)) * 1e-6, float(step_times_ms(inputs).mean())


class OurRun:
    """Our filter on the compared problem, without gates as the others have none."""

    name = "ours"

    def __init__(self, model: PlainModel, nominal: Nominal, covariance: np.ndarray) -> None:
        estimate = NavEstimate(COMPARED, 0.0, nominal.rotation)
        self.core = ErrorStateFilter(estimate, covariance, ProcessNoise())

    def predict(self, force: np.ndarray, rate: np.ndarray, dt: float) -> None:
        self.core.predict_strapdown(ImuSample(self.core.at_s + dt, dt, force, rate))

    def fix(self, position: np.ndarray, noise: np.ndarray) -> None:
        self.core.update(BlockValue(self.core.at_s, "position", position, noise, "gps"), None, None)

    def position(self) -> np.ndarray:
        return self.core.estimate.position_ned_m


def compared(kind: type[OurRun | FilterpyRun | NavlieRun], inputs: list[Second]) -> tuple[float, float]:
    """Seconds needed and RMS error of the position, m: IMU at 20 Hz, position every second, 15 states."""
    noise = ProcessNoise()
    model = PlainModel(
        Earth().gravity_mps2,
        noise.accel_noise_mps_per_sqrt_s,
        noise.gyro_noise_rad_per_sqrt_s,
        noise.gyro_bias_walk_radps_per_sqrt_s,
        noise.accel_bias_walk_mps2_per_sqrt_s,
    )
    std = np.repeat([2.0, 0.1, 0.02, 0.002, 0.05], 3)
    run = kind(model, Nominal(np.eye(3), np.zeros(12)), np.diag(std**2))
    random, fix_noise = np.random.default_rng(5), FIX_STD_M**2 * np.eye(3)
    fixes = [truth + FIX_STD_M * random.normal(size=3) for _, _, truth in inputs[19::20]]
    errors = np.empty(len(inputs))
    elapsed = 0
    for index, (sample, _, truth) in enumerate(inputs):
        begin = time.thread_time_ns()
        run.predict(sample.specific_force_frd_mps2, sample.angular_rate_frd_radps, INTERVAL_S)
        if index % 20 == 19:
            run.fix(fixes[index // 20], fix_noise)
        elapsed += time.thread_time_ns() - begin
        errors[index] = np.linalg.norm(run.position() - truth)
    return elapsed * 1e-9, float(np.sqrt(np.mean(errors**2)))


def rows() -> list[dict[str, object]]:
    """ekf_step_mean, ekf_step_p99, smoothing_hour, ekf_vs_filterpy, ekf_vs_navlie, delay_buffer_late."""
    inputs = list(dive(STEPS_S))
    step_times_ms(inputs[:200])
    turns = [(step_times_ms(inputs), dense_step_times_ms(inputs)) for _ in range(ROUNDS)]
    ours, dense = (min((turn[side] for turn in turns), key=np.mean) for side in (0, 1))
    mean, p99 = float(ours.mean()), min(float(np.percentile(turn[0], 99)) for turn in turns)
    ratio = f"{mean / float(dense.mean()):.2f} x the covariance algebra alone with whole matrices"
    updates = sum(len(second.measurements) for second in inputs) / len(inputs)
    table = [
        _row("ekf_step_mean", f"Filter step of 29 states, {updates:.1f} updates, mean", mean, "ms",
             STEP_MEAN_MUST_MS, ratio),
        _row("ekf_step_p99", "Filter step, 99 % of all", p99, "ms", STEP_P99_MUST_MS,
             f"whole matrices {float(np.percentile(dense, 99)):.2f} ms"),
    ]  # fmt: skip
    comparison = list(dive(COMPARISON_S, 2))
    kinds = (OurRun, FilterpyRun, NavlieRun)
    results = [[compared(kind, comparison) for kind in kinds] for _ in range(ROUNDS)]
    best = [min(turn[index][0] for turn in results) for index in range(len(kinds))]
    rmse = [results[0][index][1] for index in range(len(kinds))]
    per_step = [seconds / len(comparison) * 1e6 for seconds in best]
    for index, row_id in ((1, "ekf_vs_filterpy"), (2, "ekf_vs_navlie")):
        times = best[index] / best[0]
        table.append({
            "id": row_id, "name": f"15-state filter, times as fast as {kinds[index].name} at equal accuracy",
            "value": round(times, 2), "unit": "x", "must": "> 1",
            "met": times > 1.0 and rmse[0] <= EQUAL_ACCURACY * rmse[index],
            "reference": f"RMSE {rmse[0]:.3f} m against {rmse[index]:.3f} m; "
                         f"{per_step[0]:.0f} us a step against {per_step[index]:.0f} us",
        })  # fmt: skip
    late_ms, buffered_ms, plain_ms = late_measurements(inputs)
    table.append(_row("delay_buffer_late", "A fix that is 1 s late put in its place", late_ms, "ms", LATE_MUST_MS,
                      f"a step through the buffer {buffered_ms / plain_ms:.2f} x one without"))  # fmt: skip
    smooth_s, megabytes, textbook_s, count = smoothing()
    table.append(_row("smoothing_hour", f"Smoothing one hour, {count} states", smooth_s, "s", SMOOTHING_MUST_S,
                      f"{megabytes:.0f} MB recorded; textbook recursion, no updates, {textbook_s:.1f} s"))  # fmt: skip
    return table


def _row(row_id: str, name: str, value: float, unit: str, most: float, reference: str) -> dict[str, object]:
    return {
        "id": row_id,
        "name": name,
        "value": round(value, 3),
        "unit": unit,
        "must": f"<= {most:g}",
        "met": value <= most,
        "reference": reference,
    }


if __name__ == "__main__":
    for row in rows():
        print(json.dumps(row))
