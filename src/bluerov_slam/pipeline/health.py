"""What the operator is told: one chip per part of the system, and every fault with its cause and its cure.

Pure: records and facts in, texts out. The services fill the facts; the pages show the texts as they are.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from bluerov_slam.pipeline.health_acoustics import check_acoustics
from bluerov_slam.pipeline.health_link import check_link, check_mavlink, check_recorder, system_faults
from bluerov_slam.pipeline.health_memory import HealthMemory
from bluerov_slam.pipeline.health_model import (
    AcousticFacts,
    Chip,
    ChipState,
    Fault,
    FaultLevel,
    Finding,
    Health,
    HealthFacts,
    LinkFacts,
    MavlinkFacts,
    NavigationFacts,
    PortState,
    RecorderFacts,
    RecorderState,
    SensorFacts,
)
from bluerov_slam.pipeline.health_navigation import check_navigation
from bluerov_slam.pipeline.health_sensors import check_ctd, check_depth, check_gps, check_imu, check_sonar, patient
from bluerov_slam.records import Channel

if TYPE_CHECKING:
    from collections.abc import Callable

    from bluerov_slam.records import Record

__all__ = [
    "AcousticFacts",
    "Chip",
    "ChipState",
    "Fault",
    "FaultLevel",
    "Health",
    "HealthFacts",
    "HealthMonitor",
    "LinkFacts",
    "MavlinkFacts",
    "NavigationFacts",
    "PortState",
    "RecorderFacts",
    "RecorderState",
    "SensorFacts",
]

_CHECKS: tuple[tuple[str, str, Callable[[float, HealthMemory, HealthFacts], Finding]], ...] = (
    ("link", "Link", check_link),
    ("sonar_a", "Sonar A", patient(partial(check_sonar, Channel.A))),
    ("sonar_b", "Sonar B", patient(partial(check_sonar, Channel.B))),
    ("imu", "IMU", patient(check_imu)),
    ("depth", "Depth", patient(check_depth)),
    ("ctd", "CTD", patient(check_ctd)),
    ("gps", "GPS", patient(check_gps)),
    ("recorder", "Recorder", check_recorder),
    ("mavlink", "MAVLink", check_mavlink),
    ("navigation", "Navigation", check_navigation),
    ("acoustics", "Acoustics", check_acoustics),
)
_WORST_FIRST = tuple(FaultLevel)


class HealthMonitor:
    """Feed it every record; ask it once a second, and whenever a fact changed."""

    def __init__(self) -> None:
        self._memory = HealthMemory()

    def observe(self, record: Record) -> None:
        """Take a record; those that do not matter to health are ignored."""
        self._memory.observe(record)

    def assess(self, now_s: float, facts: HealthFacts) -> Health:
        """The state of everything at host monotonic time `now_s`."""
        memory = self._memory
        memory.take(now_s, facts)
        findings = [(chip_id, label, check(now_s, memory, facts)) for chip_id, label, check in _CHECKS]
        # A fault is also told where no chip stands beside it: as an event, in QGroundControl.
        faults = [
            replace(finding.fault, title=f"{label}: {finding.fault.title}")
            for _, label, finding in findings
            if finding.fault is not None
        ]
        faults += system_faults(now_s, memory, facts)
        faults.sort(key=lambda fault: _WORST_FIRST.index(fault.level))
        return Health(tuple(_chip(*found) for found in findings), tuple(faults))


def _chip(chip_id: str, label: str, finding: Finding) -> Chip:
    cause, cure = ("", "") if finding.fault is None else (finding.fault.cause, finding.fault.cure)
    return Chip(chip_id, label, finding.state, finding.text, cause, cure, finding.age_s, finding.parts)
