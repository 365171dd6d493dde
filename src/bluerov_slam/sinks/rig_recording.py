"""A recording of a session with the rig: one MCAP file, as a dive has, that `sources/recording_reader.py` opens.

`/rig/point` has what our log has of a point, `/rig/set_point` every move that was asked for, `/rig/session` and
`/rig/event` the rest. Records of the receiver's samples, where there are any, stand in `/link/raw` as an array's board
sends them, so that `isbl solve` takes the file; bytes of a real rig's two links stand under `LINK_TOPICS`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bluerov_slam.records import AcousticRecord
from bluerov_slam.rig.collection import STEP_S, Action, Keep, Move, SendDepth
from bluerov_slam.sinks.acoustic_records import write_raw_record
from bluerov_slam.sinks.mcap_log import McapLog, encode_record, to_ns
from bluerov_slam.sinks.rig_log import action_json

SUFFIX = ".mcap"
POINT_TOPIC, SET_POINT_TOPIC = "/rig/point", "/rig/set_point"
SESSION_TOPIC, EVENT_TOPIC = "/rig/session", "/rig/event"
LINK_TOPICS = {
    ("rig", False): "/rig/link",
    ("rig", True): "/rig/link_down",
    ("receiver", False): "/receiver/link",
    ("receiver", True): "/receiver/link_down",
}
"""By whose port it is, and whether the bytes went to it."""
_TOPICS = {"rig_point": POINT_TOPIC, "rig_set_point": SET_POINT_TOPIC, "rig_session": SESSION_TOPIC}


class RigRecordingWriter:
    """One session's recording; times are seconds of one clock that only goes forward."""

    def __init__(self, path: Path, source: str, wall_offset_ns: int | None = None) -> None:
        """Create `path`; `source`: "simulated" or what the rig is connected to; `wall_offset_ns`: wall clock less that
        clock, None where there is no wall clock. Raises OSError."""
        wall = {"wall_clock": "unknown"} if wall_offset_ns is None else {}
        simulated = "true" if source == "simulated" else "false"
        session = {"source": f"bluerov-slam rig collect, {source}", "simulated": simulated, **wall}
        self._log = McapLog(path, wall_offset_ns or 0, {"wall_offset_ns": str(wall_offset_ns or 0), **session})

    def take(self, action: Action, at_s: float, extra: dict[str, Any] | None = None) -> None:
        """Write what of an action belongs into the recording; a point goes to the disk at once. Raises OSError."""
        content = action_json(action) or _asked(action)
        if content is None:
            return
        topic = _TOPICS.get(content["type"], EVENT_TOPIC)
        self._log.write_message(topic, "json", encode_record({**content, **(extra or {})}), to_ns(at_s))
        if isinstance(action, Keep):
            self._log.flush()

    def record(self, record: AcousticRecord) -> None:
        """What the receiver heard of a pulse; only fills memory."""
        write_raw_record(self._log, record)

    def link(self, whose: str, down: bool, data: bytes, at_s: float) -> None:
        """Bytes of the link to the "rig" or the "receiver"; only fills memory."""
        self._log.write_message(LINK_TOPICS[whose, down], "bytes", data, to_ns(at_s))

    def close(self) -> None:
        """Write what is left, and the index. Raises OSError; the file is closed in any case."""
        self._log.finish()


def _asked(action: Action) -> dict[str, Any] | None:
    """What a log of points has no place for."""
    match action:
        case Move(start, end, steps):
            return {
                "type": "rig_set_point",
                "start_mm": start[:3],
                "start_rad": start[3:],
                "end_mm": end[:3],
                "end_rad": end[3:],
                "steps": steps,
                "step_s": STEP_S,
            }
        case SendDepth(x_m, attempt):
            return {"type": "rig_depth", "x_m": x_m, "attempt": attempt}
        case _:
            return None
