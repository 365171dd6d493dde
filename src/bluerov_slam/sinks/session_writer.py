"""One dive on disk: a folder with its MCAP parts, its JSONL parts and session.json."""

from __future__ import annotations

import contextlib
import datetime
import logging
import shutil
import statistics
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bluerov_slam import records
from bluerov_slam.errors import RecordingError
from bluerov_slam.sinks.jsonl_log import JsonlLog, NavigationLines, SensorLines
from bluerov_slam.sinks.mcap_log import PING_TOPICS, McapLog, to_ns
from bluerov_slam.sinks.mcap_recovery import recover_mcap
from bluerov_slam.sinks.session_file import change_session, new_session
from bluerov_slam.sinks.state_thinning import StateThinning

_log = logging.getLogger(__name__)

# GPS UTC and the wall clock may differ by this much before the wall clock counts as wrong: NMEA arrives up to 1 s late.
TRUSTED_OFFSET_S = 2.0
_GPS_FIXES_KEPT = 15
# Estimates are recorded this far apart: the inputs are recorded whole, so that each can be made anew.
NAVIGATION_PERIOD_S = 0.5
NAVIGATION_LINE_PERIOD_S = 1.0


@dataclass(frozen=True, slots=True)
class SessionStart:
    """The two clocks at the start of a session, and what a replay needs to decode as the live run did."""

    mono_ns: int
    wall_ns: int
    metadata: dict[str, str]


