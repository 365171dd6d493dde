import dataclasses

import pytest

from bluerov_slam.pipeline.health import (
    ChipState,
    HealthFacts,
    HealthMonitor,
    LinkFacts,
    MavlinkFacts,
    NavigationFacts,
    PortState,
    RecorderFacts,
    RecorderState,
    SensorFacts,
)
from bluerov_slam.pipeline.link_counters import LinkDecoderCounters
from bluerov_slam.records import NavMode, SensorTrust

WELL = NavigationFacts("running", mode=NavMode.AIDED, text="Known within 2.1 m", heard_s=99.9)
GPS = SensorFacts("gps", SensorTrust.REJECTED, "it jumped by 1 km")
DEPTH = SensorFacts("depth", SensorTrust.IGNORED, "the pressure has not changed for 20 s: check the sensor.")
THRUST = SensorFacts("thrust", SensorTrust.IGNORED, "no battery voltage")


def assess(facts, link=PortState.CONNECTED):
    health = HealthMonitor().assess(
        100.0,
        HealthFacts(
            LinkFacts(link), RecorderFacts(RecorderState.OFF), MavlinkFacts(enabled=False), LinkDecoderCounters(),
            navigation=facts,
        ),
    )  # fmt: skip
    chip = next(chip for chip in health.chips if chip.id == "navigation")
    assert 0 < len(chip.text) <= 40
    faults = [fault for fault in health.faults if fault.title.startswith("Navigation")]
    assert all(all(dataclasses.astuple(fault)) for fault in faults)
    return chip, faults


def changed(**changes):
    return assess(dataclasses.replace(WELL, **changes))


def test_a_known_position_is_ok():
    chip, faults = assess(WELL)
    assert (chip.state, chip.text, faults) == (ChipState.OK, "Known within 2.1 m", [])


@pytest.mark.parametrize("facts", [None, NavigationFacts("off")])
def test_switched_off_is_off(facts):
    chip, faults = assess(facts)
    assert (chip.state, faults) == (ChipState.OFF, [])


@pytest.mark.parametrize("mode", [NavMode.STARTING, NavMode.ATTITUDE])
def test_no_position_yet_is_not_known(mode):
    assert changed(mode=mode, text="No position yet")[0].state is ChipState.UNKNOWN
    assert changed(mode=None, heard_s=None)[0].text == "Waiting for data"


def test_silence_of_the_link_is_the_links_fault():
    chip, faults = changed(heard_s=80.0)
    assert (chip.state, chip.text, faults) == (ChipState.UNKNOWN, "No data for 20 s", [])
    assert assess(dataclasses.replace(WELL, heard_s=80.0), PortState.FINISHED)[0].text == "Replay finished"


@pytest.mark.parametrize(
    ("changes", "fault_id", "state", "word"),
    [
        ({"worker": "restarting", "error": "killed by SIGKILL"}, "navigation_crashed", ChipState.FAULT, "SIGKILL"),
        ({"worker": "starting", "error": "exit code 1"}, "navigation_crashed", ChipState.FAULT, "exit code 1"),
        ({"dropped": 17}, "navigation_drops", ChipState.WARN, "17 records"),
        ({"save_error": "No space left on device"}, "navigation_unsaved", ChipState.WARN, "No space left"),
        ({"distrusted": (GPS,)}, "navigation_distrust", ChipState.WARN, "GPS: it jumped by 1 km"),
        ({"odometry_problem": "Nothing is sent: MAVLink is off"}, "odometry_stopped", ChipState.WARN, "MAVLink is off"),
    ],
)
def test_each_fault_has_cause_and_cure(changes, fault_id, state, word):
    chip, faults = changed(**changes)
    assert [fault.id for fault in faults] == [fault_id]
    assert chip.state is state
    assert word in faults[0].cause


def test_distrusted_sensors_are_named_and_each_reason_is_told():
    chip, (fault,) = changed(distrusted=(GPS, DEPTH))
    assert chip.text == "GPS and Depth not trusted"
    assert "pressure has not changed" in fault.cause
    assert ".." not in fault.cause
    assert changed(distrusted=(GPS, DEPTH, THRUST))[0].text == "3 sensors not trusted"
