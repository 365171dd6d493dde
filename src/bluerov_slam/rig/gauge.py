"""The go/no-go gauge: how far two servo horns that fit its channel may still be out of line.

Two servos of a pair face each other, their axes a spacing d apart and level; each horn has length l (axis to the last
hole) and width w, with a round end. The gauge, a channel of width g and length k, is held centred over the gap, and
covers the last c = k/2 - (d/2 - l cos(h)) of each horn. Horns that hang or rise alike by h (a V) need a channel of

    w/2  +  c tan(h)  +  w / (2 cos(h))  =  g

The published text (thesis section 2.6, equations 2.14 to 2.17) solves this for theta = 2 h, the angle BETWEEN the two
horns. With t = tan(h/2) it is a quartic, so that every root is known:

    g t^4 + (k - d - 2 l) t^3 + w t^2 + (k - d + 2 l) t + (w - g) = 0

Check: w 7.5, l 24.5, g 7.85, k 31.4, d 59 mm -> theta = 3.730 degrees, published as 3.7.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_REAL = 1e-9


@dataclass(frozen=True, slots=True)
class GaugePair:
    """A gauge over a pair of horns, millimetres. The defaults are the published worst case."""

    horn_width_mm: float = 7.5
    horn_length_mm: float = 24.5
    servo_spacing_mm: float = 59.0
    channel_width_mm: float = 7.85
    channel_length_mm: float = 31.4

    def covered_mm(self, angle_rad: float = 0.0) -> float:
        """How much of a horn that is out of level by `angle_rad` lies in the channel."""
        half_gap = 0.5 * self.servo_spacing_mm - self.horn_length_mm * math.cos(angle_rad)
        return 0.5 * self.channel_length_mm - half_gap


PUBLISHED_RANGES = {
    "horn_width_mm": (7.5, 7.8),
    "horn_length_mm": (24.5, 25.5),
    "servo_spacing_mm": (57.0, 59.0),
}
"""What the thesis measured on its horns and servos."""


@dataclass(frozen=True, slots=True)
class GaugeRoot:
    """A root of the published equation, and why it is or is not the answer."""

    between_horns_rad: float
    physical: bool
    reason: str


def largest_misalignment_rad(pair: GaugePair | None = None) -> float:
    """The largest angle between two horns that still fit (each is half of it out of level); NaN if none does."""
    physical = [root.between_horns_rad for root in misalignment_branches(pair) if root.physical]
    return physical[0] if physical else math.nan


def misalignment_branches(pair: GaugePair | None = None) -> tuple[GaugeRoot, ...]:
    """Every real root of the published equation within one turn of each horn, smallest size first."""
    pair = pair or GaugePair()
    reach = pair.channel_length_mm - pair.servo_spacing_mm
    arm, width, channel = 2.0 * pair.horn_length_mm, pair.horn_width_mm, pair.channel_width_mm
    roots = np.roots([channel, reach - arm, width, reach + arm, width - channel])
    angles = sorted((4.0 * math.atan(t.real) for t in roots if abs(t.imag) < _REAL), key=abs)
    return tuple(_judged(angle, pair) for angle in angles)


def _judged(between_rad: float, pair: GaugePair) -> GaugeRoot:
    half = 0.5 * between_rad
    if math.cos(half) < 0.0:
        return GaugeRoot(between_rad, False, "the horns point away from each other")
    if pair.covered_mm(half) <= 0.0:
        return GaugeRoot(between_rad, False, "the horns end outside the channel: the covered length is negative")
    if half < 0.0:
        return GaugeRoot(between_rad, False, "the width that an angle costs is counted negative")
    needed = pair.covered_mm(half) * math.tan(half)
    if needed > pair.channel_width_mm:
        return GaugeRoot(between_rad, False, "the horns do not lie in the channel")
    return GaugeRoot(between_rad, True, "the horns form a V whose ends touch both walls")


def worst_case(ranges: dict[str, tuple[float, float]] | None = None) -> tuple[float, GaugePair]:
    """The largest misalignment over all corners of the ranges, and the pair it belongs to."""
    names = list(ranges or PUBLISHED_RANGES)
    corners = itertools.product(*(ranges or PUBLISHED_RANGES).values())
    pairs = [GaugePair(**dict(zip(names, corner, strict=True))) for corner in corners]
    angles = [largest_misalignment_rad(pair) for pair in pairs]
    return max(zip(angles, pairs, strict=True), key=lambda found: found[0])


def servo_error_polygon(pair: GaugePair | None = None, slide_mm: float = 0.0) -> Floats:
    """Which errors (first, second) of two servos, rad and up positive, pass the gauge: corners (n, 2), in order round.

    The gauge is held by hand and may tilt and shift in height, so it does not see both horns turned one up, one down
    as well as its channel is wide. A set of points fits between two parallel walls, if every middle one of three lies
    within the clearance of the line through the outer two; so each three of the four places where a horn enters or ends
    give one inequality. Small angles: the V comes out 0.5 % larger than by the exact equation.

    Args:
        slide_mm: how far the gauge is held off the middle, towards the second servo.
    """
    pair = pair or GaugePair()
    normals = _pass_normals(pair, slide_mm)
    limit = pair.channel_width_mm - pair.horn_width_mm
    if limit < 0.0:
        return np.empty((0, 2))
    corners = []
    for first, second in itertools.combinations(np.concatenate((normals, -normals)), 2):
        sides = np.array([first, second])
        if abs(np.linalg.det(sides)) > _REAL:
            corner = np.linalg.solve(sides, [limit, limit])
            if np.all(np.abs(normals @ corner) <= limit * (1.0 + _REAL)):
                corners.append(corner)
    found = np.unique(np.round(corners, 12), axis=0)
    return np.asarray(found[np.argsort(np.arctan2(found[:, 1], found[:, 0]))], dtype=float)


def _pass_normals(pair: GaugePair, slide_mm: float) -> Floats:
    """(4, 2): the deviation from a straight line of each three of the four places, per radian of each servo."""
    enters, ends = 0.5 * pair.channel_length_mm, 0.5 * pair.servo_spacing_mm - pair.horn_length_mm
    along = np.array([slide_mm - enters, -ends, ends, slide_mm + enters])
    heights = np.zeros((4, 2))
    heights[:2, 0] = 0.5 * pair.servo_spacing_mm + along[:2]
    heights[2:, 1] = 0.5 * pair.servo_spacing_mm - along[2:]
    rows = []
    for left, middle, right in itertools.combinations(range(4), 3):
        share = (along[middle] - along[left]) / (along[right] - along[left])
        rows.append((1.0 - share) * heights[left] + share * heights[right] - heights[middle])
    return np.array(rows)


@dataclass(frozen=True, slots=True)
class ServoErrors:
    """What passing the gauge says of the two servos, rad.

    Attributes:
        one_servo_rad: the largest error of one servo.
        alike_rad: of each, both up or both down (the published V).
        opposite_rad: of each, one up and the other down.
        covariance_rad2: (2, 2) if every pair that passes is as likely as any other.
    """

    one_servo_rad: float
    alike_rad: float
    opposite_rad: float
    covariance_rad2: Floats


def servo_errors(pair: GaugePair | None = None, slide_mm: float = 0.0) -> ServoErrors:
    """How far servos may be wrong after the gauge has passed them."""
    pair = pair or GaugePair()
    corners = servo_error_polygon(pair, slide_mm)
    normals = _pass_normals(pair, slide_mm)
    limit = pair.channel_width_mm - pair.horn_width_mm
    alike, opposite = (limit / float(np.max(np.abs(normals @ way))) for way in ([1.0, 1.0], [1.0, -1.0]))
    return ServoErrors(float(np.max(np.abs(corners))), alike, opposite, _uniform_covariance(corners))


def _uniform_covariance(corners: Floats) -> Floats:
    """Second moment about the origin of a polygon evenly filled, by its triangles to the origin."""
    following = np.roll(corners, -1, axis=0)
    areas = 0.5 * np.abs(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0])
    total = corners + following
    outer = corners[:, :, None] * corners[:, None] + following[:, :, None] * following[:, None]
    moments = (outer + total[:, :, None] * total[:, None]) / 12.0
    return np.asarray(np.einsum("n,nij->ij", areas, moments) / np.sum(areas))
