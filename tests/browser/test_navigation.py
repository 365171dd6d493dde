"""The map and the navigation page in a real browser, on a running system; some with a state put in its messages."""

from __future__ import annotations

import json
import math
import re
import shutil
import struct
import zlib
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from bluerov_slam.navigation.local_frame import LocalFrame
from browser_rig import OpenPage, RunningSystem, Watch
from dashboard_page import changed_messages, live, open_tab, until

pytestmark = pytest.mark.browser

# Of the upper layer: vehicle, ellipse, measured line.
PAINTED = """() => {
    const canvas = document.querySelectorAll('.map-canvas')[1];
    if (!canvas?.width) return 0;
    const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    const colours = new Set();
    for (let i = 0; i < pixels.length; i += 4) if (pixels[i + 3] === 255)
        colours.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
    return colours.size;
}"""


def sensor(name: str, label: str, **changes: Any) -> dict[str, Any]:
    return {
        "id": name, "label": label, "trust": "used", "reason": "", "accepted": 40, "rejected": 0, "age_s": 0.2,
        "nis_ratio": 1.0, "nis_count": 40, "nis_band": [0.6, 1.5],
    } | changes  # fmt: skip


def state(**changes: Any) -> dict[str, Any]:
    """The topic's data in mid-dive, with a few keys changed."""
    return {
        "mode": "dead_reckoning",
        "text": "Dead reckoning, within 8.0 m, 90 s since the last fix",
        "origin": {"latitude_deg": 47.6, "longitude_deg": -2.7},
        "position": {
            "north_m": 12.0, "east_m": -5.0, "depth_m": 7.5, "latitude_deg": 47.600108, "longitude_deg": -2.700067,
        },
        "ellipse": {"major_m": 8.0, "minor_m": 3.0, "bearing_deg": 40.0, "probability": 0.95},
        "attitude": {"roll_deg": 1.0, "pitch_deg": -2.0, "heading_deg": 45.0},
        "std": {"heading_deg": 1.5, "tilt_deg": 0.3, "depth_m": 0.02, "speed_mps": 0.06},
        "velocity": {"north_mps": 0.3, "east_mps": 0.3, "down_mps": 0.0, "speed_mps": 0.42, "course_deg": 45.0},
        "current": {"north_mps": -0.1, "east_mps": 0.0, "std_mps": 0.02},
        "altitude_m": None, "distance_m": 321.0, "since_fix_s": 90.0, "reset_counter": 0, "simulated": True,
        "sensors": [sensor("compass", "Compass"), sensor("gps", "GPS")],
        "fix": None, "odometry": {"enabled": False, "sent": 0, "text": "Nothing is sent to the autopilot"},
    } | changes  # fmt: skip


def told(data: dict[str, Any]) -> Any:
    """Every message of the navigator says this; the track it remembers is empty."""

    def change(message: dict[str, Any]) -> dict[str, Any]:
        return {**message, "data": data} if message["topic"] == "navigation" else message

    def prepare(page: Page) -> None:
        changed_messages(change)(page)
        empty = {"origin": data["origin"], "points": [], "fixes": []}
        page.route("**/api/navigation/track*", lambda route: route.fulfill(json=empty))

    return prepare


def cell(page: Page, label: str) -> Any:
    return page.locator(".card-navigation .cell", has=page.get_by_text(label, exact=True)).locator(".number")


def test_the_navigator_speaks_to_the_page(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard)
    live(page)
    expect(page.locator(".navigation-sentence")).not_to_have_text("Waiting for the navigator")
    expect(page.locator("#strip li", has_text="Navigation")).to_be_visible()
    expect(page.locator(".card-navigation .navigation-trust")).to_contain_text("Rests on")


def test_the_map_shows_where_the_vehicle_is_and_how_sure_that_is(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, prepare=told(state()))
    live(page)
    expect(page.locator(".map-sentence")).to_have_text("Dead reckoning, within 8.0 m, 90 s since the last fix")
    expect(page.locator(".map-empty")).to_be_hidden()
    until(page, lambda: page.evaluate(PAINTED) > 3)
    expect(cell(page, "North")).to_have_text("12.0")
    expect(cell(page, "East")).to_have_text("−5.0")
    expect(cell(page, "Within (95 %)")).to_have_text("8.0")
    expect(cell(page, "True heading")).to_have_text("045° ±3.0°")
    expect(cell(page, "Sets to")).to_have_text("180°")


