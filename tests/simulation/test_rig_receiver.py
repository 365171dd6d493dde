"""The thesis's receiver on a simulated rig: fixes near the truth that it cannot see, and errors that are its own."""

from dataclasses import replace

import numpy as np

from bluerov_slam.geometry.platform_stack import rotations
from bluerov_slam.simulation.rig import Track
from bluerov_slam.simulation.rig_receiver import ReceiverFigures, SimulatedReceiver, euler_rad

PLACE = np.array((110.0, 0.0, -648.4))
TRANSMITTER = (2645.0, 0.0, -682.0)
QUIET = replace(
    ReceiverFigures(),
    resonance=0.0,
    filter_corner=0.0,
    gain=0.0,
    place_mm=0.0,
    noise_counts=(1.0, 1.0),
    floor_echo=(0.0, 0.0),
    transmitter_mm=0.0,
    wobble_deg=(0.0, 0.0),
    compass_noise_deg=0.0,
    level_noise_deg=0.0,
    level_wander_deg=0.0,
    gyro_noise_deg_per_rt_s=0.0,
    gyro_bias_deg_per_s=0.0,
    depth_noise_mm=0.0,
)


def listened(figures=QUIET, rotation=None, track=None, seed=5):
    receiver = SimulatedReceiver(seed, TRANSMITTER, figures)
    receiver.tell(PLACE[0] / 1e3)
    return receiver.listen(3.0, PLACE, np.eye(3) if rotation is None else rotation, track)


def test_without_errors_a_fix_is_good_to_the_thesiss_resolution():
    heard = listened()
    assert heard.raw_mm[0] == PLACE[0]
    # Whole samples of delay and the rank skew it does not know: 0.4 mm in 0.35 m of base, at 2.5 m.
    assert np.abs(heard.raw_mm - PLACE).max() < 6.0
    assert heard.samples.shape == (4, 2048)


def test_the_fix_is_turned_by_the_attitude():
    rotation = rotations(np.radians([[10.0, -5.0, 8.0]]))[0]
    heard = listened(rotation=rotation)
    np.testing.assert_allclose(heard.attitude_rad, np.radians((10.0, -5.0, 8.0)), atol=1e-9)
    assert np.abs(heard.raw_mm - PLACE).max() < 8.0


def test_the_filters_start_from_zero_as_the_thesiss_do():
    heard = listened()
    assert heard.acoustic_mm[2] > 0.95 * PLACE[2]
    receiver = SimulatedReceiver(5, TRANSMITTER, QUIET)
    receiver.tell(PLACE[0] / 1e3)
    fixes = [receiver.listen(3.0 * n, PLACE, np.eye(3)) for n in range(1, 30)]
    np.testing.assert_allclose(fixes[-1].acoustic_mm, fixes[-1].raw_mm, atol=3.0)


def test_errors_are_the_seeds_own_and_come_again():
    first, again, other = (listened(ReceiverFigures(), seed=seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.samples, again.samples)
    np.testing.assert_array_equal(first.raw_mm, again.raw_mm)
    assert np.abs(first.raw_mm - other.raw_mm).max() > 0.0


def test_a_transmitter_out_of_hearing_gives_no_result():
    receiver = SimulatedReceiver(5, (60_000.0, 0.0, -650.0), QUIET)
    receiver.tell(0.11)
    assert receiver.listen(3.0, PLACE, np.eye(3)) is None


def test_dead_reckoning_sees_a_hard_vertical_move_and_no_gentle_one():
    times = np.array((0.0, 0.1))
    hard = listened(track=Track(times, PLACE + np.array(((0, 0, 0), (0, 0, 8.0)))))
    gentle = listened(track=Track(np.array((0.0, 0.8)), PLACE + np.array(((0, 0, 0), (0, 0, 2.0)))))
    assert hard.displacement_mm[2] > 1.0
    np.testing.assert_array_equal(gentle.displacement_mm, 0.0)
    np.testing.assert_array_equal(listened().displacement_mm, 0.0)


def test_euler_angles_come_back_from_their_rotation():
    angles = np.radians((12.0, -30.0, 100.0))
    np.testing.assert_allclose(euler_rad(rotations(angles[None])[0]), angles)
