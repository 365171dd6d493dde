"""The plain log: a line per SENSORS frame (the seed's JSON), outside position and acoustic pulse; the estimate at 1 Hz.

Every line has `t_mono` and `t_unix`; lines that are not of a SENSORS frame say what they are in `type`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import orjson

from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.pipeline.link_decoder import SonarActivity
from bluerov_slam.protocol.acoustic_json import fix_json
from bluerov_slam.protocol.navigation_json import navigation_json
from bluerov_slam.protocol.sensor_json import sensor_json
from bluerov_slam.records import AcousticFix, Channel, CtdSample, NavState, PositionFix, SensorSample
from bluerov_slam.sinks.append_file import AppendFile


class SensorLines:
    """Turns samples into lines.

    A sample waits for the CtdSample computed from it, which the decoder hands over next.
    """

    def __init__(self, wall_offset_ns: int | None) -> None:
        """`wall_offset_ns`: wall clock less monotonic clock; None where it is not known, and `t_unix` is null."""
        self._wall_offset_s = None if wall_offset_ns is None else wall_offset_ns * 1e-9
        self._activity = SonarActivity()
        self._waiting: SensorSample | None = None

    def feed(self, record: SensorSample | CtdSample) -> list[bytes]:
        """The lines that became complete, each with its newline."""
        if isinstance(record, SensorSample):
            lines = self.flush()
            self._waiting = record
            return lines
        if self._waiting is None or self._waiting.measured_s != record.measured_s:
            return []
        sample, self._waiting = self._waiting, None
        return [self._line(sample, record)]

    def flush(self) -> list[bytes]:
        """The line of a sample that no CtdSample followed."""
        if self._waiting is None:
            return []
        sample, self._waiting = self._waiting, None
        return [self._line(sample, None)]

    def _line(self, sample: SensorSample, ctd: CtdSample | None) -> bytes:
        self._activity.observe(sample)
        a_alive, b_alive = self._activity.alive(Channel.A), self._activity.alive(Channel.B)
        content: dict[str, Any] = dict(sensor_json(sample, a_alive, b_alive, ctd))
        content["t_mono"] = sample.measured_s
        content["t_unix"] = None if self._wall_offset_s is None else sample.measured_s + self._wall_offset_s
        return orjson.dumps(content, option=orjson.OPT_APPEND_NEWLINE)


class NavigationLines:
    """Turns estimates and positions into lines."""

    def __init__(self, wall_offset_ns: int, simulated: bool) -> None:
        self._wall_offset_s = wall_offset_ns * 1e-9
        self._simulated = simulated

    def state(self, state: NavState) -> bytes:
        """The line of an estimate: the topic's `data`."""
        place = None
        if state.origin_deg is not None and state.position_ned_m is not None:
            place = LocalFrame(*state.origin_deg).to_geodetic(*state.position_ned_m)[:2]
        return self._line("navigation", state.measured_s, navigation_json(state, place, simulated=self._simulated))

    def fix(self, fix: PositionFix) -> bytes:
        """The line of a position from outside, its fields by their own names."""
        content = {
            "source": fix.source,
            "latitude_deg": fix.latitude_deg,
            "longitude_deg": fix.longitude_deg,
            "covariance_ne_m2": fix.covariance_ne_m2,
            "depth_m": fix.depth_m,
        }
        return self._line("position_fix", fix.measured_s, content)

    def acoustic(self, fix: AcousticFix) -> bytes:
        """The line of one acoustic pulse."""
        return self._line("acoustics", fix.measured_s, fix_json(fix))

    def _line(self, kind: str, at_s: float, content: dict[str, Any]) -> bytes:
        line = {"type": kind, **content, "t_mono": at_s, "t_unix": at_s + self._wall_offset_s}
        return orjson.dumps(line, option=orjson.OPT_APPEND_NEWLINE)


class JsonlLog:
    """Appends whole lines; lines the disk did not take stay here until it does."""

    def __init__(self, path: Path) -> None:
        """Create `path` (it must not exist). Raises OSError."""
        self.path = path
        self._file = AppendFile(path)
        self._lines: list[bytes] = []

    @property
    def size(self) -> int:
        """Bytes handed to the kernel."""
        return self._file.size

    @property
    def is_deleted(self) -> bool:
        """Whether somebody deleted the file meanwhile."""
        return self._file.is_deleted

    def write(self, lines: list[bytes]) -> None:
        """Take whole lines for the next flush."""
        self._lines += lines

    def flush(self) -> None:
        """Hand the lines to the kernel, whole or not at all. Raises OSError, and keeps the lines."""
        if not self._lines:
            return
        self._file.write(b"".join(self._lines))
        self._file.flush()
        self._lines.clear()

    def sync(self) -> None:
        """Have the kernel write to the disk. Raises OSError."""
        self._file.sync()

    def close(self) -> None:
        """Flush and close. Raises OSError; the file is closed in any case."""
        try:
            self.flush()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close without what the disk did not take."""
        self._file.close()
