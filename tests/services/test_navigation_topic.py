"""The topic's pace and words, on the test's own clock: the worker's answers are handed in as they would come."""

from __future__ import annotations

from typing import Any

import orjson
import pytest

from bluerov_slam.pipeline.navigator import NavigatorOptions
from bluerov_slam.protocol.navigation_json import FixOutcome
from bluerov_slam.records import Event, NavSensor, NavState, SensorTrust
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.navigation_messages import Done, PlacedState, Setup
from bluerov_slam.services.navigation_odometry import OdometryOptions, OdometrySender
from bluerov_slam.services.navigation_process import WorkerFacts, WorkerState
from bluerov_slam.services.navigation_service import NavigationService
from nav_samples import nav_state


class Page:
    """A broadcaster that keeps what it was given."""

    def __init__(self) -> None:
        self.listening = True
        self.messages: list[dict[str, Any]] = []

    def wants(self, topic: str) -> bool:
        return self.listening and topic == "navigation"

    def publish_text(self, topic: str, payload: bytes) -> None:
        self.messages.append(orjson.loads(payload))


class Rig:
    def __init__(self) -> None:
        self.now_s = 100.0
        self.page = Page()
        self.hub = Hub()
        self.events: list[Event] = []
        self.hub.subscribe(self.events.append, Event)
        self.states: list[NavState] = []
        self.hub.subscribe(self.states.append, NavState)
        self.service = NavigationService(
            self.hub,
            self.page,  # type: ignore[arg-type]
            lambda: Setup("none:none", NavigatorOptions(), None),
            now_s=lambda: self.now_s,
            unix_s=lambda at_s: at_s + 1e9,
            simulated=False,
            odometry=OdometrySender(None, OdometryOptions, lambda: self.now_s),  # type: ignore[arg-type]
            host_s=lambda: self.now_s,
        )
        self.worker(WorkerState.RUNNING)

    def worker(self, state: WorkerState, dropped: int = 0, error: str | None = None) -> None:
        self.service.process.facts = lambda: WorkerFacts(state, 1, 0, dropped, 0, error)  # type: ignore[method-assign]

    def answer(self, **changes: Any) -> None:
        state = nav_state(measured_s=self.now_s - 0.005, arrived_s=self.now_s)
        self.service._take(Done(states=(PlacedState(state, (54.0, 10.0)),), **changes))


@pytest.fixture
def rig():
    return Rig()


@pytest.mark.parametrize(
    ("rate_hz", "least", "most"), [(20.0, 98, 101), (10.0, 98, 101), (4.0, 39, 41), (50.0, 95, 101)]
)
def test_the_page_gets_at_most_ten_a_second_and_the_hub_every_state(rig, rate_hz, least, most):
    for _ in range(int(10 * rate_hz)):
        rig.now_s += 1.0 / rate_hz
        rig.answer()
    assert least <= len(rig.page.messages) <= most
    assert len(rig.states) == int(10 * rate_hz)
    assert rig.page.messages[-1]["t"] == pytest.approx(1e9 + rig.now_s, abs=0.3)


def test_nothing_is_encoded_while_nobody_listens(rig):
    rig.page.listening = False
    rig.service.message = lambda: pytest.fail("encoded for nobody")
    for _ in range(20):
        rig.now_s += 0.1
        rig.answer()
    assert len(rig.states) == 20


def test_a_fix_goes_out_once(rig):
    fix = FixOutcome(99.0, "gps", 54.0, 10.0, 1.0, 2.0, 1.5, True)
    rig.answer(fixes=(fix,))
    rig.now_s += 1.0
    rig.answer()
    assert [message["data"]["fix"] is None for message in rig.page.messages] == [False, True]
    assert len(rig.service.track.listing()["fixes"]) == 1


def test_silence_is_told_each_second_with_growing_ages(rig):
    rig.answer()
    for _ in range(5):
        rig.now_s += 1.0
        rig.service.tick()
    assert len(rig.page.messages) == 6
    assert rig.page.messages[-1]["data"]["text"] == "No new data for 5 s"
    assert rig.page.messages[-1]["data"]["since_fix_s"] == pytest.approx(15.0)


def test_dropped_records_are_an_event_a_fault_and_a_word_on_the_page_for_a_while(rig):
    rig.answer()
    rig.worker(WorkerState.RUNNING, dropped=12)
    rig.service.tick()
    assert "left out 12 records" in rig.events[0].text
    assert rig.service.facts().dropped == 12
    assert "too slow" in rig.service.data()["text"]
    rig.service.tick()
    assert len(rig.events) == 1
    rig.now_s += 100.0
    assert rig.service.facts().dropped == 0


def test_a_save_that_fails_is_told_once_and_again_when_it_changes(rig):
    for error in ("No space left on device", "No space left on device", None, "No space left on device"):
        rig.answer(save_error=error)
    assert len(rig.events) == 2
    assert "No space left" in rig.service.facts().save_error


@pytest.mark.parametrize(
    ("state", "mode", "word"),
    [
        (WorkerState.OFF, "off", "switched off"),
        (WorkerState.RESTARTING, "starting", "SIGSEGV"),
    ],
)
def test_without_a_worker_no_old_position_is_shown(rig, state, mode, word):
    rig.answer()
    rig.worker(state, error="killed by SIGSEGV")
    data = rig.service.data()
    assert (data["mode"], data["position"]["north_m"]) == (mode, None)
    assert word in data["text"]


def test_sensors_that_are_not_trusted_reach_the_health_page(rig):
    sensors = tuple(
        _sensor(name, trust) for name, trust in (("gps", SensorTrust.REJECTED), ("depth", SensorTrust.USED))
    )
    rig.service._take(Done(states=(PlacedState(nav_state(sensors=sensors), None),)))
    assert [sensor.name for sensor in rig.service.facts().distrusted] == ["gps"]


def _sensor(name: str, trust: SensorTrust) -> NavSensor:
    return NavSensor(name, trust, "because", 1, 1, None, None, 0)
