"""Crossed sonar cables, put right: records of A become records of B, right after decoding and before every sink."""

from __future__ import annotations

from dataclasses import replace

from bluerov_slam.pipeline.link_counters import SonarCounters
from bluerov_slam.records import Channel, DeviceStatus, Ping, Record, SensorSample, SonarFrames


def other(channel: Channel) -> Channel:
    """B for A and A for B."""
    return Channel.B if channel is Channel.A else Channel.A


def swapped(record: Record) -> Record:
    """The same record with A and B exchanged; records that concern neither come back as they are."""
    if isinstance(record, SonarFrames | Ping):
        return replace(record, channel=other(record.channel))
    if isinstance(record, SensorSample):
        return replace(
            record,
            a_packets=record.b_packets,
            a_bytes=record.b_bytes,
            b_packets=record.a_packets,
            b_bytes=record.a_bytes,
        )
    if isinstance(record, DeviceStatus):
        return replace(
            record,
            a_pings_dropped=record.b_pings_dropped,
            b_pings_dropped=record.a_pings_dropped,
            a_frame_errors=record.b_frame_errors,
            b_frame_errors=record.a_frame_errors,
            a_overflow_bytes=record.b_overflow_bytes,
            b_overflow_bytes=record.a_overflow_bytes,
        )
    return record


def swapped_counters(counters: dict[Channel, SonarCounters]) -> dict[Channel, SonarCounters]:
    """Counters by the sonar they belong to once the cables are put right."""
    return {other(channel): values for channel, values in counters.items()}
