"""Late and shuffled measurements against the same ones in order; what is refused; what is kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bluerov_slam.navigation.delay_buffer import MOST_WAITING, DelayBuffer
from bluerov_slam.navigation.ekf import ErrorStateFilter, Measurement
from bluerov_slam.navigation.measurements import CompassHeading, Depth, HorizontalPosition, WaterVelocity
from bluerov_slam.navigation.process import ImuSample
from bluerov_slam.navigation.smoother import StepRecorder, smooth
from navigation.simulated_motion import FULL, WindingDive, full_filter, resting

SECONDS = 3.0


def inputs(seed: int) -> tuple[list[ImuSample], list[Measurement]]:
    """Three seconds of IMU, and measurements at instants of their own, some shared, some at a sample's end."""
    random = np.random.default_rng(seed)
    samples = [sample for sample, _ in WindingDive(seed).steps(SECONDS)]
    measurements: list[Measurement] = []
    for t in np.arange(0.11, SECONDS - 0.05, 0.13):
        measurements.append(Depth(float(t), float(random.normal()), 0.05))
        measurements.append(WaterVelocity(float(t), random.normal(size=3) * 0.3, 0.1))
    measurements += [CompassHeading(0.05 * k, 0.1 * float(random.normal()), 0.05) for k in range(5, 58, 7)]
    measurements += [HorizontalPosition(float(t), *random.normal(size=2), np.eye(2)) for t in (0.7, 1.313, 2.2)]
    return samples, measurements


def in_order(samples: list[ImuSample], measurements: list[Measurement]) -> ErrorStateFilter:
    """Without the buffer: every sample cut where something was measured."""
    core = full_filter()
    waiting = sorted(measurements, key=lambda measurement: (measurement.at_s, measurement.sensor))
    for sample in samples:
        while waiting and waiting[0].at_s <= sample.at_s:
            at_s = waiting[0].at_s
            if at_s > core.at_s:
                core.predict_strapdown(sample._replace(at_s=at_s, interval_s=at_s - core.at_s))
            core.update(waiting.pop(0))
        if sample.at_s > core.at_s:
            core.predict_strapdown(sample._replace(interval_s=sample.at_s - core.at_s))
    return core


def feed(buffer: DelayBuffer, samples, measurements, delays) -> None:
    """Samples at once, each measurement with its own delay."""
    arrivals = [(sample.at_s, 0, index, sample) for index, sample in enumerate(samples)]
    arrivals += [
        (measurement.at_s + delay, 1, index, measurement)
        for index, (measurement, delay) in enumerate(zip(measurements, delays, strict=True))
    ]
    for _, kind, _, item in sorted(arrivals, key=lambda arrival: arrival[:3]):
        if kind == 0:
            buffer.predict_strapdown(item)
        else:
            buffer.update(item)


def assert_same(ours, theirs, tolerance: float = 1e-9) -> None:
    assert ours.at_s == theirs.at_s
    np.testing.assert_allclose(ours.estimate.difference(theirs.estimate), 0.0, atol=tolerance)
    scale = np.sqrt(np.diag(theirs.covariance))
    difference = (ours.covariance - theirs.covariance) / np.outer(scale, scale)
    np.testing.assert_allclose(difference, 0.0, atol=tolerance)


@settings(max_examples=25)
@given(seed=st.integers(0, 1000), data=st.data())
def test_any_order_within_a_second_gives_what_the_right_order_gives(seed, data):
    samples, measurements = inputs(seed)
    longest = data.draw(st.sampled_from([0.0, 0.04, 0.3, 0.94]))
    random = np.random.default_rng(data.draw(st.integers(0, 10_000)))
    delays = random.uniform(0.0, longest, len(measurements))
    buffer = DelayBuffer(full_filter())
    feed(buffer, samples, measurements, delays)
    # The last ones arrive when no sample follows.
    assert buffer.too_old == buffer.too_early == 0
    assert_same(buffer, in_order(samples, measurements))