class SessionWriter:
    """Writes records into the current parts. Every method may raise OSError; nothing unwritten is lost by that."""

    def __init__(self, root: Path, start: SessionStart) -> None:
        self.wall_offset_ns = start.wall_ns - start.mono_ns
        self.folder = _make_folder(root, start.wall_ns)
        self.name = self.folder.name
        self.pings = dict.fromkeys(PING_TOPICS, 0)
        self.mcap_path: Path | None = None
        self.jsonl_path: Path | None = None
        self._start = start
        self._last_ns = start.mono_ns
        self._part = 0
        self._jsonl_part = 0
        self._part_started_ns = start.mono_ns
        self._closed_bytes = 0
        self._mcap: McapLog | None = None
        self._jsonl: JsonlLog | None = None
        self._lines = SensorLines(self.wall_offset_ns)
        self._navigation_lines = NavigationLines(self.wall_offset_ns, start.metadata.get("simulated") == "true")
        self._navigation_due = StateThinning(NAVIGATION_PERIOD_S)
        self._navigation_line_due = StateThinning(NAVIGATION_LINE_PERIOD_S)
        self._lines_failed = 0
        self._unflushed: list[records.Record] = []
        self._cut: list[Path] = []
        self._gps_offsets_s: deque[float] = deque(maxlen=_GPS_FIXES_KEPT)
        self._wall_steps: list[dict[str, float]] = []
        try:
            content = new_session(self.name, start.wall_ns * 1e-9, start.mono_ns * 1e-9)
            change_session(self.folder, lambda session: session.update(content))
            self.resume()
        except OSError:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise

    @property
    def size(self) -> int:
        """Bytes of this session on disk."""
        open_bytes = (self._mcap.size if self._mcap else 0) + (self._jsonl.size if self._jsonl else 0)
        return self._closed_bytes + open_bytes

    @property
    def is_gone(self) -> bool:
        """Whether somebody deleted or moved the session, or one of the files being written."""
        files = (self._mcap, self._jsonl)
        return not self.folder.is_dir() or any(file is not None and file.is_deleted for file in files)

    def take_waiting(self) -> list[records.Record]:
        """What the disk has not got yet, for another session to write."""
        waiting, self._unflushed = self._unflushed, []
        return waiting

    def write(self, record: records.Record) -> None:
        """Take one record for the next flush."""
        if isinstance(record, records.NavState) and not self._navigation_due.wants(record):
            return
        self._unflushed.append(record)
        if self._mcap is not None:
            self._last_ns = max(self._last_ns, _write_mcap(self._mcap, record))
        if self._jsonl is not None:
            self._write_line(self._jsonl, record)
        if isinstance(record, records.Ping):
            self.pings[record.channel] += 1
        elif isinstance(record, records.GpsFix):
            self._note_gps(record)

    def release(self) -> None:
        """Let go of every file as it is; the next start repairs them."""
        if self._mcap is not None:
            self._mcap.abandon()
            self._mcap = None
        if self._jsonl is not None:
            self._jsonl.abandon()
            self._jsonl = None

    @property
    def waiting(self) -> int:
        """Records taken that the disk has not."""
        return len(self._unflushed)

    def flush(self) -> None:
        """Hand everything taken to the kernel."""
        if self._mcap is not None and self._unflushed:
            self._flush_mcap(self._mcap)
        if self._jsonl is not None:
            self._jsonl.flush()

    def sync(self) -> None:
        """Have the kernel write to the disk, against a power cut."""
        if self._mcap is not None:
            self._mcap.sync()
        if self._jsonl is not None:
            self._jsonl.sync()

    def suspend(self) -> None:
        """Let go of the MCAP part, with its footer if the disk takes it; `resume` goes on with what it did not take."""
        if self._mcap is None:
            return
        mcap = self._mcap
        try:
            if self._unflushed:
                self._flush_mcap(mcap)
        except OSError:
            return
        self._mcap = None
        try:
            mcap.finish()
        except OSError:
            self._cut.append(mcap.path)
        self._closed_bytes += mcap.size

    def resume(self) -> None:
        """Open the next MCAP part, if none is open, and write into it what the last one did not take."""
        if self._jsonl is None:
            self.jsonl_path = self.folder / _jsonl_name(self.name, self._jsonl_part)
            self._jsonl = JsonlLog(self.jsonl_path)
            self._jsonl_part += 1
        if self._mcap is None:
            self._jsonl.flush()
            self._mcap = self._open_mcap()
            self._unflushed.clear()
        if self._cut:
            self._repair_cut_parts()

    def rotate_if_due(self, now_ns: int, max_bytes: int, max_s: float) -> None:
        """Begin new parts when the MCAP part is too large or too old."""
        if self._mcap is None or self._unflushed:
            return
        if self._mcap.size < max_bytes and now_ns - self._part_started_ns < max_s * 1e9:
            return
        self.suspend()
        if self._jsonl is not None:
            jsonl, self._jsonl = self._jsonl, None
            self._closed_bytes += jsonl.size
            jsonl.close()
        self._part_started_ns = now_ns
        self.resume()
        self.save()

    def note_wall_step(self, mono_ns: int, step_s: float) -> None:
        """Remember that the wall clock jumped; what is recorded keeps the offset of the start."""
        self._wall_steps.append({"mono_s": mono_ns * 1e-9, "step_s": step_s})

    def save(self, closed: bool = False) -> None:
        """Bring session.json up to date."""
        facts = self._facts() | {"closed": closed}
        change_session(self.folder, lambda session: session.update(facts))

    def close(self) -> None:
        """Write index and footer, close everything, mark the session as whole."""
        if (self._mcap is None and self._unflushed) or self._jsonl is None:
            self.resume()
        if self._jsonl is not None:
            self._jsonl.write(self._lines.flush())
        self.flush()
        self.suspend()
        if self._jsonl is not None:
            jsonl, self._jsonl = self._jsonl, None
            self._closed_bytes += jsonl.size
            jsonl.close()
        self._repair_cut_parts()
        self.save(closed=not self._cut)

    def _write_line(self, jsonl: JsonlLog, record: records.Record) -> None:
        try:
            if isinstance(record, records.SensorSample | records.CtdSample):
                jsonl.write(self._lines.feed(record))
            elif isinstance(record, records.PositionFix):
                jsonl.write([self._navigation_lines.fix(record)])
            elif isinstance(record, records.AcousticFix):
                jsonl.write([self._navigation_lines.acoustic(record)])
            elif isinstance(record, records.NavState) and self._navigation_line_due.wants(record):
                jsonl.write([self._navigation_lines.state(record)])
        except (TypeError, ValueError, ArithmeticError, LookupError):
            # Never at the cost of the raw bytes, from which it can be made again.
            self._lines_failed += 1
            if self._lines_failed == 1:
                _log.exception("a %s has no line in the text log; the recording holds it", type(record).__name__)

    def _open_mcap(self) -> McapLog:
        path = self.folder / f"link_{self._part:03d}.mcap"
        metadata = self._start.metadata | {
            "session": self.name,
            "part": str(self._part),
            "wall_offset_ns": str(self.wall_offset_ns),
        }
        mcap = McapLog(path, self.wall_offset_ns, metadata)
        try:
            for record in self._unflushed:
                _write_mcap(mcap, record)
            mcap.flush()
        except OSError:
            mcap.abandon()
            path.unlink(missing_ok=True)
            raise
        self._part += 1
        self.mcap_path = path
        return mcap

    def _flush_mcap(self, mcap: McapLog) -> None:
        """After a failure the writer's own index is wrong: the part is left as it is and repaired later."""
        try:
            mcap.flush()
        except OSError:
            mcap.abandon()
            self._mcap = None
            self._closed_bytes += mcap.size
            self._cut.append(mcap.path)
            raise
        self._unflushed.clear()

    def _repair_cut_parts(self) -> None:
        for path in list(self._cut):
            with contextlib.suppress(OSError, RecordingError):
                recover_mcap(path)
                self._cut.remove(path)

    def _note_gps(self, fix: records.GpsFix) -> None:
        # Before its first fix a receiver tells the time of its own clock, which may be off by anything.
        if fix.utc_unix_s is None or fix.fix is records.FixType.NONE:
            return
        self._gps_offsets_s.append(fix.utc_unix_s - (fix.measured_s + self.wall_offset_ns * 1e-9))
        if len(self._gps_offsets_s) == 1:
            self.save()

    def _facts(self) -> dict[str, Any]:
        offset_s = statistics.median(self._gps_offsets_s) if self._gps_offsets_s else None
        return {
            "duration_s": (self._last_ns - self._start.mono_ns) * 1e-9,
            "pings_a": self.pings[records.Channel.A],
            "pings_b": self.pings[records.Channel.B],
            "gps_utc_offset_s": offset_s,
            "wall_clock_trusted": None if offset_s is None else abs(offset_s) <= TRUSTED_OFFSET_S,
            "wall_steps": self._wall_steps,
        }


def _write_mcap(mcap: McapLog, record: records.Record) -> int:
    if isinstance(record, records.LinkBytes):
        stamp_ns = to_ns(record.arrived_s)
        mcap.write_raw(record.data, stamp_ns)
        return stamp_ns
    if isinstance(record, records.AcousticBytes):
        stamp_ns = to_ns(record.arrived_s)
        mcap.write_datagram(record, stamp_ns)
        return stamp_ns
    if isinstance(record, records.LinkBytesSent):
        mcap.write_raw_down(record.data, to_ns(record.sent_s))
    else:
        mcap.write_record(record)
    return 0


def _make_folder(root: Path, wall_ns: int) -> Path:
    """A new folder named for the start in UTC; a name that is taken moves on by a second."""
    root.mkdir(parents=True, exist_ok=True)
    started = datetime.datetime.fromtimestamp(wall_ns // 1_000_000_000, datetime.UTC)
    while True:
        folder = root / started.strftime("session_%Y%m%d_%H%M%S")
        try:
            folder.mkdir()
        except FileExistsError:
            started += datetime.timedelta(seconds=1)
            continue
        return folder


def _jsonl_name(name: str, part: int) -> str:
    return f"{name}.jsonl" if part == 0 else f"{name}.{part}.jsonl"
