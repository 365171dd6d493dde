"""Runs the navigator over records and keeps what is judged: estimates once a second and every measurement's NIS."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.rotation import log_so3, rotation_from_quaternion
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.records import Event, LinkBytes, NavState

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from bluerov_slam.navigation.ekf import UpdateResult
    from bluerov_slam.records import Record

_EPOCH_S = 1.0


def decoded(inputs: Iterable[Record]) -> Iterator[Record]:
    """The records of the link's bytes, in place of them; what came beside the link stays where it is."""
    decoder = LinkDecoder()
    for record in inputs:
        if isinstance(record, LinkBytes):
            yield from decoder.feed(record.data, record.arrived_s)
        else:
            yield record


@dataclass(slots=True)
class SensorNis:
    """Sums over one sensor's tested measurements."""

    accepted: int = 0
    rejected: int = 0
    nis: float = 0.0
    dof: int = 0

    def add(self, result: UpdateResult) -> None:
        """Rejected ones are counted but not summed: an outlier says nothing of the errors of the rest."""
        if result.accepted:
            self.accepted += 1
            self.nis += result.nis
            self.dof += result.dof
        else:
            self.rejected += 1


@dataclass(frozen=True, slots=True)
class Estimates:
    """Estimates with a position, once a second: first axis = time."""

    at_s: NDArray[np.float64]
    position_ned_m: NDArray[np.float64]
    velocity_ned_mps: NDArray[np.float64]
    rotation_ned_frd: NDArray[np.float64]
    pose_covariance: NDArray[np.float64]

    @classmethod
    def of(cls, states: Sequence[NavState]) -> Estimates:
        """The first state of each second that has a position."""
        chosen: list[NavState] = []
        second = -math.inf
        for state in states:
            if state.position_ned_m is None or state.measured_s < second:
                continue
            second = _EPOCH_S * (math.floor(state.measured_s / _EPOCH_S) + 1.0)
            chosen.append(state)
        nothing = (math.nan,) * 3
        return cls(
            np.array([state.measured_s for state in chosen]),
            np.array([state.position_ned_m for state in chosen], dtype=float).reshape(-1, 3),
            np.array([state.velocity_ned_mps or nothing for state in chosen], dtype=float).reshape(-1, 3),
            np.array([rotation_from_quaternion(state.quaternion_ned_frd or (1, 0, 0, 0)) for state in chosen]),
            np.array([state.pose_covariance for state in chosen], dtype=float).reshape(-1, 6, 6),
        )

    def pose_errors(
        self, position_ned_m: NDArray[np.float64], rotation_ned_frd: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """True minus estimated position, and the rotation from the estimated attitude to the true one: (n, 6)."""
        turns = [log_so3(true @ own.T) for true, own in zip(rotation_ned_frd, self.rotation_ned_frd, strict=True)]
        return np.hstack((position_ned_m - self.position_ned_m, np.array(turns).reshape(-1, 3)))

    def heading_errors_rad(self, rotation_ned_frd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Estimated minus true heading, (n,)."""
        own = np.arctan2(self.rotation_ned_frd[:, 1, 0], self.rotation_ned_frd[:, 0, 0])
        true = np.arctan2(rotation_ned_frd[:, 1, 0], rotation_ned_frd[:, 0, 0])
        return np.asarray((own - true + math.pi) % (2.0 * math.pi) - math.pi)


@dataclass(slots=True)
class NavigationRun:
    """What one run of the navigator gave. `resets`: how often it said that it jumped."""

    causal: Estimates
    smoothed: Estimates | None
    nis: dict[str, SensorNis]
    origin_deg: tuple[float, float] | None
    resets: int
    events: list[str] = field(default_factory=list)


def run_navigator(
    records: Iterable[Record], navigator: Navigator, smooth: bool = False, first_pass: Sequence[NavState] = ()
) -> NavigationRun:
    """Feed all records; with `smooth` every step again afterwards, with what came after it. `first_pass`: the smoothed
    states of a run over the same records."""
    nis: dict[str, SensorNis] = {}

    def hear(result: UpdateResult) -> None:
        nis.setdefault(result.sensor, SensorNis()).add(result)

    navigator.on_update = hear
    if smooth:
        navigator.keep_for_smoothing(first_pass)
    states: list[NavState] = []
    events: list[str] = []
    second = -math.inf
    last: NavState | None = None
    for record in records:
        for output in navigator.feed(record):
            if isinstance(output, Event):
                events.append(f"{output.at_s:.1f} {output.text}")
                continue
            last = output
            if output.measured_s >= second and output.position_ned_m is not None:
                second = _EPOCH_S * (math.floor(output.measured_s / _EPOCH_S) + 1.0)
                states.append(output)
    if last is not None and states and last.position_ned_m is not None and last is not states[-1]:
        states.append(last)  # the end is judged at the end
    smoothed = Estimates.of(navigator.smoothed()) if smooth else None
    return NavigationRun(
        Estimates.of(states),
        smoothed,
        nis,
        last.origin_deg if last is not None else None,
        last.reset_counter if last is not None else 0,
        events,
    )