def test_measurements_that_arrive_before_their_sample_wait_for_it():
    samples, measurements = inputs(3)
    buffer = DelayBuffer(full_filter())
    feed(buffer, samples, measurements, [-0.4] * len(measurements))
    assert_same(buffer, in_order(samples, measurements))
    assert buffer.replayed_slots == 0


def test_what_waited_is_reported_when_its_time_comes():
    buffer = DelayBuffer(full_filter())
    assert buffer.update(Depth(0.03, 0.0, 0.1)) is None
    assert buffer.update(Depth(0.08, 0.0, 0.1)) is None
    (first,) = buffer.predict_strapdown(resting(0.05))
    assert (first.sensor, first.at_s, first.accepted) == ("depth", 0.03, True)
    (second,) = buffer.predict_kinematic(0.1)
    assert second.at_s == 0.08
    assert buffer.predict_strapdown(resting(0.15)) == []


def test_a_late_measurement_is_reported_once_and_those_after_it_are_not_again():
    buffer = DelayBuffer(full_filter())
    for step in range(1, 11):
        buffer.predict_strapdown(resting(0.05 * step))
    at_end = buffer.update(Depth(0.5, 0.2, 0.1))
    late = buffer.update(Depth(0.22, 0.1, 0.1))
    assert at_end.accepted
    assert late.at_s == 0.22
    assert buffer.replayed_slots == 6
    assert buffer.predict_strapdown(resting(0.55)) == []


def test_older_than_the_buffer_is_refused_and_counted():
    buffer = DelayBuffer(full_filter())
    for step in range(1, 61):
        buffer.predict_strapdown(resting(0.05 * step))
    before = buffer.estimate.copy()
    assert buffer.update(Depth(1.99, 0.2, 0.1)) is None
    assert buffer.update(Depth(-5.0, 0.2, 0.1)) is None
    assert buffer.update(Depth(math.nan, 0.2, 0.1)) is None
    assert buffer.too_old == 3
    np.testing.assert_array_equal(buffer.estimate.values, before.values)
    assert buffer.update(Depth(2.0, 0.2, 0.1)).accepted
    assert buffer.update(Depth(2.001, 0.2, 0.1)).accepted


def test_before_the_beginning_is_refused_and_at_the_beginning_is_not():
    buffer = DelayBuffer(full_filter())
    buffer.predict_strapdown(resting(0.05))
    assert buffer.update(Depth(-0.01, 0.2, 0.1)) is None
    assert buffer.too_old == 1
    assert buffer.update(Depth(0.0, 0.2, 0.1)).accepted
    assert buffer.at_s == 0.05


def test_from_the_future_is_refused_and_the_waiting_are_limited():
    buffer = DelayBuffer(full_filter())
    assert buffer.update(Depth(1.1, 0.2, 0.1)) is None
    assert buffer.update(Depth(math.inf, 0.2, 0.1)) is None
    assert buffer.too_early == 2
    for _ in range(MOST_WAITING + 5):
        buffer.update(Depth(0.5, 0.2, 0.1))
    assert buffer.too_early == 7
    assert len(buffer.predict_strapdown(resting(0.5, 0.5))) == MOST_WAITING


def test_memory_does_not_grow():
    buffer = DelayBuffer(full_filter())
    for step in range(1, 500):
        buffer.predict_strapdown(resting(0.05 * step))
        buffer.update(Depth(buffer.at_s - 0.31, 0.0, 0.1))
    assert len(buffer._slots) <= 22
    assert sum(len(slot.events) for slot in buffer._slots) <= 22
    assert not buffer._waiting


def test_no_numbers_are_refused_once():
    buffer = DelayBuffer(full_filter())
    for step in range(1, 11):
        buffer.predict_strapdown(resting(0.05 * step))
    assert buffer.update(Depth(0.31, math.nan, 0.1)) is None
    assert buffer.update(Depth(0.22, 0.0, 0.1)).accepted
    assert buffer.core.refused_measurements == 1
    sample = resting(0.55)
    sample.angular_rate_frd_radps[0] = math.nan
    assert buffer.predict_strapdown(sample) == []
    assert buffer.core.refused_samples == 1
    assert buffer.at_s == 0.5
    assert np.isfinite(buffer.covariance).all()


