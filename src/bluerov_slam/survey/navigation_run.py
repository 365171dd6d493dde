"""The navigator over a whole recording: the very estimator of live operation, with an ear at each measurement."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.pipeline.acoustics import AcousticNavigation
from bluerov_slam.pipeline.navigator import Navigator, NavigatorOptions, SavedNavigation
from bluerov_slam.records import Event, GpsFix, NavMode, NavSensor, NavState, PositionFix, Record, SensorTrust
from bluerov_slam.sources.recording_reader import Recording
from bluerov_slam.sources.replay import decode
from bluerov_slam.survey.navigation_track import NavTrack, TrackBuilder

if TYPE_CHECKING:
    from bluerov_slam.navigation.ekf import UpdateResult
    from bluerov_slam.navigation.seawater import WaterColumn

FloatArray = NDArray[np.float64]

# A fix and its measurement in the filter differ by the fix's latency at most.
_SAME_FIX_S = 2.0
_SAME_INSTANT_S = 1e-6
_FIX_SENSORS: dict[type, str] = {GpsFix: "gps", PositionFix: "position"}
MOST_COMPONENTS = 3


@dataclass(frozen=True, slots=True)
class Fix:
    """A position from outside and what became of it; `accepted` is None where it was not tested."""

    at_s: float
    sensor: str
    source: str
    latitude_deg: float
    longitude_deg: float
    std_m: float | None
    accepted: bool | None


@dataclass(frozen=True, slots=True)
class TrustChange:
    """From this instant on a sensor was treated so."""

    at_s: float
    sensor: str
    trust: SensorTrust
    reason: str


@dataclass(frozen=True, slots=True)
class SensorUpdates:
    """Every measurement of one sensor that met the filter. `residual` and `sigma`: (n, 3), NaN beyond its size."""

    at_s: FloatArray
    residual: FloatArray
    sigma: FloatArray
    nis: FloatArray
    dof: FloatArray
    accepted: NDArray[np.bool_]


@dataclass(slots=True)
class NavigationRun:
    """What a run gave; times are those of the records."""

    filtered: NavTrack
    smoothed: NavTrack | None
    origin_deg: tuple[float, float] | None
    fixes: list[Fix]
    updates: dict[str, SensorUpdates]
    trust: list[TrustChange]
    sensors: tuple[NavSensor, ...]
    events: list[Event]
    records: Counter[str]
    start_s: float
    end_s: float
    states: int = 0
    water: WaterColumn | None = None
    problems: list[str] = field(default_factory=list)

    @property
    def track(self) -> NavTrack:
        """The best there is."""
        return self.filtered if self.smoothed is None else self.smoothed


def run_navigation(
    recording: Recording,
    *,
    options: NavigatorOptions | None = None,
    saved: SavedNavigation | None = None,
    smooth: bool = True,
    baud: int = 115200,
    keep: Callable[[NavState], None] = lambda _state: None,
) -> NavigationRun:
    """Decode and estimate; `keep` hears the states of the best track, five a second."""
    navigator = Navigator(options, saved)
    if smooth:
        navigator.keep_for_smoothing()
    ear = _Ear()
    navigator.on_update = ear.hear
    collector = _Collector(ear, (lambda _state: None) if smooth else keep)
    aided = AcousticNavigation(navigator, navigator.options.acoustics)
    for record in decode(recording, baud):
        collector.before(record)
        for result in aided.feed(record):
            if isinstance(result, NavState | Event):
                collector.take(result)
        collector.after(record)
    run = collector.run(list(dict.fromkeys(recording.problems)))
    run.water = navigator.whole_water_column()
    if smooth:
        states = navigator.smoothed()
        if "acoustics" in ear.heard:
            # A direction from where the vehicle was is worth more than one from where it was thought to be.
            states = _second_pass(recording, options, saved, baud, states)
        run.smoothed = _smoothed(states, run.filtered, keep)
    return run


def _second_pass(
    recording: Recording,
    options: NavigatorOptions | None,
    saved: SavedNavigation | None,
    baud: int,
    first: list[NavState],
) -> list[NavState]:
    """All again, the acoustic pulses as they are seen from the smoothed track."""
    navigator = Navigator(options, saved)
    navigator.keep_for_smoothing(first)
    aided = AcousticNavigation(navigator, navigator.options.acoustics)
    for record in decode(recording, baud):
        aided.feed(record)
    return navigator.smoothed()


def _smoothed(states: list[NavState], live: NavTrack, keep: Callable[[NavState], None]) -> NavTrack:
    """The smoothed states, with what is a matter of live knowledge as it was live: mode, last fix, path length."""
    builder = TrackBuilder()
    at_s = live["at_s"]
    for state in states:
        row = int(np.searchsorted(at_s, state.measured_s + _SAME_INSTANT_S)) - 1
        if row < 0:
            continue
        mode = live.mode_at(row)
        if state.position_ned_m is not None and mode is not NavMode.AIDED:
            # Before the first fix the position is reckoned back from it.
            mode = NavMode.DEAD_RECKONING
        state = replace(
            state,
            arrived_s=state.measured_s,
            mode=mode,
            last_fix_s=_known(live["last_fix_s"][row]),
            altitude_m=_known(live["altitude_m"][row]),
            distance_m=float(live["distance_m"][row]),
            reset_counter=int(live["reset_counter"][row]),
            angular_rate_frd_radps=None,
        )
        if builder.add(state):
            keep(state)
    return builder.build()


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


class _Ear:
    """Takes down every measurement's residual and NIS."""

    def __init__(self) -> None:
        self.heard: dict[str, array[float]] = {}
        self.latest: list[tuple[str, float, bool]] = []

    def hear(self, update: UpdateResult) -> None:
        size = min(len(update.residual), MOST_COMPONENTS)
        rest = [math.nan] * (MOST_COMPONENTS - size)
        sigma = np.sqrt(np.diag(update.innovation_covariance))
        row = [update.at_s, *map(float, update.residual[:size]), *rest, *map(float, sigma[:size]), *rest]
        row += [update.nis, float(update.dof), float(update.accepted)]
        self.heard.setdefault(update.sensor, array("d")).extend(row)
        self.latest.append((update.sensor, update.at_s, update.accepted))

    def updates(self) -> dict[str, SensorUpdates]:
        """Everything, by sensor."""
        width = 1 + 2 * MOST_COMPONENTS + 3
        by_sensor = {}
        for sensor, values in self.heard.items():
            table = np.frombuffer(values, dtype=np.float64).reshape(-1, width)
            table = table[np.argsort(table[:, 0], kind="stable")]
            residual, sigma = table[:, 1 : 1 + MOST_COMPONENTS], table[:, 1 + MOST_COMPONENTS : 1 + 2 * MOST_COMPONENTS]
            by_sensor[sensor] = SensorUpdates(
                table[:, 0], residual, sigma, table[:, -3], table[:, -2], table[:, -1] > 0.5
            )
        return by_sensor


