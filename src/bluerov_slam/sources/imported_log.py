"""What an importer hands over: records in one time that never jumps, and an account of what was read and left out."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

from bluerov_slam.records import Record

# Stamps may disagree by this much before the difference counts as a step of the log's clock.
SMALL_STEP_S = 2.0
# One position that came this often is frozen.
_FROZEN_AFTER = 20


@dataclass(slots=True)
class ImportReport:
    """Counts by what they are of. `notes` are whole sentences for the user."""

    read: Counter[str] = field(default_factory=Counter)
    left_out: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Say something once."""
        if text not in self.notes:
            self.notes.append(text)

    def lines(self) -> list[str]:
        """What was read, what was left out and why, and what else there is to say."""
        read = [f"  read      {count:>8}  {what}" for what, count in sorted(self.read.items())]
        left_out = [f"  left out  {count:>8}  {what}" for what, count in self.left_out.most_common()]
        return [*read, *left_out, *(f"  note: {text}" for text in self.notes)]


@dataclass(frozen=True, slots=True)
class ImportedLog:
    """A log as records in order; their time counts from the log's beginning.

    `start_unix_s` is that beginning, None where the log does not say; it is a local time, good for a name but not for
    what is dated, unless `start_is_utc`.
    """

    kind: str
    start_unix_s: float | None
    start_is_utc: bool
    records: list[Record]
    report: ImportReport


class LogClock:
    """Turns the stamps of a log into seconds since its beginning that only go forward.

    A ground station's clock may be set while it logs. Where the log has them (`boot_times`), the times the autopilot
    has been running tell a step of that clock from a pause of the log; without them a step back takes no time and a
    step forward is a pause.
    """

    def __init__(self, report: ImportReport, boot_times: bool) -> None:
        self._report = report
        self._boot_times = boot_times
        self._now_s = 0.0
        self._stamp_s: float | None = None
        self._boot_s: float | None = None
        self._at_boot_s = 0.0
        self._step_s = 0.0

    def at(self, stamp_s: float, boot_s: float | None = None) -> float:
        """The time of an entry; `boot_s` is how long its sender, the autopilot, had been running."""
        passed_s = 0.0 if self._stamp_s is None else stamp_s - self._stamp_s
        if self._stamp_s is None or passed_s >= 0.0 or passed_s < -SMALL_STEP_S:
            self._stamp_s = stamp_s
        if 0.0 <= passed_s <= SMALL_STEP_S:
            self._now_s += passed_s
        elif abs(passed_s) > SMALL_STEP_S:
            # Until the autopilot speaks again nobody knows how long it took.
            self._step_s += passed_s
        if boot_s is not None:
            self._settle(boot_s)
        elif self._step_s and not self._boot_times:
            self._take_step(None)
        return self._now_s

    def _settle(self, boot_s: float) -> None:
        if self._boot_s is not None and boot_s < self._boot_s - SMALL_STEP_S:
            self._report.note(f"the autopilot restarted {self._now_s:.0f} s after the log's beginning")
            self._boot_s = None
        if self._step_s:
            self._take_step(None if self._boot_s is None else self._at_boot_s + boot_s - self._boot_s)
        self._boot_s, self._at_boot_s = boot_s, self._now_s

    def _take_step(self, by_boot_s: float | None) -> None:
        stepped_s = self._now_s + self._step_s
        after_s = max(self._now_s, stepped_s if by_boot_s is None else by_boot_s)
        step_s, self._step_s = stepped_s - after_s, 0.0
        if abs(step_s) > SMALL_STEP_S:
            self._report.note(f"the log's clock was set by {step_s:+.1f} s at {self._now_s:.0f} s; it was put right")
        if after_s - self._now_s > SMALL_STEP_S:
            self._report.note(f"the log pauses for {after_s - self._now_s:.1f} s at {self._now_s:.0f} s")
        self._now_s = after_s


class PositionWatch:
    """Tells positions that are news from those that are none: not there, impossible, or the one before once more.

    A receiver or an acoustic system that measures anew never gives the same ten-millionth of a degree (a centimetre)
    twice in a row for long; what repeats is what it had to say last.
    """

    def __init__(self) -> None:
        self.new = 0
        self.repeated = 0
        self._before: tuple[float, float] | None = None

    @property
    def is_frozen(self) -> bool:
        """Whether all that came was one position."""
        return self.new == 1 and self.repeated >= _FROZEN_AFTER

    def objection(self, latitude_deg: float, longitude_deg: float) -> str | None:
        """Why this position is none, None if it is one."""
        if not (math.isfinite(latitude_deg) and math.isfinite(longitude_deg)):
            return "without numbers"
        if latitude_deg == 0.0 and longitude_deg == 0.0:
            return "at latitude 0, longitude 0: no fix"
        if abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0:
            return "outside the globe"
        position = (latitude_deg, longitude_deg)
        repeated = position == self._before
        self._before = position
        self.repeated += repeated
        self.new += not repeated
        return "that repeat the one before: nothing new was measured" if repeated else None
