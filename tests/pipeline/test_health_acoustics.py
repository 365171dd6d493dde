"""The chip of the acoustic array, from pulses to its few words."""

from typing import Any

import pytest

from bluerov_slam.acoustics.position import IN_PLANE
from bluerov_slam.pipeline.acoustic_callers import OTHER_TEXT, PLACES_TEXT, TWO_TEXT, WRONG_TEXT
from bluerov_slam.pipeline.acoustic_watch import (
    NAVIGATION_OFF,
    NOT_DESCRIBED,
    NOT_FITTED,
    AcousticWatch,
    AcousticWords,
)
from bluerov_slam.pipeline.health import (
    AcousticFacts,
    Chip,
    ChipState,
    Health,
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
from bluerov_slam.pipeline.health_acoustics import acoustic_parts
from bluerov_slam.pipeline.link_counters import LinkDecoderCounters
from bluerov_slam.records import AcousticFix, NavMode, SensorTrust

ONE_METRE = ((0.25, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.01))


def fix(at_s: float = 100.0, **changes: Any) -> AcousticFix:
    values: dict[str, Any] = {
        "accepted": True, "reason": "", "sound_speed_mps": 1500.0, "azimuth_rad": -0.4, "elevation_rad": 0.2,
        "range_m": 20.0, "range_std_m": 1.0, "position_deg": (54.0, 10.0), "covariance_ned_m2": ONE_METRE,
    }  # fmt: skip
    return AcousticFix(at_s, at_s, **(values | changes))


def assess(facts: AcousticFacts | None, link: PortState = PortState.CONNECTED, **changes: Any) -> Health:
    return HealthMonitor().assess(
        100.0,
        HealthFacts(
            LinkFacts(link), RecorderFacts(RecorderState.OFF), MavlinkFacts(enabled=False), LinkDecoderCounters(),
            acoustics=facts, **changes,
        ),
    )  # fmt: skip


def chip_of(health: Health) -> Chip:
    chip = health.chips[-1]
    assert chip.id == "acoustics"
    assert 0 < len(chip.text) <= 28
    faults = [fault for fault in health.faults if fault.id.startswith("acoustics")]
    assert bool(faults) == bool(chip.cause)
    assert all(fault.cause and fault.cure for fault in faults)
    return chip


def chip(words: AcousticWords, age_s: float | None = 0.5, link: PortState = PortState.CONNECTED) -> Chip:
    return chip_of(assess(AcousticFacts(words, age_s), link))


def said(*fixes: AcousticFix, now_s: float = 100.0) -> AcousticWords:
    watch = AcousticWatch()
    for each in fixes:
        watch.observe(each)
    return watch.words(now_s)


def test_without_an_array_it_is_off() -> None:
    for health in (assess(None), assess(AcousticFacts(NOT_FITTED))):
        found = chip_of(health)
        assert (found.state, found.text) == (ChipState.OFF, "No array")


@pytest.mark.parametrize(
    ("words", "state"), [(NOT_DESCRIBED, ChipState.WARN), (NAVIGATION_OFF, ChipState.FAULT)], ids=["array", "estimator"]
)
def test_a_setting_that_is_missing_has_its_cure(words: AcousticWords, state: ChipState) -> None:
    found = chip(words, None)
    assert found.state is state
    assert "under Settings" in found.cure


def test_a_fresh_fix_is_told_with_the_longer_axis_of_its_ellipse() -> None:
    found = chip(said(*(fix(96.0 + k) for k in range(5))))
    assert (found.state, found.text) == (ChipState.OK, "Fix within 2.4 m")


def test_a_fix_grows_stale_before_it_is_a_silence() -> None:
    words = said(fix(93.0))
    found = chip(words, 7.0)
    assert (found.state, found.text) == (ChipState.UNKNOWN, "Stale: 7 s old")
    silent = chip(said(fix(88.0)), 12.0)
    assert (silent.state, silent.text) == (ChipState.FAULT, "No pulses for 12 s")
    assert "udp_port" in silent.cure
    finished = chip(said(fix(88.0)), 12.0, PortState.FINISHED)
    assert (finished.state, finished.text) == (ChipState.UNKNOWN, "Replay finished")


def test_before_the_first_pulse_it_says_what_to_check() -> None:
    found = chip(AcousticWatch().words(100.0), None)
    assert (found.state, found.text) == (ChipState.UNKNOWN, "No pulse heard yet")
    assert "transmitter is on" in dict(found.parts)["To check"]


@pytest.mark.parametrize(
    "reason",
    [
        TWO_TEXT,
        PLACES_TEXT,
        WRONG_TEXT,
        "no receiver heard a pulse: the transmitter is off, or out of range",
        "only 2 of the receivers can be used, and a direction needs 3",
        IN_PLANE,
        "delay 2 is 500.0 us, the array allows 333.0 us",
        "receivers 0 and 2 or 1 and 3 seem exchanged; check the order of their plugs",
        "a sample rate of 50000 Hz, expected 100000 to 20000000",
        "short: the record lasts 0.20 ms, one bit of a pulse 0.50 ms",
        "sample rate: the carrier comes out at 20.0 kHz: not sampled at 425700 Hz, more like 851400",
    ],
)
def test_what_is_refused_says_why_in_few_words(reason: str) -> None:
    found = chip(said(*(fix(96.0 + k, accepted=False, reason=reason) for k in range(5))))
    assert found.state is ChipState.FAULT
    assert found.text.startswith("Refused: ")
    assert found.cause.startswith(reason.partition("; ")[0][1:20], 1)


def test_what_nobody_thought_of_still_has_a_cause_and_a_cure() -> None:
    found = chip(said(fix(accepted=False, reason="strange")))
    assert (found.text, found.cause) == ("Pulses refused", "Strange.")
    assert chip(said(fix(accepted=False))).cause == "The pulses cannot be used."


def test_a_direction_alone_and_a_receiver_left_out_are_warnings() -> None:
    alone = {"range_m": None, "position_deg": None, "covariance_ned_m2": None}
    found = chip(said(fix(reason="no position: the depth contradicts the angles", **alone)))
    assert (found.state, found.text) == (ChipState.WARN, "Depth contradicts angles")
    left_out = ((2, "its delay is longer than the array allows: an echo, noise or another sound"),)
    found = chip(said(fix(excluded=left_out)))
    assert (found.state, found.text) == (ChipState.WARN, "Receiver 2 is left out")
    assert "longer than the array allows" in found.cause


def test_another_transmitter_beside_ours_is_a_warning() -> None:
    pulses = (fix(90.0 + k, **({"accepted": False, "reason": OTHER_TEXT} if k % 2 else {})) for k in range(11))
    found = chip(said(*pulses))
    assert (found.state, found.text) == (ChipState.WARN, "Two heard, ours used")


def test_a_fix_that_navigation_refuses_is_not_green() -> None:
    navigation = NavigationFacts(
        "running", mode=NavMode.AIDED, text="Known within 2.1 m", heard_s=99.9,
        distrusted=(SensorFacts("acoustics", SensorTrust.REJECTED, "it jumps"),),
    )  # fmt: skip
    health = assess(AcousticFacts(said(fix()), 0.5), navigation=navigation)
    found = chip_of(health)
    assert (found.state, found.text) == (ChipState.WARN, "Navigation refuses it")
    assert dict(found.parts)["Why"] == "it jumps"


def test_what_the_newest_pulse_told_stands_behind_the_chip() -> None:
    assert acoustic_parts(None, 0, 0) == ()
    parts = dict(acoustic_parts(fix(), 40, 3))
    assert parts["Transmitter"] == "23\u00b0 to port, 11\u00b0 down"
    assert parts["Distance"] == "20.0 m, within 2.0 m (95 %)"
    assert parts["Fix"] == "within 2.4 m (95 %)"
    assert parts["Pulses"] == "40 heard, 3 refused"
    parts = dict(acoustic_parts(fix(accepted=False, reason=TWO_TEXT), 40, 4))
    assert "Distance" not in parts
    assert "Fix" not in parts
    assert parts["Newest pulse"].startswith("two transmitters")
