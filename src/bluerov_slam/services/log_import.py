"""Makes a session of our own out of a log from elsewhere, so that replay, convert and navigate take it."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from bluerov_slam import __version__
from bluerov_slam.errors import RecordingError
from bluerov_slam.sinks.mcap_log import to_ns
from bluerov_slam.sinks.session_file import change_session
from bluerov_slam.sinks.session_writer import SessionStart, SessionWriter
from bluerov_slam.sources.imported_log import ImportedLog
from bluerov_slam.sources.log_import import read_log
from bluerov_slam.sources.recording_reader import UNKNOWN_CLOCK

# Records between two flushes: a chunk of the MCAP file.
_CHUNK_RECORDS = 2000


@dataclass(frozen=True, slots=True)
class Import:
    """Where an imported log now lies, and what to tell the user."""

    folder: Path
    lines: list[str]


def import_log(path: Path, out: Path, utc_offset_h: float | None = None) -> Import:
    """Write `path` as a new session folder in `out`. Raises RecordingError naming the cure."""
    log = read_log(path, utc_offset_h)
    try:
        folder = _write(log, path, out)
    except OSError as error:
        raise RecordingError(
            f"cannot write into {error.filename or out}: {error.strerror or error}; give another folder with --out"
        ) from error
    duration_s = log.records[-1].arrived_s if log.records else 0.0  # type: ignore[union-attr]
    head = f"{folder}: {log.kind} of {duration_s:.0f} s, {len(log.records)} records"
    return Import(folder, [head, *log.report.lines()])


def _write(log: ImportedLog, path: Path, out: Path) -> Path:
    metadata = {
        "bluerov_slam_version": __version__,
        "decoder_settings": "{}",
        "imported_from": path.name,
        "imported_kind": log.kind,
        "wall_clock": "utc" if log.start_is_utc else UNKNOWN_CLOCK,
    }
    writer = SessionWriter(out, SessionStart(0, to_ns(log.start_unix_s or 0.0), metadata))
    try:
        for number, record in enumerate(log.records):
            writer.write(record)
            if number % _CHUNK_RECORDS == _CHUNK_RECORDS - 1:
                writer.flush()
        writer.close()
        facts = {
            "title": path.name,
            "notes": "\n".join([f"Imported from {path.name} ({log.kind}).", *log.report.lines()]),
            "imported_from": path.name,
            "duration_s": max((getattr(record, "arrived_s", 0.0) for record in log.records), default=0.0),
        }
        change_session(writer.folder, lambda session: session.update(facts))
    except BaseException:
        writer.release()
        shutil.rmtree(writer.folder, ignore_errors=True)
        raise
    return writer.folder
