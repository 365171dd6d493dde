"""SENSORS as the user's old firmware sends them: no extension, and the short fields wrap in silence."""

from __future__ import annotations

from dataclasses import replace

from bluerov_slam.protocol.sensor_frame import SensorFields


def as_legacy(fields: SensorFields) -> SensorFields:
    """The same readings in the original 76 bytes."""
    known_ec, known_depth = fields.full_conductivity_dus != 0xFFFFFF, fields.full_pressure_pa != 0xFFFFFF
    return replace(
        fields,
        extension=0,
        conductivity_dus=fields.full_conductivity_dus & 0xFFFF if known_ec else 0,
        pressure_dmbar=(fields.full_pressure_pa // 10) & 0xFFFF if known_depth else 0,
        full_conductivity_dus=0,
        full_pressure_pa=0,
        salinity_dpsu=_wrapped_salinity(fields),
    )


def _wrapped_salinity(fields: SensorFields) -> int:
    """The probe's salinity in 0.1 PSU, cut to eight bits."""
    return (fields.ec_salinity_cpsu // 10) & 0xFF if fields.ec_salinity_cpsu != 0xFFFF else 0
