"""The navigator with what surrounds it in its worker: actions, outcomes of fixes, places, the saved state."""

from __future__ import annotations

import importlib
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, Protocol, cast

from bluerov_slam.errors import ExpectedError
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.seawater import WaterColumn
from bluerov_slam.pipeline.acoustics import AcousticNavigation
from bluerov_slam.pipeline.navigator import NavigatorAction, NavigatorCommand, NavigatorOptions, SavedNavigation
from bluerov_slam.pipeline.navigator_water import water_json
from bluerov_slam.protocol.navigation_json import FixOutcome
from bluerov_slam.records import AcousticFix, AcousticMessage, Event, EventLevel, GpsFix, NavState, PositionFix, Record
from bluerov_slam.services.navigation_messages import Ask, Done, PlacedState, Reply, Setup, Work
from bluerov_slam.services.navigation_state_file import NavigationStateFile, load_saved

_log = logging.getLogger(__name__)

SAVE_PERIOD_S: Final = 5.0
CALIBRATION_PERIOD_S: Final = 0.5
# Older than any estimate that is taken up again.
ANCIENT_S: Final = 1e9
_SENSOR_OF: Final[dict[type, str]] = {GpsFix: "gps", PositionFix: "position"}


class NavigatorLike(Protocol):
    """What of `pipeline.navigator.Navigator` is used here."""

    def feed(self, record: Record) -> list[NavState | Event]: ...
    def command(self, command: NavigatorCommand) -> list[NavState | Event]: ...
    def expire(self, now_s: float) -> list[NavState | Event]: ...
    def save(self) -> SavedNavigation: ...
    def calibrations(self) -> list[Any]: ...
    def water_column(self) -> WaterColumn | None: ...


