"""Our filters on a real BlueROV2's raw samples, beside what its autopilot made of them."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from pymavlink import mavutil

from bluerov_slam.navigation.attitude.ekf_attitude import EkfAttitude
from bluerov_slam.navigation.attitude.filter import AttitudeFilter
from bluerov_slam.navigation.attitude.initial import initial_attitude
from bluerov_slam.navigation.attitude.madgwick import Madgwick
from bluerov_slam.navigation.attitude.mahony import Mahony
from bluerov_slam.navigation.attitude.quaternion import to_euler
from inertial_samples import GRAVITY_MPS2
from real_data import recording

pytestmark = pytest.mark.data
LOGS = ("bench_2023-04-18_11-03-34.tlog", "surface_ugps_2023-05-04.tlog")
NOTHING = (math.nan, math.nan, math.nan)


@lru_cache
def messages(log: str) -> tuple[list[tuple[float, ...]], list[tuple[float, ...]]]:
    """(seconds, force m/s2, field) at 2 Hz and (seconds, rates rad/s, roll, pitch, yaw rad) at 20 Hz."""
    link = mavutil.mavlink_connection(str(recording("bluerov2_ardusub_logs", log)))
    samples, angles = [], []
    while (message := link.recv_match(type=["RAW_IMU", "ATTITUDE"])) is not None:
        if message.get_type() == "RAW_IMU":
            force = (GRAVITY_MPS2 * 1e-3 * value for value in (message.xacc, message.yacc, message.zacc))
            samples.append((message.time_usec * 1e-6, *force, message.xmag, message.ymag, message.zmag))
        else:
            m = message
            angles.append((m.time_boot_ms * 1e-3, m.rollspeed, m.pitchspeed, m.yawspeed, m.roll, m.pitch, m.yaw))
    return samples, angles


@pytest.mark.parametrize("log", LOGS)
@pytest.mark.parametrize("make", [Madgwick, Mahony, EkfAttitude])
def test_agrees_with_the_autopilot_on_the_same_samples(make: type[AttitudeFilter], log: str) -> None:
    samples, angles = messages(log)
    first = np.array(samples[:5])
    start = initial_attitude(first[:, 1:4], first[:, 4:7])
    assert start is not None
    attitude = make()
    attitude.initialise(start.quaternion_ned_frd)
    waiting = list(samples)
    differences, last_s = [], angles[0][0]
    for at_s, p, q, r, *theirs in angles[1:]:
        force: tuple[float, ...] = NOTHING
        field: tuple[float, ...] | None = None
        while waiting and waiting[0][0] <= at_s:
            _, *values = waiting.pop(0)
            force, field = tuple(values[:3]), tuple(values[3:])
        attitude.update((p, q, r), force, field, at_s - last_s)
        last_s = at_s
        ours = to_euler(attitude.quaternion_ned_frd)
        differences.append([math.remainder(a - b, 2.0 * math.pi) for a, b in zip(ours, theirs, strict=True)])
    found = np.degrees(np.array(differences))
    assert len(found) > 5000
    # The autopilot's level is trimmed by the user and its yaw is true: both are constants. The rest is the filters'.
    mean, spread = found.mean(axis=0), found.std(axis=0)
    assert (np.abs(mean[:2]) < 2.5).all()
    assert (spread[:2] < 0.8).all()
    assert spread[2] < 3.0


@pytest.mark.parametrize("log", LOGS)
def test_the_first_five_samples_give_the_autopilots_tilt(log: str) -> None:
    samples, angles = messages(log)
    first = np.array(samples[:5])
    start = initial_attitude(first[:, 1:4], first[:, 4:7])
    assert start is not None
    roll, pitch, _ = to_euler(start.quaternion_ned_frd)
    at_first = [row for row in angles if abs(row[0] - first[2, 0]) < 1.0]
    assert at_first
    theirs = np.mean([row[4:6] for row in at_first], axis=0)
    assert np.degrees([roll - theirs[0], pitch - theirs[1]]) == pytest.approx([0.0, 0.0], abs=3.0)