def test_the_callers_arrays_may_change_afterwards():
    """A sample's arrays are views of a burst: what runs again must not read them anew."""
    force, rate = np.array([0.0, 0.0, -9.81]), np.array([0.0, 0.0, 0.1])
    changed, kept = DelayBuffer(full_filter()), DelayBuffer(full_filter())
    changed.predict_strapdown(ImuSample(0.05, 0.05, force, rate))
    kept.predict_strapdown(ImuSample(0.05, 0.05, force.copy(), rate.copy()))
    force[:], rate[:] = 99.0, 99.0
    for buffer in (changed, kept):
        buffer.update(Depth(0.02, 0.1, 0.1))
    assert_same(changed, kept, 0.0)


def test_a_reset_stays_between_what_was_before_and_what_came_after():
    """A depth from before the reset, arriving after it, moves what the reset did not touch and nothing of the reset."""
    late, ordered = DelayBuffer(full_filter()), DelayBuffer(full_filter())
    for buffer in (late, ordered):
        for step in range(1, 5):
            buffer.predict_strapdown(resting(0.05 * step))
        if buffer is ordered:
            buffer.update(Depth(0.13, 0.4, 0.05))
        buffer.reset_block("position", (10.0, 20.0, 3.0), 0.5)
        buffer.add_uncertainty("current", 0.3)
        buffer.update(HorizontalPosition(0.2, 10.5, 20.0, np.eye(2)))
        buffer.predict_strapdown(resting(0.25))
        if buffer is late:
            buffer.update(Depth(0.13, 0.4, 0.05))
    assert_same(late, ordered)
    assert late.estimate.position_ned_m[1] == pytest.approx(20.0, abs=0.5)
    assert late.std("current")[0] == pytest.approx(math.hypot(0.2, 0.3), rel=1e-3)


def test_a_measurement_inside_a_gap_of_the_imu_is_put_there():
    late, early = DelayBuffer(full_filter()), DelayBuffer(full_filter())
    early.predict_strapdown(resting(0.05))
    late.predict_strapdown(resting(0.05))
    early.update(Depth(0.4, 0.2, 0.05))
    for buffer in (early, late):
        buffer.predict_strapdown(resting(0.75))
    late.update(Depth(0.4, 0.2, 0.05))
    assert late.at_s == 0.75
    assert_same(late, early)


def test_the_smoother_sees_only_the_last_version_of_history():
    samples, measurements = inputs(11)
    recorders = StepRecorder(0.0), StepRecorder(0.0)
    shuffled = DelayBuffer(full_filter(recorder=recorders[0]))
    ordered = DelayBuffer(full_filter(recorder=recorders[1]))
    random = np.random.default_rng(0)
    feed(shuffled, samples, measurements, random.uniform(0.0, 0.9, len(measurements)))
    feed(ordered, samples, measurements, [-0.2] * len(measurements))
    assert shuffled.replayed_slots > 50
    assert len(recorders[0].steps) == len(recorders[1].steps)
    for ours, theirs in zip(smooth(recorders[0].steps), smooth(recorders[1].steps), strict=True):
        assert ours.at_s == theirs.at_s
        np.testing.assert_allclose(ours.estimate.difference(theirs.estimate), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.diag(ours.covariance), np.diag(theirs.covariance), rtol=1e-7)


def test_the_verbs_of_the_filter():
    buffer = DelayBuffer(full_filter())
    assert buffer.layout is FULL
    assert buffer.std("depth_bias").tolist() == pytest.approx([0.05])
    assert buffer.predict_kinematic(math.inf) == buffer.predict_kinematic(0.0) == []
