from __future__ import annotations

import base64
import csv
import json
import os
import re
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, FrameLocator, Page, WebSocketRoute, expect

from browser_rig import OpenPage, PrefixProxy, RunningSystem, Watch
from patience import PATIENCE_S

pytestmark = pytest.mark.browser

SIZES = {"320 px": (320, 640), "phone": (360, 740), "tablet": (820, 1180), "laptop": (1440, 900), "4K": (3840, 2160)}
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
LOST = ("WebSocket", "ERR_CONNECTION", "Failed to load resource", "ERR_FAILED", "ERR_EMPTY_RESPONSE")
CHROMIUM = os.environ.get("BLUEROV_SLAM_CHROMIUM", "/usr/bin/chromium")
WITHOUT_GL = ["--no-sandbox", "--disable-gpu", "--disable-3d-apis"]
# What the browser says about a test that reads the picture back.
READING = ("GPU stall due to ReadPixels",)
PING_HEADER = struct.Struct("<BBBBIddHHHBBHHI")
# A panel that opens or closes changes the stage; the picture follows with the browser's next frame.
FITS = """(() => {
  const { element, picture, dpr } = viewer.stage;
  return picture.width === Math.round(element.getBoundingClientRect().width * dpr);
})()"""
# Nothing is under way that would put pings into what is shown already.
LOADED = "Object.values(viewer.feed.channels).every((channel) => !channel.busy && channel.repairs === 0)"
# The picture, small: a canvas drawn in the same task still has its pixels.
PIXELS = """() => {
  const { waterfall } = viewer;
  waterfall.draw();
  const small = document.createElement('canvas');
  small.width = 120;
  small.height = 90;
  const context = small.getContext('2d', { willReadFrequently: true });
  context.drawImage(waterfall.canvas, 0, 0, 120, 90);
  return Array.from(context.getImageData(0, 0, 120, 90).data).filter((_, k) => k % 4 === 0);
}"""


def until(page: Page, expression: str) -> None:
    """Wait until the page finds this true. (Playwright's own waiting needs eval, which our content policy forbids.)"""
    deadline = time.monotonic() + PATIENCE_S
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, f"not within {PATIENCE_S} s: {expression}"
        page.wait_for_timeout(40)


def live(page: Page | FrameLocator) -> None:
    """Wait until pings are drawn."""
    expect(page.locator("#transport-state")).to_have_text("● Live")


def settled(page: Page) -> None:
    """Pause with levels that no longer move: what changes from here on was changed by the test."""
    live(page)
    until(page, "viewer.waterfall.levels.settled")
    page.keyboard.press("a")
    page.keyboard.press("Space")
    expect(page.locator("#transport-state")).to_contain_text("Paused")
    # Pings under way at the moment of the pause still find their place in it.
    until(page, "viewer.waterfall.rings.slice(0, 2).every((ring) => ring.newestS > viewer.waterfall.view.topS + 1)")
    until(page, LOADED)


def pixels(page: Page) -> list[int]:
    """The red channel of the picture, 120 x 90, once it is as wide as its stage."""
    until(page, FITS)
    found: list[int] = page.evaluate(PIXELS)
    return found


def difference(one: list[int], other: list[int]) -> float:
    """Mean difference of two pictures."""
    return sum(abs(a - b) for a, b in zip(one, other, strict=True)) / len(one)


def put_cursor(page: Page, x: float = 0.75, y: float = 0.5) -> tuple[float, float]:
    """The mouse over the picture, by shares of it."""
    box = page.locator("#stage").bounding_box()
    assert box
    at = (box["x"] + x * box["width"], box["y"] + y * box["height"])
    page.mouse.move(*at)
    return at


def packed_ping(number: int, seconds: float, samples: bytes, gaps: tuple[tuple[int, int], ...] = ()) -> bytes:
    """A binary ping of sonar A, 20 mm a sample."""
    header = PING_HEADER.pack(
        0x50, 1, 0, int(bool(gaps)), number, seconds, seconds, len(samples), 0, 20, 1, 0, len(gaps), 0, 0
    )
    return header + b"".join(struct.pack("<HH", *gap) for gap in gaps) + samples


