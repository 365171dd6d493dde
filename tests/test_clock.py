import random

import pytest

from bluerov_slam.clock import DeviceClock, WallClock

WRAP = 1 << 32


def us32(device_s: float) -> int:
    return int(device_s * 1e6) % WRAP


def ms32(device_s: float) -> int:
    return int(device_s * 1e3) % WRAP


def run(
    clock: DeviceClock, start_s: float, stop_s: float, *, offset_s: float, drift: float = 0.0, seed: int = 1
) -> float:
    """Half-second messages with 2..40 ms delay; returns the worst error of the last 60 s against the smallest delay."""
    rng = random.Random(seed)
    worst_s, device_s = 0.0, start_s
    while device_s < stop_s:
        true_s = offset_s + device_s * (1 + drift)
        arrived_s = true_s + 0.002 + rng.expovariate(1 / 0.01)
        measured_s = clock.map_us32(us32(device_s), arrived_s)
        assert measured_s <= arrived_s
        if device_s > stop_s - 60:
            worst_s = max(worst_s, abs(measured_s - true_s - 0.002))
        device_s += 0.5
    return worst_s


def test_the_first_stamp_arrives_when_it_was_made() -> None:
    assert DeviceClock().map_us32(5_000_000, 100.0) == pytest.approx(100.0)


def test_delay_is_taken_out() -> None:
    clock = DeviceClock()
    assert run(clock, 3.0, 120.0, offset_s=1000.0) < 0.002


@pytest.mark.parametrize("drift", [-100e-6, -20e-6, 40e-6, 100e-6])
def test_drift_is_followed_for_hours_across_the_wrap(drift: float) -> None:
    clock = DeviceClock()
    assert run(clock, 3.0, 2.5 * 3600, offset_s=500.0, drift=drift) < 0.003
    assert clock.drift_ppm == pytest.approx(drift * 1e6, abs=5)
    assert clock.resets == 0


def test_milliseconds_and_microseconds_share_one_timeline() -> None:
    clock = DeviceClock()
    for k in range(200):
        device_s = 5 * 3600 + k * 0.25
        from_us = clock.map_us32(us32(device_s), 77.0 + device_s)
        from_ms = clock.map_ms32(ms32(device_s), 77.0 + device_s)
        assert from_us == pytest.approx(from_ms, abs=0.0011)
    assert clock.resets == 0


def test_milliseconds_wrap_after_49_days() -> None:
    clock = DeviceClock()
    start_s = WRAP / 1e3 - 3.0
    for k in range(20):
        device_s = start_s + 0.5 * k
        assert clock.map_ms32(ms32(device_s), 10.0 + 0.5 * k) == pytest.approx(10.0 + 0.5 * k, abs=0.002)
    assert clock.resets == 0


@pytest.mark.parametrize("uptime_s", [30.0, 1200.0, 3600.0, 4280.0])
def test_a_reset_starts_a_new_mapping(uptime_s: float) -> None:
    clock = DeviceClock()
    for k in range(100):
        clock.map_us32(us32(uptime_s - 10 + k * 0.1), 50.0 + k * 0.1)
    assert clock.map_us32(us32(0.4), 62.0) == pytest.approx(62.0)
    assert clock.map_us32(us32(0.5), 62.1) == pytest.approx(62.1)
    assert clock.resets == 1
    assert clock.offset_s == pytest.approx(61.6)


def test_a_single_wrong_stamp_is_no_reset() -> None:
    clock = DeviceClock()
    run(clock, 3.0, 300.0, offset_s=200.0)
    for wrong_s in (1.0, 2000.0):
        assert clock.map_us32(us32(wrong_s), 500.1) == 500.1
        assert clock.map_us32(us32(300.2), 500.25) == pytest.approx(500.2, abs=0.005)
    assert clock.map_ms32(ms32(300.3), 500.31) == pytest.approx(500.3, abs=0.005)
    assert clock.map_ms32(ms32(0.1), 500.4) == 500.4
    assert clock.map_ms32(ms32(300.5), 500.51) == pytest.approx(500.5, abs=0.005)
    assert clock.resets == 0


