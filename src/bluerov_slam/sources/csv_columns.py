"""Tables of other programs: columns by name, cells that may be empty, `--.--` or damaged, files that may be cut."""

from __future__ import annotations

import csv
import datetime
import math
from collections.abc import Iterator
from pathlib import Path

from bluerov_slam.errors import RecordingError
from bluerov_slam.sources.imported_log import ImportReport


def read_rows(path: Path, needed: tuple[str, ...], report: ImportReport) -> Iterator[dict[str, str]]:
    """The whole rows of a table. Raises RecordingError where the file or a needed column is missing."""
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}; give the path of the CSV file") from error
    rows = csv.reader(text.replace("\0", "").splitlines())
    header = next(rows, [])
    if missing := [name for name in needed if name not in header]:
        raise RecordingError(
            f"{path}: no column {', '.join(missing)}; export the whole log again, as the program writes it"
        )
    for row in rows:
        if len(row) != len(header):
            report.left_out[f"rows of {path.name} that are not whole"] += 1
            continue
        yield dict(zip(header, row, strict=True))


def number(row: dict[str, str], column: str) -> float | None:
    """The cell as a number; None where there is no such column or it holds none (`--.--`, empty, nan)."""
    try:
        value = float(row[column])
    except (KeyError, ValueError):
        return None
    return value if math.isfinite(value) else None


def time_of_day(text: str) -> float | None:
    """A date and time without a zone as seconds since 1970, as if the zone were UTC; None if it is none."""
    try:
        moment = datetime.datetime.fromisoformat(text.strip())
    except ValueError:
        return None
    return moment.replace(tzinfo=datetime.UTC).timestamp() if moment.tzinfo is None else moment.timestamp()