def test_without_a_position_the_map_says_what_is_missing(system: RunningSystem, open_page: OpenPage) -> None:
    nothing = {
        "origin": {"latitude_deg": None, "longitude_deg": None},
        "position": dict.fromkeys(("north_m", "east_m", "depth_m", "latitude_deg", "longitude_deg")),
        "ellipse": {"major_m": None, "minor_m": None, "bearing_deg": None, "probability": 0.95},
    }
    reason = "waiting for three fixes that agree"
    waiting = [sensor("gps", "GPS", trust="waiting", reason=reason, nis_ratio=None, nis_band=None)]
    page = open_page(system.dashboard, prepare=told(state(mode="attitude", sensors=waiting, **nothing)))
    live(page)
    expect(page.locator(".map-empty")).to_have_text(f"No position yet. GPS: {reason}")
    assert page.evaluate(PAINTED) == 0
    expect(cell(page, "North")).to_have_text("-")
    page.get_by_role("button", name="GPX").click()
    expect(page.locator(".map-cursor")).to_have_text("There is no track to save yet")


def test_the_map_moves_and_zooms_by_the_keyboard(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, prepare=told(state()))
    live(page)
    until(page, lambda: page.evaluate(PAINTED) > 3)
    scale = page.locator(".map-scale")
    expect(scale).to_have_text(re.compile(r"\d m"))
    target = page.locator(".map-target")
    target.focus()
    first = scale.inner_text()
    for _ in range(8):
        page.keyboard.press("-")
    expect(scale).not_to_have_text(first)
    follow = page.get_by_role("button", name="Follow")
    expect(follow).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("ArrowLeft")
    expect(follow).to_have_attribute("aria-pressed", "false")
    page.keyboard.press("f")
    expect(follow).to_have_attribute("aria-pressed", "true")


def test_a_distance_is_measured_between_two_clicks(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, prepare=told(state()))
    live(page)
    until(page, lambda: page.evaluate(PAINTED) > 3)
    page.get_by_role("button", name="Measure").click()
    expect(page.locator(".map-cursor")).to_have_text("Click two points, or Enter at the cross")
    box = page.locator(".map-target").bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.click(x - 150, y)
    page.wait_for_timeout(400)  # the map waits whether a click becomes a double click
    page.mouse.click(x + 50, y)
    expect(page.locator(".map-cursor")).to_have_text(re.compile(r"^\d+\.\d m, bearing 090° true$"))
    page.keyboard.press("Tab")
    page.locator(".map-target").focus()
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Measure")).to_have_attribute("aria-pressed", "false")


def test_a_distance_is_measured_by_the_keyboard(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, prepare=told(state()), reduced_motion="reduce")
    live(page)
    until(page, lambda: page.evaluate(PAINTED) > 3)
    page.locator(".map-target").focus()
    page.keyboard.press("m")
    page.keyboard.press("Enter")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(150)  # the map's own animation of one step
    page.keyboard.press("Enter")
    expect(page.locator(".map-cursor")).to_have_text(re.compile(r"^[1-9]\d*\.\d m, bearing 090° true$"))


def test_what_the_navigator_no_longer_says_is_told_with_its_age(system: RunningSystem, open_page: OpenPage) -> None:
    silent = False

    def change(message: dict[str, Any]) -> dict[str, Any] | None:
        if message["topic"] != "navigation":
            return message
        return None if silent else {**message, "data": state()}

    page = open_page(system.dashboard, prepare=changed_messages(change))
    live(page)
    expect(page.locator(".map-sentence")).to_have_text("Dead reckoning, within 8.0 m, 90 s since the last fix")
    silent = True
    expect(page.locator(".map-sentence")).to_have_text(re.compile(r"^\d+ s ago: Dead reckoning"))
    expect(page.locator(".card-navigation")).to_have_class(re.compile("stale"))


def test_a_change_of_trust_is_read_aloud_and_seconds_are_not(system: RunningSystem, open_page: OpenPage) -> None:
    since_s = 90
    doubted: list[dict[str, Any]] = []

    def change(message: dict[str, Any]) -> dict[str, Any]:
        nonlocal since_s
        if message["topic"] != "navigation":
            return message
        since_s += 1
        text = f"Dead reckoning, {since_s} s since the last fix"
        return {**message, "data": state(text=text, sensors=[sensor("compass", "Compass"), *doubted])}

    page = open_page(system.dashboard, prepare=changed_messages(change))
    live(page)
    spoken = page.locator(".card-navigation [role=status]")
    expect(spoken).to_have_text(re.compile("Rests on Compass"))
    first = spoken.inner_text()
    seen = page.locator(".navigation-sentence").inner_text()
    expect(page.locator(".navigation-sentence")).not_to_have_text(seen)
    assert spoken.inner_text() == first
    doubted.append(sensor("gps", "GPS", trust="rejected", reason="far away"))
    expect(spoken).to_have_text(re.compile("Not trusted: GPS"))


