"""The truth that a collection writes down: the rig's as drawn, mended by the attitude that the array itself measured.

Over a collection the same rig stands at many poses, so one `SessionTruth` follows it. Its set points are what the whole
counts make that the servos get: a count is 0.45 degrees, and all four platforms get the same ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bluerov_slam.geometry.platform_stack import PLATFORMS, rotations
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_SERVOS, Floats, ManufacturingSpread
from bluerov_slam.rig.forward import plate_pose
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.servos import angles_of, counts_of
from bluerov_slam.rig.session_truth import AttitudeErrors, SessionTruth
from bluerov_slam.rig.validation import logged_spread

STACKING_MM = 0.5
"""Of each part on the one beneath, each coordinate: printed plates, bolted. Without it the height, which hardly follows
the tilt, would pass for known to a millimetre."""

_SEAT_DEG, _NO_YAW_DEG = 0.2, 5.0
ATTITUDE = AttitudeErrors(
    noise_rad=tuple(np.radians([0.05, 0.05, 0.1]).tolist()),
    wander_rad=tuple(np.radians([0.1, 0.1, 0.45]).tolist()),
    seat_rad=tuple(np.radians([_SEAT_DEG, _SEAT_DEG, _NO_YAW_DEG]).tolist()),
    wander_readings=20.0,
)
"""Noise and wander as the stationary ones of the thesis's logs have them (0.04, 0.03, 0.09 degrees from one reading to
the next; 0.05, 0.07, 0.43 over a log, yaw still alike by 0.6 ten readings later). The board calls its yaw at the start
zero, so that its yaw tells of changes only; how well it sits is assumed."""
LEVEL_STD_RAD = float(np.radians(0.23))
YAW_STD_RAD = float(np.radians(1.0))
"""Of a single reading, roll and pitch by gravity with the seat; yaw by a compass set to zero by one reading."""


def truth_spread() -> ManufacturingSpread:
    """Of the thesis's rig: gauge (facing servos pass it together, hence correlated), stated dimensions, gains, lean and
    play as the logs show, and the stacking."""
    return replace(logged_spread(), stacking_mm=STACKING_MM)


class CollectionTruth:
    """Called with each point's set point and measured attitude, in the order of the points.

    All numbers in: set point (6,) of four platforms, the array's roll, pitch and yaw (3,) measured. Out: array's centre
    (3,) mm and covariance (3, 3) mm2; NaN where the set point cannot be reached.
    """

    def __init__(self, spread: ManufacturingSpread | None = None, attitude: AttitudeErrors = ATTITUDE) -> None:
        self._session = SessionTruth(FO_SHIP, truth_spread() if spread is None else spread, attitude)

    def __call__(self, set_point: Floats, attitude_rad: Floats) -> tuple[Floats, Floats]:
        """Truth at the next point."""
        turn = rotations(np.asarray(attitude_rad)[None])[0]
        found = self._session.take(counted_set_points(np.tile(set_point, (PLATFORMS, 1))), turn)
        return found.position_mm, found.covariance[:3, :3]

    def since_first(self) -> tuple[Floats, Floats]:
        """How far (3,) mm the array is from where it was at the first point, with its covariance (3, 3) mm2."""
        return self._session.since_first()

    def restart(self) -> None:
        """A new session: the board may have been started anew."""
        self._session.restart()


def counted_set_points(set_points: Floats) -> Floats:
    """What a rig as drawn makes of set points (platforms, 6) in whole counts; NaN where a servo cannot go."""
    made: list[Floats] = []
    for i, platform in enumerate(FO_SHIP.platforms):
        if i and np.array_equal(set_points[i], set_points[0]):
            made.append(made[0])  # offsets are whole counts, so equal set points are rounded alike
            continue
        told = np.broadcast_to(servo_angles_rad(set_points[i], platform), (PLATFORMS, 6))
        angles = angles_of(counts_of(told, FO_SHIP_SERVOS), FO_SHIP_SERVOS)[i]
        made.append(plate_pose(angles, platform, set_points[i]).set_point)
    return np.array(made)
