"""What the navigator must beat: dead reckoning with a compass and no filter, and the same pulled onto GPS fixes.

B0 goes at a constant speed where the compass points, B1 as fast as the thruster model says, both without a current. The
compass is the sensor's own heading with the declination put on. The rubber band is B1, corrected at every fix, with the
correction spread linearly over the time between fixes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.evaluation.trajectory import dead_reckoned, rubber_band
from bluerov_slam.navigation.attitude.declination import decimal_year, magnetic_field
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.vehicle_model import MovingVehicle, ThrustModel
from bluerov_slam.records import GpsFix, SensorSample, VehicleBattery, VehicleServoOutput

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from bluerov_slam.records import Record

CONSTANT_MPS = 0.5


@dataclass(frozen=True, slots=True)
class Baselines:
    """Paths about the given origin at the times of the sensor's headings, from the first fix on: (n,), (n, 2)."""

    at_s: NDArray[np.float64]
    constant_ne_m: NDArray[np.float64]
    thruster_ne_m: NDArray[np.float64]
    rubber_band_ne_m: NDArray[np.float64]

    def at(self, path_ne_m: NDArray[np.float64], at_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """One of the paths at other times."""
        return np.column_stack([np.interp(at_s, self.at_s, path_ne_m[:, axis]) for axis in range(2)])


def baselines(records: Iterable[Record], origin_deg: tuple[float, float]) -> Baselines:
    """All three over the same records."""
    frame = LocalFrame(*origin_deg)
    model = MovingVehicle(ThrustModel())
    headings: list[tuple[float, float]] = []
    velocities: list[tuple[float, float, float]] = []
    fixes: list[tuple[float, float, float]] = []
    voltage_v: float | None = None
    commanded: VehicleServoOutput | None = None
    declination_rad = 0.0
    for record in records:
        if isinstance(record, SensorSample) and record.yaw_rad is not None:
            headings.append((record.measured_s, record.yaw_rad))
        elif isinstance(record, VehicleBattery):
            voltage_v = record.voltage_v
        elif isinstance(record, VehicleServoOutput):
            if commanded is not None:
                held_s = record.arrived_s - commanded.arrived_s
                velocity = model.update(commanded.pwm_us, voltage_v, held_s)
                if velocity is not None:
                    velocities.append((record.arrived_s, *velocity.velocity_frd_mps[:2].tolist()))
            commanded = record
        elif isinstance(record, GpsFix) and record.latitude_deg is not None and record.longitude_deg is not None:
            north, east, _ = frame.to_ned_m(record.latitude_deg, record.longitude_deg)
            fixes.append((record.measured_s, north, east))
            if len(fixes) == 1 and record.utc_unix_s is not None:
                field = magnetic_field(record.latitude_deg, record.longitude_deg, decimal_year(record.utc_unix_s))
                declination_rad = field.declination_rad
    fix_s, fix_ne_m = np.array(fixes)[:, 0], np.array(fixes)[:, 1:]
    table = np.array([heading for heading in headings if heading[0] >= fix_s[0]])
    at_s, heading_rad = table[:, 0], table[:, 1] + declination_rad
    by_thrusters = np.array(velocities)
    moved = np.column_stack([np.interp(at_s, by_thrusters[:, 0], by_thrusters[:, axis]) for axis in (1, 2)])
    constant = np.column_stack((np.full(len(at_s), CONSTANT_MPS), np.zeros(len(at_s))))
    thruster = dead_reckoned(at_s, heading_rad, moved, fix_ne_m[0])
    return Baselines(
        at_s,
        dead_reckoned(at_s, heading_rad, constant, fix_ne_m[0]),
        thruster,
        rubber_band(at_s, thruster, fix_s, fix_ne_m),
    )
