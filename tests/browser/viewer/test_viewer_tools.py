"""Contacts, measuring, cursor and snapshot; the sonar's settings."""

from __future__ import annotations

import csv
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from browser_rig import OpenPage, RunningSystem, Watch
from viewer_page import READING, live, put_cursor, settled, until, with_vehicle

pytestmark = pytest.mark.browser


# --- contacts, measuring, snapshot


def test_a_contact_is_named_listed_exported_and_still_there_after_a_reload(
    system: RunningSystem, open_page: OpenPage
) -> None:
    page = open_page(system.viewer)
    settled(page)
    page.mouse.click(*put_cursor(page, 0.8, 0.4))
    name = page.get_by_label("Name", exact=True)
    expect(name).to_be_focused()
    name.fill("Anchor, old")
    page.keyboard.press("Enter")
    expect(page.locator("#drop")).to_be_hidden()
    page.keyboard.press("c")
    row = page.locator(".contact", has=page.locator("input[value='Anchor, old']"))
    expect(row).to_have_count(1)
    expect(row).to_contain_text("starboard")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save CSV").click()
    with Path(download.value.path()).open(newline="") as file:
        saved = [line for line in csv.DictReader(file) if line["name"] == "Anchor, old"]
    assert len(saved) == 1
    assert float(saved[0]["range_m"]) > 0
    page.reload()
    live(page)
    page.keyboard.press("c")
    again = page.locator(".contact", has=page.locator("input[value='Anchor, old']"))
    expect(again).to_have_count(1)
    kept = system.get("api/contacts", system.viewer)["contacts"]
    assert [contact["channel"] for contact in kept if contact["name"] == "Anchor, old"] == ["A"]
    again.get_by_role("button", name="Show").click()
    marker = "viewer.overlay.markers.find((marker) => marker.name === 'Anchor, old')"
    until(page, f"{marker}.selected && viewer.overlay.locate({marker}.spot) !== null")
    again.get_by_role("button", name="Delete").click()
    page.locator("#confirm").get_by_role("button", name="Delete").click()
    expect(again).to_have_count(0)


def test_a_contact_can_be_dropped_by_keyboard_alone(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    settled(page)
    for _ in range(4):
        page.keyboard.press("Shift+ArrowRight")
    expect(page.locator("#readout-range")).to_contain_text("m stbd")
    page.locator("#stage").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_label("Name", exact=True)).to_be_focused()
    page.keyboard.type("By keys")
    page.keyboard.press("Enter")
    expect(page.locator("#toast")).to_contain_text("By keys saved")
    assert any(c["name"] == "By keys" for c in system.get("api/contacts", system.viewer)["contacts"])


