"""Forward kinematics of a stack of equal hexapod platforms: the positioner that is the thesis's truth (Fo-SHIP).

All four platforms are set alike. Each moves its top plate by T in the frame of the plate beneath and turns it by R; the
next stands on it. With M the orientation reached so far, x0 the foot of the first and d the height of a base:

    p = x0, M = I;  four times  p += M (d + T), M = R M;  p += M tip

R is a quarter of the stack's attitude (Euler angles yaw, pitch, roll in this order, each divided by four). Exact for
one axis; for several it is what the positioner computes, and so what its logs mean. M = R M is the order of its code; a
real stack turns about axes that turned before (M = M R), the same for equal platforms.

Frame: x forward, y right, z down, origin at the base; millimetres, as its drawings. Source: thesis chapter 2. Check: at
home the tip, the centre of the array, is at (110, 0, -648.38).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PLATFORMS = 4
FOOT_MM = np.array([0.0, 0.0, -30.0])
BASE_MM = np.array([0.0, 0.0, -34.0])
HOME_MM = np.array([0.0, 0.0, -100.0])
TIP_MM = np.array([110.0, 0.0, -82.38])


def stack_tip_mm(translation_mm: Floats, attitude_rad: Floats, tip_mm: Floats = TIP_MM) -> Floats:
    """Where the tip is, (n, 3).

    Args:
        translation_mm: of the whole stack from home, (n, 3); every platform does a quarter of it.
        attitude_rad: of the uppermost plate, roll, pitch, yaw (n, 3).
        tip_mm: in the frame of the uppermost plate.
    """
    turn = rotations(attitude_rad / PLATFORMS)
    lift = BASE_MM + HOME_MM + translation_mm / PLATFORMS
    position = np.broadcast_to(FOOT_MM, translation_mm.shape).copy()
    reached = np.broadcast_to(np.eye(3), turn.shape)
    for _ in range(PLATFORMS):
        position += np.einsum("nij,nj->ni", reached, lift)
        reached = turn @ reached
    return np.asarray(position + reached @ tip_mm)


def cross(first: Floats, second: Floats) -> Floats:
    """Cross products along the last axis, for few vectors much faster than NumPy's."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def rotations(attitude_rad: Floats) -> Floats:
    """Rz(yaw) Ry(pitch) Rx(roll) of roll, pitch, yaw (..., 3): (..., 3, 3)."""
    angles = np.moveaxis(attitude_rad, -1, 0)
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    found = np.empty((*sr.shape, 3, 3))
    found[..., 0, 0], found[..., 0, 1], found[..., 0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    found[..., 1, 0], found[..., 1, 1], found[..., 1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    found[..., 2, 0], found[..., 2, 1], found[..., 2, 2] = -sp, cp * sr, cp * cr
    return found
