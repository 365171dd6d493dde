"""The acoustic card and the map's beacon in a real browser; mostly with a state put in the extension's messages."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from browser_rig import OpenPage, RunningSystem
from dashboard_page import blank, changed_messages, huge, live, until

pytestmark = pytest.mark.browser

CARD = ".card-acoustics"


def receiver(index: int, **changes: Any) -> dict[str, Any]:
    return {"index": index, "signal_counts": 300.0, "snr_db": None, "state": "used", "reason": ""} | changes


def heard(**changes: Any) -> dict[str, Any]:
    """The topic's data after a good pulse, with a few keys changed."""
    return {
        "enabled": True, "state": "ok", "text": "Heard; the position rests on its direction and the depth", "cure": "",
        "age_s": 0.1, "accepted": True, "reason": "",
        "direction": {"azimuth_deg": 22.4, "elevation_deg": -12.0, "std_deg": 0.3},
        "range_m": 50.0, "range_std_m": 2.0, "delays_us": [60.0, 150.0, 80.0], "residuals_us": [0.1, -0.4, 0.2],
        "slip": {"state": "sure", "probability": 0.0}, "receivers": [receiver(index) for index in range(4)],
        "sound_speed_mps": 1499.0, "raw_bits": "11110000000101", "record_id": None,
        "message": {"text": "Position report", "latitude_deg": 47.6, "longitude_deg": -2.7, "std_m": 2.0,
                    "depth_m": 10.0, "age_s": 3.0, "corrected_errors": 2, "bytes": "01"},
        "fix": {"north_m": 10.0, "east_m": -6.0, "latitude_deg": 47.6, "longitude_deg": -2.7, "accepted": True,
                "reason": "", "ellipse": {"major_m": 6.0, "minor_m": 2.0, "bearing_deg": 30.0, "probability": 0.95}},
        "beacon": {"latitude_deg": 47.6, "longitude_deg": -2.7, "depth_m": 3.0, "source": "message",
                   "north_m": 30.0, "east_m": 25.0},
        "pings": 40, "rejected": 3, "missing_samples": 0, "sources": ["127.0.0.1:5"], "simulated": True,
    } | changes  # fmt: skip


def told(data: dict[str, Any]) -> Any:
    """Every message of the array says this."""
    return changed_messages(lambda message: {**message, "data": data} if message["topic"] == "acoustics" else message)


def shown(system: RunningSystem, open_page: OpenPage, data: dict[str, Any], width: int = 1440) -> Page:
    page = open_page(system.dashboard, width=width, prepare=told(data))
    live(page)
    return page


def cell(page: Page, label: str, number: int = 0) -> Any:
    return page.locator(f"{CARD} .cell", has=page.get_by_text(label, exact=True)).locator(".number").nth(number)


def test_without_an_array_there_is_one_quiet_line(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard)
    live(page)
    expect(page.locator(f"{CARD} .acoustics-text")).to_have_text("No acoustic array is fitted")
    expect(page.locator(f"{CARD} .acoustics-body")).to_be_hidden()
    assert page.locator(CARD).bounding_box()["height"] < 90  # type: ignore[index]
    expect(page.locator(".map-legend")).not_to_contain_text("acoustic pulse")


def test_the_card_tells_direction_distance_and_each_receiver(system: RunningSystem, open_page: OpenPage) -> None:
    page = shown(system, open_page, heard())
    expect(cell(page, "Azimuth")).to_have_text("22° stbd")
    expect(cell(page, "Elevation")).to_have_text("12° up")
    expect(cell(page, "Distance")).to_have_text("50.0")
    expect(cell(page, "Within (95 %)", 0)).to_have_text("0.73°")
    expect(cell(page, "Within (95 %)", 1)).to_have_text("3.9")
    expect(cell(page, "Residual")).to_have_text("0.40")
    expect(cell(page, "Carrier cell")).to_have_text("Sure")
    expect(cell(page, "Pulses left out")).to_have_text("3 of 40")
    expect(page.locator(f"{CARD} .receivers li")).to_have_count(4)
    expect(page.locator(f"{CARD} canvas")).to_have_attribute("aria-label", "Transmitter: 22° stbd, 12° up")
    message = page.locator(f"{CARD} .acoustics-message")
    expect(message).to_contain_text("Position report, 47.600000° N, 2.700000° W, depth 10.0 m")
    expect(message).to_contain_text("2 errors corrected")


def test_what_is_wrong_comes_with_its_cure(system: RunningSystem, open_page: OpenPage) -> None:
    silent = [
        receiver(0),
        receiver(1),
        receiver(2, state="silent", reason="silent: check its cable", signal_counts=2.0),
    ]
    wrong = {"state": "warn", "text": "Receiver 2: silent", "cure": "Check its cable."}
    page = shown(system, open_page, heard(receivers=silent, **wrong))
    expect(page.locator(f"{CARD} .acoustics-text")).to_have_text("Receiver 2: silent")
    expect(page.locator(f"{CARD} .acoustics-cure")).to_have_text("Check its cable.")
    line = page.locator(f"{CARD} .receivers li").nth(2)
    expect(line).to_contain_text("silent: check its cable")
    expect(line.locator(".state-icon")).to_have_attribute("data-state", "fault")
    expect(page.get_by_text("Acoustics: Receiver 2: silent. Check its cable.")).to_be_attached()


