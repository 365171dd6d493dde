from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import expect

from browser_rig import OpenPage, RunningSystem, Watch
from dashboard_page import open_tab

pytestmark = pytest.mark.browser


def test_a_recording_can_be_named_remarked_and_deleted_only_after_a_question(
    system: RunningSystem, open_page: OpenPage
) -> None:
    page = open_page(f"{system.dashboard}#recordings")
    first = page.locator(".recording", has=page.locator(".recording-now:visible")).first
    expect(first.get_by_role("button", name="Delete")).to_be_disabled()
    name = first.get_attribute("data-name")
    dive = page.locator(f"[data-name={name}]")
    dive.locator("summary").first.click()
    dive.get_by_label("Remark, dated now").fill("Anchor chain")
    dive.get_by_role("button", name="Add").click()
    expect(dive.locator(".annotations")).to_contain_text("Anchor chain")
    dive.get_by_label("Name", exact=True).fill("Wreck, second pass")
    dive.get_by_role("button", name="Save").click()
    expect(dive.locator("h3")).to_have_text("Wreck, second pass")
    page.get_by_role("button", name="Stop recording").click()
    expect(page.get_by_role("button", name="Start recording")).to_be_enabled()
    expect(dive.get_by_role("button", name="Delete")).to_be_enabled()

    dive.get_by_role("button", name="Delete").click()
    question = page.get_by_role("dialog")
    expect(question).to_contain_text("Wreck, second pass")
    expect(question.get_by_role("button", name="Cancel")).to_be_focused()
    page.keyboard.press("Escape")
    expect(question).to_have_count(0)
    expect(dive).to_be_visible()
    assert name in {recording["name"] for recording in system.get("api/recordings")["recordings"]}

    dive.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Delete for good").click()
    expect(dive).to_have_count(0)
    assert name not in {recording["name"] for recording in system.get("api/recordings")["recordings"]}
    page.get_by_role("button", name="Start recording").click()
    expect(page.get_by_role("button", name="Stop recording")).to_be_enabled()
    expect(page.locator(".recording", has=page.locator(".recording-now:visible"))).to_be_visible()


def test_a_recording_is_downloaded_file_by_file_and_whole(
    system: RunningSystem, open_page: OpenPage, tmp_path: Path
) -> None:
    name = system.active_recording(
        lambda dive: any(file["name"].endswith(".jsonl") and file["bytes"] > 1000 for file in dive["files"])
    )["name"]
    page = open_page(f"{system.dashboard}#recordings")
    dive = page.locator(f".recording[data-name={name}]")
    with page.expect_download() as export:
        dive.get_by_role("link", name="Export zip").click()
    export.value.save_as(tmp_path / "dive.zip")
    assert (tmp_path / "dive.zip").read_bytes()[:2] == b"PK"
    dive.locator("summary", has_text="Files").click()
    with page.expect_download() as log:
        dive.get_by_role("link", name=re.compile(r"\.jsonl$")).first.click()
    log.value.save_as(tmp_path / "dive.jsonl")
    lines = [json.loads(line) for line in (tmp_path / "dive.jsonl").read_text().splitlines()]
    assert any(line.get("ts", -1) >= 0 for line in lines)


def setting(system: RunningSystem, key: str) -> Any:
    """What the extension holds."""
    return next(item["value"] for item in system.get("api/settings")["settings"] if item["key"] == key)


