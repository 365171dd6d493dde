"""What the navigator has made of each sensor: trust, counts and how well its stated errors fit."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from bluerov_slam.pipeline.navigator_words import Fault, Wait, fault_text, rejected_text, wait_text
from bluerov_slam.records import NavSensor, SensorTrust

if TYPE_CHECKING:
    from collections.abc import Iterator

SENSOR_NAMES = ("imu", "compass", "depth", "gps", "position", "thrust", "dvl", "altitude", "acoustics")
# Not shown before they were heard: few vehicles have one.
RARE = frozenset(("acoustics",))
SILENT_AFTER_S = {"gps": 5.0, "position": 15.0, "acoustics": 10.0}
SILENT_S = 3.0
# So many in a row are more than the odd outlier.
REJECTED_IN_A_ROW = 3
# A fault is shown for a moment, so that one bad value in a hundred can be read.
SHOWN_S = 3.0
NIS_WINDOW = 100
# White noise differs from one installation to the next (vibration, waves, the sensor's copy). It is learned from the
# innovations: the standard deviation of a sensor is multiplied by what brings its mean NIS to one, within limits. Slow
# errors are states of their own and not meant; the lower limits keep them from being taken for precision. An acoustic
# fix's stated error is that of the place, 1 to 20 m, its jitter is centimetres: the widest range.
NOISE_LIMITS = {
    "compass": (0.1, 4.0),
    "depth": (0.05, 5.0),
    "gps": (0.5, 3.0),
    "gps_velocity": (0.5, 4.0),
    "position": (0.05, 4.0),
    "thrust": (0.6, 3.0),
    "dvl": (0.5, 4.0),
    "acoustics": (0.1, 3.0),
}
LEARNING = 0.015
# Values that come one in four seconds must tell more each, or a dive is over before anything was learned.
LEARNING_RARE = {"thrust": 0.05}
# One value tells no more than this, so that an outlier teaches nothing.
MOST_TOLD = 4.0


class SensorStatus:
    """One sensor's account. Times are those of the records."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.heard_s: float | None = None
        self.used_s: float | None = None
        self.accepted = 0
        self.rejected = 0
        self.refused = 0
        self.rejected_in_a_row = 0
        self.noise_scale = 1.0
        self.wait: Wait | None = None
        self.remark = ""
        self.faults: dict[Fault, int] = {}
        self._fault: Fault | None = None
        self._fault_s = 0.0
        self._nis: deque[tuple[float, int]] = deque(maxlen=NIS_WINDOW)
        self.changed = True

    def hear(self, at_s: float) -> None:
        """Something came, good or bad."""
        self.heard_s = at_s if self.heard_s is None else max(self.heard_s, at_s)

    def refuse(self, fault: Fault, at_s: float) -> None:
        """A value was faulty in itself."""
        self.hear(at_s)
        self.changed |= fault is not self._fault
        self.refused += 1
        self.faults[fault] = self.faults.get(fault, 0) + 1
        self._fault, self._fault_s = fault, at_s

    def wait_for(self, wait: Wait | None, at_s: float) -> None:
        """The sensor is healthy and cannot be used for this reason; None: it can."""
        self.hear(at_s)
        self.changed |= wait is not self.wait
        self.wait = wait

    def note(self, remark: str) -> None:
        """What a user should know of a sensor although it is used; empty: nothing."""
        self.changed |= remark != self.remark
        self.remark = remark

    def use(self, at_s: float, nis: float | None = None, dof: int = 0) -> None:
        """A value went into the estimate."""
        self.accepted += 1
        self.changed |= self.rejected_in_a_row >= REJECTED_IN_A_ROW
        self.rejected_in_a_row = 0
        self.used_s = at_s
        if nis is not None:
            self._nis.append((nis, dof))
            self._learn(nis / dof)

    def reject(self, nis: float, dof: int) -> None:
        """A value contradicted the estimate."""
        self.rejected += 1
        self.rejected_in_a_row += 1
        self.changed |= self.rejected_in_a_row == REJECTED_IN_A_ROW
        # The mean shows how well values fit, the count of rejected ones that some did not: one wild value is not both.
        self._nis.append((min(nis, MOST_TOLD * dof), dof))
        if self.rejected_in_a_row <= REJECTED_IN_A_ROW:
            self._learn(nis / dof)

    def fault(self, now_s: float) -> Fault | None:
        """What was wrong within the last moment."""
        return self._fault if self._fault is not None and now_s - self._fault_s <= SHOWN_S else None

    def is_silent(self, now_s: float) -> bool:
        """Whether a sensor that was heard has stopped."""
        return self.heard_s is not None and now_s - self.heard_s > SILENT_AFTER_S.get(self.name, SILENT_S)

    def view(self, now_s: float) -> NavSensor:
        """As the page shows it."""
        trust, reason = self._trust(now_s)
        count, dof = len(self._nis), sum(dof for _, dof in self._nis)
        return NavSensor(
            name=self.name,
            trust=trust,
            reason=reason,
            accepted=self.accepted,
            rejected=self.rejected,
            last_used_s=self.used_s,
            nis_ratio=sum(nis for nis, _ in self._nis) / dof if dof else None,
            nis_count=count,
        )

    def _learn(self, ratio: float) -> None:
        low, high = NOISE_LIMITS.get(self.name, (1.0, 1.0))
        learning = LEARNING_RARE.get(self.name, LEARNING)
        scale = self.noise_scale * math.exp(learning * (min(ratio, MOST_TOLD) - 1.0))
        self.noise_scale = min(max(scale, low), high)

    def _trust(self, now_s: float) -> tuple[SensorTrust, str]:
        if self.heard_s is None:
            return SensorTrust.ABSENT, ""
        if self.is_silent(now_s):
            return SensorTrust.IGNORED, fault_text(self.name, Fault.SILENT)
        fault = self.fault(now_s)
        if fault is not None:
            return SensorTrust.IGNORED, fault_text(self.name, fault)
        if self.wait is not None:
            return SensorTrust.WAITING, wait_text(self.wait)
        if self.rejected_in_a_row >= REJECTED_IN_A_ROW:
            return SensorTrust.REJECTED, rejected_text(self.name)
        if self.used_s is None:
            return SensorTrust.WAITING, wait_text(Wait.NO_ATTITUDE)
        return SensorTrust.USED, self.remark


class SensorBook:
    """All sensors of the page, in its order."""

    def __init__(self) -> None:
        self._statuses = {name: SensorStatus(name) for name in SENSOR_NAMES}
        self._view: tuple[NavSensor, ...] = ()
        self._view_s: float | None = None

    def __getitem__(self, name: str) -> SensorStatus:
        return self._statuses[name]

    def get(self, name: str) -> SensorStatus | None:
        """None for what is no sensor, such as a prior."""
        return self._statuses.get(name)

    def __iter__(self) -> Iterator[SensorStatus]:
        return iter(self._statuses.values())

    def view(self, now_s: float) -> tuple[NavSensor, ...]:
        """All of them; made anew once a second and whenever the trust in one changes."""
        due = self._view_s is None or not 0.0 <= now_s - self._view_s < 1.0
        if due or any(status.changed for status in self):
            self._view = tuple(
                status.view(now_s) for status in self if status.name not in RARE or status.heard_s is not None
            )
            self._view_s = now_s
            for status in self:
                status.changed = False
        return self._view
