"""The thesis's dead reckoning, its defects and all, and the corrected one on the same moves."""

from __future__ import annotations

import csv
import gzip
import itertools
import math
from collections import defaultdict

import numpy as np
import pytest

from bluerov_slam.navigation.attitude.quaternion import IDENTITY, conjugate, from_euler, rotate
from bluerov_slam.navigation.dead_reckoning.corrected import CorrectedDeadReckoning
from bluerov_slam.navigation.dead_reckoning.stationary import StationaryDetector
from bluerov_slam.navigation.dead_reckoning.thesis import THRESHOLD_G, ThesisDeadReckoning
from inertial_samples import GRAVITY_MPS2
from real_data import recording

RATE_HZ = 208.0
DT = 1.0 / RATE_HZ
STILL = (0.0, 0.0, 0.0)


def steps(direction: tuple[float, float, float], length_m: float, count: int, step_s: float = 0.05) -> np.ndarray:
    """Accelerations (n, 3) of a move as the thesis's hexapods make it: small steps, each from rest to rest.

    A step is a polynomial of the fifth degree (least jerk), which the platform follows with a lag of 40 ms; a second of
    rest before and after.
    """
    n = round(step_s * RATE_HZ)
    s = (np.arange(n) + 0.5) / n
    one = length_m / count / step_s**2 * (60.0 * s - 180.0 * s**2 + 120.0 * s**3)
    along = np.concatenate([np.zeros(208), np.tile(one, count), np.zeros(330)])
    lag = np.exp(-np.arange(100) * DT / 0.04)
    along = np.convolve(along, lag / lag.sum())[: len(along)]
    return along[:, None] * np.array(direction)


def measured(
    acceleration_ned: np.ndarray, attitude: tuple[float, ...], seed: int | None, bias: float = 0.0
) -> np.ndarray:
    """Specific force in the body with the noise (0.01 m/s2 rms at 208 Hz) and bias of a consumer accelerometer."""
    force = acceleration_ned - np.array([0.0, 0.0, GRAVITY_MPS2])
    body = np.array([rotate(conjugate(attitude), tuple(f)) for f in force])  # type: ignore[arg-type]
    if seed is None:
        return body
    random = np.random.default_rng(seed)
    return body + random.normal(0.0, 0.01, body.shape) + random.normal(0.0, bias, 3)


def travelled(acceleration: np.ndarray) -> np.ndarray:
    velocity = np.cumsum(acceleration, axis=0) * DT
    return np.asarray((velocity - 0.5 * acceleration * DT).sum(axis=0) * DT)


def by_thesis(force: np.ndarray, attitude: tuple[float, ...] = IDENTITY) -> np.ndarray:
    reckoning = ThesisDeadReckoning()
    for f in force:
        reckoning.update(f, attitude, DT)  # type: ignore[arg-type]
    return np.array(reckoning.take())


def corrected(force: np.ndarray, attitude: tuple[float, ...] = IDENTITY, seed: int = 0) -> tuple[np.ndarray, float]:
    reckoning = CorrectedDeadReckoning()
    random = np.random.default_rng(seed + 500)
    for f in force:
        result = reckoning.update(random.normal(0.0, 0.001, 3), f, attitude, DT)  # type: ignore[arg-type]
    assert result.still
    return np.array(result.position_ned_m), result.std_m


def test_thesis_adds_up_by_hand() -> None:
    """Ten samples of 1 m/s2 down, ten of 0.9 up, calm: velocities, drift and areas as the published lines give them."""
    reckoning = ThesisDeadReckoning()
    for _ in range(5):
        reckoning.update((0.0, 0.0, -9.81), IDENTITY, 0.005)
    position = velocity = 0.0
    for acceleration in [1.0] * 10 + [-0.9] * 10:
        velocity += acceleration * 0.005
        position += velocity * 0.005
        reckoning.update((0.0, 0.0, -9.81 + acceleration), IDENTITY, 0.005)
    assert reckoning.velocity_mps[2] == pytest.approx(velocity)
    assert reckoning.displacement_m[2] == pytest.approx(position)
    for _ in range(19):
        reckoning.update((0.0, 0.0, -9.81), IDENTITY, 0.005)
    position += 19 * velocity * 0.005
    assert reckoning.displacement_m[2] == pytest.approx(position)
    reckoning.update((0.0, 0.0, -9.81), IDENTITY, 0.005)
    # Last calm at count 4, now at 44: 41 - 20 = 21 samples of triangle, 20 of rectangle, at 208 Hz instead of 200.
    position -= velocity * (21 / 2 + 20) / 208.0
    assert reckoning.displacement_m[2] == pytest.approx(position)
    assert reckoning.velocity_mps == pytest.approx((0.0, 0.0, 0.0))


