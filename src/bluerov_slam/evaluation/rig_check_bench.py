"""A simulated rig and receiver for the check of a rig: each attitude is the board's, of a pulse that it heard."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.rig.check import Missing
from bluerov_slam.rig.published_tests import PUBLISHED_TESTS
from bluerov_slam.simulation.rig import ServoFault, SimulatedRig
from bluerov_slam.simulation.rig_receiver import SimulatedReceiver, euler_rad

Array = NDArray[np.float64]

PULSES, MOVE_S = 4, 2.0
"""The board answers to every third or fifth pulse; a careful move takes some seconds."""
_STEPS, _STEP_S = 24, 0.05
_RUNS = 1001


class SimulatedBench:
    """One rig by its seed with the thesis's board on it; the same rig plays otherwise in another run."""

    def __init__(self, seed: int, run: int, faults: Sequence[ServoFault] = ()) -> None:
        self._rig = SimulatedRig(seed, faults=faults)
        self._at = np.zeros((4, 6))
        for _ in range(run):
            self._rig.move(self._at, self._at, 1, _STEP_S)  # each draws the servos' play anew
        place = PUBLISHED_TESTS[0].transmitter_mm
        yaw = float(euler_rad(self._rig.pose.rotation)[2])
        self._receiver = SimulatedReceiver(_RUNS * seed + run, place, None, yaw, set_seed=seed)
        self._now_s = 0.0

    def attitude_at(self, set_points: Array) -> Array:
        """What the board says there. Raises Missing."""
        if self._rig.move(self._at, set_points, _STEPS, _STEP_S) is None:
            raise Missing("a servo has no angle on the way")
        self._at = set_points
        self._now_s += MOVE_S + PULSES * self._receiver.period_s
        pose = self._rig.pose
        self._receiver.tell(float(pose.position_mm[0]) / 1e3)
        heard = self._receiver.listen(self._now_s, pose.position_mm, pose.rotation)
        if heard is None:
            raise Missing("the receiver heard no pulse")
        # Its line has two decimals.
        return np.asarray(np.radians(np.round(np.degrees(heard.attitude_rad), 2)))
