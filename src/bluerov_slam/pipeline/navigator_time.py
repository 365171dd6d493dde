"""The vehicle's own messages on the host's clock: each sender's boot time, mapped by the envelope of its delays."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bluerov_slam.clock import DeviceClock
from bluerov_slam.records import (
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleMotionDelta,
    VehicleRange,
    VehicleServoOutput,
)

if TYPE_CHECKING:
    from bluerov_slam.records import VehicleRecord

_WRAP = 1 << 32


class VehicleClocks:
    """One clock for each kind of message: a DVL driver stamps with its own computer's time, the autopilot with its."""

    def __init__(self) -> None:
        self._attitude = DeviceClock()
        self._servos = DeviceClock()
        self._motion = DeviceClock()
        self._depth = DeviceClock()
        self._range = DeviceClock()

    def measured_s(self, record: VehicleRecord) -> float:
        """When it was measured, on the host's monotonic clock. A battery's message carries no time of its own."""
        if isinstance(record, VehicleAttitude):
            return self._attitude.map_ms32(record.boot_ms % _WRAP, record.arrived_s)
        if isinstance(record, VehicleServoOutput):
            return self._servos.map_us32(record.boot_us % _WRAP, record.arrived_s)
        if isinstance(record, VehicleMotionDelta):
            return self._motion.map_us32(record.boot_us % _WRAP, record.arrived_s)
        if isinstance(record, VehicleDepth):
            return self._depth.map_ms32(record.boot_ms % _WRAP, record.arrived_s)
        if isinstance(record, VehicleRange):
            return self._range.map_ms32(record.boot_ms % _WRAP, record.arrived_s)
        assert isinstance(record, VehicleBattery)
        return record.arrived_s
