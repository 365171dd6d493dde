"""Our own log of a collection: a line of JSON per point, whole or missing, with truth, its covariance and the reason.

SI units are in the names; what is not known is null. `t_unix` is the wall clock at which the point was written.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bluerov_slam.rig.collection import Action, Close, Discard, Hold, Keep, Open, Point, Pressed
from bluerov_slam.sinks.jsonl_log import JsonlLog
from bluerov_slam.sinks.mcap_log import encode_record

SUFFIX = ".jsonl"


class RigLogWriter:
    """One session's log."""

    def __init__(self, path: Path, source: str, clock: Callable[[], float] | None = None) -> None:
        """Create `path`; `source`: "simulated" or what the rig is connected to. `clock`: wall clock, s; None for a
        simulation, which has none. Raises OSError."""
        self._log = JsonlLog(path)
        self._source = source
        self._clock = clock

    def take(self, action: Action, extra: dict[str, Any] | None = None) -> None:
        """Write what of an action belongs into the log; `extra` goes into a point's line. Raises OSError."""
        content = action_json(action)
        if content is None:
            return
        stamp = None if self._clock is None else self._clock()
        line = {**content, **(extra or {}), "source": self._source, "t_unix": stamp}
        self._log.write([encode_record(line) + b"\n"])
        self._log.flush()

    def close(self) -> None:
        """Flush and close. Raises OSError."""
        self._log.close()


def action_json(action: Action) -> dict[str, Any] | None:
    """What of an action belongs into a log, in plain numbers; None where nothing does."""
    match action:
        case Open(session):
            return {
                "type": "rig_session",
                "session": session.name,
                "motion": session.motion.value,
                "transmitter_mm": list(session.transmitter_mm),
                "ranges": {axis: list(ends) for axis, ends in session.ranges.items()},
            }
        case Keep(point):
            return point_json(point)
        case Discard():
            return {"type": "rig_discard"}
        case Hold(reason):
            return {"type": "rig_hold", "reason": reason}
        case Pressed(place):
            return {"type": "rig_button", "place": place}
        case Close(reason):
            return {"type": "rig_end", "reason": reason}
        case _:
            return None


def point_json(point: Point) -> dict[str, Any]:
    """A point in plain numbers; null is unknown."""
    result = point.result
    return {
        "type": "rig_point",
        "session": point.session,
        "number": point.number,
        "axis": point.axis,
        "label": point.label,
        "set_point_mm": point.set_point[:3],
        "set_point_rad": point.set_point[3:],
        "after_discard": point.after_discard,
        "missing": point.missing or None,
        "acoustic_mm": None if result is None else result.acoustic_mm,
        "fused_mm": None if result is None else result.fused_mm,
        "raw_mm": None if result is None else result.raw_mm,
        "attitude_rad": None if result is None else result.attitude_rad,
        "published_truth_mm": None if result is None else point.published_truth_mm,
        "truth_mm": point.truth_mm,
        "truth_std_mm": None if point.truth_covariance_mm2 is None else np.sqrt(np.diag(point.truth_covariance_mm2)),
        "truth_covariance_mm2": point.truth_covariance_mm2,
    }
