"""Every bad input is named; good ones are left alone."""

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.receiver_faults import Fault, SwapWatch, examine_record, find_swapped
from bluerov_slam.simulation.acoustic_paths import floor_below
from bluerov_slam.simulation.acoustic_record import (
    SAMPLE_RATE_HZ,
    AcousticSetup,
    Tolerances,
    Window,
    simulate_records,
)

ARRAY = ReceiverArray.cross(sample_skew_s=[0.0, 0.42e-6, 0.0, 0.42e-6])
WORN = Tolerances(receiver_resonance=0.01, receiver_q=0.1, filter_corner=0.1, gain=0.1)


def _records(count=40, seed=3, **changes):
    rng = np.random.default_rng(seed)
    sources_m = np.array([2.6, 0.3, 0.2]) + rng.normal(0.0, 0.2, (count, 3))
    return simulate_records(AcousticSetup(ARRAY, **changes), sources_m, seed)


@pytest.mark.parametrize("snr_db", [0.0, 10.0, 30.0])
@pytest.mark.parametrize("reflectors", [(), (floor_below(0.66, 0.6),)])
def test_good_records_pass(snr_db, reflectors):
    records = _records(snr_db=snr_db, tolerances=WORN, reflectors=reflectors)
    for samples in records.samples:
        assert examine_record(samples, SAMPLE_RATE_HZ) == ()
        assert examine_record(samples + 2048.0, SAMPLE_RATE_HZ) == ()


def test_pure_noise_says_nothing_about_the_rate():
    noise = np.random.default_rng(1).normal(0.0, 60.0, (4, 2048))
    assert examine_record(noise, 500_000.0) == ()


def test_a_dead_receiver_is_named():
    samples = _records(1).samples[0]
    samples[2] = 17.0
    (finding,) = examine_record(samples, SAMPLE_RATE_HZ)
    assert (finding.fault, finding.receivers, finding.usable) == (Fault.DEAD, (2,), False)
    assert finding.text == "stands still at 17 counts"


def test_a_silent_receiver_is_named():
    samples = _records(1).samples[0]
    samples[1] = np.random.default_rng(1).normal(0.0, 2.0, 2048)
    (finding,) = examine_record(samples, SAMPLE_RATE_HZ)
    assert (finding.fault, finding.receivers) == (Fault.SILENT, (1,))
    assert finding.text.startswith("hears 2.0 counts where the others hear ")


@pytest.mark.parametrize("middle", [0.0, 2048.0])
def test_a_clipped_receiver_is_named_and_stays_usable(middle):
    samples = np.clip(_records(1, peak_counts=600.0).samples[0] * np.array([[1.0], [1.0], [1.0], [6.0]]), -2048, 2047)
    (finding,) = examine_record(samples + middle, SAMPLE_RATE_HZ)
    assert (finding.fault, finding.receivers, finding.usable) == (Fault.CLIPPED, (3,), True)


@pytest.mark.parametrize("stated", [0.5, 0.9, 0.94, 1.06, 1.1, 2.0])
def test_a_wrong_sample_rate_is_named_with_the_likely_one(stated):
    for samples in _records(10, snr_db=10.0).samples:
        (finding,) = examine_record(samples, SAMPLE_RATE_HZ * stated)
        assert finding.fault is Fault.SAMPLE_RATE
        likely_hz = float(finding.text.rsplit(" ", 1)[1])
        assert likely_hz == pytest.approx(SAMPLE_RATE_HZ, rel=0.02)


def test_a_record_shorter_than_a_bit_is_named():
    records = _records(1, window=Window("blocks", samples=400))
    (finding,) = examine_record(records.samples[0], SAMPLE_RATE_HZ)
    assert finding.fault is Fault.SHORT
    assert finding.text == "the record lasts 0.47 ms, one bit of a pulse 0.50 ms"


def _delays(records, order, seed=1):
    arrivals_s = records.toa_s[:, order] + np.random.default_rng(seed).normal(0.0, 0.3e-6, records.toa_s.shape)
    return arrivals_s[:, :1] - arrivals_s[:, 1:]


