"""Tells what kind of log a file is, and imports it."""

from __future__ import annotations

from pathlib import Path

from mcap.writer import MCAP0_MAGIC

from bluerov_slam.errors import RecordingError
from bluerov_slam.sources import acoustic_csv, dataflash_log, ground_station_csv, telemetry_log
from bluerov_slam.sources.imported_log import ImportedLog
from bluerov_slam.sources.vehicle_log import parse_vehicle_log

_PROBE_BYTES = 1024 * 1024
_WHAT_WE_TAKE = (
    "give an ArduSub .tlog or .BIN, a QGroundControl CSV log, or the folder of a Water Linked G2 topside's CSV files"
)


def read_log(path: Path, utc_offset_h: float | None = None) -> ImportedLog:
    """The records of a log of any kind we know. Raises RecordingError naming the cure."""
    try:
        if path.is_dir():
            return _folder(path)
        with path.open("rb") as stream:
            head = stream.read(_PROBE_BYTES)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}; {_WHAT_WE_TAKE}") from error
    if not head:
        raise RecordingError(f"{path} is empty: copy it from the vehicle or the ground station again")
    if head.startswith(MCAP0_MAGIC) or head.startswith(b"PK\x03\x04"):
        raise RecordingError(f"{path} is a recording already: use it with replay, convert or navigate as it is")
    if head.startswith(dataflash_log.MAGIC):
        return dataflash_log.import_dataflash_log(path)
    if path.name.endswith(acoustic_csv.MARK):
        return acoustic_csv.import_acoustic_folder(path.parent)
    first_line = head.split(b"\n", 1)[0].decode("utf-8", "replace")
    if first_line.lstrip("\ufeff").startswith("Timestamp,"):
        return ground_station_csv.import_ground_station_csv(path, utc_offset_h)
    if next(parse_vehicle_log(head), None) is not None:
        return telemetry_log.import_telemetry_log(path)
    raise RecordingError(f"{path} is no log that we can import: {_hint(path, head)}{_WHAT_WE_TAKE}")


def _folder(path: Path) -> ImportedLog:
    if any(path.glob("link_*.mcap")):
        raise RecordingError(f"{path} is a recording already: use it with replay, convert or navigate as it is")
    if any(path.glob(f"*{acoustic_csv.MARK}")):
        return acoustic_csv.import_acoustic_folder(path)
    raise RecordingError(f"{path} holds no file *{acoustic_csv.MARK}: {_WHAT_WE_TAKE}")


def _hint(path: Path, head: bytes) -> str:
    if head.startswith(b"FMT,"):
        return "it is a dataflash log as text; download the .BIN instead, or "
    if b"$GP" in head or b"$GN" in head:
        return "NMEA text holds positions only of the boat; "
    if path.suffix.lower() in (".bin", ".tlog"):
        return "its beginning is damaged or it is something else; "
    return ""
