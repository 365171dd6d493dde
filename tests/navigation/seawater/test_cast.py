"""Dives whose water is known, sampled as a vehicle does it."""

import dataclasses

import numpy as np
import pytest

from bluerov_slam.navigation.seawater import ColumnOptions, CtdCast, WaterColumn
from bluerov_slam.records import CtdSample

LATITUDE_DEG = 48.0


def water_at(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Temperature and salinity of the true water: warm and fresher above 20 m."""
    above = 1.0 / (1.0 + np.exp((depth - 20.0) / 2.0))
    return 9.0 + 7.0 * above, 35.0 - 1.5 * above


def sampled(depth: np.ndarray, at_s: np.ndarray, seed: int = 3, offset_degc: float | np.ndarray = 0.0) -> np.ndarray:
    """Samples (n, 4) along a path, with noise."""
    generator = np.random.default_rng(seed)
    temperature, salinity = water_at(depth)
    return np.column_stack(
        (
            at_s,
            depth * 1.008e4 + generator.normal(0, 20.0, len(depth)),
            temperature + offset_degc + generator.normal(0, 0.01, len(depth)),
            salinity + generator.normal(0, 0.03, len(depth)),
        )
    )


def path(*legs: tuple[float, float], rate_hz: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Depth and time of straight legs: (depth to reach, seconds for it), from the surface."""
    depths, last = [np.zeros(1)], 0.0
    for to_m, seconds in legs:
        depths.append(np.linspace(last, to_m, int(seconds * rate_hz) + 1)[1:])
        last = to_m
    depth = np.concatenate(depths)
    return depth, np.arange(len(depth)) / rate_hz


def column_of(samples: np.ndarray, options: ColumnOptions | None = None) -> WaterColumn:
    cast = CtdCast(options)
    for row in samples:
        cast.add(*map(float, row))
    column = cast.column(LATITUDE_DEG)
    assert column is not None
    return column


def temperature_errors(column: WaterColumn, low_m: float = 1.0, high_m: float = 39.0) -> np.ndarray:
    depth = np.arange(low_m, high_m, 0.5)
    return column.temperature_at_degc(depth) - water_at(depth)[0]


def test_a_descent_gives_the_water_back() -> None:
    column = column_of(sampled(*path((40.0, 160.0))))
    assert np.max(np.abs(temperature_errors(column))) < 0.25  # 1 m bins where 0.9 degC change in a metre
    depth = np.arange(1.0, 39.0)
    assert np.max(np.abs(column.salinity_at_psu(depth) - water_at(depth)[1])) < 0.12
    assert column.deepest_m == pytest.approx(40.0, abs=0.2)
    assert column.shallowest_m == 0.0
    assert np.all(column.nodes.descending[:-1])


def test_the_way_up_does_not_spoil_the_way_down() -> None:
    depth, at_s = path((40.0, 160.0), (40.0, 60.0), (0.0, 160.0))
    # In its own wash, and with a warm housing, the vehicle reads 1 degC too much once it is down.
    wash = np.where(at_s > 160.0, 1.0, 0.0)
    column = column_of(sampled(depth, at_s, offset_degc=wash))
    assert np.max(np.abs(temperature_errors(column))) < 0.25


def test_up_and_down_again_uses_every_descent() -> None:
    once = column_of(sampled(*path((40.0, 160.0))))
    thrice = column_of(sampled(*path((40.0, 160.0), (5.0, 140.0), (40.0, 140.0), (5.0, 140.0), (40.0, 140.0))))
    middle = (thrice.nodes.sea_pressure_pa > 1e5) & (thrice.nodes.sea_pressure_pa < 3.8e5)
    assert np.all(thrice.nodes.samples[middle] >= 10)
    assert np.mean(thrice.nodes.temperature_std_degc[middle]) < np.mean(once.nodes.temperature_std_degc)
    assert np.max(np.abs(temperature_errors(thrice))) < 0.25


def test_where_only_ascents_came_through_they_have_to_do() -> None:
    depth, at_s = path((40.0, 160.0), (0.0, 160.0))
    samples = sampled(depth, at_s)
    blind = (samples[:, 0] < 160.0) & (depth > 10.0) & (depth < 30.0)
    column = column_of(samples[~blind])
    hole = (column.nodes.sea_pressure_pa > 1.2e5) & (column.nodes.sea_pressure_pa < 2.8e5)
    assert np.count_nonzero(hole) >= 15
    assert not np.any(column.nodes.descending[hole])
    assert np.max(np.abs(temperature_errors(column))) < 0.3


def test_hovering_for_long_moves_nothing() -> None:
    depth, at_s = path((19.9, 80.0), (19.9, 1800.0), (40.0, 80.0))
    column = column_of(sampled(depth, at_s))
    assert np.max(np.abs(temperature_errors(column))) < 0.25


def test_single_wrong_samples_do_not_count() -> None:
    samples = sampled(*path((40.0, 160.0)))
    clean = column_of(samples)
    generator = np.random.default_rng(8)
    wrong = generator.choice(np.arange(10, len(samples) - 10, 9), 20, replace=False)
    samples[wrong[:7], 2] = 40.0
    samples[wrong[7:14], 3] = 0.0
    samples[wrong[14:], 1] = 3e6
    spoiled = column_of(samples)
    assert spoiled.deepest_m == pytest.approx(clean.deepest_m, abs=0.3)
    assert np.max(np.abs(temperature_errors(spoiled))) < 0.35


def test_the_stated_random_error_is_what_noise_causes() -> None:
    depth, at_s = path((40.0, 400.0))
    truth_degc, stated, found = 9.0, [], []
    for seed in range(60):
        generator = np.random.default_rng(seed)
        samples = np.column_stack(
            (at_s, depth * 1.008e4, truth_degc + generator.normal(0, 0.1, len(depth)), np.full(len(depth), 35.0))
        )
        nodes = column_of(samples).nodes
        inner = slice(1, -1)
        stated.append(np.mean(nodes.temperature_std_degc[inner] ** 2))
        found.append(np.mean((nodes.temperature_degc[inner] - truth_degc) ** 2))
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.sqrt(np.mean(found)), rel=0.2)


