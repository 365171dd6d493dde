"""What the virtual instruments look at: a simulated dive, or a recorded survey played back."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation import flight as columns
from bluerov_slam.simulation.conditions import conditions_of
from bluerov_slam.simulation.flight import Flight
from bluerov_slam.simulation.hull import ANTENNA_FRD_M
from bluerov_slam.simulation.place import metres_per_degree
from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.sonar import PORT, STARBOARD, SideScan
from bluerov_slam.simulation.survey_route import SurveyRoute
from bluerov_slam.simulation.thrusters import FRAMES
from bluerov_slam.simulation.truth import Motion, TruthRows
from bluerov_slam.simulation.vehicle import VehicleState
from bluerov_slam.simulation.world import World, build_world

_REMEMBERED_S = 120.0
_RUN_UP_S = 30.0
_DRY_M = 0.03
_DIFFERENCE_S = 0.1

FloatArray = NDArray[np.float64]


class Scene(Protocol):
    """A vehicle and what its side-scan sonars hear, at any mission time."""

    origin_latitude_deg: float
    origin_longitude_deg: float

    def state(self, mission_s: float) -> VehicleState:
        """Where the vehicle is."""

    def motion(self, times_s: FloatArray) -> Motion:
        """How it moves, at many mission times."""

    def water_above_m(self, mission_s: float) -> float:
        """Height of the water column that a pressure sensor feels."""

    def ping(
        self, side: int, mission_s: float, samples: int, resolution_m: float, first_sample: int
    ) -> NDArray[np.uint8]:
        """The echogram of one side (sonar.STARBOARD or sonar.PORT)."""


class FlownScene:
    """Rows of truth, above a seabed that is built when the first ping needs it."""

    def __init__(
        self, truth: TruthRows, origin_deg: tuple[float, float], seabed: Callable[[], World], seed: int
    ) -> None:
        self.truth = truth
        self.origin_latitude_deg, self.origin_longitude_deg = origin_deg
        self._seabed = seabed
        self._seed = seed
        self._sides: dict[int, SideScan] = {}

    def state(self, mission_s: float) -> VehicleState:
        position = self.truth.linear(mission_s, columns.POSITION).tolist()
        w, x, y, z = self.truth.linear(mission_s, columns.QUATERNION).tolist()
        velocity = self.truth.linear(mission_s, columns.VELOCITY).tolist()
        surface_m = float(self.truth.linear(mission_s, columns.SURFACE))
        norm = w * w + x * x + y * y + z * z
        down = (2.0 * (x * z - w * y) / norm, 2.0 * (y * z + w * x) / norm, 1.0 - 2.0 * (x * x + y * y) / norm)
        antenna_m = position[2] + sum(part * arm for part, arm in zip(down, ANTENNA_FRD_M, strict=True))
        return VehicleState(
            north_m=position[0],
            east_m=position[1],
            depth_m=position[2],
            roll_rad=math.atan2(down[1], down[2]),
            pitch_rad=-math.asin(min(1.0, max(-1.0, down[0]))),
            yaw_rad=math.atan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z),
            speed_mps=math.hypot(velocity[0], velocity[1]),
            fix_possible=antenna_m + surface_m < -_DRY_M,
            course_rad=math.atan2(velocity[1], velocity[0]),
        )

    def motion(self, times_s: FloatArray) -> Motion:
        return self.truth.motion(times_s)

    def water_above_m(self, mission_s: float) -> float:
        before, after, share = self.truth.place(mission_s)
        depth_m, surface_m = 2, columns.SURFACE
        column_0, column_1 = before[depth_m] + before[surface_m], after[depth_m] + after[surface_m]
        return float(column_0 * (1.0 - share) + column_1 * share)

    def ping(
        self, side: int, mission_s: float, samples: int, resolution_m: float, first_sample: int
    ) -> NDArray[np.uint8]:
        self.build_seabed()
        return self._sides[side].ping(self.state(mission_s), samples, resolution_m, first_sample)

    def build_seabed(self) -> None:
        """Half a second of work, for whoever cannot spare it at the first ping."""
        if not self._sides:
            world = self._seabed()
            self._sides = {each: SideScan(world, each, self._seed) for each in (STARBOARD, PORT)}


class SimulatedScene(FlownScene):
    """The seeded world, surveyed by a vehicle that is flown as the mission goes on; what is long past is forgotten."""

    def __init__(self, scenario: Scenario) -> None:
        # Under way when the mission starts, not at rest in mid-water.
        start_s = max(0.0, scenario.mission_start_s - _RUN_UP_S)
        self.flight = Flight(
            SurveyRoute(scenario.survey_depth_m),
            conditions_of(scenario.conditions, scenario.noise_family),
            scenario.seed,
            start_s,
            FRAMES[scenario.thrusters],
        )
        flight = self.flight
        truth = TruthRows(flight.fly(2), start_s, flight.step_s, flight.fly, _REMEMBERED_S)
        origin_deg = (scenario.origin_latitude_deg, scenario.origin_longitude_deg)
        super().__init__(truth, origin_deg, lambda: build_world(scenario.seed, scenario.water_depth_m), scenario.seed)
        self.build_seabed()


class DifferencedMotion(ABC):
    """Motion of a scene that knows states only: by differences over a tenth of a second."""

    @abstractmethod
    def state(self, mission_s: float) -> VehicleState:
        """Where the vehicle is."""

    def motion(self, times_s: FloatArray) -> Motion:
        """As a `Scene`."""
        steps = (-_DIFFERENCE_S, 0.0, _DIFFERENCE_S)
        states = [[self.state(time_s + step) for time_s in times_s.tolist()] for step in steps]
        before, now, after = (np.array([(s.north_m, s.east_m, s.depth_m) for s in row]) for row in states)
        turned_before, turned_now, turned_after = (np.array([rotation_ned_frd(s) for s in row]) for row in states)
        turn = np.einsum("nji,njk->nik", turned_before, turned_after)
        rate = np.column_stack(
            (turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1])
        )
        return Motion(
            times_s,
            now,
            (after - before) / (2.0 * _DIFFERENCE_S),
            (after - 2.0 * now + before) / _DIFFERENCE_S**2,
            turned_now,
            rate / (4.0 * _DIFFERENCE_S),
            np.zeros(len(times_s)),
            np.zeros(len(times_s)),
        )

    def water_above_m(self, mission_s: float) -> float:
        """As a `Scene`."""
        return self.state(mission_s).depth_m


@dataclass(frozen=True, slots=True)
class RecordedSurvey:
    """A real side-scan recording, ready to be played: one row per ping.

    `time_s` counts from the first ping. Port and starboard hold amplitudes near to far, already 8 bits. North and
    east are metres from the origin; angles are radians; depth is that of the vehicle.
    """

    name: str
    origin_latitude_deg: float
    origin_longitude_deg: float
    time_s: NDArray[np.float64]
    north_m: NDArray[np.float64]
    east_m: NDArray[np.float64]
    depth_m: NDArray[np.float64]
    roll_rad: NDArray[np.float64]
    pitch_rad: NDArray[np.float64]
    yaw_rad: NDArray[np.float64]
    slant_range_m: float
    port: NDArray[np.uint8]
    starboard: NDArray[np.uint8]

    @property
    def period_s(self) -> float:
        """Mean time from ping to ping."""
        return float(self.time_s[-1]) / max(1, len(self.time_s) - 1)

    @property
    def duration_s(self) -> float:
        """Length of one pass through the recording."""
        return float(self.time_s[-1]) + self.period_s


class RecordedScene(DifferencedMotion):
    """A recording played in a loop; the antenna is taken to have the position that the recording states."""

    def __init__(self, survey: RecordedSurvey) -> None:
        self.origin_latitude_deg = survey.origin_latitude_deg
        self.origin_longitude_deg = survey.origin_longitude_deg
        self.survey = survey
        self._yaw_rad = np.unwrap(survey.yaw_rad)

    def state(self, mission_s: float) -> VehicleState:
        survey = self.survey
        time_s = mission_s % survey.duration_s
        later_s = min(time_s + 1.0, survey.duration_s - survey.period_s)
        north_m, east_m = self._at(survey.north_m, time_s), self._at(survey.east_m, time_s)
        moved_m = math.hypot(self._at(survey.north_m, later_s) - north_m, self._at(survey.east_m, later_s) - east_m)
        return VehicleState(
            north_m=north_m,
            east_m=east_m,
            depth_m=self._at(survey.depth_m, time_s),
            roll_rad=self._at(survey.roll_rad, time_s),
            pitch_rad=self._at(survey.pitch_rad, time_s),
            yaw_rad=math.remainder(self._at(self._yaw_rad, time_s), 2.0 * math.pi),
            speed_mps=moved_m,
            fix_possible=True,
        )

    def ping(
        self, side: int, mission_s: float, samples: int, resolution_m: float, first_sample: int
    ) -> NDArray[np.uint8]:
        survey = self.survey
        row = int(np.searchsorted(survey.time_s, mission_s % survey.duration_s, "right")) - 1
        recorded = (survey.starboard if side == STARBOARD else survey.port)[row]
        step_m = survey.slant_range_m / len(recorded)
        index = ((first_sample + np.arange(samples) + 0.5) * resolution_m / step_m).astype(np.intp)
        heard = np.zeros(samples, np.uint8)
        inside = index < len(recorded)
        heard[inside] = recorded[index[inside]]
        return heard

    def _at(self, values: NDArray[np.float64], time_s: float) -> float:
        return float(np.interp(time_s, self.survey.time_s, values))


def rotation_ned_frd(state: VehicleState) -> FloatArray:
    """Body to world, from yaw, pitch, roll in that order."""
    cr, sr = math.cos(state.roll_rad), math.sin(state.roll_rad)
    cp, sp = math.cos(state.pitch_rad), math.sin(state.pitch_rad)
    cy, sy = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


def geodetic(scene: Scene, state: VehicleState) -> tuple[float, float]:
    """Latitude and longitude in degrees of a state, on WGS 84: good to centimetres over a survey."""
    north, east = metres_per_degree(scene.origin_latitude_deg)
    return scene.origin_latitude_deg + state.north_m / north, scene.origin_longitude_deg + state.east_m / east


def metres_from(
    origin_deg: tuple[float, float], latitude_deg: FloatArray, longitude_deg: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """North and east of an origin, the inverse of `geodetic`."""
    north, east = metres_per_degree(origin_deg[0])
    return (latitude_deg - origin_deg[0]) * north, (longitude_deg - origin_deg[1]) * east