@pytest.mark.parametrize("pair", [(0, 1), (0, 3), (1, 2), (2, 3)])
def test_exchanged_neighbours_are_named(pair):
    order = [0, 1, 2, 3]
    order[pair[0]], order[pair[1]] = order[pair[1]], order[pair[0]]
    finding = find_swapped(_delays(_records(10), order), ARRAY, 343.0)
    assert finding is not None
    assert finding.fault is Fault.SWAPPED
    assert f"{pair[0]} and {pair[1]}" in finding.text
    assert set(pair) <= set(finding.receivers)


def test_the_board_s_wrong_channel_order_is_found():
    # The trigger's code takes ADC 1 for receivers 0 and 2: 1 and 2 exchanged.
    finding = find_swapped(_delays(_records(10), [0, 2, 1, 3]), ARRAY, 343.0)
    assert finding is not None
    assert "1 and 2" in finding.text


@pytest.mark.parametrize("distance_m", [1.3, 2.6, 50.0])
def test_right_order_is_left_alone_near_and_far(distance_m):
    rng = np.random.default_rng(5)
    direction = np.column_stack((np.ones(50), rng.uniform(-0.4, 0.4, (50, 2))))
    sources_m = distance_m * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    records = simulate_records(AcousticSetup(ARRAY), sources_m, 2)
    delays_s = _delays(records, [0, 1, 2, 3])
    assert find_swapped(delays_s, ARRAY, 343.0) is None
    assert all(find_swapped(row, ARRAY, 343.0) is None for row in delays_s)


def test_some_wrong_pings_do_not_hide_or_make_an_exchange():
    records = _records(12)
    wrong = np.random.default_rng(2).uniform(-8e-4, 8e-4, (4, 3))
    exchanged, right = _delays(records, [0, 2, 1, 3]), _delays(records, [0, 1, 2, 3])
    exchanged[:4] = right[:4] = wrong
    assert "1 and 2" in find_swapped(exchanged, ARRAY, 343.0).text
    assert find_swapped(right, ARRAY, 343.0) is None


def test_a_receiver_a_period_off_is_no_exchange():
    delays_s = _delays(_records(10), [0, 1, 2, 3])
    for receiver in range(3):
        slipped = delays_s.copy()
        slipped[:, receiver] += 25.1e-6
        assert find_swapped(slipped, ARRAY, 343.0) is None


@pytest.mark.parametrize("pair", [(0, 1), (2, 3), (2, 4)])
def test_exchanges_show_in_an_array_with_a_stalk(pair):
    array = ReceiverArray(np.vstack((ReceiverArray.cross().positions_m, (0.25, 0.0, 0.0))))
    order = list(range(5))
    order[pair[0]], order[pair[1]] = order[pair[1]], order[pair[0]]
    rng = np.random.default_rng(8)
    found = set()
    for _ in range(10):
        source_m = np.array([5.0, 20.0, 8.0]) + rng.normal(0.0, 2.0, (6, 3))
        arrivals_s = np.linalg.norm(source_m[:, None] - array.positions_m, axis=2)[:, order] / 1500.0
        finding = find_swapped(arrivals_s[:, :1] - arrivals_s[:, 1:], array, 1500.0)
        found.add(finding is not None and f"{pair[0]} and {pair[1]}" in finding.text)
    assert found == {True}


def test_the_watch_speaks_after_some_pings_and_falls_silent_again():
    watch = SwapWatch(ARRAY)
    records = _records(40)
    exchanged = records.toa_s[:12, [0, 2, 1, 3]]
    said = [watch.hear(row - row[0], 343.0) for row in exchanged]
    assert said[:5] == [None] * 5
    assert all(finding is not None for finding in said[5:])
    assert watch.hear([0.0, np.nan, 1e-5, 1e-5], 343.0) is not None  # an incomplete ping changes nothing
    put_right = [watch.hear(row - row[0], 343.0) for row in records.toa_s[12:32]]
    assert put_right[-1] is None
