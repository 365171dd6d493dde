"""NavStates for tests of what surrounds the navigator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bluerov_slam.records import NavMode, NavState

_STATE = NavState(
    measured_s=100.0, arrived_s=100.01, mode=NavMode.DEAD_RECKONING, origin_deg=(54.3219, 10.1356),
    position_ned_m=(20.0, -5.0, 3.0), velocity_ned_mps=(0.4, 0.1, 0.05),
    quaternion_ned_frd=(0.8, 0.0, 0.0, 0.6), angular_rate_frd_radps=(0.0, 0.0, 0.1),
    pose_covariance=np.diag([1.0, 0.25, 0.01, 1e-4, 1e-4, 1e-3]), velocity_covariance_m2ps2=np.eye(3) * 0.01,
    depth_m=3.0, depth_std_m=0.1, altitude_m=None, current_ne_mps=(0.1, 0.0), current_std_mps=(0.05, 0.05),
    last_fix_s=90.0, distance_m=50.0, reset_counter=2,
)  # fmt: skip


def nav_state(**changes: Any) -> NavState:
    """One state with these fields changed."""
    return replace(_STATE, **changes)
