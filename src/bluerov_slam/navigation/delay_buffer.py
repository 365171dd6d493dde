"""A filter with one second of memory: measurements that arrive late or out of order are put where they belong.

Time is cut into slots, one per prediction. Each keeps the filter's state at its start, what was predicted with, and the
measurements that were true inside it. A measurement for a past instant restores its slot's start and runs from there
again; inside a slot the prediction is cut at the instants of its measurements. Order is by instant, then by sensor,
then by arrival: whatever the order of arrival within the buffer's depth, the numbers come out the same. What is newer
than the filter waits for it.
"""

from __future__ import annotations

import math
from bisect import insort
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bluerov_slam.navigation.ekf import GAP_SHARE, GATE_PROBABILITY, ErrorStateFilter, Measurement, UpdateResult
from bluerov_slam.navigation.process import ImuSample
from bluerov_slam.navigation.state import NavEstimate, StateLayout

Array = NDArray[np.float64]

DEPTH_S = 1.0

MOST_WAITING = 1000
"""Measurements in one slot, or ahead of the filter: more than any sensors send in a second."""

Walks = tuple[float | None, float | None]


@dataclass(order=True, slots=True)
class _Event:
    """Something that happens to the filter at an instant. Fields before `action` give the order."""

    at_s: float
    resets_before: int  # at this very instant
    rank: int
    sensor: str
    arrival: int
    action: Callable[[ErrorStateFilter], UpdateResult | None] = field(compare=False)
    done: bool = field(default=False, compare=False)


@dataclass(slots=True)
class _Slot:
    """One prediction: from the state at its start to `end_s`, with what happened on the way."""

    end_s: float
    force: Array | None
    rate: Array | None
    walks: Walks
    estimate: NavEstimate
    covariance: Array
    mark: Any
    events: list[_Event] = field(default_factory=list)