def test_dragging_measures(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    settled(page)
    page.mouse.move(*put_cursor(page, 0.6, 0.3))
    page.mouse.down()
    put_cursor(page, 0.8, 0.5)
    page.mouse.up()
    until(page, "viewer.overlay.measurement !== null")
    measured = page.evaluate("viewer.overlay.measurement")
    across = abs(measured["to"]["rangeM"] - measured["from"]["rangeM"])
    assert across > 1
    assert f"{across:.2f} m across" in measured["label"]
    page.keyboard.press("Escape")
    assert page.evaluate("viewer.overlay.measurement") is None


def test_the_cursor_reads_range_time_and_amplitude(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    settled(page)
    put_cursor(page, 0.25, 0.5)
    expect(page.locator("#readout-range")).to_have_text(re.compile(r"^\d+\.\d\d m port$"))
    expect(page.locator("#readout-time")).to_have_text(re.compile(r"^\d\d:\d\d:\d\d\.\d$"))
    expect(page.locator("#readout-amplitude")).to_have_text(re.compile(r"^(\d+ \(\d+ %\)|missing|lost|-)$"))


def only_told(**vehicle: Any) -> Callable[[Page], None]:
    """The vehicle as stated, and no history of it from before the page was opened, which has the real one."""
    prepared = with_vehicle(**vehicle)

    def prepare(page: Page) -> None:
        page.route("**/api/track*", lambda route: route.fulfill(json={"columns": [], "states": []}))
        prepared(page)

    return prepare


def cursor_on_known_vehicle(page: Page) -> tuple[float, float]:
    """The mouse on starboard, at a time at which this page was told about the vehicle."""
    live(page)
    until(page, "viewer.track.states.length > 4")
    settled(page)
    known = "viewer.overlay.locate({channel: 'A', rangeM: 10, timeS: viewer.track.states[3].timeS})"
    until(page, f"{known} !== null")
    place, box = page.evaluate(known), page.locator("#stage").bounding_box()
    assert box
    at = (box["x"] + place["x"], box["y"] + place["y"])
    page.mouse.move(*at)
    return at


def test_the_position_under_the_cursor_is_the_estimates_with_its_uncertainty(
    system: RunningSystem, open_page: OpenPage
) -> None:
    estimate = {
        "latitude_deg": 47.6, "longitude_deg": -2.7, "within_m": 3.0, "heading_deg": 0.0, "heading_std_deg": 0.0,
        "altitude_m": None,
    }  # fmt: skip
    page = open_page(system.viewer, prepare=only_told(latitude_deg=None, longitude_deg=None, estimate=estimate))
    at = cursor_on_known_vehicle(page)
    position = page.locator("#readout-position")
    # Heading north: the echo to starboard lies due east. No height above the bottom is known, and that is said.
    expect(position).to_have_text(re.compile(r"^≈ 47\.60000° N, 2\.699\d\d° W ±3\.0 m slant$"))
    page.mouse.click(*at)
    page.get_by_label("Name", exact=True).fill("East of north")
    page.keyboard.press("Enter")
    expect(page.locator("#drop")).to_be_hidden()
    kept = system.get("api/contacts", system.viewer)["contacts"]
    contact = next(contact for contact in kept if contact["name"] == "East of north")
    assert (contact["position_within_m"], contact["ground_range_m"]) == (3.0, None)
    assert -2.7 < contact["longitude_deg"] < -2.699


def test_without_estimate_and_gps_the_position_is_a_dash(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer, prepare=only_told(latitude_deg=None, longitude_deg=None, estimate=None))
    cursor_on_known_vehicle(page)
    expect(page.locator("#readout-range")).not_to_have_text("-")
    expect(page.locator("#readout-position")).to_have_text("-")


def test_a_snapshot_is_a_png_as_wide_as_the_picture(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    with page.expect_download() as download:
        page.keyboard.press("s")
    data = Path(download.value.path()).read_bytes()
    assert re.fullmatch(r"sonar_\d{8}T\d{6}Z\.png", download.value.suggested_filename)
    assert data.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", data[16:24])
    assert width == page.evaluate("viewer.stage.picture.width")
    assert height > page.evaluate("viewer.stage.picture.height")


# --- the sonar's settings


def test_a_setting_is_asked_and_read_back_from_the_sonar(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    page.keyboard.press("o")
    page.get_by_role("radio", name="Both").check()
    expect(page.locator("#sonar-range_m-read")).to_contain_text("Reads A")
    page.locator("#sonar-range_m").fill("14")
    expect(page.locator("#sonar-sum")).to_contain_text("Two-way time 2 × 14 m")
    page.get_by_role("button", name="Apply").click()
    expect(page.locator("#sonar-answer")).to_contain_text("set and read back")
    expect(page.locator("#sonar-range_m-read")).to_have_text("Reads A 14.00, B 14.00")
    assert system.get("api/sonar", system.viewer)["A"]["read"]["range_m"] == pytest.approx(14)
    until(page, "Math.abs(viewer.waterfall.farthestM - 14) < 0.1")
    page.locator("#sonar-range_m").fill("20")
    page.get_by_role("button", name="Apply").click()
    expect(page.locator("#sonar-range_m-read")).to_have_text("Reads A 20.00, B 20.00")


def test_a_conflict_is_refused_with_its_arithmetic(system: RunningSystem, open_page: OpenPage, watch: Watch) -> None:
    watch.expect_complaints("409", *READING)
    page = open_page(system.viewer)
    live(page)
    page.keyboard.press("o")
    expect(page.locator("#sonar-period_ms-read")).to_contain_text("Reads")
    before = system.get("api/sonar", system.viewer)["A"]["read"]
    page.locator("#sonar-range_m").fill("190")
    expect(page.locator("#sonar-sum")).to_have_text(re.compile(r"2 × 190 m / \d+(\.\d+)? m/s = \d+\.\d ms > period"))
    page.get_by_role("button", name="Apply").click()
    expect(page.locator("#sonar-answer")).to_have_text(re.compile(r"2 x 190(\.\d+)? m / \d+ m/s = \d+\.\d ms"))
    assert system.get("api/sonar", system.viewer)["A"]["read"] == before
    page.get_by_role("button", name="Revert").click()
    expect(page.locator("#sonar-answer")).to_have_text("")


def test_a_value_that_cannot_be_is_not_sent(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    page.keyboard.press("o")
    page.locator("#sonar-period_ms").fill("soon")
    expect(page.locator("#sonar-period_ms")).to_have_attribute("aria-invalid", "true")
    posts: list[str] = []
    page.on("request", lambda request: posts.append(request.url) if request.method == "POST" else None)
    page.get_by_role("button", name="Apply").click()
    expect(page.locator("#sonar-answer")).to_contain_text("Period: a number")
    assert posts == []


def test_the_ctd_gives_the_sound_speed(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    page.keyboard.press("o")
    button = page.get_by_role("button", name="Use CTD value")
    expect(button).to_have_text(re.compile(r"\(\d+\.\d m/s\)"))
    button.click()
    typed = float(page.locator("#sonar-sound_speed_mps").input_value())
    assert 1350 < typed < 1750


def test_flash_and_reboot_ask_first(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    posts: list[str] = []
    page.on("request", lambda request: posts.append(request.url) if request.method == "POST" else None)
    page.keyboard.press("o")
    page.get_by_role("button", name="Reboot").click()
    expect(page.locator("#confirm")).to_be_visible()
    page.get_by_role("button", name="Cancel").click()
    assert posts == []
    page.get_by_role("radio", name="Stbd A").check()
    page.get_by_role("button", name="Save to flash").click()
    page.locator("#confirm").get_by_role("button", name="Save").click()
    expect(page.locator("#sonar-answer")).to_contain_text("saved")
    assert [url.rsplit("/", 3)[1:] for url in posts] == [["sonar", "A", "action"]]
