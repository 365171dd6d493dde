"""What the pilot is told."""

from typing import Any

import pytest

from bluerov_slam.pipeline.acoustic_callers import OTHER_TEXT, PLACES_TEXT, TWO_TEXT, WRONG_TEXT
from bluerov_slam.pipeline.acoustic_watch import AcousticState, AcousticWatch, AcousticWords
from bluerov_slam.records import AcousticFix


def fix(at_s: float, **changes: Any) -> AcousticFix:
    values: dict[str, Any] = {
        "accepted": True, "reason": "", "sound_speed_mps": 1500.0, "azimuth_rad": 0.3, "elevation_rad": 0.2,
        "range_m": 20.0, "position_deg": (54.0, 10.0),
    }  # fmt: skip
    return AcousticFix(at_s, at_s, **(values | changes))


def words(*fixes: AcousticFix, now_s: float | None = None) -> AcousticWords:
    watch = AcousticWatch()
    for each in fixes:
        watch.observe(each)
    return watch.words(fixes[-1].arrived_s if now_s is None else now_s)


def series(count: int = 8, **changes: Any) -> list[AcousticFix]:
    return [fix(float(k), **changes) for k in range(count)]


def test_before_the_first_pulse_it_says_what_to_check() -> None:
    said = AcousticWatch().words(100.0)
    assert said.state is AcousticState.WAITING
    assert "transmitter is on" in said.cure


def test_good_pulses() -> None:
    assert words(*series()).state is AcousticState.OK
    assert words(*series(position_deg=None)).text == "Heard; direction and range are known"


def test_silence_is_a_fault_with_its_length() -> None:
    assert words(*series(), now_s=16.0).state is AcousticState.OK
    said = words(*series(), now_s=19.0)
    assert (said.state, said.text) == (AcousticState.FAULT, "No pulses for 12 s")
    assert words(*series(), now_s=607.0).text == "No pulses for 10 min"
    assert "udp_port" in said.cure


def test_one_bad_pulse_is_no_fault_and_most_of_them_are() -> None:
    bad = {"accepted": False, "reason": "only 2 of the receivers can be used, and a direction needs 3"}
    assert words(*series(), fix(8.0, **bad)).text == "Heard; 1 of the last 5 pulses were left out"
    said = words(*series(), *(fix(8.0 + k, **bad) for k in range(3)))
    assert said.state is AcousticState.FAULT
    assert said.text.startswith("Only 2 of the receivers")
    assert "cables" in said.cure


def test_a_receiver_that_stays_silent_is_named_with_its_cure() -> None:
    silent = ((2, "silent: check its cable"),)
    assert words(*series(), fix(8.0, excluded=silent)).state is AcousticState.OK
    said = words(*series(excluded=silent))
    assert (said.state, said.text, said.cure) == (AcousticState.WARN, "Receiver 2: silent", "Check its cable.")


@pytest.mark.parametrize(
    ("reason", "text", "cure"),
    [
        ("dead: stands still at 5 counts", "Receiver 2: dead, stands still at 5 counts", "amplifier's supply"),
        ("clipped: 31.4 % of its samples stand at the end of the scale", "Receiver 2: clipped, 31.4 %", "gain"),
        ("its delay is longer than the array allows: an echo", "Receiver 2: its delay is longer", "An echo."),
    ],
)
def test_a_figure_is_no_cure(reason: str, text: str, cure: str) -> None:
    """Records bring what is wrong with a receiver in figures."""
    said = words(*series(excluded=((2, reason),)))
    assert said.state is AcousticState.WARN
    assert said.text.startswith(text)
    assert cure in said.cure


def test_a_clipped_receiver_that_must_be_used_is_not_said_to_be_left_out() -> None:
    reason = "hears an echo as loud as the pulse"
    assert words(*series(excluded=((2, reason),), receivers=(0, 1, 2))).brief == "Receiver 2 is doubtful"
    assert words(*series(excluded=((2, reason),), receivers=(0, 1, 3))).brief == "Receiver 2 is left out"


@pytest.mark.parametrize(
    ("reason", "text"), [(TWO_TEXT, "Two transmitters"), (PLACES_TEXT, "jumps between two"), (WRONG_TEXT, "should be")]
)
def test_what_is_held_back_is_a_fault_with_its_cure(reason: str, text: str) -> None:
    said = words(*series(accepted=False, reason=reason))
    assert said.state is AcousticState.FAULT
    assert text in said.text
    assert ";" not in said.text
    assert said.cure.endswith(".")


def test_another_transmitter_beside_ours_is_a_warning() -> None:
    other = {"accepted": False, "reason": OTHER_TEXT}
    said = words(*(fix(float(k), **(other if k % 2 else {})) for k in range(12)))
    assert said.state is AcousticState.WARN
    assert "the one where ours should be is used" in said.text
    assert words(*series(), fix(8.0, **other)).state is AcousticState.OK


def test_a_direction_alone_says_what_is_missing() -> None:
    alone = {"range_m": None, "position_deg": None}
    said = words(*series(reason="no position: the transmitter's place is not known; set acoustics.beacon", **alone))
    assert said.text == "Direction only: the transmitter's place is not known"
    assert said.cure == "Set acoustics.beacon."
    said = words(*series(reason="no position: the depth contradicts the angles", **alone))
    assert "beacon_depth_m" in said.cure


def test_one_pulse_without_a_range_among_fixes_is_no_warning() -> None:
    alone = {"range_m": None, "position_deg": None, "reason": "no position: the attitude is not known yet"}
    assert words(*series(), fix(8.0, **alone)).state is AcousticState.OK
    said = words(*series(), *(fix(8.0 + k, **alone) for k in range(3)))
    assert said.text == "Direction only: the attitude is not known yet"
    assert "Navigation tab" in said.cure


def test_a_place_that_is_missing_while_the_range_is_known_is_told() -> None:
    said = words(
        *series(position_deg=None, reason="no position: the transmitter's place is not known; set acoustics.beacon")
    )
    assert said.state is AcousticState.OK
