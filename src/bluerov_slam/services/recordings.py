"""The recordings folder: what is in it, and the few things a user may do with it.

Everything here touches the disk: call it from a worker thread. Names come from the network, so each is matched against
its pattern, and what it names must be a plain file or folder inside the recordings folder, never a link out of it.
"""

from __future__ import annotations

import re
import shutil
import uuid
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bluerov_slam.errors import RecordingError
from bluerov_slam.services.annotations import MAX_ANNOTATIONS, checked_annotation, checked_text
from bluerov_slam.sinks.disk_guard import disk_state
from bluerov_slam.sinks.session_file import change_session, read_session
from bluerov_slam.sinks.session_recovery import SESSION_NAME

ACTIVE = "active"

_FILE_NAME = re.compile(r"link_\d{3,6}\.mcap(\.cut)?|session_\d{8}_\d{6}(\.\d{1,6})?\.jsonl|session\.json")
_ZIP_BLOCK_BYTES = 256 * 1024


class UnknownRecordingError(RecordingError):
    """There is no recording, file or annotation of that name."""


class RecordingStore:
    """The sessions below `folder`. `active_name` tells which one is being written."""

    def __init__(self, folder: Path, active_name: Callable[[], str | None] = lambda: None) -> None:
        self.folder = folder
        self._active_name = active_name

    def overview(self) -> dict[str, Any]:
        """Everything the recordings page shows, newest dive first."""
        disk = disk_state(self.folder)
        return {
            "folder": str(self.folder),
            "free_bytes": disk.free_bytes,
            "total_bytes": disk.total_bytes,
            "active": self._active_name(),
            "recordings": [self._describe(folder) for folder in self._sessions()],
        }

    def details(self, name: str) -> dict[str, Any]:
        """One dive of the overview. Raises UnknownRecordingError."""
        return self._describe(self.session_folder(name))

    def session_folder(self, name: str) -> Path:
        """The folder of a dive; `active` names the one being written. Raises RecordingError."""
        if name == ACTIVE:
            active = self._active_name()
            if active is None:
                raise RecordingError("nothing is being recorded: start a recording first")
            name = active
        folder = self.folder / name
        if not SESSION_NAME.fullmatch(name) or folder.is_symlink() or not folder.is_dir():
            raise UnknownRecordingError(f"there is no recording {name[:80]!r}: names look like session_20260131_142500")
        return folder

    def file(self, name: str, file_name: str) -> Path:
        """One file of a dive. Raises UnknownRecordingError."""
        path = self.session_folder(name) / file_name
        if not _FILE_NAME.fullmatch(file_name) or path.is_symlink() or not path.is_file():
            raise UnknownRecordingError(f"recording {name} has no file {file_name[:80]!r}")
        return path

    def rename(self, name: str, changes: dict[str, Any]) -> dict[str, Any]:
        """Set `title` and `notes`. Raises RecordingError, OSError."""
        folder = self.session_folder(name)
        unknown = sorted(set(changes) - {"title", "notes"})
        if unknown:
            raise RecordingError(f"unknown key {unknown[0]!r}: a recording has a title and notes")
        texts = {key: checked_text(key, value) for key, value in changes.items()}
        change_session(folder, lambda session: session.update(texts))
        return self._describe(folder)

    def delete(self, name: str) -> None:
        """Remove a dive for good; never the one being written. Raises RecordingError, OSError."""
        folder = self.session_folder(name)
        if folder.name == self._active_name():
            raise RecordingError(f"{folder.name} is being recorded: stop the recording first")
        shutil.rmtree(folder)

    def annotations(self, name: str) -> list[dict[str, Any]]:
        """Notes and contacts of a dive, in the order they were made."""
        return list(read_session(self.session_folder(name)).get("annotations", []))

    def add_annotation(self, name: str, given: dict[str, Any]) -> dict[str, Any]:
        """Keep a note or a contact; returns it with its id. One whose id is known already is replaced.

        Raises RecordingError, OSError.
        """
        annotation = {"id": uuid.uuid4().hex[:12], "kind": "note", **checked_annotation(given)}

        def add(session: dict[str, Any]) -> None:
            kept = session.setdefault("annotations", [])
            kept[:] = [other for other in kept if other.get("id") != annotation["id"]]
            if len(kept) >= MAX_ANNOTATIONS:
                raise RecordingError(f"this recording holds {MAX_ANNOTATIONS} annotations already")
            kept.append(annotation)

        change_session(self.session_folder(name), add)
        return annotation

    def change_annotation(self, name: str, annotation_id: str, given: dict[str, Any]) -> dict[str, Any]:
        """Change keys of an annotation. Raises RecordingError, OSError."""
        changes = {**checked_annotation(given), "id": annotation_id}
        found: dict[str, Any] = {}

        def change(session: dict[str, Any]) -> None:
            found.update(_find(session, annotation_id))
            found.update(changes)
            kept = session["annotations"]
            kept[:] = [found if other.get("id") == annotation_id else other for other in kept]

        change_session(self.session_folder(name), change)
        return found

    def remove_annotation(self, name: str, annotation_id: str) -> None:
        """Forget an annotation. Raises RecordingError, OSError."""

        def remove(session: dict[str, Any]) -> None:
            _find(session, annotation_id)
            session["annotations"] = [other for other in session["annotations"] if other.get("id") != annotation_id]

        change_session(self.session_folder(name), remove)

    def export(self, name: str) -> Iterator[bytes]:
        """The zip of a whole dive, made as it is read. Raises RecordingError at once, OSError on the way."""
        folder = self.session_folder(name)
        return _zip_blocks(folder, [self.file(folder.name, path.name) for path in self._files(folder)])

    def _sessions(self) -> list[Path]:
        try:
            entries = list(self.folder.iterdir())
        except OSError:
            return []
        sessions = [e for e in entries if SESSION_NAME.fullmatch(e.name) and e.is_dir() and not e.is_symlink()]
        return sorted(sessions, reverse=True)

    def _files(self, folder: Path) -> list[Path]:
        try:
            entries = list(folder.iterdir())
        except OSError:
            return []
        return sorted(e for e in entries if _FILE_NAME.fullmatch(e.name) and e.is_file() and not e.is_symlink())

    def _describe(self, folder: Path) -> dict[str, Any]:
        session = read_session(folder)
        sizes = {path.name: path.stat().st_size for path in self._files(folder)}
        return {
            "name": folder.name,
            "title": session.get("title", ""),
            "notes": session.get("notes", ""),
            "started_unix_s": session.get("started_unix_s"),
            "duration_s": session.get("duration_s"),
            "bytes": sum(sizes.values()),
            "files": [{"name": name, "bytes": size} for name, size in sizes.items()],
            "pings_a": session.get("pings_a"),
            "pings_b": session.get("pings_b"),
            "active": folder.name == self._active_name(),
            "wall_clock_trusted": session.get("wall_clock_trusted"),
            "gps_utc_offset_s": session.get("gps_utc_offset_s"),
            "annotations": session.get("annotations", []),
        }


