"""Ten real tracks of the AUV Snapir: a Doppler log at 1 Hz, and attitude and position of a navigation-grade system.

They become records as our vehicle would send them: attitude (with an error put in), the Doppler log's displacements
(with an error put in) and a few position fixes. Two constants of the installation are put right, both found by
comparing the log's velocity with the reference's velocity, never with its position: the log lies 1.9 m behind the
reference's point, and its stamps are early, by 1.5 s on eight tracks and by 0.5 s on two.

Data: Cohen and Klein (2025), doi:10.1016/j.engappai.2025.110221; columns in the folder's README.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.trajectory import path_length_m
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.rotation import log_so3, rotation_from_euler
from bluerov_slam.records import PositionFix, VehicleAttitude, VehicleMotionDelta

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from bluerov_slam.records import Record

TRACKS = range(1, 11)
FIXES_AT_S = (0.0, 200.0, 400.0)
# The reference's own position, which its velocity contradicts by 1 to 5 m over a track: stated with the fixes' noise.
REFERENCE_STD_M = 1.4
_LEVER_ARM_M = -1.9
_EARLY_S = {5: 0.5, 6: 0.5}
_USUALLY_EARLY_S = 1.5
_ATTITUDE_S = 0.2
_BOOTED_BEFORE_S = 60.0


@dataclass(frozen=True, slots=True)
class SnapirTrack:
    """One track: times from 0, truth about its first point. Angles of the reference are unwrapped."""

    number: int
    at_s: NDArray[np.float64]
    position_ned_m: NDArray[np.float64]
    velocity_ned_mps: NDArray[np.float64]
    roll_pitch_yaw_rad: NDArray[np.float64]
    dvl_frd_mps: NDArray[np.float64]
    origin_deg: tuple[float, float]

    @property
    def distance_m(self) -> float:
        """Length of the true path."""
        return path_length_m(self.position_ned_m[:, :2])

    def truth_ne_m(self, at_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """True position at other times, (n, 2)."""
        return np.column_stack([np.interp(at_s, self.at_s, self.position_ned_m[:, axis]) for axis in range(2)])


@dataclass(frozen=True, slots=True)
class InjectedErrors:
    """What is put in: the attitude's heading reads too much, the Doppler log reads too much."""

    heading_rad: float = math.radians(2.0)
    scale: float = 0.01


def snapir_track(number: int, dvl_csv: str, truth_csv: str) -> SnapirTrack:
    """Reads the two tables of one track. The Doppler log's velocity is referred to the reference's point and time."""
    dvl = _table(dvl_csv, 4)
    truth = _table(truth_csv, 10)
    latitude_deg, longitude_deg = np.degrees(truth[:, 2]), np.degrees(truth[:, 1])
    frame = LocalFrame(float(latitude_deg[0]), float(longitude_deg[0]))
    position = [
        frame.to_ned_m(lat, lon, height)
        for lat, lon, height in zip(latitude_deg.tolist(), longitude_deg.tolist(), truth[:, 3].tolist(), strict=True)
    ]
    at_s = truth[:, 0] - truth[0, 0]
    angles = np.unwrap(truth[:, 7:10], axis=0)
    stamped_s = dvl[:, 0] - truth[0, 0] + _EARLY_S.get(number, _USUALLY_EARLY_S)
    velocity = np.column_stack([np.interp(at_s, stamped_s, dvl[:, axis]) for axis in (1, 2, 3)])
    velocity[:, 1] -= _LEVER_ARM_M * np.gradient(angles[:, 2], at_s)
    return SnapirTrack(
        number, at_s, np.array(position), truth[:, 4:7], angles, velocity, (frame.latitude_deg, frame.longitude_deg)
    )


def as_measured(
    track: SnapirTrack, errors: InjectedErrors, fix_std_m: float, rng: np.random.Generator
) -> Iterator[Record]:
    """Records in order of arrival: attitude at 5 Hz, a displacement each second, three fixes."""
    fixes = [(at_s, rng.normal(0.0, fix_std_m, 2)) for at_s in FIXES_AT_S]
    fine_s = np.arange(0.0, track.at_s[-1] + 1e-9, _ATTITUDE_S)
    angles = np.column_stack([np.interp(fine_s, track.at_s, track.roll_pitch_yaw_rad[:, axis]) for axis in range(3)])
    angles[:, 2] += errors.heading_rad
    rates = np.gradient(angles, fine_s, axis=0)
    deltas = list(_displacements(track, errors))
    for at_s, (roll, pitch, yaw), rate in zip(fine_s.tolist(), angles.tolist(), rates.tolist(), strict=True):
        while deltas and deltas[0].arrived_s <= at_s + 1e-9:
            yield deltas.pop(0)
        yield VehicleAttitude(at_s, _boot_ms(at_s), roll, pitch, math.remainder(yaw, math.tau), tuple(rate))
        if (fixes and fixes[0][0] <= at_s + 0.5 * _ATTITUDE_S) or (fixes and at_s >= track.at_s[-1] - _ATTITUDE_S):
            _, noise = fixes.pop(0)
            yield _fix(track, at_s, noise, fix_std_m)


def plain_integration(track: SnapirTrack, errors: InjectedErrors) -> NDArray[np.float64]:
    """The path that displacements and attitude give by themselves, (n, 2)."""
    angles = track.roll_pitch_yaw_rad + np.array([0.0, 0.0, errors.heading_rad])
    velocity = np.array(
        [
            rotation_from_euler(*angle) @ each
            for angle, each in zip(angles.tolist(), (1.0 + errors.scale) * track.dvl_frd_mps, strict=True)
        ]
    )
    steps = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(track.at_s)[:, None]
    return np.vstack((np.zeros((1, 2)), np.cumsum(steps, axis=0)[:, :2]))


def _displacements(track: SnapirTrack, errors: InjectedErrors) -> Iterator[VehicleMotionDelta]:
    """Each second's displacement in the axes of its middle, as a driver that knows the turn would give it."""
    rotations = [rotation_from_euler(*angle) for angle in track.roll_pitch_yaw_rad.tolist()]
    for number in range(1, len(track.at_s)):
        start_s, end_s = float(track.at_s[number - 1]), float(track.at_s[number])
        mean = 0.5 * (track.dvl_frd_mps[number - 1] + track.dvl_frd_mps[number]) * (1.0 + errors.scale)
        turn = log_so3(rotations[number - 1].T @ rotations[number])
        x, y, z = (mean * (end_s - start_s)).tolist()
        yield VehicleMotionDelta(
            end_s, int(_boot_ms(end_s) * 1000), end_s - start_s, tuple(turn.tolist()), (x, y, z), 100.0
        )


def _fix(track: SnapirTrack, at_s: float, noise_m: NDArray[np.float64], std_m: float) -> PositionFix:
    north, east = (track.truth_ne_m(np.array([at_s]))[0] + noise_m).tolist()
    latitude_deg, longitude_deg, _ = LocalFrame(*track.origin_deg).to_geodetic(north, east)
    variance = std_m**2 + REFERENCE_STD_M**2
    return PositionFix(at_s, at_s, "reference", latitude_deg, longitude_deg, (variance, 0.0, variance))


def _boot_ms(at_s: float) -> int:
    return round((at_s + _BOOTED_BEFORE_S) * 1000.0)


def _table(text: str, columns: int) -> NDArray[np.float64]:
    rows = [[float(cell) for cell in line.split(",")] for line in text.splitlines()[1:] if line.strip()]
    table = np.array(rows, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != columns or not np.all(np.isfinite(table)):
        raise ValueError(f"a table of {columns} columns of numbers was expected")
    return table