class NavigationEngine:
    """`run` one `Work` after the other. Whatever the navigator raises comes out: its process ends and is begun anew."""

    def __init__(self, setup: Setup, now_s: Callable[[], float] = time.monotonic) -> None:
        self.resumed: str | None = None
        self._now_s = now_s
        self._options = cast(NavigatorOptions, setup.options)
        saved, age_s = self._load(setup)
        self._navigator = _make_navigator(setup.navigator, self._options, saved, age_s)
        self._acoustics = AcousticNavigation(self._navigator, getattr(self._options, "acoustics", None))
        self._file = None if setup.state_file is None else NavigationStateFile(Path(setup.state_file), setup.boot_id)
        self._saved_s = -math.inf
        self._unsaved = False
        self._position_saved = False
        self._save_fault: str | None = None
        self._told_s = -math.inf
        self._fixes: list[GpsFix | PositionFix] = []
        self._counts: dict[str, tuple[int, int]] = {}
        self._water: WaterColumn | None = None

    def run(self, work: Work) -> Done:
        """Feed, act, answer."""
        states: list[PlacedState] = []
        events: list[Event] = []
        fixes: list[FixOutcome] = []
        heard: list[AcousticFix | AcousticMessage] = []
        for record in work.records:
            if isinstance(record, GpsFix | PositionFix) and record.latitude_deg is not None:
                self._fixes.append(record)
            self._sort(self._acoustics.feed(record), states, events, fixes, heard)
        replies = [self._obey(ask, states, events, fixes) for ask in work.asks]
        if work.expire_s is not None:
            self._sort(self._navigator.expire(work.expire_s), states, events, fixes)
        self._unsaved |= bool(states or work.asks)
        if states and (states[-1].state.position_ned_m is not None) != self._position_saved:
            self._saved_s = -math.inf  # what a restart most needs to know
            self._position_saved = not self._position_saved
        self._save_sometimes()
        return Done(
            tuple(states),
            tuple(events),
            tuple(fixes),
            tuple(replies),
            calibrations=self._calibrations_sometimes(bool(work.asks)),
            water=self._new_water(),
            save_error=None if self._file is None else self._save_fault or self._file.error,
            acoustics=tuple(heard),
        )

    def calibrations(self) -> tuple[Mapping[str, Any], ...]:
        """Every guided routine and how far it is."""
        return tuple(asdict(progress) for progress in self._navigator.calibrations())

    def close(self) -> None:
        """Save for the next start."""
        if self._file is not None:
            self._file.save(self._navigator.save().to_json())
            self._file.close()

    def _sort(
        self,
        results: Sequence[NavState | Event | AcousticFix | AcousticMessage],
        states: list[PlacedState],
        events: list[Event],
        fixes: list[FixOutcome],
        heard: list[AcousticFix | AcousticMessage] | None = None,
    ) -> None:
        for result in results:
            if isinstance(result, Event):
                events.append(result)
                continue
            if isinstance(result, AcousticFix | AcousticMessage):
                if heard is not None:
                    heard.append(result)
                continue
            states.append(PlacedState(result, _place(result)))
            fixes += self._judged(result)

    def _judged(self, state: NavState) -> list[FixOutcome]:
        """The fixes since the last state: its counters tell whether they were taken."""
        waiting, self._fixes = self._fixes, []
        before, counts = self._counts, {sensor.name: (sensor.accepted, sensor.rejected) for sensor in state.sensors}
        self._counts = counts
        outcomes = []
        for fix in waiting:
            name = _SENSOR_OF[type(fix)]
            accepted, rejected = counts.get(name, (0, 0))
            accepted_before, rejected_before = before.get(name, (0, 0))
            verdict = True if accepted > accepted_before else False if rejected > rejected_before else None
            outcomes.append(self._outcome(fix, state, verdict))
        return outcomes

    def _outcome(self, fix: GpsFix | PositionFix, state: NavState, accepted: bool | None) -> FixOutcome:
        assert fix.latitude_deg is not None
        assert fix.longitude_deg is not None
        position_deg = (fix.latitude_deg, fix.longitude_deg)
        north_m, east_m = None, None
        if state.origin_deg is not None:
            north_m, east_m, _ = LocalFrame(*state.origin_deg).to_ned_m(*position_deg)
        source = _SENSOR_OF[type(fix)]
        return FixOutcome(fix.measured_s, source, *position_deg, north_m, east_m, self._std_m(fix), accepted)

    def _std_m(self, fix: GpsFix | PositionFix) -> float | None:
        """One sigma per axis as the navigator takes it."""
        if isinstance(fix, GpsFix):
            gps = self._options.gps
            return gps.std_m_per_hdop * (gps.unknown_hdop if fix.hdop is None else max(fix.hdop, 1.0))
        if fix.covariance_ne_m2 is None:
            return None
        north, _, east = fix.covariance_ne_m2
        return math.sqrt(max(north, east))

    def _obey(self, ask: Ask, states: list[PlacedState], events: list[Event], fixes: list[FixOutcome]) -> Reply:
        try:
            command = NavigatorCommand(NavigatorAction(ask.action), **ask.arguments)
            results = self._navigator.command(command)
        except (ExpectedError, ValueError, TypeError) as error:
            return Reply(ask.number, False, str(error))
        self._sort(results, states, events, fixes)
        answers = [result for result in results if isinstance(result, Event)]
        refused = [event for event in answers if event.level is not EventLevel.INFO]
        told = refused or answers
        return Reply(ask.number, not refused, told[-1].text if told else "done")

    def _save_sometimes(self) -> None:
        if self._file is not None and self._unsaved and self._now_s() - self._saved_s >= SAVE_PERIOD_S:
            self._saved_s, self._unsaved = self._now_s(), False
            try:
                self._file.save(self._navigator.save().to_json())
            except Exception as error:  # the estimate itself is well, and goes on without
                if self._save_fault is None:
                    _log.exception("the navigator's state cannot be told")
                self._save_fault = f"{type(error).__name__}: {error}"
            else:
                self._save_fault = None

    def _calibrations_sometimes(self, now: bool) -> tuple[Mapping[str, Any], ...]:
        if not now and self._now_s() - self._told_s < CALIBRATION_PERIOD_S:
            return ()
        self._told_s = self._now_s()
        return self.calibrations()

    def _new_water(self) -> Mapping[str, Any] | None:
        """The profile, where it was made anew."""
        before, self._water = self._water, self._navigator.water_column()
        return None if self._water is None or self._water is before else water_json(self._water)

    def _load(self, setup: Setup) -> tuple[SavedNavigation | None, float | None]:
        """What was saved, and its age; None: by the monotonic clock, which went on.

        After another boot of the computer nobody knows how long ago that was, whatever its clock says: only what does
        not age is taken up, the calibrations.
        """
        if setup.state_file is None:
            return None, None
        data, same_boot, fault = load_saved(Path(setup.state_file), setup.boot_id)
        saved = None if data is None else SavedNavigation.from_json(data)
        if fault is None and data is not None and saved is None:
            fault = "the saved navigation is damaged: starting anew"
        if saved is None:
            self.resumed = fault
            return None, None
        if not same_boot:
            return SavedNavigation(at_s=0.0, calibration=saved.calibration), ANCIENT_S
        if saved.position_known:
            self.resumed = "going on from the saved position; its uncertainty has grown with the time since"
        return saved, None


def _make_navigator(
    path: str, options: NavigatorOptions, saved: SavedNavigation | None, age_s: float | None
) -> NavigatorLike:
    module, _, name = path.partition(":")
    factory = getattr(importlib.import_module(module), name)
    return cast(NavigatorLike, factory(options, saved, age_s))


def _place(state: NavState) -> tuple[float, float] | None:
    if state.origin_deg is None or state.position_ned_m is None:
        return None
    return LocalFrame(*state.origin_deg).to_geodetic(*state.position_ned_m)[:2]