def test_the_track_is_saved_as_other_programs_read_it(
    system: RunningSystem, open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page(system.dashboard, prepare=told(state()))
    live(page)
    expect(page.locator(".map-sentence")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="GeoJSON").click()
    download.value.save_as(tmp_path / "track.geojson")
    line = json.loads((tmp_path / "track.geojson").read_text())["features"][0]
    longitude, latitude, height = line["geometry"]["coordinates"][0]
    assert (longitude, latitude) == pytest.approx((-2.700067, 47.600108), abs=2e-6)
    assert height == -7.5
    assert line["properties"]["simulated"] is True
    assert line["properties"]["mode"][0] == "dead_reckoning"


def test_a_distrusted_sensor_is_named_with_the_reason(system: RunningSystem, open_page: OpenPage) -> None:
    reason = "1 km from where everything else says; check the antenna"
    doubted = sensor("gps", "GPS", trust="rejected", reason=reason, rejected=7, nis_ratio=40.0)
    page = open_page(system.dashboard, prepare=told(state(sensors=[sensor("compass", "Compass"), doubted])))
    live(page)
    expect(page.locator(".navigation-trust")).to_contain_text("Not trusted: GPS")
    open_tab(page, "Navigation")
    expect(page.locator(".consistency-sentence")).to_contain_text("Not trusted: GPS.")
    row = page.locator(".sensor-trust", has_text="GPS")
    expect(row).to_contain_text("Rejected")
    expect(row).to_contain_text(reason)
    expect(row.locator(".nis-mark")).to_have_attribute("data-outside", "true")


def test_a_calibration_starts_says_what_to_do_and_is_cancelled(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard)
    live(page)
    open_tab(page, "Navigation")
    expect(page.locator(".assistant-steps li")).to_have_count(6)
    gyro = page.locator(".calibration", has_text="Gyro")
    gyro.get_by_role("button", name=re.compile("Start|Repeat")).click()
    expect(gyro.locator(".instruction")).to_have_text(re.compile(r"\w+ \w+"))
    expect(page.locator(".calibration", has_text="Accelerometer").get_by_role("button", name="Start")).to_be_disabled()
    gyro.get_by_role("button", name="Cancel").click()
    expect(gyro.get_by_role("button", name=re.compile("Start|Repeat"))).to_be_enabled()


def test_the_assistant_begins_a_compass_swing_and_says_what_the_thrusters_field_wants(
    system: RunningSystem, open_page: OpenPage, watch: Watch
) -> None:
    watch.expect_complaints("409")  # what is refused
    page = open_page(system.dashboard)
    live(page)
    open_tab(page, "Navigation")
    step = page.locator(".assistant-steps li", has_text="Swing the compass")
    step.get_by_role("button", name="Begin").click()
    swing = page.locator('.calibration[data-kind="swing"]')
    expect(swing).to_contain_text("two turns on the spot")
    expect(swing.locator(".instruction")).to_contain_text("turn slowly on the spot")
    expect(swing).to_be_in_viewport()
    expect(step).to_contain_text("degrees to go")
    swing.get_by_role("button", name="Cancel").click()
    expect(step).to_contain_text("two slow turns")
    # The virtual vehicle's magnetometer was never calibrated: the thrusters' field has nothing to be measured against.
    page.locator(".assistant-steps li", has_text="thrusters' field").get_by_role("button", name="Begin").click()
    expect(page.get_by_text(re.compile("[Cc]alibrate the magnetometer first")).first).to_be_visible()
    expect(page.locator('.calibration[data-kind="course_swing"]')).to_contain_text("driving under GPS")


def test_the_autopilot_panel_says_why_it_cannot_ask(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard)
    live(page)
    open_tab(page, "Navigation")
    panel = page.locator(".panel-autopilot")
    expect(panel).to_contain_text(re.compile("MAVLink|autopilot"))
    expect(panel.get_by_role("button", name="Set parameters")).to_be_disabled()


def flat_png(red: int, green: int, blue: int) -> bytes:
    """A tile of one colour."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 256, 256, 8, 2, 0, 0, 0)
    rows = (b"\0" + bytes((red, green, blue)) * 256) * 256
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


TILE_COLOUR = """([dx, dy]) => {
    const target = document.querySelector('.map-target').getBoundingClientRect();
    const canvas = document.querySelector('.ol-layer canvas:not(.map-canvas)');
    if (!canvas) return null;
    const x = Math.round(((target.width / 2 + dx) * canvas.width) / target.width);
    const y = Math.round(((target.height / 2 + dy) * canvas.height) / target.height);
    return [...canvas.getContext('2d').getImageData(x, y, 1, 1).data.slice(0, 3)];
}"""


MOVED = """() => {
    window.moves = [];
    const canvas = document.querySelectorAll('.map-canvas')[0];
    new MutationObserver(() => window.moves.push(canvas.style.transform)).observe(canvas, {attributes: true});
}"""


def test_a_track_that_is_dear_to_draw_is_moved_while_it_is_dragged(system: RunningSystem, open_page: OpenPage) -> None:
    """Without an IMU a track jitters: thousands of pieces of line in every picture."""
    points = [
        [1e3 + k, 20.0 * ((k * 7919) % 97) / 97.0, k / 40.0, 5.0, 3.0, 0.5, "dead_reckoning"] for k in range(4000)
    ]

    def prepare(page: Page) -> None:
        told(state())(page)
        track = {"origin": state()["origin"], "points": points, "fixes": []}
        page.route("**/api/navigation/track*", lambda route: route.fulfill(json=track))

    page = open_page(system.dashboard, prepare=prepare, reduced_motion="reduce")
    live(page)
    page.get_by_role("button", name="Fit").click()
    page.wait_for_timeout(300)
    page.evaluate(MOVED)
    box = page.locator(".map-target").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 13):
        page.mouse.move(x + 5 * step, y + 3 * step)
    page.mouse.up()
    moves = page.evaluate("window.moves")
    moved = [tuple(map(float, re.findall(r"-?[\d.]+(?:e-?\d+)?", move))) for move in moves if move]
    # As the hand moves: to the right and down.
    assert all(right >= 0.0 and down >= 0.0 for right, down in moved)
    assert max(moved) > (4.0, 2.0)
    until(page, lambda: page.evaluate("document.querySelectorAll('.map-canvas')[0].style.transform") == "")


def test_the_services_sentences_are_in_the_units_of_the_page(system: RunningSystem, open_page: OpenPage) -> None:
    def imperial(page: Page) -> None:
        told(state())(page)

        def changed(route: Route) -> None:
            answer = route.fetch().json()
            for setting in answer["settings"]:
                if setting["key"] == "display.units":
                    setting["value"] = "imperial"
            route.fulfill(json=answer)

        page.route("**/api/settings", changed)

    page = open_page(system.dashboard, prepare=imperial)
    live(page)
    expect(page.locator("#map-sentence")).to_contain_text("within 26.2 ft, 90 s")
    expect(page.locator(".navigation-sentence")).to_contain_text("within 26.2 ft")
    expect(page.get_by_role("button", name="Tiles")).to_be_hidden()


def test_the_users_own_tiles_lie_where_they_belong(system: RunningSystem, open_page: OpenPage, watch: Watch) -> None:
    """Four tiles meet in a corner: 20 m east and 10 m north of the origin, so says the ellipsoid."""
    watch.expect_complaints("willReadFrequently")
    zoom, x, y = 18, 129100, 91900
    latitude = math.degrees(math.atan(math.sinh(math.pi * (1 - 2 * y / 2**zoom))))
    longitude = x / 2**zoom * 360 - 180
    origin = LocalFrame(latitude, longitude).to_geodetic(-10.0, -20.0)[:2]
    colours = {(-1, -1): (255, 0, 0), (1, -1): (0, 255, 0), (-1, 1): (0, 0, 255), (1, 1): (255, 255, 0)}
    folder = system.folder / "state" / "tiles"
    try:
        for (east, south), colour in colours.items():
            path = folder / str(zoom) / str(x + min(east, 0)) / f"{y + min(south, 0)}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(flat_png(*colour))
        here = state() | {"origin": {"latitude_deg": origin[0], "longitude_deg": origin[1]}}
        here["position"] = here["position"] | {"north_m": 0.0, "east_m": 0.0}
        page = open_page(system.dashboard, prepare=told(here), reduced_motion="reduce")
        live(page)
        for (east, south), colour in colours.items():
            # One metre from the corner, at 0.15 m a pixel.
            at = [(20.0 + east) / 0.15, (-10.0 + south) / 0.15]
            until(page, lambda at=at, colour=colour: page.evaluate(TILE_COLOUR, at) == list(colour))
        switch = page.get_by_role("button", name="Tiles")
        switch.click()
        expect(switch).to_have_attribute("aria-pressed", "false")
        until(page, lambda: page.evaluate(TILE_COLOUR, [0, 0]) is None)
        page.reload()
        live(page)
        expect(switch).to_have_attribute("aria-pressed", "false")
        switch.click()
        until(page, lambda: page.evaluate(TILE_COLOUR, [21.0 / 0.15, -9.0 / 0.15]) == [255, 255, 0])
    finally:
        shutil.rmtree(folder, ignore_errors=True)
