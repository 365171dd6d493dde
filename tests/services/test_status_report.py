import json

import pytest

from bluerov_slam.clock import WallClock
from bluerov_slam.pipeline.health import LinkFacts, MavlinkFacts, PortState, RecorderFacts, RecorderState
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.services.esp_link import EspLink
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.status_report import StatusReport, StatusSources
from samples import ctd_sample, sensor_sample


class Source:
    kind = "serial"
    link = LinkFacts(PortState.CONNECTED, port="/dev/ttyUSB0")
    now = 100.0

    def now_s(self):
        return self.now

    def facts(self):
        return self.link


class Audience:
    def __init__(self):
        self.listening, self.messages = True, []

    def wants(self, _topic):
        return self.listening

    def publish_text(self, topic, payload):
        self.messages.append(json.loads(payload))


class Rig:
    def __init__(self):
        self.hub, self.source, self.audience, self.healths = Hub(), Source(), Audience(), []
        sources = StatusSources(
            recorder=lambda: RecorderFacts(RecorderState.OFF),
            mavlink=lambda: MavlinkFacts(enabled=True, last_heard_s=98.0),
            mavlink_counters=lambda: {"sent": {"HEARTBEAT": 3}},
            forwarding=tuple,
            clients=lambda: 1,
        )
        link = EspLink(self.source, LinkDecoder(), self.hub)
        wall = WallClock(1_000_100.0, self.source.now)
        self.report = StatusReport(
            self.hub, link, wall, sources, self.audience, simulated=True, on_health=self.healths.append
        )


def test_the_status_is_published_at_every_tick_and_says_it_is_simulated():
    rig = Rig()
    rig.report.tick()
    rig.report.tick()
    assert [message["topic"] for message in rig.audience.messages] == ["status"] * 2
    message = rig.audience.messages[0]
    assert message["t"] == pytest.approx(1_000_100.0)
    assert message["data"]["simulated"] is True
    assert message["data"]["mavlink"]["last_heard_s"] == pytest.approx(2.0)
    assert message["data"]["firmware"] is None


def test_a_changed_chip_is_published_at_once_and_an_unchanged_one_is_not():
    rig = Rig()
    rig.report.tick()
    rig.report.glance()
    assert len(rig.audience.messages) == 1
    rig.source.link = LinkFacts(PortState.ABSENT, waiting_for="/dev/ttyUSB0")
    rig.report.glance()
    assert len(rig.audience.messages) == 2
    assert rig.audience.messages[1]["data"]["chips"][0]["state"] == "fault"
    assert rig.audience.messages[1]["data"]["link"]["waiting_for"] == "/dev/ttyUSB0"


def test_sensor_frames_make_it_look_but_not_more_than_four_times_a_second():
    rig = Rig()
    for frame in range(20):
        rig.source.now = 100.0 + frame / 20
        rig.hub.publish(sensor_sample(arrived_s=rig.source.now))
        rig.hub.publish(ctd_sample(arrived_s=rig.source.now))
    assert 4 <= len(rig.healths) <= 5


def test_health_is_assessed_also_when_nobody_listens():
    rig = Rig()
    rig.audience.listening = False
    rig.report.tick()
    assert rig.audience.messages == []
    assert len(rig.healths) == 1


def test_the_first_question_is_answered_before_the_first_tick_without_raising_events():
    rig = Rig()
    assert len(rig.report.data()["chips"]) == 11
    assert rig.healths == []
