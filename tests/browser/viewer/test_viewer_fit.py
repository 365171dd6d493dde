"""Keys, names, focus, sizes, fingers, themes."""

from __future__ import annotations

import pytest
from playwright.sync_api import WebSocketRoute, expect

from browser_rig import OpenPage, RunningSystem, Watch
from viewer_page import LOST, OVERFLOW, READING, SIZES, instead_of_pings, live, packed_ping, put_cursor, until

pytestmark = pytest.mark.browser


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
