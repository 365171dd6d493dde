"""Converts a recorded dive: always from its raw link bytes through today's decoder, never from old decoded records."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import (
    Channel,
    CtdSample,
    Ping,
    Record,
    SensorSample,
    SonarFrames,
    UnknownFrame,
    VehicleRecord,
)
from bluerov_slam.services.channel_swap import swapped
from bluerov_slam.sinks.csv_tables import CsvTables
from bluerov_slam.sinks.dive_track import DiveTrack
from bluerov_slam.sinks.jsonl_log import SensorLines
from bluerov_slam.sinks.klf_writer import KlfWriter
from bluerov_slam.sinks.whole_output import in_whole
from bluerov_slam.sinks.xtf_writer import XtfWriter
from bluerov_slam.sources.recording_reader import Recording, open_recording
from bluerov_slam.sources.replay import decode


class _Dive:
    """A recording and what a first pass over it tells."""

    def __init__(self, recording: Recording, baud: int, swap: bool) -> None:
        self.recording = recording
        self._baud = baud
        self._swap = swap
        self.track = DiveTrack(recording.utc_offset_s)
        self.dual: set[Channel] = set()
        self.sonar_frames = 0
        valid = recording.imported_from is not None
        for record in self.records():
            self.track.add(record)
            valid = valid or not isinstance(record, UnknownFrame | VehicleRecord)
            if isinstance(record, SonarFrames):
                self.sonar_frames += len(record.frames)
            elif isinstance(record, Ping) and record.sub_channel:
                self.dual.add(record.channel)
        self.problems = list(dict.fromkeys(recording.problems))
        if not valid:
            raise RecordingError(f"{recording.path} holds no valid frame of the ESP32: is it the right file?")

    def records(self) -> Iterator[Record]:
        """Every record of the dive, decoded afresh each time."""
        records = decode(self.recording, self._baud)
        return map(swapped, records) if self._swap else records

    def require_sonar(self) -> None:
        """Raises RecordingError for a dive without sonar data."""
        if not self.sonar_frames:
            raise RecordingError(f"{self.recording.path} holds no sonar data: convert it to jsonl or csv")


def convert(
    source: Path, target_format: str, output: Path, *, baud: int = 115200, swap: bool = False, force: bool = False
) -> list[str]:
    """Convert `source` into `output`; `swap` exchanges the sonars A and B.

    Returns what to tell the user. Raises RecordingError naming the cure.
    """
    converters: dict[str, Callable[[_Dive, Path], str]] = {
        "jsonl": _to_jsonl,
        "csv": _to_csv,
        "klf": _to_klf,
        "xtf": _to_xtf,
    }
    if output.exists() and not force:
        raise RecordingError(f"{output} exists already: choose another name, or add --force to replace it")
    dive = _Dive(open_recording(source), baud, swap)
    try:
        with in_whole(output) as unfinished:
            summary = converters[target_format](dive, unfinished)
    except OSError as error:
        raise RecordingError(f"cannot write {output}: {error.strerror or error}; choose another place") from error
    return [f"{output}: {summary}", *dive.problems]


def _to_jsonl(dive: _Dive, path: Path) -> str:
    lines = SensorLines(dive.recording.wall_offset_ns)
    count = 0
    with path.open("wb") as stream:
        for record in dive.records():
            if isinstance(record, SensorSample | CtdSample):
                complete = lines.feed(record)
                stream.writelines(complete)
                count += len(complete)
        rest = lines.flush()
        stream.writelines(rest)
    return f"{count + len(rest)} sensor lines"


def _to_csv(dive: _Dive, path: Path) -> str:
    path.mkdir()
    with CsvTables(path, dive.track) as tables:
        for record in dive.records():
            tables.write(record)
    return ", ".join(f"{name} with {rows} rows" for name, rows in tables.rows.items())


def _to_klf(dive: _Dive, path: Path) -> str:
    dive.require_sonar()
    with path.open("wb") as stream:
        writer = KlfWriter(stream, dive.track)
        for record in dive.records():
            writer.write(record)
        writer.finish()
    counts = writer.counts
    refused = f"; {counts.refused} frames on which KoggerApp crashes were left out" if counts.refused else ""
    return (
        f"{counts.frames_a} frames of A (address 1), {counts.frames_b} of B (address 2), "
        f"{counts.positions} positions, {counts.attitudes} attitudes{refused}"
    )


def _to_xtf(dive: _Dive, path: Path) -> str:
    dive.require_sonar()
    with path.open("wb") as stream:
        name = path.name.removesuffix(".part")
        writer = XtfWriter(stream, dive.track, name, frozenset(dive.dual))
        for record in dive.records():
            if isinstance(record, Ping):
                writer.write(record)
        writer.finish()
    counts = writer.counts
    return (
        f"{counts.records} records with {counts.starboard} starboard and {counts.port} port pings "
        f"({counts.single} with one side only), {counts.with_position} with position"
    )
