"""What health speaks in: chips and faults going out, facts about the edges of the system coming in."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bluerov_slam.pipeline.acoustic_watch import AcousticWords
    from bluerov_slam.pipeline.link_counters import LinkDecoderCounters
    from bluerov_slam.records import NavMode, SensorTrust


class ChipState(StrEnum):
    """How a chip is coloured."""

    OK = "ok"
    WARN = "warn"
    FAULT = "fault"
    OFF = "off"
    UNKNOWN = "unknown"


class FaultLevel(StrEnum):
    """How much a fault matters; worst first."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


@dataclass(frozen=True, slots=True)
class Chip:
    """One part of the system in a few words. `age_s` is the age of its newest data, None if there never was any."""

    id: str
    label: str
    state: ChipState
    text: str
    cause: str = ""
    cure: str = ""
    age_s: float | None = None
    parts: tuple[tuple[str, str], ...] = ()  # what else is known, as names and words


@dataclass(frozen=True, slots=True)
class Fault:
    """Something wrong now. `id` stays the same as long as the fault does."""

    id: str
    level: FaultLevel
    title: str
    cause: str
    cure: str


class PortState(StrEnum):
    """What the serial port (or the replay that stands in for it) is doing."""

    CONNECTED = "connected"
    ABSENT = "absent"
    BUSY = "busy"
    DENIED = "denied"
    FAILED = "failed"
    FINISHED = "finished"


@dataclass(frozen=True, slots=True)
class LinkFacts:
    """The link as its source sees it. `device_folder_seen` is False in a container without /dev."""

    state: PortState
    kind: str = "serial"
    port: str | None = None
    by_id: str | None = None
    baud: int = 115200
    reconnects: int = 0
    waiting_for: str | None = None
    detail: str = ""
    device_folder_seen: bool = True


class RecorderState(StrEnum):
    """What the recorder is doing."""

    OFF = "off"
    WAITING = "waiting"
    RECORDING = "recording"
    DISK_FULL = "disk_full"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class RecorderFacts:
    """The recorder as it sees itself; `state` OFF means switched off by the user."""

    state: RecorderState
    file: str | None = None
    bytes: int = 0
    bytes_per_s: float = 0.0
    dropped: int = 0
    queue: int = 0
    free_bytes: int | None = None
    seconds_left: float | None = None
    error: str | None = None


@dataclass(frozen=True, slots=True)
class MavlinkFacts:
    """The MAVLink bridge as it sees itself. `last_heard_s` is host monotonic time."""

    enabled: bool
    target: str = ""
    sent: int = 0
    peer_alive: bool = False
    peer: str | None = None
    last_heard_s: float | None = None
    received: int = 0
    enabled_since_s: float | None = None
    error: str | None = None


@dataclass(frozen=True, slots=True)
class SensorFacts:
    """A sensor that the navigator does not use, and why."""

    name: str
    trust: SensorTrust
    reason: str


@dataclass(frozen=True, slots=True)
class NavigationFacts:
    """The navigator and its process. `worker`: off, starting, running or restarting; `heard_s`: of its newest state."""

    worker: str
    error: str | None = None
    restarts: int = 0
    dropped: int = 0
    save_error: str | None = None
    odometry_problem: str | None = None
    mode: NavMode | None = None
    text: str = ""
    heard_s: float | None = None
    distrusted: tuple[SensorFacts, ...] = ()


@dataclass(frozen=True, slots=True)
class AcousticFacts:
    """The acoustic array: what the pilot is told of it, the newest pulse's age, what else is known of it."""

    words: AcousticWords
    age_s: float | None = None
    parts: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class HealthFacts:
    """Everything `HealthMonitor.assess` needs besides the records it has seen."""

    link: LinkFacts
    recorder: RecorderFacts
    mavlink: MavlinkFacts
    counters: LinkDecoderCounters
    wall_trusted: bool | None = None
    extension_version: str = ""
    navigation: NavigationFacts | None = None
    acoustics: AcousticFacts | None = None


@dataclass(frozen=True, slots=True)
class Health:
    """The chips in the order of the page, and everything wrong now, worst first."""

    chips: tuple[Chip, ...]
    faults: tuple[Fault, ...]


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check found: how its chip looks and, where something is wrong, the fault behind it."""

    state: ChipState
    text: str
    fault: Fault | None = None
    age_s: float | None = None
    parts: tuple[tuple[str, str], ...] = ()


def wrong(
    fault_id: str, text: str, cause: str, cure: str, *, level: FaultLevel = FaultLevel.ERROR, age_s: float | None = None
) -> Finding:
    """A finding whose chip text is the fault's title; an error colours the chip as fault, a warning as warn."""
    state = ChipState.FAULT if level is FaultLevel.ERROR else ChipState.WARN
    return Finding(state, text, Fault(fault_id, level, text, cause, cure), age_s)