def _find(session: dict[str, Any], annotation_id: str) -> dict[str, Any]:
    for annotation in session.get("annotations", []):
        if annotation.get("id") == annotation_id:
            found: dict[str, Any] = annotation
            return found
    raise UnknownRecordingError(f"there is no annotation {annotation_id[:40]!r} in this recording")


class _ZipOutput:
    """What zipfile writes into: it can only go forward, and is emptied after each block."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Nothing waits here."""

    def take(self) -> bytes:
        block = b"".join(self._parts)
        self._parts.clear()
        return block


def _zip_blocks(folder: Path, files: list[Path]) -> Iterator[bytes]:
    """MCAP is compressed already, so everything is stored as it is: the vehicle's processor has other work."""
    output = _ZipOutput()
    with zipfile.ZipFile(output, "w", zipfile.ZIP_STORED) as archive:  # type: ignore[call-overload]
        for path in files:
            info = zipfile.ZipInfo.from_file(path, f"{folder.name}/{path.name}", strict_timestamps=False)
            with path.open("rb") as source, archive.open(info, "w", force_zip64=True) as target:
                remaining = info.file_size  # of a file that still grows, what was there when the export began
                while remaining > 0 and (block := source.read(min(_ZIP_BLOCK_BYTES, remaining))):
                    remaining -= len(block)
                    target.write(block)
                    yield output.take()
    yield output.take()
