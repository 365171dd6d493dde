"""The recorder: the longest queue of all, and the one thread that may wait for the disk.

The event loop only appends to the queue (`observe`); the thread wakes five times a second, writes what came, and hands
it to the kernel at least every half second, so a killed process loses less than the last second. A disk that is full,
missing or read-only stops nothing else: records wait in the queue, the thread tries again every two seconds, and what
the queue cannot hold is dropped, counted and called an error.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import orjson

from bluerov_slam import __version__, records
from bluerov_slam.errors import RecordingError
from bluerov_slam.pipeline.health import RecorderFacts, RecorderState
from bluerov_slam.sinks.disk_guard import DiskFullError, DiskGuard, describe_os_error
from bluerov_slam.sinks.session_recovery import recover_sessions
from bluerov_slam.sinks.session_writer import SessionStart, SessionWriter

_log = logging.getLogger(__name__)

CYCLE_S = 0.2
FLUSH_S = 0.4
SYNC_S = 5.0
SAVE_S = 10.0
GUARD_S = 2.0
RETRY_S = 2.0
RATE_WINDOW_S = 10.0
WALL_STEP_S = 0.5

# Bytes of link that may precede the first valid frame in a recording.
PRE_ROLL_BYTES = 64 * 1024
# What a queued record costs beside its payload.
_RECORD_BYTES = 1024
_NAVIGATION_BYTES = 4096
_BLOCK_BYTES = 192

# A decoded record of one of these types proves that the link carries valid frames.
_VALID_FRAME = (
    records.SensorSample,
    records.ImuBurst,
    records.GpsFix,
    records.DeviceStatus,
    records.CommandAck,
    records.SonarFrames,
    records.TimeDifferenceReading,
    records.AcousticRecord,
    records.AcousticMessage,
)
# The bulk of what is decoded or estimated: left out first when the disk does not keep up, because it can be made anew
# from the raw bytes.
_BULK = (records.Ping, records.ImuBurst, records.NavState)
# Rebuilt from the raw bytes, or of no use later.
_NOT_RECORDED = (records.SonarFrames, records.UnknownFrame, records.AcousticRecord)


@dataclass(frozen=True, slots=True)
class RecordingLimits:
    """When to begin a new file, how much disk to leave free, how much memory may wait for the disk."""

    max_file_bytes: int = 256 * 1024 * 1024
    max_file_s: float = 3600.0
    min_free_bytes: int = 500_000_000
    queue_bytes: int = 16 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class Clocks:
    """The two clocks a recording needs, in nanoseconds; tests bring their own."""

    monotonic_ns: Callable[[], int] = time.monotonic_ns
    wall_ns: Callable[[], int] = time.time_ns


@dataclass(slots=True)
class _Due:
    """Repeats after `period_s`."""

    period_s: float
    last_ns: int | None = field(default=None)

    def __call__(self, now_ns: int) -> bool:
        if self.last_ns is not None and now_ns - self.last_ns < self.period_s * 1e9:
            return False
        self.last_ns = now_ns
        return True


class Recorder:
    """Records everything that `observe` is given while it is switched on.

    `decoder_settings` are kept in the recording so that a replay decodes as the live run did, and `navigation_settings`
    (asked when a session begins) so that the same estimate can be made again. `on_event(level, text)` and
    `navigation_settings()` are called on the recorder's own thread.
    """

    def __init__(
        self,
        folder: Path,
        limits: RecordingLimits | None = None,
        *,
        enabled: bool = True,
        simulated: bool = False,
        decoder_settings: Mapping[str, object] | None = None,
        navigation_settings: Callable[[], Mapping[str, object]] = dict,
        on_event: Callable[[records.EventLevel, str], None] | None = None,
        clocks: Clocks | None = None,
    ) -> None:
        self.folder = folder
        self.limits = limits or RecordingLimits()
        self._simulated = simulated
        self._decoder_settings = dict(decoder_settings or {})
        self._navigation_settings = navigation_settings
        self._on_event = on_event
        self._clocks = clocks or Clocks()
        self._guard = DiskGuard(folder, self.limits.min_free_bytes)
        # Shared between the event loop and the thread: a deque whose two ends are each used by one side.
        self._queue: deque[records.Record] = deque()
        self._bytes_in = 0
        self._bytes_out = 0
        self._bytes_dropped = 0
        self._dropped = 0
        self._left_out = 0
        self._armed = enabled
        self._frame_seen = False
        self._wake = threading.Event()
        self._settled = threading.Condition()
        self._requests = 0
        self._requests_done = 0
        self._stopping = False
        self._thread: threading.Thread | None = None
        # Used by the thread only.
        self._session: SessionWriter | None = None
        self._error: str | None = None
        self._disk_full = False
        self._recovered = False
        self._lock_descriptor = -1
        self._dropped_reported = 0
        self._wall_offset_ns: int | None = None
        self._flush_due = _Due(FLUSH_S)
        self._sync_due = _Due(SYNC_S)
        self._save_due = _Due(SAVE_S)
        self._guard_due = _Due(GUARD_S)
        self._retry_at_ns = 0
        self._rate: deque[tuple[int, int]] = deque(maxlen=int(RATE_WINDOW_S / FLUSH_S))

    # Event loop side: never blocks.

    def observe(self, record: records.Record) -> None:
        """Queue one record. Subscribe it to the hub for every record."""
        if isinstance(record, _VALID_FRAME):
            self._frame_seen = True
        if not self._armed or isinstance(record, _NOT_RECORDED):
            return
        if isinstance(record, _BULK) and self._bytes_waiting() > self.limits.queue_bytes // 2:
            self._left_out += 1
            return
        self._queue.append(record)
        self._bytes_in += _cost(record)
        if self._frame_seen:
            self._make_room(self.limits.queue_bytes, counted=True)
        else:
            self._make_room(PRE_ROLL_BYTES, counted=False)

    def request_start(self) -> None:
        """Record from now on (from the next valid frame when none was seen yet)."""
        self._armed = True
        self._request()

    def request_stop(self) -> None:
        """End the session and record no more until asked."""
        self._armed = False
        self._request()

    def settle(self, timeout_s: float) -> bool:
        """Wait until the thread has acted on the last request; for a worker thread, not the event loop."""
        with self._settled:
            return self._settled.wait_for(lambda: self._requests_done == self._requests, timeout_s)

    @property
    def armed(self) -> bool:
        """True while it records or waits for something to record."""
        return self._armed

    @property
    def active_name(self) -> str | None:
        """Name of the session being written."""
        session = self._session
        return session.name if session else None

    @property
    def log_path(self) -> str | None:
        """Path of the JSONL file being written."""
        session = self._session
        return str(session.jsonl_path) if session and session.jsonl_path else None

    def set_limits(self, limits: RecordingLimits) -> None:
        """Use other limits from now on."""
        self.limits = limits
        self._guard.min_free_bytes = limits.min_free_bytes

    def facts(self) -> RecorderFacts:
        """What the status page shows; asks no disk."""
        session = self._session
        disk = self._guard.state
        rate = self._bytes_per_s()
        return RecorderFacts(
            state=self._state(),
            file=str(session.mcap_path) if session and session.mcap_path else None,
            bytes=session.size if session else 0,
            bytes_per_s=rate,
            dropped=self._dropped,
            queue=len(self._queue),
            free_bytes=disk.free_bytes,
            seconds_left=self._guard.seconds_left(rate),
            error=self._error,
        )

    def start(self) -> None:
        """Start the thread: it first repairs sessions that were cut short."""
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Write everything queued, close the session, end the thread. Blocks: call it from a worker."""
        self._stopping = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    # Thread side.

    def cycle(self) -> None:
        """Everything that is due now; what the thread repeats."""
        now_ns = self._clocks.monotonic_ns()
        requests = self._requests
        if now_ns >= self._retry_at_ns:
            self._try(now_ns)
        self._report_drops()
        with self._settled:
            self._requests_done = requests
            self._settled.notify_all()

    def finish(self) -> None:
        """Write what is queued and close the session; a disk that refuses leaves it for the next start to repair."""
        self._retry_at_ns = 0
        self.cycle()
        self._close_session()
        if self._lock_descriptor >= 0:
            os.close(self._lock_descriptor)
            self._lock_descriptor = -1
        self._recovered = False

    def _run(self) -> None:
        while not self._stopping:
            self._wake.wait(CYCLE_S)
            self._wake.clear()
            try:
                self.cycle()
            except Exception:
                _log.exception("the recorder failed; it goes on")
                self._fail("internal error of the recorder, see the log; it goes on", self._clocks.monotonic_ns())
        self.finish()

    def _try(self, now_ns: int) -> None:
        try:
            self._write_queue(now_ns)
            self._clear_error()
        except DiskFullError as error:
            self._fail(str(error), now_ns, disk_full=True)
        except RecordingError as error:
            self._fail(str(error), now_ns)
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            self._fail(describe_os_error(error, self.folder), now_ns, disk_full=full)

    def _write_queue(self, now_ns: int) -> None:
        if not self._armed:
            self._close_session()
            return
        self._check_disk(now_ns)
        self._take_folder()
        if self._session is not None and self._session.is_gone:
            self._leave_session(self._session)
        if self._session is None and self._frame_seen:
            self._open_session(now_ns)
        session = self._session
        if session is None:
            return
        session.resume()
        self._note_wall_clock(session, now_ns)
        self._drain(session)
        if self._flush_due(now_ns):
            session.flush()
            self._rate.append((now_ns, session.size))
        session.rotate_if_due(now_ns, self.limits.max_file_bytes, self.limits.max_file_s)
        if self._sync_due(now_ns):
            session.sync()
        if self._save_due(now_ns):
            session.save()

    def _check_disk(self, now_ns: int) -> None:
        if self._guard_due(now_ns) and (problem := self._guard.problem()):
            raise DiskFullError(problem)

    def _take_folder(self) -> None:
        """Once: take the folder for this process and repair what an earlier one left open."""
        if self._recovered:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        if self._lock_descriptor < 0:
            self._lock_descriptor = _lock(self.folder)
        for name in recover_sessions(self.folder):
            self._tell(records.EventLevel.WARNING, f"recording {name} was cut short; it has been repaired")
        self._recovered = True

    def _open_session(self, now_ns: int) -> None:
        try:
            first = self._queue[0]
        except IndexError:
            return
        raw = records.LinkBytes | records.AcousticBytes
        first_ns = min(now_ns, round(first.arrived_s * 1e9)) if isinstance(first, raw) else now_ns
        wall_ns = self._clocks.wall_ns()
        metadata = {
            "bluerov_slam_version": __version__,
            "decoder_settings": orjson.dumps(self._decoder_settings).decode(),
            "navigation_settings": orjson.dumps(self._navigation_settings()).decode(),
            "simulated": "true" if self._simulated else "false",
        }
        self._session = SessionWriter(self.folder, SessionStart(first_ns, wall_ns - (now_ns - first_ns), metadata))
        self._wall_offset_ns = wall_ns - now_ns
        self._rate.clear()
        self._tell(records.EventLevel.INFO, f"recording into {self._session.folder}")

    def _leave_session(self, session: SessionWriter) -> None:
        """Somebody deleted or moved it, as a file browser lets one: what follows belongs into a new one."""
        waiting = session.take_waiting()
        self._queue.extendleft(reversed(waiting))
        self._bytes_out -= sum(map(_cost, waiting))
        session.release()
        self._session = None
        text = f"recording {session.name} was deleted or moved while it was being written; a new one is begun"
        self._tell(records.EventLevel.ERROR, text)

    def _drain(self, session: SessionWriter) -> None:
        for _ in range(len(self._queue)):
            try:
                record = self._queue.popleft()
            except IndexError:  # the other side made room meanwhile
                return
            self._bytes_out += _cost(record)
            session.write(record)

    def _close_session(self) -> None:
        session = self._session
        if session is None:
            self._queue_is_stale()
            return
        try:
            self._drain(session)
            session.close()
        except OSError as error:
            self._dropped += session.waiting
            session.release()
            self._tell(records.EventLevel.ERROR, describe_os_error(error, self.folder))
        self._session = None
        self._rate.clear()
        self._tell(records.EventLevel.INFO, f"recording {session.name} ended, {session.size} bytes")

    def _queue_is_stale(self) -> None:
        """Switched off without a session: what waited for a first frame belongs to no recording."""
        while self._queue:
            self._bytes_out += _cost(self._queue.popleft())

    def _fail(self, text: str, now_ns: int, disk_full: bool = False) -> None:
        self._retry_at_ns = now_ns + int(RETRY_S * 1e9)
        self._guard_due.last_ns = None
        if self._session is not None:
            self._session.suspend()
        news = self._error is None or self._error.split(":")[0] != text.split(":")[0]
        self._error, self._disk_full = text, disk_full
        if news:
            self._tell(records.EventLevel.ERROR, text)

    def _clear_error(self) -> None:
        self._retry_at_ns = 0
        if self._error is not None:
            self._error = None
            left_out, self._left_out = self._left_out, 0
            note = f"; {left_out} decoded pings, IMU bursts and estimates were left out, the raw bytes hold them"
            if self._armed:
                self._tell(records.EventLevel.INFO, "recording works again" + (note if left_out else ""))

    def _note_wall_clock(self, session: SessionWriter, now_ns: int) -> None:
        offset_ns = self._clocks.wall_ns() - now_ns
        before_ns, self._wall_offset_ns = self._wall_offset_ns, offset_ns
        if before_ns is None or abs(offset_ns - before_ns) < WALL_STEP_S * 1e9:
            return
        step_s = (offset_ns - before_ns) * 1e-9
        session.note_wall_step(now_ns, step_s)
        text = f"the wall clock stepped by {step_s:+.1f} s; the recording keeps the time it started with"
        session.write(records.Event(now_ns * 1e-9, records.EventLevel.WARNING, text))
        session.save()

    def _report_drops(self) -> None:
        new = self._dropped - self._dropped_reported
        if new and (self._dropped_reported == 0 or new >= 1000):
            self._dropped_reported = self._dropped
            text = (
                f"{self._dropped} records could not be written in time and are lost: {self._error or 'disk too slow'}"
            )
            self._tell(records.EventLevel.ERROR, text)

    def _make_room(self, limit: int, counted: bool) -> None:
        while self._bytes_waiting() > limit:
            try:
                oldest = self._queue.popleft()
            except IndexError:  # the thread took it meanwhile
                return
            self._bytes_dropped += _cost(oldest)
            if counted:
                self._dropped += 1

    def _bytes_waiting(self) -> int:
        return self._bytes_in - self._bytes_out - self._bytes_dropped

    def _request(self) -> None:
        with self._settled:
            self._requests += 1
        self._retry_at_ns = 0
        self._wake.set()

    def _state(self) -> RecorderState:
        if self._error is not None:
            return RecorderState.DISK_FULL if self._disk_full else RecorderState.FAILED
        if self._session is not None:
            return RecorderState.RECORDING
        return RecorderState.WAITING if self._armed else RecorderState.OFF

    def _bytes_per_s(self) -> float:
        if len(self._rate) < 2:
            return 0.0
        (first_ns, first_size), (last_ns, last_size) = self._rate[0], self._rate[-1]
        return (last_size - first_size) / max(1e-3, (last_ns - first_ns) * 1e-9)

    def _tell(self, level: records.EventLevel, text: str) -> None:
        _log.log(_LOG_LEVELS[level], text)
        if self._on_event is not None:
            self._on_event(level, text)


_LOG_LEVELS = {
    records.EventLevel.INFO: logging.INFO,
    records.EventLevel.WARNING: logging.WARNING,
    records.EventLevel.ERROR: logging.ERROR,
}


def _cost(record: records.Record) -> int:
    if isinstance(record, records.LinkBytes | records.LinkBytesSent | records.AcousticBytes):
        return len(record.data) + _BLOCK_BYTES
    if isinstance(record, records.Ping):
        return len(record.samples) + _RECORD_BYTES
    if isinstance(record, records.NavState):
        return _NAVIGATION_BYTES
    return _RECORD_BYTES


def _lock(folder: Path) -> int:
    """Take the recordings folder for this process: two recorders in one folder would repair each other's sessions."""
    descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise RecordingError(
            f"another process records into {folder}; stop it, or give this one its own recording.folder"
        ) from None
    except OSError as error:
        _log.warning("%s cannot be locked against a second recorder: %s", folder, error)
    return descriptor
