"""Where a vehicle was at any instant of a recording, by a smoother that has run before.

A second pass takes every acoustic pulse as it is seen from there (an iterated smoother: measurements are linearised
about the smoothed track, not about what was known at the time). Source: Bell, The iterated Kalman smoother as a
Gauss-Newton method, SIAM J. Optimization 4 (1994).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.acoustics.navigation_aid import Pose
from bluerov_slam.navigation.rotation import exp_so3, log_so3, rotation_from_quaternion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bluerov_slam.records import NavState

# States further apart have a gap between them, in which nothing is known better.
LONGEST_GAP_S = 2.0


class SmoothedPoses:
    """Between two states the position is even in time and the turn is one about a fixed axis."""

    def __init__(self, states: Sequence[NavState]) -> None:
        known = [state for state in states if state.position_ned_m is not None and state.quaternion_ned_frd is not None]
        self._at_s = np.array([state.measured_s for state in known])
        self._states = known

    def __call__(self, at_s: float) -> Pose | None:
        """None before the first state, after the last, and in a gap."""
        after = int(np.searchsorted(self._at_s, at_s))
        if after < len(self._at_s) and self._at_s[after] == at_s:
            return self._pose(after)
        if not 0 < after < len(self._at_s):
            return None
        before_s, after_s = self._at_s[after - 1 : after + 1].tolist()
        if after_s - before_s > LONGEST_GAP_S:
            return None
        share = (at_s - before_s) / (after_s - before_s)
        first, second = self._pose(after - 1), self._pose(after)
        turn = log_so3(second.rotation_ned_frd @ first.rotation_ned_frd.T)
        return Pose(
            first.position_ned_m + share * (second.position_ned_m - first.position_ned_m),
            exp_so3(share * turn) @ first.rotation_ned_frd,
        )

    def _pose(self, index: int) -> Pose:
        state = self._states[index]
        assert state.position_ned_m is not None
        assert state.quaternion_ned_frd is not None
        return Pose(np.array(state.position_ned_m), rotation_from_quaternion(state.quaternion_ned_frd))
