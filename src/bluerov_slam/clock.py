"""Device time on the host's monotonic clock, and the host's monotonic clock on the wall clock.

The ESP32 stamps with one 64-bit timer of which the wire carries the low 32 bits of its microseconds (wrapping after
71.6 minutes) or of its milliseconds (49.7 days). A message cannot arrive before it was made, so

    arrived - device = offset + drift * device + delay,    delay >= 0

and the lower envelope of the left side over many messages is the offset with the smallest delay there is. Its slope
is found as the edge of the lower convex hull over the middle of the last ten minutes (Moon, Skelly, Towsley 1999,
doi:10.1109/INFCOM.1999.749287), which no single late message can disturb.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

_WRAP = 1 << 32
_HALF = 1 << 31
_US_PER_MS = 1000

BUCKET_S = 10.0
BUCKETS = 60
# Bursts and pings carry the time of their first sample, so stamps run back a little in a healthy stream.
BACKWARD_TOLERANCE_US = 2_000_000
# Millisecond stamps are made when the frame is queued: they run back only where a more urgent frame overtook another.
BACKWARD_TOLERANCE_MS = 300
# What waited for room on a slow link (a raw acoustic record) may be this old when it comes.
LATE_TOLERANCE_US = 60_000_000
# How far a device stamp may run ahead of the host's clock before it must be another boot that happens to look later.
FORWARD_TOLERANCE_US = 5_000_000
# An ESP32 crystal is good to 40 ppm; a fitted slope beyond this is noise.
MAX_DRIFT = 200e-6
_MIN_BUCKETS_FOR_DRIFT = 6
# The frames of one ping carry the same stamp; the later ones tell nothing new.
_SAME_STAMP_S = 60.0


class DeviceClock:
    """Maps 32-bit stamps of one device to host monotonic seconds."""

    def __init__(self) -> None:
        self.resets = 0
        self._last_us: int | None = None
        self._last_ms: int | None = None
        self._echo_offset_s: float | None = None
        self._closed: deque[tuple[float, float]] = deque(maxlen=BUCKETS)
        self._open: tuple[float, float] | None = None
        self._suspect_us: tuple[int, float] | None = None
        self._suspect_ms: tuple[int, float] | None = None
        self._same_us: int | None = None
        self._same_arrived_s = 0.0
        self._same_s = 0.0
        self._forget()

    @property
    def offset_s(self) -> float | None:
        """Host minus device time now, s; None before the first stamp."""
        return None if self._last_us is None else self._offset_at(self._last_us / 1e6)

    @property
    def drift_ppm(self) -> float | None:
        """How much faster the host's clock runs than the device's, parts per million; None until it can be told."""
        return self._slope * 1e6 if len(self._closed) >= _MIN_BUCKETS_FOR_DRIFT else None

    @property
    def uncertainty_s(self) -> float | None:
        """Upper bound of the constant delay hidden in the offset; known only once a TIME_SYNC was echoed."""
        offset_s = self.offset_s
        if offset_s is None or self._echo_offset_s is None:
            return None
        return max(0.0, offset_s - self._echo_offset_s)

    def map_us32(self, t_us: int, arrived_s: float) -> float:
        """Host time of a stamp in device microseconds modulo 2^32 that arrived at `arrived_s`."""
        return self._map_stamp(t_us, arrived_s)

    def map_late_us32(self, kind: int, t_us: int, arrived_s: float) -> float:
        """`map_us32` for what is sent at the lowest priority: stamps that may be long past and tell no reset.

        Stamps of one `kind` ascend among themselves; one that does not is of another boot and mapped as any other.
        """
        previous_us = self._last_late_us.get(kind)
        ascends = previous_us is None or (t_us - previous_us) % _WRAP < _HALF
        behind_us = 0 if self._last_us is None else (self._last_us - t_us) % _WRAP
        if ascends and 0 < behind_us < LATE_TOLERANCE_US:
            assert self._last_us is not None
            device_s = (self._last_us - behind_us) / 1e6
            measured_s = min(arrived_s, device_s + self._offset_at(device_s))
        else:
            measured_s = self._map_stamp(t_us, arrived_s)
            if self._suspect_us is not None:
                return measured_s
        self._last_late_us[kind] = t_us
        return measured_s

    def map_ms32(self, t_ms: int, arrived_s: float) -> float:
        """Host time of a stamp in device milliseconds modulo 2^32; also tells a reset that microseconds hide."""
        behind_ms = 0 if self._last_ms is None else (self._last_ms - t_ms) % _WRAP
        if BACKWARD_TOLERANCE_MS < behind_ms < _HALF:
            suspect, self._suspect_ms = self._suspect_ms, (t_ms, arrived_s)
            if suspect is None or not _agree(suspect, self._suspect_ms, _US_PER_MS):
                return arrived_s
            self.restart()
        self._suspect_ms = None
        measured_s = self._map_stamp(t_ms * _US_PER_MS % _WRAP, arrived_s)
        if self._suspect_us is None:
            self._last_ms = t_ms
        return measured_s

    def note_echo(self, sent_s: float, device_us32: int) -> None:
        """A TIME_SYNC sent at host time `sent_s` reached the device at `device_us32`: bounds the offset from below."""
        if self._last_us is None:
            return
        device_us = self._last_us + (device_us32 - self._last_us + _HALF) % _WRAP - _HALF
        self._echo_offset_s = sent_s - device_us / 1e6

    def restart(self) -> None:
        """The device started again: forget its old time."""
        if self._last_us is not None:
            self.resets += 1
        self._forget()

    def _forget(self) -> None:
        self._last_us = None
        self._last_arrived_s = 0.0
        self._last_ms = None
        self._closed.clear()
        self._open = None
        self._open_ends_s = 0.0
        self._suspect_us = None
        self._suspect_ms = None
        self._same_us = None
        self._last_late_us: dict[int, int] = {}
        self._anchor_s = 0.0
        self._base_offset_s = float("inf")
        self._slope = 0.0
        self._echo_offset_s = None

    def _map_stamp(self, t_us: int, arrived_s: float) -> float:
        if t_us == self._same_us and 0 <= arrived_s - self._same_arrived_s < _SAME_STAMP_S:
            return self._same_s
        last_us = self._last_us
        if last_us is None:
            self._start(t_us, arrived_s)
            last_us = t_us
        # The 64-bit time nearest to where the device's clock must be by now.
        elapsed_us = int((arrived_s - self._last_arrived_s) * 1e6)
        ahead_us = (t_us - last_us - elapsed_us + _HALF) % _WRAP - _HALF
        device_us = last_us + elapsed_us + ahead_us
        if self._is_reset(device_us, ahead_us, arrived_s):
            suspect, self._suspect_us = self._suspect_us, (t_us, arrived_s)
            if suspect is None or not _agree(suspect, self._suspect_us, 1):
                return arrived_s
            self.restart()
            self._start(t_us, arrived_s)
            device_us = t_us
        self._suspect_us = None
        self._same_us, self._same_arrived_s = t_us, arrived_s
        self._same_s = self._map(device_us, arrived_s)
        return self._same_s

    def _start(self, t_us: int, arrived_s: float) -> None:
        self._last_us, self._last_arrived_s = t_us, arrived_s
        self._anchor_s = t_us / 1e6
        self._open_ends_s = (self._anchor_s // BUCKET_S + 1) * BUCKET_S

    def _is_reset(self, device_us: int, ahead_us: int, arrived_s: float) -> bool:
        """Whether the stamp belongs to another time line."""
        if self._last_us is None or device_us < self._last_us - BACKWARD_TOLERANCE_US:
            return True
        # Bytes that waited while the host was paused arrive late all at once and the next ones are far ahead of them,
        # but not ahead of the envelope.
        return (
            ahead_us > FORWARD_TOLERANCE_US
            and device_us / 1e6 + self._offset_at(device_us / 1e6) - arrived_s > FORWARD_TOLERANCE_US / 1e6
        )

    def _map(self, device_us: int, arrived_s: float) -> float:
        device_s = device_us / 1e6
        if self._last_us is None or device_us >= self._last_us:
            self._last_us, self._last_arrived_s = device_us, arrived_s
        offset_s = arrived_s - device_s
        if self._open is None or offset_s < self._open[1] or device_s >= self._open_ends_s:
            self._collect(device_s, offset_s)
        envelope_s = self._offset_at(device_s)
        if offset_s < envelope_s:
            self._anchor_s, self._base_offset_s = device_s, offset_s
            return arrived_s
        return device_s + envelope_s

    def _offset_at(self, device_s: float) -> float:
        return self._base_offset_s + self._slope * (device_s - self._anchor_s)

    def _collect(self, device_s: float, offset_s: float) -> None:
        if device_s >= self._open_ends_s:
            if self._open is not None:
                self._closed.append(self._open)
                self._fit(device_s)
            self._open = None
            self._open_ends_s = (device_s // BUCKET_S + 1) * BUCKET_S
        if self._open is None or offset_s < self._open[1]:
            self._open = (device_s, offset_s)

    def _fit(self, device_s: float) -> None:
        """Slope and offset from the lower hull of the closed buckets."""
        if len(self._closed) < _MIN_BUCKETS_FOR_DRIFT:
            return
        first, second = _hull_edge_over_the_middle(list(self._closed))
        slope = (second[1] - first[1]) / (second[0] - first[0])
        self._slope = min(max(slope, -MAX_DRIFT), MAX_DRIFT)
        self._anchor_s = device_s
        self._base_offset_s = min(offset + self._slope * (device_s - at_s) for at_s, offset in self._closed)


def _hull_edge_over_the_middle(
    points: list[tuple[float, float]],
) -> tuple[tuple[float, float], tuple[float, float]]:
    """The edge of the lower convex hull that spans the mean abscissa; `points` ascend in it."""
    hull: list[tuple[float, float]] = []
    for point in points:
        while len(hull) >= 2 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    middle = sum(x for x, _ in points) / len(points)
    right = next((k for k in range(1, len(hull)) if hull[k][0] >= middle), len(hull) - 1)
    return hull[right - 1], hull[right]


def _turns_right(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])


def _agree(first: tuple[int, float], second: tuple[int, float], us_per_unit: int) -> bool:
    """One stamp from another time line may be a damaged frame that passed its check; two that agree are a reset."""
    device_step_us = ((second[0] - first[0] + _HALF) % _WRAP - _HALF) * us_per_unit
    return abs(device_step_us - (second[1] - first[1]) * 1e6) < FORWARD_TOLERANCE_US


@dataclass(frozen=True, slots=True)
class WallClockStep:
    """The wall clock was set: at `at_s` (monotonic) its offset changed by `by_s`."""

    at_s: float
    by_s: float


class WallClock:
    """Wall clock minus monotonic clock. Readings are passed in; a step is recorded, never smoothed away."""

    def __init__(self, wall_unix_s: float, monotonic_s: float, step_threshold_s: float = 0.5) -> None:
        self._step_threshold_s = step_threshold_s
        self._offset_s = wall_unix_s - monotonic_s
        self._steps: list[WallClockStep] = []
        self._gps_minus_wall_s: float | None = None

    @property
    def offset_s(self) -> float:
        """Add this to monotonic seconds to get Unix seconds of the wall clock."""
        return self._offset_s

    @property
    def steps(self) -> tuple[WallClockStep, ...]:
        """Every step seen, oldest first."""
        return tuple(self._steps)

    @property
    def gps_utc_offset_s(self) -> float | None:
        """GPS time minus wall clock, s; None before the first GPS time. What dates a session whose clock was wrong."""
        return self._gps_minus_wall_s

    def is_trusted(self, tolerance_s: float = 2.0) -> bool | None:
        """Whether the wall clock agrees with GPS time; None when GPS never told the time."""
        return None if self._gps_minus_wall_s is None else abs(self._gps_minus_wall_s) <= tolerance_s

    def unix_s(self, monotonic_s: float) -> float:
        """Unix seconds of the wall clock at a monotonic instant, by the present offset."""
        return monotonic_s + self._offset_s

    def observe(self, wall_unix_s: float, monotonic_s: float) -> WallClockStep | None:
        """Compare the two clocks now; returns the step if the wall clock was set since the last look."""
        offset_s = wall_unix_s - monotonic_s
        by_s = offset_s - self._offset_s
        self._offset_s = offset_s
        if abs(by_s) < self._step_threshold_s:
            return None
        step = WallClockStep(monotonic_s, by_s)
        self._steps.append(step)
        if self._gps_minus_wall_s is not None:
            self._gps_minus_wall_s -= by_s
        return step

    def note_gps(self, utc_unix_s: float, measured_s: float) -> None:
        """GPS said it was `utc_unix_s` at the monotonic instant `measured_s`."""
        self._gps_minus_wall_s = utc_unix_s - self.unix_s(measured_s)
