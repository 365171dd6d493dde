"""Counts kept by the link decoder, as one snapshot."""

from __future__ import annotations

from dataclasses import dataclass, field

from bluerov_slam.protocol.acoustic_record_assembly import AssemblyCounters
from bluerov_slam.records import Channel, LinkCounters, Sender


@dataclass(frozen=True, slots=True)
class SonarCounters:
    """One sonar since the decoder was made; what is not known yet is None.

    `coding` is how its amplitudes travel: "raw", "mean", "peak" or "coded". `gap_samples` counts samples that never
    arrived inside emitted pings, `pings_missed` whole pings by the firmware's own numbering, `chunks_rejected` chunks
    that cannot belong to any ping.
    """

    bytes: int = 0
    frames: int = 0
    checksum_errors: int = 0
    pings: int = 0
    pings_incomplete: int = 0
    pings_missed: int = 0
    gap_samples: int = 0
    chunks_rejected: int = 0
    samples: int | None = None
    first_sample: int | None = None
    resolution_m: float | None = None
    coding: str | None = None
    checksum_in_use: str | None = None
    last_ping_arrived_s: float | None = None


@dataclass(frozen=True, slots=True)
class LinkDecoderCounters:
    """Everything the link decoder counted since it was made.

    `unknown_layouts` are 0x04 frames whose arithmetic does not add up; `malformed` other frames whose check was right
    and whose content was not, by type; `undecoded` frames of known types that this version has no use for.
    """

    link: LinkCounters = field(default_factory=LinkCounters)
    sonars: dict[Channel, SonarCounters] = field(default_factory=dict)
    unknown_types: dict[int, int] = field(default_factory=dict)
    undecoded: dict[int, int] = field(default_factory=dict)
    malformed: dict[int, int] = field(default_factory=dict)
    unknown_layouts: int = 0
    unknown_layout_reason: str = ""
    acoustic_records: AssemblyCounters = field(default_factory=AssemblyCounters)
    sender: Sender | None = None
    device_resets: int = 0
    conductivity_distrusted: bool = False
    pressure_distrusted: bool = False