def test_settings_show_default_reason_and_limits_and_are_applied(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(f"{system.dashboard}#settings")
    row = page.locator("[data-key='recording.max_file_mb']")
    expect(row).to_contain_text("default 256 MB")
    expect(row).to_contain_text("1 to 4096 MB")
    expect(row.locator(".hint").first).not_to_be_empty()
    apply = page.get_by_role("button", name="Apply")
    expect(apply).to_be_disabled()

    field = row.get_by_role("textbox")
    field.fill("99999")
    expect(row.locator(".setting-error")).to_have_text("Allowed: 1 to 4096 MB")
    expect(apply).to_be_disabled()
    page.get_by_role("button", name="Revert").click()
    expect(field).to_have_value("256")

    field.fill("128")
    expect(page.locator(".changes")).to_have_text("1 change")
    apply.click()
    expect(page.locator("#panel-settings > .notice-line")).to_contain_text("Applied")
    assert setting(system, "recording.max_file_mb") == 128
    row.get_by_role("button", name="back to the default").click()
    apply.click()
    expect(page.locator(".changes")).to_have_text("No changes")
    assert setting(system, "recording.max_file_mb") == 256


def test_a_refused_setting_names_the_reason_and_changes_nothing(
    system: RunningSystem, open_page: OpenPage, watch: Watch
) -> None:
    watch.expect_complaints("Failed to load resource")
    page = open_page(f"{system.dashboard}#settings")
    field = page.locator("[data-key='forwarding.targets']").get_by_role("textbox")
    field.fill("not a host!")
    page.get_by_role("button", name="Apply").click()
    expect(page.locator("#panel-settings > .notice-line")).to_have_attribute("data-level", "error")
    expect(page.locator("#panel-settings > .notice-line")).to_contain_text("forwarding")
    expect(field).to_have_value("not a host!")
    assert setting(system, "forwarding.targets") == ["127.0.0.1"]


def test_units_are_changed_for_the_pages_only(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(f"{system.dashboard}#settings")
    choice = page.locator("[data-key='display.units'] select")
    try:
        choice.select_option("imperial")
        page.get_by_role("button", name="Apply").click()
        open_tab(page, "Live")
        expect(page.locator(".card-depth .hero .unit")).to_have_text("ft")
        expect(page.locator("[data-field=temperature] .unit")).to_have_text("°F")
        expect(page.locator("[data-plot=depth] .unit")).to_have_text("ft")
    finally:
        open_tab(page, "Settings")
        choice.select_option("metric")
        page.get_by_role("button", name="Apply").click()
    open_tab(page, "Live")
    expect(page.locator(".card-depth .hero .unit")).to_have_text("m")


def test_settings_are_backed_up_and_restored(system: RunningSystem, open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(f"{system.dashboard}#settings")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save backup").click()
    backup = tmp_path / "backup.json"
    download.value.save_as(backup)
    assert isinstance(json.loads(backup.read_text()), dict)
    page.locator("input[type=file]").set_input_files(backup)
    expect(page.locator("#panel-settings > .notice-line")).to_have_text(re.compile("Restored"))
    (tmp_path / "wrong.json").write_text("no JSON")
    page.locator("input[type=file]").set_input_files(tmp_path / "wrong.json")
    expect(page.locator("#panel-settings > .notice-line")).to_contain_text(
        "no settings backup".replace("no ", "not a ")
    )


def test_mavlink_is_switched_on_here_and_says_that_nobody_answers(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(f"{system.dashboard}#settings")
    panel = page.locator(".mavlink-panel")
    expect(panel).to_contain_text("Off: nothing is sent.")
    panel.locator("summary").click()
    expect(panel).to_contain_text("UDP Server")
    expect(panel).to_contain_text("14401")
    panel.get_by_role("button", name="Switch on").click()
    expect(panel).to_contain_text("nobody answers")
    panel.get_by_role("button", name="Switch off").click()
    expect(panel).to_contain_text("Off: nothing is sent.")


def test_the_rates_of_the_esp32_are_sent_and_acknowledged(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(f"{system.dashboard}#settings")
    rate = page.get_by_label("Sensor frames")
    rate.fill("21")
    send = page.get_by_role("button", name="Send to the ESP32")
    send.click()
    notice = page.locator(".rates ~ .notice-line")
    expect(notice).to_contain_text("outside 0.5 to 20")
    rate.fill("2")
    send.click()
    expect(notice).to_have_text("The ESP32 acknowledged.")


def test_the_health_page_lists_counters_events_and_cures(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(f"{system.dashboard}#health")
    for part in ("Link", "Sonar A, starboard", "Sonar B, port", "Recorder", "MAVLink", "Clock", "Versions"):
        expect(page.get_by_role("heading", name=part, exact=True)).to_be_visible()
    expect(page.locator(".counters")).to_contain_text("0x01 SENSORS")
    expect(page.locator(".events")).to_contain_text("serial link up")
    page.get_by_role("button", name="Errors", exact=True).click()
    expect(page.locator(".events")).not_to_contain_text("serial link up")
    assert page.locator(".troubles details").count() >= 10
