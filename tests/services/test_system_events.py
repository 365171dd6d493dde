import pytest

from bluerov_slam.clock import WallClock
from bluerov_slam.pipeline.health import Chip, ChipState, Fault, FaultLevel, Health, LinkFacts, PortState
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.checksums import kogger_mod255
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import Event, EventLevel, UnknownFrame
from bluerov_slam.services.esp_link import EspLink
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.system_events import SystemEvents
from samples import gps_fix

FAULT = Fault("imu_silent", FaultLevel.ERROR, "IMU silent", "The IMU does not talk.", "Check its wires.")
ILL = Health((Chip("imu", "IMU", ChipState.FAULT, "IMU silent", FAULT.cause, FAULT.cure),), (FAULT,))
WELL = Health((Chip("imu", "IMU", ChipState.OK, "20 Hz"),), ())


class Source:
    """A port whose facts a test sets."""

    kind = "serial"
    link = LinkFacts(PortState.ABSENT, waiting_for="/dev/ttyUSB0")
    now = 100.0

    def now_s(self):
        return self.now

    def facts(self):
        return self.link


class Rig:
    def __init__(self):
        self.hub, self.source, self.wall_s = Hub(), Source(), 1_000_100.0
        self.wall = WallClock(self.wall_s, self.source.now)
        self.link = EspLink(self.source, LinkDecoder(), self.hub)
        self.events = SystemEvents(self.hub, self.link, self.wall, lambda: self.wall_s)
        self.told = []
        self.hub.subscribe(self.told.append, Event)

    def texts(self):
        return [event.text for event in self.told]


def test_the_port_is_told_when_its_state_changes_and_only_then():
    rig = Rig()
    rig.events.link_changed()
    rig.events.link_changed()
    rig.source.link = LinkFacts(PortState.CONNECTED, port="/dev/ttyUSB0")
    rig.events.link_changed()
    assert rig.texts() == ["no link: waiting for /dev/ttyUSB0", "serial link up: /dev/ttyUSB0, 115200 baud"]
    assert [event.level for event in rig.told] == [EventLevel.WARNING, EventLevel.INFO]


def test_a_fault_is_told_once_and_again_when_it_is_gone():
    rig = Rig()
    for health in (WELL, ILL, ILL, WELL):
        rig.events.take_health(health)
    assert rig.texts() == ["IMU silent. The IMU does not talk.", "cleared: IMU silent"]
    assert rig.told[0].level is EventLevel.ERROR


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_a_set_wall_clock_is_told_with_the_step(step_s):
    rig = Rig()
    rig.events.tick()
    rig.wall_s += step_s + 1.0
    rig.source.now += 1.0
    rig.events.tick()
    rig.events.tick()
    assert rig.texts() == [f"the wall clock was set by {step_s:+.1f} s; order and ages are unaffected"]
    assert rig.wall.unix_s(rig.source.now) == rig.wall_s


def test_gps_time_judges_the_wall_clock_once_for_each_verdict():
    rig = Rig()
    for offset_s in (0.1, 0.2, 500.0, 500.0):
        rig.hub.publish(gps_fix(measured_s=100.0, utc_unix_s=1_000_100.0 + offset_s))
    rig.hub.publish(gps_fix(measured_s=100.0, utc_unix_s=None))
    assert rig.texts() == [
        "the vehicle's clock agrees with GPS time",
        "the vehicle's clock is wrong: GPS time is +500.0 s from it",
    ]


def test_a_replays_clock_is_left_alone():
    hub, source = Hub(), Source()
    wall = WallClock(5.0, source.now)
    events = SystemEvents(hub, EspLink(source, LinkDecoder(), hub), wall, None)
    events.tick()
    assert wall.unix_s(source.now) == 5.0


def test_an_unknown_frame_type_is_told_once():
    rig = Rig()
    for frame_type in (0x42, 0x42, 0x43):
        rig.hub.publish(UnknownFrame(1.0, frame_type, 10))
    assert [text[:23] for text in rig.texts()] == ["frames of type 0x42 mea", "frames of type 0x43 mea"]


def test_a_sonar_that_turns_out_to_use_the_other_checksum_is_told():
    rig = Rig()
    rig.events.tick()
    body = bytes((0, 0x41, 5, 2, 0xFF, 0xFE))
    frame = b"\xbb\x55" + body + kogger_mod255(body)
    for _ in range(12):
        rig.link.decoder.feed(encode_frame(MessageType.KOGGER_RAW_A, bytes(4) + frame), 1.0)
    rig.events.tick()
    rig.events.tick()
    assert rig.texts() == ["sonar A sends mod255 checksums, not mod256: they are accepted from now on"]
