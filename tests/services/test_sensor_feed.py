import json
from dataclasses import replace

import pytest

from bluerov_slam.records import FixType, Sender, VehicleMotionDelta
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.sensor_feed import SensorFeed
from samples import ctd_sample, gps_fix, sensor_sample

OFFSET_S = 1_800_000_000.0
MOTION = VehicleMotionDelta(100.0, 0, 0.5, (0.0, 0.0, 0.0), (0.5, -0.1, 0.05), 90.0)


class Audience:
    """A broadcaster that somebody listens to, or nobody."""

    def __init__(self, listening=True):
        self.listening, self.messages = listening, []

    def wants(self, _topic):
        return self.listening

    def publish_text(self, _topic, payload):
        self.messages.append(json.loads(payload))


class Rig:
    def __init__(self, listening=True):
        self.hub, self.now_s = Hub(), 100.0
        self.bare, self.topics = Audience(listening), Audience(listening)
        self.feed = SensorFeed(
            self.hub,
            self.bare,
            self.topics,
            alive=lambda _channel: True,
            unix_s=lambda s: s + OFFSET_S,
            now_s=lambda: self.now_s,
        )

    def sense(self, **changes):
        sample = sensor_sample(**changes)
        self.hub.publish(sample)
        self.hub.publish(ctd_sample(arrived_s=sample.arrived_s))


def test_each_frame_goes_out_bare_and_with_what_is_known_beyond_it():
    rig = Rig()
    rig.sense()
    [bare], [message] = rig.bare.messages, rig.topics.messages
    assert message["data"] == bare
    assert message["topic"] == "sensors"
    assert message["t"] == pytest.approx(OFFSET_S + 100.01)
    assert message["extra"]["measured_unix_s"] == pytest.approx(OFFSET_S + 100.0)
    assert message["extra"]["sender"] == "full_range"


def test_nothing_is_encoded_when_nobody_listens():
    rig = Rig(listening=False)
    rig.sense()
    assert rig.bare.messages == rig.topics.messages == []
    assert rig.feed.latest()["ts"] == 12345


def test_an_old_frame_keeps_its_values_and_nothing_in_it_is_alive():
    rig = Rig()
    rig.sense()
    assert rig.feed.latest()["imu"]["alive"] is True
    rig.now_s = 106.0
    latest = rig.feed.latest()
    assert latest["imu"]["r"] is not None
    assert not any(part["alive"] for part in latest.values() if isinstance(part, dict) and "alive" in part)
    assert latest["depth"]["ok"] is latest["celsius"]["ok"] is False


@pytest.mark.parametrize(("fix", "name"), [(FixType.NONE, "none"), (FixType.FIX_2D, "2d"), (FixType.FIX_3D, "3d")])
def test_the_receivers_own_word_on_its_fix_counts(fix, name):
    rig = Rig()
    rig.hub.publish(gps_fix(fix=fix))
    rig.sense()
    assert rig.topics.messages[-1]["extra"]["gps_fix"] == name


def test_without_the_receivers_word_only_the_absence_of_a_position_is_certain():
    rig = Rig()
    rig.sense(gps_latitude_deg=None, gps_longitude_deg=None)
    rig.sense()
    rig.sense(gps_alive=False, gps_latitude_deg=None)
    assert [message["extra"]["gps_fix"] for message in rig.topics.messages] == ["none", None, None]


def test_an_old_gps_report_is_forgotten():
    rig = Rig()
    rig.hub.publish(gps_fix(arrived_s=90.0))
    rig.sense(sender=Sender.LEGACY)
    extra = rig.topics.messages[-1]["extra"]
    assert (extra["gps_fix"], extra["hdop"], extra["sender"]) == (None, None, "legacy")


def test_a_dvl_gives_velocity_while_it_is_fresh_and_confident():
    rig = Rig()
    rig.hub.publish(MOTION)
    assert rig.feed.dvl_json() == {"vx": 1.0, "vy": -0.2, "vz": 0.1, "valid": True}
    rig.now_s = 103.0
    invalid = {"vx": 0.0, "vy": 0.0, "vz": 0.0, "valid": False}
    assert rig.feed.dvl_json() == invalid
    for useless in (replace(MOTION, confidence_percent=0.0), replace(MOTION, interval_s=0.0)):
        rig.now_s = 100.0
        rig.hub.publish(useless)
        assert rig.feed.dvl_json() == invalid


def test_the_ctd_answer_is_in_the_units_of_the_present_system():
    rig = Rig()
    rig.sense()
    assert rig.feed.ctd_json() == {
        "timestamp": "2027-01-15T08:01:40.000+00:00",
        "depth_m": 4.8,
        "temperature_c": 15.18,
        "conductivity_us": 42000.0,
        "salinity_psu": 34.9,
        "sound_velocity_ms": 1507.9,
        "pressure_mbar": 1500.0,
    }
