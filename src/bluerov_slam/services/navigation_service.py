"""Navigation as the rest of the extension sees it: states on the hub, topic, track, actions, facts for health."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import orjson

from bluerov_slam.errors import CommandError
from bluerov_slam.pipeline.health import NavigationFacts, SensorFacts
from bluerov_slam.protocol.navigation_json import (
    OFF,
    FixOutcome,
    error_ellipse,
    navigation_json,
    nothing_json,
    short_text,
    state_text,
)
from bluerov_slam.records import Event, EventLevel, NavMode, SensorTrust
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.navigation_assistant import DiveStartAssistant
from bluerov_slam.services.navigation_messages import Done, PlacedState, Setup
from bluerov_slam.services.navigation_odometry import OdometrySender
from bluerov_slam.services.navigation_process import NavigationProcess, WorkerState
from bluerov_slam.services.navigation_track import NavigationTrack
from bluerov_slam.sinks.websocket import Broadcaster

TOPIC: Final = "navigation"
PERIOD_S: Final = 0.1
# What comes a little early is what is due: of a burst each 50 or 100 ms none is left out by mistake.
EARLY_S: Final = 0.02
STALE_S: Final = 3.0
DROPS_SHOWN_S: Final = 60.0
KIND_LABELS: Final = {
    "gyro": "Gyro at rest",
    "accelerometer": "Accelerometer on six faces",
    "magnetometer": "Magnetometer, turned every way",
    "thruster_field": "Thrusters' field, one thruster after the other",
    "swing": "Compass swing, two turns on the spot",
    "course_swing": "Compass swing, driving under GPS",
}


class NavigationService:
    """`tick` it once a second; its `process` is started and stopped by whoever made it.

    `setup` is asked at each start of the worker. `now_s` is the records' clock, which a replay lets run faster;
    messages to the pages keep to the host's.
    """

    def __init__(
        self,
        hub: Hub,
        broadcaster: Broadcaster,
        setup: Callable[[], Setup],
        *,
        now_s: Callable[[], float],
        unix_s: Callable[[float], float],
        simulated: bool,
        odometry: OdometrySender,
        on_change: Callable[[], None] = lambda: None,
        host_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.track = NavigationTrack(unix_s)
        self.assistant = DiveStartAssistant()
        self.calibrations: tuple[Mapping[str, Any], ...] = ()
        self.water: Mapping[str, Any] | None = None
        self.process = NavigationProcess(hub, setup, self._take, on_change, now_s)
        self._hub = hub
        self._broadcaster = broadcaster
        self._now_s = now_s
        self._host_s = host_s
        self._unix_s = unix_s
        self._simulated = simulated
        self._odometry = odometry
        self._latest: PlacedState | None = None
        self._fix: FixOutcome | None = None
        self._sent_s = -math.inf
        self._due_s = -math.inf
        self._save_error: str | None = None
        self._states = 0
        self._dropped = 0
        self._dropped_s = -math.inf

    @property
    def latest(self) -> PlacedState | None:
        """The newest state."""
        return self._latest

    def data(self) -> dict[str, Any]:
        """The topic's object, now."""
        latest, worker = self._latest, self.process.facts()
        if worker.state is WorkerState.OFF:
            return self._nothing(OFF, "Navigation is switched off")
        if worker.state is WorkerState.RESTARTING:
            why = f"The estimator ended ({worker.error}) and starts anew"
            return self._nothing(NavMode.STARTING.value, why)
        if latest is None:
            text = "Starting" if worker.state is WorkerState.STARTING else "Waiting for data of the sensors"
            return self._nothing(NavMode.STARTING.value, text)
        now_s = self._now_s()
        stale_s = now_s - latest.state.arrived_s
        text = f"No new data for {stale_s:.0f} s" if stale_s > STALE_S else state_text(latest.state)
        if self._drops_are_recent(now_s):
            text += "; the computer is too slow, sensor data was left out"
        return navigation_json(
            latest.state,
            latest.position_deg,
            text=text,
            fix=self._fix,
            odometry=self._odometry.json(),
            now_s=max(now_s, latest.state.measured_s),
            simulated=self._simulated,
        )

    def facts(self) -> NavigationFacts:
        """For the chip and the faults."""
        worker, latest, now_s = self.process.facts(), self._latest, self._now_s()
        state = latest.state if latest is not None else None
        return NavigationFacts(
            worker=worker.state.value,
            error=worker.error,
            restarts=worker.restarts,
            dropped=worker.dropped if self._drops_are_recent(now_s) else 0,
            save_error=self._save_error,
            odometry_problem=self._odometry.problem,
            mode=state.mode if state is not None else None,
            text=short_text(state) if state is not None else "",
            heard_s=state.arrived_s if state is not None else None,
            distrusted=()
            if state is None
            else tuple(
                SensorFacts(sensor.name, sensor.trust, sensor.reason)
                for sensor in state.sensors
                if sensor.trust in (SensorTrust.REJECTED, SensorTrust.IGNORED)
            ),
        )

    def counters(self) -> dict[str, float]:
        """For Prometheus: what only grows."""
        worker = self.process.facts()
        return {
            "navigation_restarts": worker.restarts,
            "navigation_records_dropped": worker.dropped,
            "navigation_states": self._states,
            "navigation_odometry_sent": self._odometry.sent,
        }

    def gauges(self) -> dict[str, float]:
        """For Prometheus: what is now; what is unknown is left out."""
        worker, latest = self.process.facts(), self._latest
        values: dict[str, float | None] = {
            "navigation_running": float(worker.state is WorkerState.RUNNING),
            "navigation_records_waiting": worker.waiting,
        }
        if latest is not None:
            state = latest.state
            ellipse = error_ellipse(state.pose_covariance)
            values["navigation_error_ellipse_major_m"] = None if ellipse is None else ellipse.major_m
            values["navigation_depth_m"] = state.depth_m
            values["navigation_reset_counter"] = state.reset_counter
        return {name: value for name, value in values.items() if value is not None}

    def calibration_json(self) -> dict[str, Any]:
        """What GET /api/navigation/calibration answers."""
        latest = self._latest
        steps = self.assistant.steps(None if latest is None else latest.state, self.calibrations)
        return {
            "kinds": [{**kind, "label": KIND_LABELS.get(kind["kind"], kind["kind"])} for kind in self.calibrations],
            "assistant": {"steps": steps},
        }

    async def act(self, action: str, arguments: Mapping[str, Any]) -> str:
        """Carry out an action; a sentence for the user. Raises CommandError when it was refused."""
        reply = await self.process.ask(action, arguments)
        if not reply.ok:
            raise CommandError(reply.message)
        self.assistant.done(action)
        return reply.message

    def tick(self) -> None:
        """Once a second: a page must see that nothing new comes, and drops."""
        now_s, dropped = self._now_s(), self.process.facts().dropped
        if dropped > self._dropped:
            if not self._drops_are_recent(now_s):
                text = f"navigation left out {dropped - self._dropped} records: the computer was too slow for it"
                self._hub.publish(Event(now_s, EventLevel.WARNING, text))
            self._dropped, self._dropped_s = dropped, now_s
        if self._host_s() - self._sent_s >= 1.0:
            self.publish()

    def publish(self) -> None:
        """Send the topic, if anybody listens."""
        if self._broadcaster.wants(TOPIC):
            self._broadcaster.publish_text(TOPIC, self.message())
            self._fix = None
        self._sent_s = now_s = self._host_s()
        self._due_s = max(self._due_s + PERIOD_S, now_s + 0.5 * PERIOD_S)

    def message(self) -> bytes:
        """The whole message of the topic, now."""
        latest = self._latest
        at_s = self._now_s() if latest is None else latest.state.measured_s
        return orjson.dumps({"topic": TOPIC, "t": round(self._unix_s(at_s), 4), "data": self.data()})

    def _take(self, done: Done) -> None:
        for event in done.events:
            self._hub.publish(event)
        if done.resumed:
            self._hub.publish(Event(self._now_s(), EventLevel.INFO, f"navigation: {done.resumed}"))
        if done.calibrations:
            self.calibrations = done.calibrations
        if done.water is not None:
            self.water = done.water
        self._take_save_error(done.save_error)
        for fix in done.fixes:
            self._fix = fix
        for heard in done.acoustics:
            self._hub.publish(heard)
        self._states += len(done.states)
        for placed in done.states:
            self._latest = placed
            self.track.add(placed.state)
            self.assistant.observe(placed.state)
            self._hub.publish(placed.state)
        for fix in done.fixes:  # behind the state that brought the origin they are told about
            self.track.add_fix(fix)
        if done.states and self._host_s() >= self._due_s - EARLY_S:
            self.publish()

    def _take_save_error(self, error: str | None) -> None:
        if error != self._save_error and error is not None:
            text = f"the state of navigation cannot be saved ({error}): a restart in mid-dive would begin without it"
            self._hub.publish(Event(self._now_s(), EventLevel.WARNING, text))
        self._save_error = error

    def _drops_are_recent(self, now_s: float) -> bool:
        return now_s - self._dropped_s < DROPS_SHOWN_S

    def _nothing(self, mode: str, text: str) -> dict[str, Any]:
        return {**nothing_json(mode, text, simulated=self._simulated), "odometry": self._odometry.json()}
