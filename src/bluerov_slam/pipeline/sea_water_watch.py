"""From SENSORS frames to sea water, and what can be believed of an old firmware that wraps in silence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.seawater import (
    SEA_WATER_DENSITY_KG_PER_M3,
    STANDARD_ATMOSPHERE_PA,
    depth_m,
    practical_salinity_psu,
    sound_speed_mps,
)
from bluerov_slam.protocol.sensor_frame import (
    LEGACY_SALINITY_TOLERANCE_PSU,
    STANDARD_GRAVITY_MPS2,
    sensor_sample,
)
from bluerov_slam.records import CtdSample, Sender

if TYPE_CHECKING:
    from bluerov_slam.protocol.sensor_frame import SensorFields
    from bluerov_slam.records import SensorSample

# 3 bar between two frames, or between a frame's pressure and its depth, is 30 m: a 16-bit pressure in 0.1 mbar went
# past its end.
LEGACY_PRESSURE_STEP_PA = 300_000.0
_PASCAL_PER_WIRE_M = SEA_WATER_DENSITY_KG_PER_M3 * STANDARD_GRAVITY_MPS2  # how the wire's depth is defined


class SeaWaterWatch:
    """Makes `SensorSample` and `CtdSample` of each SENSORS frame and remembers what an old firmware gave away."""

    def __init__(self, surface_pressure_pa: float = STANDARD_ATMOSPHERE_PA) -> None:
        self.surface_pressure_pa = surface_pressure_pa
        self.sender: Sender | None = None
        self.conductivity_distrusted = False
        self.pressure_distrusted = False
        self._last_pressure_pa: float | None = None

    def reconnected(self) -> None:
        """The link or the board started again: pressure may be believed again."""
        self.pressure_distrusted = False
        self._last_pressure_pa = None

    def samples(self, fields: SensorFields, measured_s: float, arrived_s: float) -> tuple[SensorSample, CtdSample]:
        """Both records of one frame."""
        sample = sensor_sample(fields, measured_s, arrived_s)
        self.sender = sample.sender
        if sample.sender is Sender.LEGACY:
            self._watch_pressure(sample.pressure_pa, sample.depth_wire_m)
            pressure_pa = None if self.pressure_distrusted else sample.pressure_pa
            self.conductivity_distrusted = sample.conductivity_s_per_m is not None and not self._agrees(
                sample, pressure_pa
            )
            if self.pressure_distrusted or self.conductivity_distrusted:
                sample = sensor_sample(
                    fields,
                    measured_s,
                    arrived_s,
                    conductivity_trusted=not self.conductivity_distrusted,
                    pressure_trusted=not self.pressure_distrusted,
                )
        else:
            self.conductivity_distrusted = self.pressure_distrusted = False
        return sample, self._ctd(sample)

    def _watch_pressure(self, pressure_pa: float | None, depth_wire_m: float | None) -> None:
        if pressure_pa is None:
            return
        expected_pa = [] if self._last_pressure_pa is None else [self._last_pressure_pa]
        if depth_wire_m:
            # Depth was taken from the pressure before that wrapped: all there is to see of a link opened below 55 m.
            expected_pa.append(STANDARD_ATMOSPHERE_PA + depth_wire_m * _PASCAL_PER_WIRE_M)
        if any(abs(pressure_pa - pa) > LEGACY_PRESSURE_STEP_PA for pa in expected_pa):
            self.pressure_distrusted = True
        self._last_pressure_pa = pressure_pa

    def _agrees(self, sample: SensorSample, pressure_pa: float | None) -> bool:
        """Whether conductivity and the probe's own salinity describe the same water."""
        if sample.ec_salinity_psu is None:
            return False
        # 300 m of depth change PSS-78 by 0.15 PSU, far less than the tolerance: the surface will do.
        salinity_psu = self._salinity_psu(sample, self.surface_pressure_pa if pressure_pa is None else pressure_pa)
        return salinity_psu is not None and abs(salinity_psu - sample.ec_salinity_psu) <= LEGACY_SALINITY_TOLERANCE_PSU

    def _ctd(self, sample: SensorSample) -> CtdSample:
        salinity_psu = self._salinity_psu(sample, sample.pressure_pa)
        return CtdSample(
            measured_s=sample.measured_s,
            arrived_s=sample.arrived_s,
            temperature_degc=sample.temperature_degc,
            conductivity_s_per_m=sample.conductivity_s_per_m,
            pressure_pa=sample.pressure_pa,
            depth_m=self._depth_m(sample.pressure_pa),
            salinity_psu=salinity_psu,
            sound_speed_mps=self._sound_speed_mps(sample, salinity_psu),
            surface_pressure_pa=self.surface_pressure_pa,
        )

    def _salinity_psu(self, sample: SensorSample, pressure_pa: float | None) -> float | None:
        if sample.conductivity_s_per_m is None or sample.temperature_degc is None or pressure_pa is None:
            return None
        try:
            return practical_salinity_psu(
                sample.conductivity_s_per_m, sample.temperature_degc, pressure_pa, self.surface_pressure_pa
            )
        except OutOfValidityError:
            return None

    def _depth_m(self, pressure_pa: float | None) -> float | None:
        if pressure_pa is None:
            return None
        try:
            return max(0.0, depth_m(pressure_pa, self.surface_pressure_pa))
        except OutOfValidityError:
            return None

    def _sound_speed_mps(self, sample: SensorSample, salinity_psu: float | None) -> float | None:
        if sample.sound_speed_wire_mps is not None:
            return sample.sound_speed_wire_mps
        if sample.temperature_degc is None or salinity_psu is None or sample.pressure_pa is None:
            return None
        try:
            return sound_speed_mps(sample.temperature_degc, salinity_psu, sample.pressure_pa - self.surface_pressure_pa)
        except OutOfValidityError:
            return None