class _Collector:
    """Puts together what a run gives."""

    def __init__(self, ear: _Ear, keep: Callable[[NavState], None]) -> None:
        self._ear = ear
        self._keep = keep
        self._builder = TrackBuilder()
        self._records: Counter[str] = Counter()
        self._fixes: list[Fix] = []
        self._trust: list[TrustChange] = []
        self._trusted: dict[str, tuple[SensorTrust, str]] = {}
        self._sensors: tuple[NavSensor, ...] = ()
        self._events: list[Event] = []
        self._states = 0
        self._start_s = math.inf
        self._end_s = -math.inf

    def before(self, record: Record) -> None:
        self._ear.latest.clear()
        self._records[type(record).__name__] += 1
        arrived_s = getattr(record, "arrived_s", None)
        if arrived_s is not None:
            self._start_s = min(self._start_s, arrived_s)
            self._end_s = max(self._end_s, arrived_s)

    def take(self, result: NavState | Event) -> None:
        if isinstance(result, Event):
            self._events.append(result)
            return
        self._states += 1
        self._sensors = result.sensors or self._sensors
        for sensor in result.sensors:
            if self._trusted.get(sensor.name) != (sensor.trust, sensor.reason):
                self._trusted[sensor.name] = (sensor.trust, sensor.reason)
                self._trust.append(TrustChange(result.measured_s, sensor.name, sensor.trust, sensor.reason))
        if self._builder.add(result):
            self._keep(result)

    def after(self, record: Record) -> None:
        if isinstance(record, GpsFix | PositionFix) and record.latitude_deg is not None:
            assert record.longitude_deg is not None
            sensor = _FIX_SENSORS[type(record)]
            verdicts = [accepted for name, _, accepted in self._ear.latest if name == sensor]
            self._fixes.append(
                Fix(
                    record.measured_s,
                    sensor,
                    record.source if isinstance(record, PositionFix) else "gps",
                    record.latitude_deg,
                    record.longitude_deg,
                    _std_m(record),
                    verdicts[-1] if verdicts else None,
                )
            )

    def run(self, problems: list[str]) -> NavigationRun:
        """Everything."""
        known = math.isfinite(self._start_s)
        return NavigationRun(
            filtered=self._builder.build(),
            smoothed=None,
            origin_deg=self._builder.origin_deg,
            fixes=_judged(self._fixes, self._ear.heard),
            updates=self._ear.updates(),
            trust=self._trust,
            sensors=self._sensors,
            events=self._events,
            records=self._records,
            start_s=self._start_s if known else 0.0,
            end_s=self._end_s if known else 0.0,
            states=self._states,
            problems=problems,
        )


def _std_m(fix: GpsFix | PositionFix) -> float | None:
    """As the source states it, the larger of both axes."""
    if isinstance(fix, GpsFix) or fix.covariance_ne_m2 is None:
        return None
    north, _, east = fix.covariance_ne_m2
    return math.sqrt(max(north, east, 0.0))


def _judged(fixes: list[Fix], heard: dict[str, array[float]]) -> list[Fix]:
    """A fix that the filter takes later than it came finds its verdict by its time."""
    width = 1 + 2 * MOST_COMPONENTS + 3
    judged = []
    for fix in fixes:
        values = heard.get(fix.sensor)
        if fix.accepted is not None or not values:
            judged.append(fix)
            continue
        table = np.frombuffer(values, dtype=np.float64).reshape(-1, width)
        place = int(np.argmin(np.abs(table[:, 0] - fix.at_s)))
        near = abs(table[place, 0] - fix.at_s) < _SAME_FIX_S / 4.0
        accepted = bool(table[place, -1] > 0.5) if near else None
        judged.append(Fix(fix.at_s, fix.sensor, fix.source, fix.latitude_deg, fix.longitude_deg, fix.std_m, accepted))
    return judged
