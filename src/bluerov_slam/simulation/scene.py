"""What the virtual instruments look at: a simulated survey, or a recorded one played back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.simulation.scenario import Scenario
from bluerov_slam.simulation.sonar import PORT, STARBOARD, SideScan
from bluerov_slam.simulation.vehicle import SurveyVehicle, VehicleState
from bluerov_slam.simulation.world import build_world

_METRES_PER_DEGREE = 6_371_000.0 * math.pi / 180.0


class Scene(Protocol):
    """A vehicle and what its side-scan sonars hear, at any mission time."""

    origin_latitude_deg: float
    origin_longitude_deg: float

    def state(self, mission_s: float) -> VehicleState:
        """Where the vehicle is."""

    def ping(
        self, side: int, mission_s: float, samples: int, resolution_m: float, first_sample: int
    ) -> NDArray[np.uint8]:
        """The echogram of one side (sonar.STARBOARD or sonar.PORT)."""


class SimulatedScene:
    """The seeded world, surveyed by the simulated vehicle."""

    def __init__(self, scenario: Scenario) -> None:
        self.origin_latitude_deg = scenario.origin_latitude_deg
        self.origin_longitude_deg = scenario.origin_longitude_deg
        world = build_world(scenario.seed, scenario.water_depth_m)
        self._vehicle = SurveyVehicle(scenario.survey_depth_m)
        self._sides = {side: SideScan(world, side, scenario.seed) for side in (STARBOARD, PORT)}

    def state(self, mission_s: float) -> VehicleState:
        return self._vehicle.state(mission_s)

    def ping(
        self, side: int, mission_s: float, samples: int, resolution_m: float, first_sample: int
    ) -> NDArray[np.uint8]:
        return self._sides[side].ping(self._vehicle.state(mission_s), samples, resolution_m, first_sample)


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


class RecordedScene:
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


def geodetic(scene: Scene, state: VehicleState) -> tuple[float, float]:
    """Latitude and longitude in degrees of a state, on a sphere: good to centimetres over a survey."""
    latitude_deg = scene.origin_latitude_deg + state.north_m / _METRES_PER_DEGREE
    shrink = math.cos(math.radians(scene.origin_latitude_deg))
    return latitude_deg, scene.origin_longitude_deg + state.east_m / (_METRES_PER_DEGREE * shrink)


def metres_from(
    origin_deg: tuple[float, float], latitude_deg: NDArray[np.float64], longitude_deg: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """North and east of an origin, the inverse of `geodetic`."""
    shrink = math.cos(math.radians(origin_deg[0]))
    north_m = (latitude_deg - origin_deg[0]) * _METRES_PER_DEGREE
    return north_m, (longitude_deg - origin_deg[1]) * _METRES_PER_DEGREE * shrink
