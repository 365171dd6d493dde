"""Our acoustic chain on the thesis's receiver: what the same pulses, depth and sensors give with better estimation.

Before a session the array listens at home, for one calibration in place: the receivers' responses (without any truth),
and what each delay is off from what rig and survey let expect there. In that are the receivers' places, which half a
millimetre moves by a microsecond and a half, and the yaw that the array has at home; it is as good as the survey and
the rig's truth at home. Then, pulse by pulse: delays of all pairs jointly, the sampling skew taken into account, a yaw
by gyro held by the compass, roll and pitch as the board has them, and the position at the given x by weighted least
squares. A pulse that gives no trustworthy position is missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses, estimate_responses
from bluerov_slam.acoustics.calibration.start_yaw import YawHold, average_yaw
from bluerov_slam.acoustics.position import solve_source
from bluerov_slam.acoustics.time_differences.estimate import estimate_delays
from bluerov_slam.geometry.platform_stack import rotations

if TYPE_CHECKING:
    from bluerov_slam.simulation.rig_receiver import Heard

Array = NDArray[np.float64]

SOUND_SPEED_MPS = 343.0
DEPTH_STD_M = 0.007
"""The x that is told is the rig's, whose mean error is stated as 7 mm."""
LEAST_PULSES = 8
HOME_YAW_STD_RAD = math.radians(0.05)
FURTHEST_MM, BELIEVED = 300.0, 3
"""A fix so far from the last one is withheld, unless as many in a row say so: the rig's whole reach is less."""
TURNED_STD_S = 0.5e-6
"""What is left of a receiver's error of place once the array has turned from where it was calibrated."""
_MM = 1e3


class OurChain:
    """One session's; `home` are the pulses heard at rest, `home_mm` where the rig says that the array was."""

    def __init__(self, array: ReceiverArray, transmitter_mm: Array, home: Sequence[Heard], home_mm: Array) -> None:
        self._array = array
        self._transmitter_mm = transmitter_mm
        self._responses: ReceiverResponses | None = None
        if len(home) >= LEAST_PULSES:
            records = np.array([heard.samples for heard in home])
            self._responses = estimate_responses(records, home[0].sample_rate_hz, array, SOUND_SPEED_MPS).responses
        self._last_mm, self._far = home_mm, 0
        self._off_s = self._delay_errors_s(home, home_mm)
        self._compass_zero_rad = _compass_zero_rad(home)
        self._hold = YawHold(0.0)
        for heard in home:
            self._hold.rest(heard.gyro_turn_rad, heard.interval_s)
            self._compass(heard)
        # At home the array's yaw is known: what the compass says there beyond its mean is its wobble.
        self._hold.reference(0.0, HOME_YAW_STD_RAD)

    def fix_mm(self, heard: Heard) -> Array:
        """The array's centre in the rig frame, (3,); NaN where this pulse gives none."""
        self._hold.turn(heard.gyro_turn_rad, heard.interval_s)
        self._compass(heard)
        attitude = np.array((*heard.attitude_rad[:2], self._hold.yaw_rad))
        source = self._source_m(heard, attitude)
        place: Array = self._transmitter_mm - _MM * source
        if not np.isfinite(place).all():
            return place
        far = float(np.linalg.norm(place - self._last_mm)) > FURTHEST_MM
        self._far = self._far + 1 if far else 0
        if far and self._far < BELIEVED:
            return np.full(3, np.nan)
        self._last_mm = place
        return place

    def _compass(self, heard: Heard) -> None:
        self._hold.compass(float(heard.attitude_rad[2]) - self._compass_zero_rad)

    def _delay_errors_s(self, home: Sequence[Heard], home_mm: Array) -> Array:
        """By how much each receiver but the first is heard later at home than rig and survey say, (n - 1,)."""
        errors = []
        for heard in home:
            turn = rotations(np.array([[*heard.attitude_rad[:2], 0.0]]))[0]
            expected = self._array.delays_s(turn.T @ (self._transmitter_mm - home_mm) / _MM, SOUND_SPEED_MPS)
            delays = self._delays(heard)[0]
            if delays is not None:
                errors.append(delays - expected)
        if not errors:
            return np.zeros(len(self._array) - 1)
        middle: Array = np.median(errors, axis=0)
        return middle

    def _delays(self, heard: Heard) -> tuple[Array | None, Array]:
        """Delays of all receivers to the first and their covariance; None where not all can be used."""
        found = estimate_delays(
            heard.samples,
            heard.sample_rate_hz,
            self._array,
            SOUND_SPEED_MPS,
            responses=self._responses,
        )
        if len(found.receivers) < len(self._array):
            return None, found.covariance_s2
        return found.delays_s, found.covariance_s2

    def _source_m(self, heard: Heard, attitude_rad: Array) -> Array:
        """The transmitter from the array's centre in the rig's axes, (3,) m; NaN where there is no answer."""
        turn = rotations(attitude_rad[None])[0]
        delays, covariance = self._delays(heard)
        if delays is None:
            return np.full(3, np.nan)
        solution = solve_source(
            self._array.positions_m,
            delays - self._off_s,
            covariance + TURNED_STD_S**2 * (np.eye(len(delays)) + 1.0),
            SOUND_SPEED_MPS,
            depth=((self._transmitter_mm[0] - heard.x_mm) / _MM, DEPTH_STD_M),
            down=turn.T @ np.array((1.0, 0.0, 0.0)),
        )
        if solution.position_m is None:
            return np.full(3, np.nan)
        source: Array = turn @ solution.position_m
        return source


def _compass_zero_rad(home: Sequence[Heard]) -> float:
    """What the compass says on average at home; 0 where it was not heard for long enough to average."""
    found = average_yaw([heard.at_s for heard in home], [heard.attitude_rad[2] for heard in home])
    return found.yaw_rad if math.isfinite(found.yaw_rad) else 0.0
