"""What a collection leaves of a session, side by side: the thesis's log, our log and our recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import AcousticRecord
from bluerov_slam.rig.collection import Action
from bluerov_slam.sinks import isbl_thesis_log, rig_log, rig_recording

SIMULATED = "simulated"


class RigSessionFiles:
    """Three files by the session's name. What a disk does not take is a RecordingError that names the cure."""

    def __init__(self, folder: Path, name: str, source: str) -> None:
        """`source`: `SIMULATED`, which has no wall clock, or what the rig is connected to. Raises RecordingError."""
        self._folder = folder
        simulated = source == SIMULATED
        self._closing = ExitStack()
        with self._writing(), ExitStack() as undo:
            self.thesis = isbl_thesis_log.ThesisLogWriter(
                folder / f"{name}{isbl_thesis_log.SUFFIX}", "SIMULATED" if simulated else "RIG"
            )
            undo.callback(self.thesis.close)
            wall: Callable[[], float] | None = None if simulated else time.time
            self.ours = rig_log.RigLogWriter(folder / f"{name}{rig_log.SUFFIX}", source, wall)
            undo.callback(self.ours.close)
            offset = None if simulated else time.time_ns() - time.monotonic_ns()
            self.recording = rig_recording.RigRecordingWriter(folder / f"{name}{rig_recording.SUFFIX}", source, offset)
            undo.callback(self.recording.close)
            self._closing = undo.pop_all()

    def take(self, action: Action, at_s: float, extra: dict[str, Any] | None = None) -> None:
        """Write what of an action belongs into each. Raises RecordingError."""
        with self._writing():
            self.thesis.take(action)
            self.ours.take(action, extra)
            self.recording.take(action, at_s, extra)

    def record(self, record: AcousticRecord) -> None:
        """What the receiver heard of a pulse."""
        self.recording.record(record)

    def link(self, whose: str, down: bool, data: bytes, at_s: float) -> None:
        """Bytes of a real rig's link; never raises, because the link must go on."""
        self.recording.link(whose, down, data, at_s)

    def close(self) -> None:
        """Close all three. Raises RecordingError; they are closed in any case."""
        with self._writing():
            self._closing.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RecordingError(
                f"cannot write into {self._folder}: {error.strerror or error}; what was collected so far is there. "
                "Free space, or give a folder on another disk, and collect the rest"
            ) from error
