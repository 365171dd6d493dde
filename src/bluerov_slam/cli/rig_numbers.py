"""Set points and poses on the command line: six numbers with commas, millimetres and degrees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import ConfigError
from bluerov_slam.geometry.platform_stack import PLATFORMS

if TYPE_CHECKING:
    from bluerov_slam.rig.stack import StackPose

Array = NDArray[np.float64]

FORM = "X,Y,Z,ROLL,PITCH,YAW"
AIMS = ("least_motion", "conditioning", "margin")
LARGEST_DEG = 180.0
METRES_MM, FURTHEST_MM = 20.0, 100_000.0
"""Less than the first is a place in metres: neither the tool nor a transmitter can be in the rig's foot."""
_AXES = ("x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg")


def six_numbers(text: str, what: str) -> Array:
    """(6,) in mm and rad of a text in mm and degrees. Raises ConfigError."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.full(0, np.nan)
    if values.shape != (6,) or not np.isfinite(values).all():
        raise ConfigError(f"{what} '{text}': six numbers with commas are expected, {FORM} in mm and degrees")
    if np.abs(values[3:]).max() > LARGEST_DEG:
        raise ConfigError(f"{what} '{text}': angles are in degrees, -{LARGEST_DEG:g} to {LARGEST_DEG:g}")
    values[3:] = np.radians(values[3:])
    return values


def stack_of(texts: Sequence[str], what: str) -> Array:
    """Set points (4, 6) of one text for all platforms alike or of four, base to top. Raises ConfigError."""
    points = np.array([six_numbers(text, what) for text in texts])
    if len(points) == 1:
        return np.repeat(points, PLATFORMS, axis=0)
    if len(points) != PLATFORMS:
        raise ConfigError(f"{what} was given {len(points)} times; once for all platforms alike, or {PLATFORMS} times")
    return points


def pose_of(text: str, what: str = "--tool") -> StackPose:
    """The tool's pose in the rig frame. Raises ConfigError."""
    from bluerov_slam.geometry.platform_stack import rotations
    from bluerov_slam.rig.stack import StackPose

    values = six_numbers(text, what)
    _check_place(values[:3], f"{what} '{text}'")
    return StackPose(values[:3], rotations(values[None, 3:])[0])


def transmitter_of(text: str) -> tuple[float, float, float]:
    """Place of a transmitter in the rig's frame, mm. Raises ConfigError."""
    place = _three(text, "--transmitter")
    _check_place(np.array(place), f"--transmitter '{text}'")
    return place


def attitude_of(text: str) -> Array:
    """Roll, pitch, yaw (3,) in rad of a text in degrees. Raises ConfigError."""
    values = np.array(_three(text, "--attitude"))
    if np.abs(values).max() > LARGEST_DEG:
        raise ConfigError(f"--attitude '{text}': angles are in degrees, -{LARGEST_DEG:g} to {LARGEST_DEG:g}")
    return np.asarray(np.radians(values))


def _three(text: str, what: str) -> tuple[float, float, float]:
    from bluerov_slam.cli.isbl_simulate import three_numbers

    try:
        return three_numbers(text)
    except ValueError as error:
        raise ConfigError(f"{what}: {error}") from error


def _check_place(place_mm: Array, what: str) -> None:
    largest = float(np.abs(place_mm).max())
    if largest < METRES_MM:
        raise ConfigError(f"{what}: this place lies in the rig's foot; x, y and z are in millimetres, not in metres")
    if largest > FURTHEST_MM:
        raise ConfigError(f"{what}: {largest:g} mm is too far, expected at most {FURTHEST_MM:g} mm from the foot")


def euler_deg(rotation: Array) -> Array:
    """Roll, pitch, yaw of Rz Ry Rx, degrees."""
    from bluerov_slam.navigation.rotation import euler_from_rotation

    return np.degrees(euler_from_rotation(rotation))


def pose_words(pose: StackPose) -> str:
    """A pose for a person."""
    x, y, z = pose.position_mm
    roll, pitch, yaw = euler_deg(pose.rotation)
    return f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm; roll {roll:.3f}, pitch {pitch:.3f}, yaw {yaw:.3f} deg"


def show_set_points(points: Array) -> None:
    """One line a platform, with its servos' angles."""
    from bluerov_slam.rig.dimensions import FO_SHIP
    from bluerov_slam.rig.platform import servo_angles_rad

    for number, (point, platform) in enumerate(zip(points, FO_SHIP.platforms, strict=True), start=1):
        angles = np.degrees(servo_angles_rad(point, platform))
        place = ", ".join(f"{value:.3f}" for value in point[:3])
        turn = ", ".join(f"{value:.3f}" for value in np.degrees(point[3:]))
        servos = ", ".join(f"{angle:.1f}" for angle in angles)
        click.echo(f"  platform {number}: {place} mm; {turn} deg; servos {servos} deg")


def write_set_points(path: Path, times_s: Array, points: Array) -> None:
    """CSV: time, then six values of each platform, mm and degrees. Raises ConfigError."""
    heads = [f"p{number}_{axis}" for number in range(1, points.shape[1] + 1) for axis in _AXES]
    table = np.array(points, dtype=np.float64)
    table[..., 3:] = np.degrees(table[..., 3:])
    write_csv(path, ["t_s", *heads], np.column_stack([times_s, table.reshape(len(table), -1)]))


def write_csv(path: Path, heads: Sequence[str], table: Array) -> None:
    """A table of numbers. Raises ConfigError."""
    try:
        np.savetxt(path, table, fmt="%.6g", delimiter=",", header=",".join(heads), comments="")
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror or error}; give --csv another place") from error