def test_thesis_counts_over_its_wrap() -> None:
    ends = []
    for calm in (5, 9985):
        reckoning = ThesisDeadReckoning()
        for _ in range(calm):
            reckoning.update((0.0, 0.0, -9.81), IDENTITY, DT)
        for acceleration in [1.0] * 10 + [-0.9] * 10 + [0.0] * 30:
            reckoning.update((0.0, 0.0, -9.81 + acceleration), IDENTITY, DT)
        ends.append(reckoning.displacement_m[2])
    assert ends[1] == pytest.approx(ends[0])


def test_thesis_turns_into_its_test_frame_and_forgets_at_a_fix() -> None:
    reckoning = ThesisDeadReckoning(start_yaw_rad=-0.5)
    attitude = from_euler(0.0, 0.0, 0.5)
    for _ in range(10):
        reckoning.update((5.0, 0.0, -9.81), attitude, DT)
    x, y, _ = reckoning.take()
    assert x > 0.001
    assert y == pytest.approx(0.0, abs=1e-12)
    assert reckoning.displacement_m == (0.0, 0.0, 0.0)
    assert reckoning.velocity_mps == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
def test_thesis_is_blind_to_the_side_up_to_a_quarter_of_g(direction: tuple[float, float, float]) -> None:
    blind = math.sqrt((1.0 + THRESHOLD_G) ** 2 - 1.0) * 9.81
    assert blind == pytest.approx(0.286 * 9.81, abs=0.01)
    for acceleration, seen in ((0.97 * blind, False), (1.03 * blind, True)):
        reckoning = ThesisDeadReckoning()
        for _ in range(50):
            reckoning.update((acceleration * direction[0], acceleration * direction[1], -9.81), IDENTITY, DT)
        assert any(reckoning.velocity_mps) is seen


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize(("length_m", "count"), [(0.008, 6), (0.002, 16), (0.03, 6), (0.2, 1)])
def test_corrected_finds_moves_in_every_direction(
    direction: tuple[float, float, float], length_m: float, count: int
) -> None:
    acceleration = steps(direction, length_m, count, step_s=0.5 if count == 1 else 0.05)
    attitude = from_euler(0.1, -0.2, 0.7)
    found, std_m = corrected(measured(acceleration, attitude, seed=1, bias=0.05), attitude)
    error = found - travelled(acceleration)
    assert np.abs(error).max() < 0.0015 + 0.02 * length_m
    assert np.abs(error).max() < 4.0 * std_m + 0.0005


def test_a_constant_error_is_removed_exactly() -> None:
    acceleration = steps((1.0, 0.0, 0.0), 0.05, 1, step_s=0.4)
    clean = measured(acceleration, IDENTITY, None)
    tilted = clean + np.array([0.1, -0.05, 0.08])
    found, _ = corrected(tilted)
    straight, _ = corrected(clean)
    assert found == pytest.approx(straight, abs=2e-4)


def test_the_stated_error_is_the_error() -> None:
    """Many moves of one second with an attitude error that changes while they last."""
    random = np.random.default_rng(7)
    normalised = []
    for seed in range(60):
        acceleration = steps((0.0, 1.0, 0.0), 0.1, 1, step_s=1.0)
        wander = np.zeros((len(acceleration), 3))
        wander[208:416] = np.linspace(0.0, 1.0, 208)[:, None] * random.normal(0.0, 0.03, 3)
        wander[416:] = wander[415]
        found, std_m = corrected(measured(acceleration, IDENTITY, seed, bias=0.05) + wander, seed=seed)
        normalised.append((found - travelled(acceleration)) / std_m)
    assert 0.5 < float(np.sqrt(np.mean(np.square(normalised)))) < 1.3


def test_an_unfinished_move_has_a_growing_error() -> None:
    reckoning = CorrectedDeadReckoning()
    stds = []
    for k in range(1000):
        shake = 2.0 * math.sin(0.3 * k)
        stds.append(reckoning.update((0.0, 0.2, 0.0), (shake, 0.0, -GRAVITY_MPS2), IDENTITY, DT).std_m)
    assert all(b >= a for a, b in itertools.pairwise(stds))
    assert stds[-1] > 0.3


def test_nonsense_changes_nothing() -> None:
    reckoning = CorrectedDeadReckoning()
    before = reckoning.update((0.0, 0.0, 0.0), (0.0, 0.0, -GRAVITY_MPS2), IDENTITY, DT)
    for rate, force, dt in (
        ((math.nan, 0.0, 0.0), (0.0, 0.0, -9.8), DT),
        ((0.0, 0.0, 0.0), (math.inf, 0.0, -9.8), DT),
        ((0.0, 0.0, 0.0), (0.0, 0.0, -9.8), 0.0),
        ((0.0, 0.0, 0.0), (0.0, 0.0, -9.8), math.nan),
    ):
        assert reckoning.update(rate, force, IDENTITY, dt) == before