def test_old_pulses_are_seen_to_be_old(system: RunningSystem, open_page: OpenPage) -> None:
    gone = {"state": "fault", "text": "No pulses for 30 s", "age_s": 30.0}
    page = shown(system, open_page, heard(**gone))
    expect(page.locator(CARD)).to_have_class("card card-acoustics stale")
    expect(page.locator(f"{CARD} canvas")).to_have_attribute("aria-label", "Direction of the transmitter: unknown")


def test_units_of_the_settings_hold_here_too(system: RunningSystem, open_page: OpenPage) -> None:
    def prepare(page: Page) -> None:
        told(heard())(page)

        def imperial(route: Any) -> None:
            answer = route.fetch().json()
            for setting in answer["settings"]:
                if setting["key"] == "display.units":
                    setting["value"] = "imperial"
            route.fulfill(json=answer)

        page.route("**/api/settings", imperial)

    page = open_page(system.dashboard, prepare=prepare)
    live(page)
    expect(cell(page, "Distance")).to_have_text("164.0")
    expect(page.locator(f"{CARD} .acoustics-message")).to_contain_text("depth 32.8 ft")


# How many pixels of the map's upper layer have the colour of sound.
SOUND = """() => {
    const canvas = document.querySelectorAll('.map-canvas')[1];
    if (!canvas?.width) return 0;
    const probe = document.createElement('canvas').getContext('2d');
    probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--plot-sound');
    probe.fillRect(0, 0, 1, 1);
    const wanted = probe.getImageData(0, 0, 1, 1).data;
    const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    let count = 0;
    for (let i = 0; i < pixels.length; i += 4)
        if (pixels[i + 3] > 200 && [0, 1, 2].every((k) => Math.abs(pixels[i + k] - wanted[k]) < 12)) count += 1;
    return count;
}"""


def test_beacon_and_newest_pulse_are_on_the_map(system: RunningSystem, open_page: OpenPage) -> None:
    page = shown(system, open_page, heard())
    expect(page.locator(".map-legend")).to_contain_text("acoustic pulse")
    page.get_by_role("button", name="Fit").click()
    # The symbols keep their size on the screen; how much of the ellipse is drawn depends on the length of the track.
    until(page, lambda: page.evaluate(SOUND) > 12)


def test_nothing_of_an_array_that_is_switched_off_stays_on_the_map(system: RunningSystem, open_page: OpenPage) -> None:
    page = shown(system, open_page, heard(enabled=False, state="off", text="No acoustic array is fitted"))
    page.get_by_role("button", name="Fit").click()
    page.wait_for_timeout(300)
    assert page.evaluate(SOUND) == 0


@pytest.mark.parametrize("change", [blank, huge], ids=["blank", "huge"])
def test_any_values_are_taken(system: RunningSystem, open_page: OpenPage, change: Any) -> None:
    data = {**change(heard()), "enabled": True}
    data["receivers"] = [change(receiver(index)) for index in range(3)] + [None]
    page = shown(system, open_page, data)
    expect(page.locator(f"{CARD} .receivers li")).to_have_count(4)


@pytest.mark.parametrize("width", [320, 390, 1024])
def test_it_fits_narrow_screens(system: RunningSystem, open_page: OpenPage, width: int) -> None:
    wordy = [
        receiver(k, state="excluded", reason="its delay is longer than the array allows: an echo") for k in range(16)
    ]
    page = shown(system, open_page, heard(receivers=wordy), width=width)
    expect(page.locator(f"{CARD} .receivers li")).to_have_count(16)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_extension_speaks_of_it_at_once(system: RunningSystem, open_page: OpenPage) -> None:
    topics: list[str] = []

    def prepare(page: Page) -> None:
        page.on("websocket", lambda ws: ws.on("framereceived", lambda text: topics.append(json.loads(text)["topic"])))

    page = open_page(system.dashboard, prepare=prepare)
    live(page)
    until(page, lambda: "acoustics" in topics)


def refused(message: dict[str, Any]) -> dict[str, Any]:
    """The status with a chip of the array that has much to say."""
    if message["topic"] == "status":
        for chip in message["data"]["chips"]:
            if chip["id"] == "acoustics":
                chip |= {
                    "state": "fault",
                    "text": "Refused: receivers swapped",
                    "cause": "Receivers 0 and 2.",
                    "cure": "Check their plugs.",
                    "age_s": 0.4,
                    "parts": [["Pulses", "40 heard, 39 refused"]],
                }
    return message  # fmt: skip


@pytest.mark.parametrize("width", [1920, 1440, 1180, 1024, 390, 320])
def test_the_chip_is_whole_at_every_width_and_opens(system: RunningSystem, open_page: OpenPage, width: int) -> None:
    page = open_page(system.dashboard, width=width, prepare=changed_messages(refused))
    live(page)
    chip = page.get_by_role("button", name="Acoustics: Fault")
    expect(chip).to_have_attribute("title", re.compile("swapped\nCause: Receivers 0 and 2.\nCure: Check their plugs."))
    cut = "[...document.querySelectorAll('#strip .chip-label')].filter((l) => l.scrollWidth > l.clientWidth + 1)"
    assert page.evaluate(f"{cut}.map((l) => l.textContent)") == []
    chip.click()
    detail = page.get_by_role("dialog", name="Acoustics")
    for words in ("Refused: receivers swapped", "Check their plugs.", "40 heard, 39 refused"):
        expect(detail).to_contain_text(words)