class DelayBuffer:
    """The filter's verbs, for measurements up to `depth_s` old in any order; older ones are refused and counted."""

    def __init__(self, core: ErrorStateFilter, depth_s: float = DEPTH_S) -> None:
        self.core = core
        self.depth_s = depth_s
        self.too_old = 0
        """Measurements older than the buffer."""
        self.too_early = 0
        """Measurements further ahead of the filter than the buffer is deep, or too many to wait."""
        self.replayed_slots = 0
        """Predictions that were run again."""
        self._waiting: list[_Event] = []
        self._arrivals = 0
        self._last_reset_s = math.nan
        self._resets_there = 0
        self._slots: deque[_Slot] = deque()
        self._open(core.at_s, None, None, (None, None))

    @property
    def estimate(self) -> NavEstimate:
        """The newest one."""
        return self.core.estimate

    @property
    def covariance(self) -> Array:
        """(n, n) of the newest estimate."""
        return self.core.covariance

    @property
    def layout(self) -> StateLayout:
        """The filter's."""
        return self.core.layout

    @property
    def at_s(self) -> float:
        """The instant of the estimate."""
        return self.core.at_s

    def std(self, name: str) -> Array:
        """Standard deviation of each state of a block."""
        return self.core.std(name)

    def predict_strapdown(self, sample: ImuSample) -> list[UpdateResult]:
        """Move on to the end of the sample; what became of the measurements that waited for it."""
        force, rate = sample.specific_force_frd_mps2, sample.angular_rate_frd_radps
        if not (sample.at_s > self.at_s and math.isfinite(sum(force.tolist()) + sum(rate.tolist()))):
            self.core.refused_samples += 1
            return []
        results: list[UpdateResult] = []
        start_s = sample.at_s - sample.interval_s
        if start_s - self.at_s > GAP_SHARE * sample.interval_s:
            results += self.predict_kinematic(start_s)
        return results + self._advance(sample.at_s, force.copy(), rate.copy(), (None, None))

    def predict_kinematic(
        self,
        to_s: float,
        attitude_walk_rad_per_sqrt_s: float | None = None,
        velocity_walk_mps_per_sqrt_s: float | None = None,
    ) -> list[UpdateResult]:
        """Move on without an IMU; what became of the measurements that waited."""
        if not to_s > self.at_s or math.isinf(to_s):
            return []
        return self._advance(to_s, None, None, (attitude_walk_rad_per_sqrt_s, velocity_walk_mps_per_sqrt_s))

    def update(
        self,
        measurement: Measurement,
        gate_probability: float | None = GATE_PROBABILITY,
        robust: Literal["huber"] | None = "huber",
    ) -> UpdateResult | None:
        """Use a measurement at its own instant. None if it is not usable, refused, or waits for the filter."""

        def action(core: ErrorStateFilter) -> UpdateResult | None:
            return core.update(measurement, gate_probability, robust)

        self._arrivals += 1
        resets = self._resets_there if measurement.at_s == self._last_reset_s else 0
        event = _Event(measurement.at_s, resets, 1, measurement.sensor, self._arrivals, action)
        if measurement.at_s > self.at_s:
            if measurement.at_s > self.at_s + self.depth_s or len(self._waiting) >= MOST_WAITING:
                self.too_early += 1
            else:
                insort(self._waiting, event)
            return None
        if not measurement.at_s >= max(self.at_s - self.depth_s, self._slots[0].estimate.at_s):
            self.too_old += 1
            return None
        return self._insert(event)

    def reset_block(self, name: str, values: ArrayLike, std: ArrayLike) -> None:
        """Forget a block now; late measurements from before are still put before it."""
        kept_values, kept_std = np.array(values, dtype=np.float64), np.array(std, dtype=np.float64)
        self._now(lambda core: core.reset_block(name, kept_values, kept_std))

    def add_uncertainty(self, name: str, std: ArrayLike) -> None:
        """Let a block's variance grow by std^2 now."""
        kept = np.array(std, dtype=np.float64)
        self._now(lambda core: core.add_uncertainty(name, kept))

    def mix_errors(self, name: str, other: str, share: ArrayLike, values: ArrayLike) -> None:
        """Now: the error of a block gets `share` of another's (`ErrorStateFilter.mix_errors`), whose values change."""
        kept_share, kept_values = np.array(share, dtype=np.float64), np.array(values, dtype=np.float64)

        def action(core: ErrorStateFilter) -> None:
            core.mix_errors(name, other, kept_share)
            core.estimate.values[core.layout[other]] = kept_values

        self._now(action)

    def _now(self, action: Callable[[ErrorStateFilter], None]) -> None:
        self._resets_there = self._resets_there + 1 if self.at_s == self._last_reset_s else 1
        self._last_reset_s = self.at_s
        self._arrivals += 1
        self._insert(_Event(self.at_s, self._resets_there, 0, "", self._arrivals, action))

    def _advance(self, to_s: float, force: Array | None, rate: Array | None, walks: Walks) -> list[UpdateResult]:
        slot = self._open(to_s, force, rate, walks)
        count = 0
        while count < len(self._waiting) and self._waiting[count].at_s <= to_s:
            count += 1
        slot.events, self._waiting = self._waiting[:count], self._waiting[count:]
        results = self._run(slot)
        while len(self._slots) > 1 and self._slots[0].end_s < to_s - self.depth_s:
            self._slots.popleft()
        return [result for result in results if result is not None]

    def _open(self, end_s: float, force: Array | None, rate: Array | None, walks: Walks) -> _Slot:
        core = self.core
        mark = None if core.recorder is None else core.recorder.mark()
        slot = _Slot(end_s, force, rate, walks, core.estimate.copy(), core.covariance.copy(), mark)
        self._slots.append(slot)
        return slot

    def _run(self, slot: _Slot) -> list[UpdateResult | None]:
        """From the slot's start to its end; results of the events that had not happened before."""
        results: list[UpdateResult | None] = []
        for event in slot.events:
            self._predict(slot, event.at_s)
            result = self._apply(event)
            if not event.done:
                event.done = True
                results.append(result)
        self._predict(slot, slot.end_s)
        return results

    def _apply(self, event: _Event) -> UpdateResult | None:
        refused = self.core.refused_measurements
        result = event.action(self.core)
        if event.done:
            self.core.refused_measurements = refused
        return result

    def _predict(self, slot: _Slot, to_s: float) -> None:
        core = self.core
        if to_s <= core.at_s:
            return
        if slot.force is None or slot.rate is None:
            core.predict_kinematic(to_s, *slot.walks)
        else:
            core.predict_strapdown(ImuSample(to_s, to_s - core.at_s, slot.force, slot.rate))

    def _insert(self, event: _Event) -> UpdateResult | None:
        slots = self._slots
        place = len(slots) - 1
        while place > 0 and slots[place].estimate.at_s >= event.at_s:
            place -= 1
        slot = slots[place]
        if len(slot.events) >= MOST_WAITING:
            self.too_early += 1
            return None
        insort(slot.events, event)
        if place == len(slots) - 1 and slot.events[-1] is event and event.at_s == self.at_s:
            event.done = True
            return event.action(self.core)
        return self._replay(place)

    def _replay(self, place: int) -> UpdateResult | None:
        """Run again from the start of a slot; the result of the one event that is new."""
        core = self.core
        slots = [self._slots[index] for index in range(place, len(self._slots))]
        first = slots[0]
        core.estimate, core.covariance = first.estimate.copy(), first.covariance.copy()
        if core.recorder is not None:
            core.recorder.rewind(first.mark)
        results: list[UpdateResult | None] = []
        for slot in slots:
            if slot is not first:
                slot.estimate, slot.covariance = core.estimate.copy(), core.covariance.copy()
                slot.mark = None if core.recorder is None else core.recorder.mark()
            results += self._run(slot)
            self.replayed_slots += 1
        return results[0] if results else None