@pytest.mark.parametrize(("direction", "floor"), [((1.0, 0.0, 0.0), 0.2), ((0.0, 0.0, 1.0), 0.2)])
def test_the_detector_tells_rest_from_motion(direction: tuple[float, float, float], floor: float) -> None:
    random = np.random.default_rng(3)
    detector = StationaryDetector.from_rest(random.normal(0.0, 0.004, (400, 3)), random.normal(0.0, 0.03, (400, 3)))
    rest, moving = [], []
    for k in range(1200):
        push = (2.0 * math.sin(0.2 * k) if k > 600 else 0.0) * np.array(direction)
        force = push + np.array([0.05, 0.0, -GRAVITY_MPS2]) + random.normal(0.0, 0.03, 3)
        (rest if k <= 600 else moving).append(detector.update(random.normal(0.0, 0.004, 3), force))
    assert np.mean(rest[29:]) == 1.0
    assert not any(rest[:28])
    assert np.mean(moving[20:]) == 0.0
    detector.update((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert detector.statistic is None or not detector.statistic < floor


def slope(found: list[np.ndarray], true: list[np.ndarray], axis: int) -> float:
    f, t = np.array(found)[:, axis], np.array(true)[:, axis]
    return float(f @ t / (t @ t))


def test_on_the_same_moves_the_thesis_loses_what_the_corrected_one_finds() -> None:
    """The thesis's platform: rapid steps of 8 mm in 0.3 s, gradual ones of 2 mm in 0.8 s."""
    slopes = {}
    for name, axis, length_m, count in (
        ("rapid down", 2, 0.008, 6),
        ("rapid aside", 1, 0.008, 6),
        ("gradual down", 2, 0.002, 16),
        ("gradual aside", 1, 0.002, 16),
    ):
        thesis, ours, true = [], [], []
        for seed in range(12):
            direction = tuple((1.0 if seed % 2 else -1.0) * (np.arange(3) == axis))
            acceleration = steps(direction, length_m, count)  # type: ignore[arg-type]
            force = measured(acceleration, IDENTITY, seed, bias=0.03)
            thesis.append(by_thesis(force))
            ours.append(corrected(force, seed=seed)[0])
            true.append(travelled(acceleration))
        slopes[name] = slope(thesis, true, axis), slope(ours, true, axis)
    # As in the logs (0.53, 0.10, 0.00, 0.00): much of the vertical, little of the lateral, nothing slow.
    assert slopes["rapid down"][0] > 3.0 * abs(slopes["rapid aside"][0])
    assert abs(slopes["rapid aside"][0]) < 0.3
    assert abs(slopes["gradual down"][0]) < 0.2
    assert abs(slopes["gradual aside"][0]) < 0.05
    for direction in ("down", "aside"):
        assert slopes[f"rapid {direction}"][1] == pytest.approx(0.93, abs=0.07)
        # Two millimetres in 0.8 s pass for rest most of the time: their tremble is no larger than the noise.
        assert 0.1 < slopes[f"gradual {direction}"][1] < 0.6


@pytest.mark.data
def test_the_logs_of_the_thesis_show_the_same_blindness() -> None:
    """Slope of the dead-reckoned displacement on the true step, from the logs themselves."""
    with gzip.open(recording("isbl_thesis", "estimates.csv.gz"), "rt", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    last: dict[tuple[str, str], dict[str, str]] = {}
    pairs: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for row in rows:
        before = last.get((row["log"], row["segment"]))
        last[row["log"], row["segment"]] = row
        usable = (
            row["truth_ok"] == "1" and row["after_discard"] == "0" and row["dr_z"] and row["axis"] in ("X", "Y", "Z")
        )
        if before is None or int(row["row"]) != int(before["row"]) + 1 or not usable:
            continue
        axis = row["axis"].lower()
        pairs[row["motion"], row["axis"]].append(
            (float(row[f"true_{axis}"]) - float(before[f"true_{axis}"]), float(row[f"dr_{axis}"]))
        )
    slopes = {}
    for key, values in pairs.items():
        true, found = np.array(values).T
        slopes[key] = float(true @ found / max(1e-9, float(true @ true)))
    assert slopes["rapid", "Z"] == pytest.approx(0.53, abs=0.02)
    assert slopes["rapid", "X"] == pytest.approx(0.10, abs=0.02)
    assert slopes["rapid", "Y"] == pytest.approx(0.11, abs=0.02)
    assert all(abs(slopes["gradual", axis]) < 0.1 for axis in "XYZ")