def test_a_fresh_lake_has_a_column_too() -> None:
    depth, at_s = path((30.0, 120.0))
    samples = np.column_stack((at_s, depth * 0.98e4, np.full(len(depth), 12.0), np.full(len(depth), 0.2)))
    column = column_of(samples)
    assert column.sound_speed_at_mps(15.0) == pytest.approx(1455.7, abs=0.5)
    assert column.density_at_kg_per_m3(15.0) == pytest.approx(999.7, abs=0.2)


def test_too_little_is_no_column() -> None:
    cast = CtdCast()
    assert cast.column(LATITUDE_DEG) is None
    assert cast.add(0.0, 1e4, 10.0, 35.0)
    assert cast.column(LATITUDE_DEG) is None
    assert not cast.add(1.0, float("nan"), 10.0, 35.0)
    assert not cast.add(1.0, 1e4, float("inf"), 35.0)
    # At the time of the one before, or too soon after it.
    assert not cast.add(0.0, 1e4, 10.0, 35.0)
    assert not cast.add(0.1, 1e4, 10.0, 35.0)
    assert len(cast) == 1


def test_a_clock_that_goes_back_is_a_new_beginning() -> None:
    depth, at_s = path((40.0, 160.0))
    samples = sampled(depth, at_s)
    samples[len(samples) // 2 :, 0] -= 5000.0
    column = column_of(samples)
    assert np.max(np.abs(temperature_errors(column))) < 0.25
    assert np.mean(column.nodes.descending) > 0.9


def test_a_long_dive_is_thinned_and_keeps_its_water() -> None:
    cast = CtdCast(ColumnOptions(sample_period_s=0.0))
    depth = 20.0 + 19.0 * np.sin(np.arange(70_000) * 2 * np.pi / 3000)
    for row in sampled(depth, np.arange(70_000) * 0.2):
        cast.add(*map(float, row))
    assert 30_000 < len(cast) < 61_000
    column = cast.column(LATITUDE_DEG)
    assert column is not None
    assert np.max(np.abs(temperature_errors(column, 2.0, 38.0))) < 0.3


def test_records_of_the_link_are_taken_as_they_are() -> None:
    sample = CtdSample(
        measured_s=1.0,
        arrived_s=1.1,
        temperature_degc=10.0,
        conductivity_s_per_m=3.8,
        pressure_pa=111_325.0,
        depth_m=1.0,
        salinity_psu=35.0,
        sound_speed_mps=1490.0,
        surface_pressure_pa=101_325.0,
    )
    cast = CtdCast()
    assert cast.add_ctd(sample)
    for missing in ("temperature_degc", "salinity_psu", "pressure_pa"):
        assert not cast.add_ctd(dataclasses.replace(sample, measured_s=9.0, **{missing: None}))
    assert cast.add_ctd(dataclasses.replace(sample, measured_s=2.0))
    column = cast.column(LATITUDE_DEG)
    assert column is not None
    assert column.nodes.sea_pressure_pa == pytest.approx([1e4])
    assert column.depth_m == pytest.approx([0.993], abs=0.002)