def instead_of_pings(send: Callable[[WebSocketRoute], None]) -> Callable[[Page], None]:
    """The real service's words, but other pings: `send` is called once the socket is open. No history either."""

    def handle(route: WebSocketRoute) -> None:
        server = route.connect_to_server()
        server.on_message(lambda message: route.send(message) if isinstance(message, str) else None)
        send(route)

    def prepare(page: Page) -> None:
        page.route_web_socket(re.compile(r"/ws$"), handle)
        page.route("**/api/history*", lambda route: route.fulfill(body=b""))

    return prepare


@pytest.fixture(autouse=True)
def _reading_allowed(watch: Watch) -> None:
    watch.expect_complaints(*READING)


@pytest.fixture(scope="module")
def flat_browser(chromium: Browser) -> Iterator[Browser]:
    """A second browser, without WebGL."""
    browser = chromium.browser_type.launch(executable_path=CHROMIUM, args=WITHOUT_GL)
    yield browser
    browser.close()


# --- drawing


def test_the_picture_grows_with_every_ping(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    until(page, "viewer.waterfall.levels.settled")
    page.keyboard.press("a")
    before = pixels(page)
    newest = page.evaluate("viewer.waterfall.newestS")
    until(page, f"viewer.waterfall.newestS > {newest} + 1")
    assert difference(before, pixels(page)) > 1
    assert max(before) > 100 > min(before)


def test_webgl_and_canvas_draw_the_same_picture(
    system: RunningSystem, open_page: OpenPage, flat_browser: Browser, watch: Watch
) -> None:
    page = open_page(system.viewer, 900, 700)
    context = flat_browser.new_context(viewport={"width": 900, "height": 700})
    flat = context.new_page()
    watch.follow(flat, "127.0.0.1")
    flat.goto(system.viewer)
    for each in (page, flat):
        live(each)
        until(each, "viewer.waterfall.newestS - viewer.feed.oldestS > 15")
        settled(each)
    assert page.evaluate("viewer.waterfall.picture.kind") == "WebGL2"
    assert flat.evaluate("viewer.waterfall.picture.kind") == "Canvas 2D"
    gain = page.evaluate("({...viewer.waterfall.levels.gain})")
    top = page.evaluate("viewer.waterfall.view.topS")
    flat.evaluate("([gain, top]) => { viewer.looks.setGain(gain); viewer.showTop(top); }", [gain, top])
    until(flat, LOADED)
    # They average differently where several samples share a pixel: alike, not equal.
    assert difference(pixels(page), pixels(flat)) < 25
    before = pixels(flat)
    flat.keyboard.press("ArrowDown")
    moved = pixels(flat)
    flat.evaluate("(top) => viewer.showTop(top)", top)
    assert difference(before, moved) > 1
    assert difference(before, pixels(flat)) < 0.01
    context.close()


def test_scrolling_away_and_back_gives_the_same_picture(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer, 900, 700)
    live(page)
    until(page, "viewer.waterfall.newestS - viewer.feed.oldestS > 15")
    settled(page)
    before = pixels(page)
    top = page.evaluate("viewer.waterfall.view.topS")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    moved = pixels(page)
    page.evaluate("(top) => viewer.showTop(top)", top)
    assert difference(before, moved) > 1
    assert difference(before, pixels(page)) < 0.01
    page.evaluate("viewer.waterfall.picture.changes.everything()")
    assert difference(before, pixels(page)) < 0.01


def test_a_frame_is_drawn_once_however_often_it_is_asked_for(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    settled(page)
    drawn = page.evaluate("""async () => {
      const { waterfall, feed } = viewer;
      feed.connection.options.onMessage = () => {};  // a ping between two frames asks for one by itself
      await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
      const before = waterfall.frames;
      for (let k = 0; k < 500; k++) waterfall.invalidate();
      await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
      return waterfall.frames - before;
    }""")
    assert drawn == 1


def test_missing_chunks_and_lost_pings_are_hatched(system: RunningSystem, open_page: OpenPage) -> None:
    def send(route: WebSocketRoute) -> None:
        for number in range(200):
            if not 100 <= number < 110:
                gap = ((400, 600),) if 40 <= number < 60 else ()
                route.send(packed_ping(number, 1000 + number / 10, bytes([200]) * 1000, gap))

    page = open_page(system.viewer, prepare=instead_of_pings(send))
    until(page, "viewer.waterfall.live('A').length === 190")
    page.keyboard.press("4")
    shades = page.evaluate("""() => {
      const { waterfall, overlay } = viewer;
      waterfall.draw();
      const context = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
      const [pane] = waterfall.panes;
      context.canvas.width = pane.width;
      context.canvas.height = pane.height;
      context.drawImage(waterfall.canvas, 0, 0);
      const shades = (number, fromM, toM) => {
        const y = Math.round(waterfall.yAtTime(pane, 1000 + number / 10) + 2);
        const x = waterfall.xAt(pane, fromM);
        const data = context.getImageData(x, y, waterfall.xAt(pane, toM) - x, 1).data;
        return new Set(Array.from(data).filter((_, k) => k % 4 === 0)).size;
      };
      return { whole: shades(80, 1, 19), gap: shades(50, 9, 11), beside: shades(50, 1, 7), lost: shades(105, 1, 19) };
    }""")
    assert shades == {"whole": 1, "gap": 2, "beside": 1, "lost": 2}
    put_cursor(page, 0.5, 0.5)
    texts = page.evaluate("""() => ['gap', 'lost'].map((what) => {
      const timeS = what === 'gap' ? 1005 : 1010.5;
      viewer.pointer.release();
      viewer.overlay.cursor = { channel: 'A', rangeM: 10, timeS };
      viewer.waterfall.draw();
      return document.getElementById('readout-amplitude').textContent;
    })""")
    assert texts == ["missing", "lost"]
    # With one sonar alone, time goes on as with two.
    page.keyboard.press("ArrowDown")
    expect(page.locator("#transport-state")).to_contain_text("Paused")
    # The word may come before the frame.
    drawn = page.evaluate("(viewer.waterfall.draw(), viewer.waterfall.topS)")
    assert page.evaluate("viewer.waterfall.view.topS") == pytest.approx(drawn, abs=0.1)


def test_pings_of_different_range_are_drawn_to_scale(system: RunningSystem, open_page: OpenPage) -> None:
    def send(route: WebSocketRoute) -> None:
        for number in range(60):
            short = number < 30
            samples = bytearray(500 if short else 1500)
            samples[250:260] = bytes([255]) * 10
            route.send(packed_ping(number, 1000 + number / 10, bytes(samples)))

    page = open_page(system.viewer, prepare=instead_of_pings(send), color_scheme="dark")
    until(page, "viewer.waterfall.live('A').length === 60")
    page.keyboard.press("4")
    columns = page.evaluate("""() => {
      const { waterfall } = viewer;
      waterfall.draw();
      const [pane] = waterfall.panes;
      const context = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
      context.canvas.width = pane.width;
      context.canvas.height = pane.height;
      context.drawImage(waterfall.canvas, 0, 0);
      return [10, 50].map((number) => {
        const y = Math.round(waterfall.yAtTime(pane, 1000 + number / 10) + 2);
        const data = context.getImageData(0, y, pane.width, 1).data;
        let best = 0;
        for (let x = 0; x < pane.width; x++) if (data[4 * x + 2] > data[4 * best + 2]) best = x;
        return waterfall.rangeAt(pane, best);
      });
    }""")
    for range_m in columns:
        assert range_m == pytest.approx(5.1, abs=0.15)
    assert page.evaluate("viewer.waterfall.state.toM") == pytest.approx(30, abs=0.1)


# --- time


def test_pause_holds_the_picture_and_counts_what_comes(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    settled(page)
    before = pixels(page)
    until(page, "viewer.newPings >= 10")
    assert difference(before, pixels(page)) == 0
    expect(page.locator("#new-pings")).to_have_text(re.compile(r"\(\d+ new\)"))
    page.get_by_role("button", name=re.compile("Back to live")).first.click()
    live(page)
    until(page, f"viewer.waterfall.topS > {page.evaluate('viewer.waterfall.newestS')} - 0.5")
    assert difference(before, pixels(page)) > 0.5


def test_scroll_back_reaches_pings_from_before_the_page_was_opened(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    first = page.evaluate("fetch('api/status').then((a) => a.json()).then((s) => s.history.A.first)")
    page.keyboard.press("Home")
    expect(page.locator("#transport-state")).to_contain_text("Paused")
    until(
        page,
        f"""() => {{
      const {{ waterfall }} = viewer;
      return waterfall.ringsOf('A').some((ring) => ring.length && ring.oldestNumber === {first});
    }}""",
    )
    received = page.evaluate("viewer.feed.channels.A.received")
    until(page, f"viewer.feed.channels.A.received > {received} + 5")
    expect(page.locator("#transport-state")).to_contain_text("Paused")
    page.keyboard.press("End")
    live(page)


def test_the_wheel_scrolls_and_zooms(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    # The beginning of a dive is not scrolled away: there is nowhere to go in a young one.
    until(page, "viewer.waterfall.newestS - viewer.feed.oldestS > 15")
    settled(page)
    put_cursor(page)
    top = page.evaluate("viewer.waterfall.view.topS")
    page.mouse.wheel(0, 200)
    until(page, f"viewer.waterfall.view.topS < {top}")
    window = page.evaluate("viewer.waterfall.windowS")
    page.keyboard.down("Shift")
    page.mouse.wheel(0, -600)
    page.keyboard.up("Shift")
    until(page, f"viewer.waterfall.windowS < {window} * 0.8")
    page.keyboard.down("Control")
    page.mouse.wheel(0, -400)
    page.keyboard.up("Control")
    until(page, "viewer.waterfall.state.toM - viewer.waterfall.state.fromM < viewer.waterfall.farthestM * 0.8")
    page.keyboard.press("0")
    until(page, "viewer.waterfall.view.toM === null")


def test_the_time_line_moves_through_the_dive(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    until(page, "Number.isFinite(viewer.feed.channels.A.firstS)")
    line = page.locator("#timeline")
    line.focus()
    page.keyboard.press("Home")
    expect(page.locator("#transport-state")).to_contain_text("Paused")
    oldest = int(line.get_attribute("aria-valuenow") or -1)
    assert oldest >= 0
    page.keyboard.press("End")
    live(page)


# --- looks


def test_palette_gain_and_mirroring_change_the_picture(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    until(page, "viewer.waterfall.newestS - viewer.feed.oldestS > 15")
    settled(page)
    copper = pixels(page)
    page.get_by_role("button", name=re.compile("Palette, gain")).click()
    page.get_by_label("Viridis").check()
    viridis = pixels(page)
    assert len(viridis) == len(copper)
    page.get_by_label("Copper").check()
    page.locator("#gain-gainDb").fill("12")
    louder = pixels(page)
    page.locator("#gain-gainDb").fill("0")
    page.keyboard.press("Escape")
    expect(page.locator("#panel")).to_be_hidden()
    plain = pixels(page)
    page.keyboard.press("x")
    mirrored = pixels(page)
    assert difference(copper, plain) < 0.01
    # Below the newest 10 s a young dive leaves the picture empty.
    copper, viridis, louder, plain, mirrored = (
        picture[: 20 * 120] for picture in (copper, viridis, louder, plain, mirrored)
    )
    assert sum(louder) > sum(plain) * 1.2
    assert difference(viridis, copper) > 5
    rows = [mirrored[k : k + 120][::-1] for k in range(0, len(mirrored), 120)]
    assert difference([value for row in rows for value in row], plain) < 6 < difference(mirrored, plain)
    page.keyboard.press("x")


def test_levels_lock_and_stay_over_a_reload(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    page.keyboard.press("p")
    page.locator("#gain-white").fill("0.4")
    expect(page.get_by_label("Locked")).to_be_checked()
    until(page, "JSON.parse(localStorage.getItem('bluerov-slam.viewer') ?? '{}').gain?.white === 0.4")
    page.reload()
    live(page)
    assert page.evaluate("viewer.waterfall.levels.gain.white") == pytest.approx(0.4)
    assert page.evaluate("viewer.waterfall.levels.automatic") is False


@pytest.mark.parametrize("layout", ["2", "3", "4"])
def test_every_layout_shows_pings(system: RunningSystem, open_page: OpenPage, layout: str) -> None:
    page = open_page(system.viewer)
    # The word "Live" needs the pings of one sonar only.
    until(page, "viewer.waterfall.rings.slice(0, 2).every((ring) => ring.length > 20)")
    page.keyboard.press(layout)
    until(page, "viewer.waterfall.levels.settled")
    shown = pixels(page)
    assert len(set(shown)) > 20
    expected = {"2": ["A", "B"], "3": ["B"], "4": ["A"]}[layout]
    assert page.evaluate("viewer.waterfall.panes.map((pane) => pane.channel)") == expected


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


# --- keys, sizes, themes


def test_keys_are_listed_and_every_tool_has_a_name(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keys and gestures")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#help")).to_be_hidden()
    nameless = page.evaluate("""() => [...document.querySelectorAll('button, input, [tabindex="0"]')]
      .filter((node) => node.offsetParent && !node.getAttribute('aria-label') && !node.textContent.trim()
        && !node.labels?.length).map((node) => node.outerHTML)""")
    assert nameless == []


def test_a_side_without_pings_says_so_in_its_half(system: RunningSystem, open_page: OpenPage) -> None:
    def send(route: WebSocketRoute) -> None:
        for number in range(20):
            route.send(packed_ping(number, 1000 + number / 10, bytes([200]) * 1000, ()))

    page = open_page(system.viewer, prepare=instead_of_pings(send))
    until(page, "viewer.waterfall.live('A').length === 20")
    until(page, "viewer.overlay.silence.B === 'no pings'")
    until(page, "viewer.overlay.silence.A.startsWith('silent for ')")


def test_the_strip_tells_what_the_extension_knows(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    expect(page.locator("[data-chip=depth]")).to_contain_text(" m")
    expect(page.locator("[data-chip=recorder]")).to_contain_text("Recording")
    expect(page.locator("[data-chip=others]")).to_be_hidden()
    page.set_viewport_size({"width": 390, "height": 844})
    expect(page.locator("[data-chip=imu]")).to_be_hidden()
    page.locator("[data-chip=others]").click()
    expect(page.get_by_role("dialog", name="Vehicle")).to_contain_text("Recording")


def test_tab_reaches_everything_and_focus_is_seen(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    reached = []
    for _ in range(32):
        page.keyboard.press("Tab")
        reached.append(
            page.evaluate("""() => {
              const node = document.activeElement;
              const style = getComputedStyle(node);
              return [node.id || node.dataset.chip || node.tagName, style.outlineStyle !== 'none'];
            }""")
        )
    names = [name for name, _ in reached]
    for wanted in ("link", "sonar_a", "loss", "stage", "timeline", "tool-pause", "tool-sonar", "tool-help"):
        assert wanted in names, names
    assert all(seen for name, seen in reached if name != "BODY")


@pytest.mark.parametrize("size", SIZES)
def test_fits_every_screen(system: RunningSystem, open_page: OpenPage, watch: Watch, size: str) -> None:
    # A 4K picture drawn in software may keep the page too busy to hold its socket: the layout is what is asked here.
    watch.expect_complaints(*LOST, *READING)
    page = open_page(system.viewer, *SIZES[size])
    expect(page.locator("#tool-help")).to_be_visible()
    assert page.evaluate(OVERFLOW) <= 0
    box = page.locator("#stage").bounding_box()
    assert box
    assert box["width"] * box["height"] > 0.5 * SIZES[size][0] * SIZES[size][1]
    for tool in ("picture", "contacts", "sonar"):
        page.locator(f"#tool-{tool}").click()
        expect(page.locator(f"#panel-{tool}")).to_be_visible()
        assert page.evaluate(OVERFLOW) <= 0
        assert page.evaluate(
            "document.querySelector('.panel > section:not([hidden])').scrollWidth <= "
            "document.querySelector('.panel > section:not([hidden])').clientWidth"
        )
    small = page.evaluate("""() => [...document.querySelectorAll('button, .segments label, .palette')]
      .filter((node) => node.offsetParent && (node.offsetWidth < 43.5 || node.offsetHeight < 43.5))
      .map((node) => node.outerHTML.slice(0, 120))""")
    assert small == []


def test_nothing_jumps_when_pings_and_values_arrive(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(
        system.viewer,
        prepare=lambda p: p.add_init_script(
            "window.shifts = 0; new PerformanceObserver((list) => { for (const e of list.getEntries()) "
            "if (!e.hadRecentInput) window.shifts += e.value; }).observe({ type: 'layout-shift', buffered: true });"
        ),
    )
    live(page)
    put_cursor(page)
    until(page, "viewer.feed.channels.A.received > 15")
    assert page.evaluate("window.shifts") < 0.02


def test_follows_the_pixel_ratio(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer, 400, 700, device_scale_factor=3)
    live(page)
    width = page.evaluate("viewer.stage.picture.width / viewer.stage.picture.getBoundingClientRect().width")
    assert width == pytest.approx(3, abs=0.02)


def test_fingers_move_zoom_and_tap(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer, 360, 740, has_touch=True, is_mobile=True)
    live(page)
    box = page.locator("#stage").bounding_box()
    assert box
    x, y = box["x"] + 0.7 * box["width"], box["y"] + 0.5 * box["height"]
    page.touchscreen.tap(x, y)
    expect(page.locator("#readout-range")).to_contain_text("m stbd")
    touch = page.context.new_cdp_session(page)

    def fingers(kind: str, *points: tuple[float, float]) -> None:
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": a, "y": b} for a, b in points]})

    fingers("touchStart", (x, y))
    for step in range(1, 6):
        fingers("touchMove", (x, y - 20 * step))
    fingers("touchEnd")
    expect(page.locator("#transport-state")).to_contain_text("Paused")
    fingers("touchStart", (x - 30, y), (x + 30, y))
    for step in range(1, 6):
        fingers("touchMove", (x - 30 - 10 * step, y), (x + 30 + 10 * step, y))
    fingers("touchEnd")
    until(page, "viewer.waterfall.state.toM - viewer.waterfall.state.fromM < viewer.waterfall.farthestM * 0.8")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_theme_by_preference_and_by_switch(system: RunningSystem, open_page: OpenPage, theme: str) -> None:
    page = open_page(system.viewer, color_scheme=theme)
    live(page)
    assert page.evaluate("document.documentElement.dataset.theme") == theme
    page.keyboard.press("t")
    other = "dark" if theme == "light" else "light"
    assert page.evaluate("document.documentElement.dataset.theme") == other


# --- where it is put, and what goes wrong


def test_says_that_the_data_is_simulated(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    expect(page.locator("#simulated")).to_be_visible()


def test_a_replay_is_never_called_live(system: RunningSystem, open_page: OpenPage) -> None:
    def handle(route: WebSocketRoute) -> None:
        server = route.connect_to_server()

        def downward(message: str | bytes) -> None:
            told = json.loads(message) if isinstance(message, str) else {}
            if told.get("topic") == "status":
                message = json.dumps({**told, "data": told["data"] | {"source": "replay"}})
            route.send(message)

        server.on_message(downward)

    page = open_page(system.viewer, prepare=lambda page: page.route_web_socket(re.compile(r"/ws$"), handle))
    expect(page.locator("#simulated")).to_have_text("REPLAY")
    expect(page.locator("#transport-state")).to_have_text("● Replay")


def test_the_dashboard_is_one_click_away(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer)
    live(page)
    until(page, "viewer.status !== null")
    with page.context.expect_page() as opened:
        page.locator("#tool-sensors").click()
    assert opened.value.url.startswith(system.dashboard)


def test_works_in_an_iframe_under_a_prefix(
    system: RunningSystem, open_page: OpenPage, prefix_proxy: Callable[..., PrefixProxy]
) -> None:
    proxy = prefix_proxy(system.viewer)
    page = open_page(proxy.frame_url)
    frame = page.frame_locator("iframe")
    live(frame)
    frame.locator("#tool-sonar").click()
    expect(frame.locator("#sonar-range_m-read")).to_contain_text("Reads A")


def test_falls_back_to_the_coarse_stream_where_no_websocket_passes(
    system: RunningSystem, open_page: OpenPage, prefix_proxy: Callable[..., PrefixProxy], watch: Watch
) -> None:
    watch.expect_complaints(*LOST, *READING)
    proxy = prefix_proxy(system.viewer, websockets=False)
    amplitudes = base64.b64encode(bytes(range(200))).decode()

    def coarse(route: WebSocketRoute) -> None:
        for number in range(30):
            route.send(json.dumps({"ch": "AB"[number % 2], "amp": amplitudes, "n": number}))

    def prepare(page: Page) -> None:
        page.route_web_socket(re.compile(r":8100/ws$"), lambda route: route.close())
        page.route_web_socket(re.compile(r":8101/$"), coarse)

    page = open_page(proxy.url, prepare=prepare)
    expect(page.locator("[data-chip=link]")).to_contain_text("200 bins")
    until(page, "viewer.waterfall.hasData")
    assert page.evaluate("viewer.overlay.unit") == "bin"


def test_a_lost_link_is_said_and_comes_back_with_what_was_missed(
    system: RunningSystem, open_page: OpenPage, watch: Watch
) -> None:
    watch.expect_complaints(*LOST, *READING)
    sockets: list[Any] = []
    blocked: list[bool] = []

    def handle(route: WebSocketRoute) -> None:
        if blocked:
            route.close()
            return
        sockets.append(route)
        route.connect_to_server()

    page = open_page(system.viewer, prepare=lambda p: p.route_web_socket(re.compile(r"/ws$|:810\d/$"), handle))
    live(page)
    blocked.append(True)
    sockets[-1].close()
    expect(page.locator("[data-chip=link]")).to_contain_text("lost")
    page.locator("[data-chip=link]").click()
    expect(page.locator(".chip-detail")).to_contain_text("Check the tether")
    # Long enough for pings to be missed: the page itself says how long it is silent.
    expect(page.locator("#transport-state")).to_contain_text("No new pings for")
    blocked.clear()
    live(page)
    until(
        page,
        """() => {
      const ring = viewer.waterfall.live('A');
      for (let k = 1; k < ring.length; k++) {
        if (ring.number[ring.slot(k)] !== ring.number[ring.slot(k - 1)] + 1) return false;
      }
      return ring.length > 30;
    }""",
    )
    assert page.evaluate("viewer.feed.channels.A.missed") == 0


def test_damaged_frames_are_counted_and_everything_goes_on(system: RunningSystem, open_page: OpenPage) -> None:
    def handle(route: WebSocketRoute) -> None:
        server = route.connect_to_server()
        for damaged in (b"", b"P\x01", b"\xff" * 500, "{not json", "null", '{"topic": 5}', '{"topic": "sonar"}'):
            route.send(damaged)
        server.on_message(lambda message: route.send(message))

    page = open_page(system.viewer, prepare=lambda p: p.route_web_socket(re.compile(r"/ws$"), handle))
    live(page)
    expect(page.locator("[data-chip=link]")).to_contain_text("4 damaged")


def test_without_pings_it_says_what_it_waits_for(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer, prepare=instead_of_pings(lambda route: None))
    expect(page.locator("#waiting-title")).to_have_text("Waiting for the first ping")
    expect(page.locator("#waiting-text")).to_contain_text("12 V")
    expect(page.locator("[data-chip=sonar_a]")).to_contain_text("no pings")


def test_on_a_phone_the_way_back_to_live_is_whole(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.viewer, 320, 640)
    live(page)
    page.keyboard.press("Space")
    until(page, "viewer.newPings > 3")
    expect(page.locator("#back-to-live")).to_be_visible()
    stage, back = page.locator("#stage").bounding_box(), page.locator("#back-to-live").bounding_box()
    assert stage
    assert back
    assert back["x"] >= stage["x"]
    assert back["x"] + back["width"] <= stage["x"] + stage["width"]


@pytest.mark.parametrize("options", ["?channel=A&theme=light", "?channel=B&palette=viridis", "?theme=dark"])
def test_the_widget_is_the_waterfall_alone(system: RunningSystem, open_page: OpenPage, options: str) -> None:
    page = open_page(system.viewer + "widget" + options, 480, 320)
    expect(page.locator("#simulated")).to_be_visible()
    expect(page.locator("#waiting")).to_be_hidden()
    assert page.evaluate(OVERFLOW) <= 0
    assert page.locator("button").count() == 0
    if "theme=" in options:
        theme = options.split("theme=")[1]
        assert page.evaluate("document.documentElement.dataset.theme") == theme
