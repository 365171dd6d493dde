"""From an endless stream of samples to records of pulses: trigger, record, validate, as the thesis's board does it.

The stream is looked at in blocks. A block trips when enough receivers have a run of samples far from their own mean;
the record begins with the next block, when the pulse's onset is already over (one to three blocks, 75 to 225 us). With
`pre_trigger_samples` a ring buffer keeps what came before, and the onset is in the record: our improvement. A finished
record is accepted if every receiver varies enough, else it is counted and the trigger is armed again.

The records do not depend on how the stream is cut into pieces.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

PRE_TRIGGER_SAMPLES = 448
"""What our own recorder keeps: the block that tripped, the array's longest delay in water (284), and some quiet."""


@dataclass(frozen=True, slots=True)
class TriggerSettings:
    """When a block of samples counts as the start of a pulse; the thesis's figures by default."""

    block_samples: int = 64
    threshold_counts: float = 50.0
    consecutive: int = 5
    least_receivers: int = 2
    skip_last_window: bool = True  # as published: the loop over windows ends one early

    def tripped(self, blocks: FloatArray) -> NDArray[np.bool_]:
        """Which blocks trip, from samples (..., receivers, blocks, block_samples): (..., blocks)."""
        above = np.abs(blocks - blocks.mean(axis=-1, keepdims=True)) > self.threshold_counts
        windows = self.block_samples - self.consecutive + (0 if self.skip_last_window else 1)
        run = above[..., :windows]
        for shift in range(1, self.consecutive):
            run = run & above[..., shift : shift + windows]
        result: NDArray[np.bool_] = run.any(axis=-1).sum(axis=-2) >= self.least_receivers
        return result


@dataclass(frozen=True, slots=True)
class RecorderSettings:
    """The whole recorder; as built by default."""

    receivers: int = 4
    trigger: TriggerSettings = field(default_factory=TriggerSettings)
    samples: int = 2048
    pre_trigger_samples: int = 0
    accept_std_counts: float = 50.0
    busy_samples: int = 0
    """After a record the board computes and looks at nothing for so long."""

    def __post_init__(self) -> None:
        if not 0 <= self.pre_trigger_samples < self.samples:
            raise ValueError(f"{self.pre_trigger_samples} samples before the trigger in a record of {self.samples}")
        if self.trigger.block_samples <= self.trigger.consecutive:
            raise ValueError(f"blocks of {self.trigger.block_samples} hold no run of {self.trigger.consecutive}")


class RecorderState(Enum):
    """What the recorder is doing."""

    TRIGGERING = "triggering"
    RECORDING = "recording"
    BUSY = "busy"


@dataclass(frozen=True, slots=True)
class RecordedPulse:
    """One finished record. `first_sample` counts from the start of the stream; `std_counts` are the receivers'."""

    first_sample: int
    trigger_index: int
    samples: FloatArray
    std_counts: FloatArray
    accepted: bool


class PulseRecorder:
    """The state machine. `feed` takes the next samples, `records_rejected` counts what did not vary enough."""

    def __init__(self, settings: RecorderSettings | None = None) -> None:
        self.settings = settings or RecorderSettings()
        self.state = RecorderState.TRIGGERING
        self.records_accepted = 0
        self.records_rejected = 0
        self._kept = np.zeros((self.settings.receivers, 0))
        self._kept_from = 0  # number of the first sample kept
        self._at = 0  # number of the next sample to be looked at
        self._trigger_end = 0

    def feed(self, samples: ArrayLike) -> list[RecordedPulse]:
        """Records that end within these samples (receivers, n): counts, about zero or about mid-scale alike."""
        fresh = np.asarray(samples, dtype=np.float64)
        if fresh.ndim != 2 or len(fresh) != self.settings.receivers:
            raise ValueError(f"samples of shape {fresh.shape}, expected {self.settings.receivers} rows")
        self._kept = np.concatenate((self._kept, fresh), axis=1)
        finished: list[RecordedPulse] = []
        while self._step(finished):
            pass
        self._forget()
        return finished

    @property
    def _end(self) -> int:
        return self._kept_from + self._kept.shape[1]

    def _step(self, finished: list[RecordedPulse]) -> bool:
        """Do what can be done with the samples at hand; whether there may be more to do."""
        if self.state is RecorderState.TRIGGERING:
            return self._look()
        if self.state is RecorderState.RECORDING:
            return self._record(finished)
        if self._end < self._at:
            return False
        self.state = RecorderState.TRIGGERING
        return True

    def _look(self) -> bool:
        block = self.settings.trigger.block_samples
        count = (self._end - self._at) // block
        if count <= 0:
            return False
        first = self._at - self._kept_from
        blocks = self._kept[:, first : first + count * block].reshape(len(self._kept), count, block)
        tripped = np.flatnonzero(self.settings.trigger.tripped(blocks))
        if not len(tripped):
            self._at += count * block
            return False
        self._at += (int(tripped[0]) + 1) * block
        self._trigger_end = self._at
        self.state = RecorderState.RECORDING
        return True

    def _record(self, finished: list[RecordedPulse]) -> bool:
        settings = self.settings
        start = max(self._kept_from, self._trigger_end - settings.pre_trigger_samples)
        end = start + settings.samples
        if self._end < end:
            return False
        record = self._kept[:, start - self._kept_from : end - self._kept_from].copy()
        std_counts = record.std(axis=1, ddof=1)
        accepted = bool((std_counts > settings.accept_std_counts).all())
        self.records_accepted += accepted
        self.records_rejected += not accepted
        finished.append(RecordedPulse(start, self._trigger_end - start, record, std_counts, accepted))
        self._at = end + settings.busy_samples
        self.state = RecorderState.BUSY if settings.busy_samples else RecorderState.TRIGGERING
        return True

    def _forget(self) -> None:
        """Keep the ring buffer's length before the next sample to be looked at, or the record that is under way."""
        anchor = self._trigger_end if self.state is RecorderState.RECORDING else min(self._at, self._end)
        keep_from = max(self._kept_from, anchor - self.settings.pre_trigger_samples)
        if keep_from > self._kept_from:
            self._kept = self._kept[:, keep_from - self._kept_from :].copy()
            self._kept_from = keep_from