def test_milliseconds_tell_a_reset_that_microseconds_hide() -> None:
    clock = DeviceClock()
    wrap_s = WRAP / 1e6
    clock.map_ms32(ms32(wrap_s), 100.0)
    clock.map_ms32(ms32(0.5), 100.5)
    clock.map_ms32(ms32(1.0), 101.0)
    assert clock.resets == 1


@pytest.mark.parametrize("uptime_s", [1.7, 2.4, 30.0])
def test_a_reset_soon_after_the_start_is_none_the_less_one(uptime_s: float) -> None:
    clock = DeviceClock()
    clock.map_us32(us32(0.1), 100.1)
    clock.map_ms32(ms32(uptime_s), 100.0 + uptime_s)
    for again_s in (0.65, 1.15, 1.65, 2.15):
        arrived_s = 130.0 + again_s
        assert clock.map_ms32(ms32(again_s), arrived_s) == pytest.approx(arrived_s, abs=0.002)
        clock.map_us32(us32(again_s + 0.1), arrived_s + 0.1)
    assert clock.resets == 1
    assert clock.offset_s == pytest.approx(130.0, abs=0.002)


def test_a_host_pause_is_no_reset_and_leaves_the_mapping_alone() -> None:
    clock = DeviceClock()
    run(clock, 3.0, 300.0, offset_s=200.0)
    for device_s in (300.0, 300.5, 301.0):  # waited in the kernel for ten minutes
        assert clock.map_us32(us32(device_s), 200.0 + 900.0) == pytest.approx(200.0 + device_s, abs=0.005)
    assert clock.map_us32(us32(900.0), 1100.002) == pytest.approx(1100.002, abs=0.01)
    assert clock.resets == 0


def test_a_gap_longer_than_half_a_wrap_is_bridged() -> None:
    clock = DeviceClock()
    run(clock, 3.0, 100.0, offset_s=0.0)
    assert clock.map_us32(us32(3 * 3600.0), 3 * 3600.0 + 0.01) == pytest.approx(3 * 3600.0, abs=0.02)
    assert clock.resets == 0


def test_stamps_may_run_back_a_little() -> None:
    clock = DeviceClock()
    assert clock.map_us32(10_000_000, 100.0) == pytest.approx(100.0)
    assert clock.map_us32(9_900_000, 100.02) == pytest.approx(99.9)
    assert clock.resets == 0


def test_old_bytes_at_the_start_do_not_spoil_the_mapping() -> None:
    clock = DeviceClock()
    clock.map_us32(us32(100.0), 500.0)  # had waited 30 s before the port was opened
    assert clock.map_us32(us32(130.0), 500.1) == pytest.approx(500.1)
    assert clock.map_us32(us32(130.1), 500.2) == pytest.approx(500.2)
    assert clock.map_us32(us32(130.5), 500.6) == pytest.approx(500.6)


def test_an_echo_bounds_the_hidden_delay() -> None:
    clock = DeviceClock()
    assert clock.uncertainty_s is None
    clock.map_us32(10_000_000, 100.005)
    assert clock.uncertainty_s is None
    clock.note_echo(sent_s=99.0, device_us32=9_002_000)
    assert clock.uncertainty_s == pytest.approx(0.007)


def test_nothing_is_known_before_the_first_stamp() -> None:
    clock = DeviceClock()
    assert clock.offset_s is None
    assert clock.drift_ppm is None


def test_wall_clock_steps_are_recorded() -> None:
    wall = WallClock(1_700_000_000.0, 10.0)
    assert wall.observe(1_700_000_001.0, 11.0) is None
    step = wall.observe(1_700_003_602.0, 12.0)
    assert step is not None
    assert step.by_s == pytest.approx(3600.0)
    assert wall.steps == (step,)
    assert wall.unix_s(12.0) == pytest.approx(1_700_003_602.0)


def test_gps_time_tells_whether_the_wall_clock_can_be_trusted() -> None:
    wall = WallClock(1_000_000_000.0, 0.0)
    assert wall.is_trusted() is None
    wall.note_gps(1_700_000_100.0, 100.0)
    assert wall.gps_utc_offset_s == pytest.approx(700_000_000.0)
    assert wall.is_trusted() is False
    wall.observe(1_700_000_101.0, 101.0)
    assert wall.gps_utc_offset_s == pytest.approx(0.0)
    assert wall.is_trusted() is True
