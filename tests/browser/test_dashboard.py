from __future__ import annotations

import math
import os
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from playwright.sync_api import Page, WebSocket, WebSocketRoute, expect

from browser_rig import OpenPage, PrefixProxy, RunningSystem, Watch
from dashboard_page import blank, changed_messages, huge, in_data, live, open_tab, until, value

pytestmark = pytest.mark.browser

TABS = ("Live", "Navigation", "Recordings", "Settings", "Health")
SIZES = {"320 px": (320, 640), "phone": (360, 740), "tablet": (820, 1180), "laptop": (1440, 900), "4K": (3840, 2160)}
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
LOST = ("WebSocket", "ERR_CONNECTION", "Failed to load resource", "ERR_FAILED", "ERR_EMPTY_RESPONSE")


def test_values_change_live_and_simulated_data_is_called_so(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard)
    live(page)
    expect(page.locator("#source-badge")).to_have_text("SIMULATED")
    for field in ("roll", "pitch", "temperature", "salinity", "soundSpeed", "conductivity", "pressure"):
        expect(value(page, field)).to_have_text(re.compile(r"^[+−\d]"))
    before = value(page, "roll").inner_text()
    expect(value(page, "roll")).not_to_have_text(before)
    expect(page.locator(".card-depth .hero .number")).to_have_text(re.compile(r"^\d+\.\d\d$"))
    expect(page.locator(".card-depth .card-age")).to_have_text(re.compile("< 1 s|1 s"))
    expect(page.locator(".sonars tbody tr").first.locator("td").first).to_have_text(re.compile(r"^\d+\.\d$"))


def test_a_replay_is_called_so(system: RunningSystem, open_page: OpenPage) -> None:
    def replayed(message: dict[str, Any]) -> dict[str, Any]:
        return {**message, "data": message["data"] | {"source": "replay"}} if message["topic"] == "status" else message

    page = open_page(system.dashboard, prepare=changed_messages(replayed))
    expect(page.locator("#source-badge")).to_have_text("REPLAY")
    expect(page.locator("#connection-text")).to_have_text("Replay")
    page.get_by_role("tab", name="Recordings").click()
    expect(page.get_by_role("button", name="Start recording")).to_be_hidden()
    expect(page.locator(".recorder-sentence")).to_have_text("A replay is not recorded again.")


def test_instruments_and_plots_draw_something(system: RunningSystem, open_page: OpenPage, watch: Watch) -> None:
    # A canvas that is read again because it was still empty: the reading is this test's own.
    watch.expect_complaints("willReadFrequently")
    page = open_page(system.dashboard)
    live(page)
    expect(page.locator(".card-plots .uplot")).to_have_count(4)
    expect(page.locator(".card-profile .uplot")).to_have_count(1)
    count_colors = """canvas => {
        const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
        const seen = new Set();
        for (let i = 0; i < data.length; i += 4) seen.add(data[i] * 65536 + data[i + 1] * 256 + data[i + 2]);
        return seen.size;
    }"""
    for canvas in page.locator("canvas").all():
        until(page, lambda canvas=canvas: canvas.evaluate(count_colors) > 3)


def test_a_page_opened_late_shows_the_dive_before_it(
    system: RunningSystem, open_page: OpenPage, tmp_path: Path
) -> None:
    system.active_recording(lambda dive: (dive["duration_s"] or 0.0) >= 6.0)
    opened = time.time()
    page = open_page(system.dashboard)
    live(page)

    def seen() -> list[str]:
        with page.expect_download() as download:
            page.locator(".card-plots").get_by_role("button", name="CSV").click()
        download.value.save_as(tmp_path / "seen.csv")
        return (tmp_path / "seen.csv").read_text().splitlines()

    def first_unix_s() -> float:
        rows = seen()[1:]  # none before the first sample is drawn
        return float(rows[0].split(",")[1]) if rows else math.inf

    until(page, lambda: first_unix_s() < opened - 3)
    lines = seen()
    assert lines[0] == "time_utc,unix_s,depth [m],temperature [°C],salinity [PSU],soundSpeed [m/s]"
    times = [float(line.split(",")[1]) for line in lines[1:]]
    assert times == sorted(times)
    assert opened - 60 < times[-1] < time.time() + 1


def test_plots_pause_change_window_and_are_saved_as_a_picture(
    system: RunningSystem, open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page(system.dashboard)
    live(page)
    page.locator(".card-plots").get_by_role("button", name="10 min").click()
    expect(page.locator(".card-plots").get_by_role("button", name="10 min")).to_have_attribute("aria-pressed", "true")
    expect(page.locator(".card-plots").get_by_role("button", name="1 min", exact=True)).to_have_attribute(
        "aria-pressed", "false"
    )
    page.locator(".card-plots").get_by_role("button", name="Pause").click()
    expect(page.locator(".card-plots").get_by_role("button", name="Paused")).to_have_attribute("aria-pressed", "true")
    with page.expect_download() as download:
        page.locator(".card-plots").get_by_role("button", name="PNG").click()
    download.value.save_as(tmp_path / "seen.png")
    assert (tmp_path / "seen.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_what_is_unknown_is_a_dash_and_never_a_zero(system: RunningSystem, open_page: OpenPage) -> None:
    def prepare(page: Page) -> None:
        changed_messages(in_data(blank))(page)
        page.route("**/api/recordings", lambda route: route.fulfill(json={"recordings": []}))

    page = open_page(system.dashboard, prepare=prepare)
    expect(page.locator("#connection-text")).to_have_text("Live")
    expect(page.locator(".fix")).to_have_text("Silent")
    for number in page.locator("#panel-live .card:not(.card-plots, .card-motion, .card-navigation) .number").all():
        expect(number).to_have_text("-")
    for cell in page.locator(".sonars td").all()[1:]:
        expect(cell).to_have_text("-")
    text = page.locator("body").inner_text()
    assert not re.search(r"NaN|undefined|null|Infinity|\[object", text), text


def test_huge_values_break_nothing(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, width=360, height=740, prepare=changed_messages(in_data(huge)))
    expect(page.locator("#connection-text")).to_have_text("Live")
    expect(value(page, "temperature")).to_have_text("1.23e22")
    assert page.evaluate(OVERFLOW) <= 0
    expect(value(page, "roll")).to_have_text("-")


def with_gps(fix: str, latitude: float, longitude: float) -> Callable[[Page], None]:
    """Messages with this GPS in them."""

    def change(message: dict[str, Any]) -> dict[str, Any]:
        if message["topic"] == "sensors":
            message["data"]["gps"] = {"lat": latitude, "lon": longitude, "alt": 1.0, "sat": 7, "alive": True}
            message["extra"] |= {"gps_fix": fix, "hdop": 1.2}
        return message

    return changed_messages(change)


def test_no_fix_is_a_word_and_no_position(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, prepare=with_gps("none", 0.0, 0.0))
    expect(page.locator(".fix")).to_have_text("No fix")
    expect(value(page, "latitude")).to_have_text("-")
    expect(value(page, "longitude")).to_have_text("-")
    expect(value(page, "satellites")).to_have_text("7")


def test_a_fix_gives_a_position(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, prepare=with_gps("3d", 47.6123, -2.7456))
    expect(page.locator(".fix")).to_have_text("3D fix")
    expect(value(page, "latitude")).to_have_text("47.612300° N")
    expect(value(page, "longitude")).to_have_text("2.745600° W")


def test_a_wall_clock_that_jumps_makes_nothing_stale(system: RunningSystem, open_page: OpenPage) -> None:
    jumps = iter(range(0, 10**9, 3600))
    page = open_page(
        system.dashboard, prepare=changed_messages(lambda message: {**message, "t": message["t"] - next(jumps)})
    )
    live(page)
    before = value(page, "roll").inner_text()
    expect(value(page, "roll")).not_to_have_text(before)
    expect(page.locator("#panel-live .card.stale")).to_have_count(0)


def faulty(message: dict[str, Any]) -> dict[str, Any]:
    """A status in which sonar B is silent."""
    if message["topic"] == "status":
        cause, cure = "No frame for 34 s.", "Check its 12 V supply."
        for chip in message["data"]["chips"]:
            if chip["id"] == "sonar_b":
                chip |= {"state": "fault", "text": "Silent", "cause": cause, "cure": cure, "age_s": 34.0}
        fault = {"id": "sonar_b_silent", "level": "error", "title": "Sonar B is silent", "cause": cause, "cure": cure}
        message["data"]["faults"] = [fault]
    return message


def test_a_chip_opens_with_cause_and_cure_by_keyboard(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, prepare=changed_messages(faulty))
    chip = page.get_by_role("button", name="Sonar B: Fault")
    chip.focus()
    page.keyboard.press("Enter")
    detail = page.get_by_role("dialog")
    expect(detail).to_be_visible()
    expect(detail).to_contain_text("No frame for 34 s.")
    expect(detail).to_contain_text("Check its 12 V supply.")
    page.keyboard.press("Escape")
    expect(detail).to_be_hidden()
    expect(chip).to_be_focused()


def test_a_fault_is_told_in_the_banner_and_on_the_health_page(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, prepare=changed_messages(faulty))
    banner = page.locator("#banner")
    expect(banner).to_have_attribute("data-state", "fault")
    expect(banner).to_contain_text("Sonar B is silent")
    expect(banner).to_contain_text("Check its 12 V supply.")
    banner.get_by_role("button").click()
    expect(page.locator(".faults")).to_contain_text("Sonar B is silent")
    trouble = page.locator(".troubles details", has_text="A sonar is not detected")
    expect(trouble.locator(".badge")).to_be_visible()
    trouble.locator("summary").click()
    expect(trouble).to_contain_text("12 V")


def test_inside_blueos_the_map_stands_beside_the_instruments(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, width=1180, height=800)
    live(page)
    boxes = [chip.bounding_box() for chip in page.locator("#strip li").all()]
    assert len({box["y"] for box in boxes}) == 1  # type: ignore[index]
    chart, depth = page.locator(".card-map").bounding_box(), page.locator(".card-depth").bounding_box()
    assert chart
    assert depth
    assert chart["x"] > depth["x"] + depth["width"]
    assert chart["y"] < 400


def test_the_waterfall_is_one_click_away(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard)
    expect(page.get_by_role("link", name="Waterfall")).to_have_attribute("href", system.viewer)


def test_the_banner_keeps_its_place_with_and_without_a_fault(system: RunningSystem, open_page: OpenPage) -> None:
    heights = []
    for prepare in (None, changed_messages(faulty)):
        page = open_page(system.dashboard, width=360, height=740, prepare=prepare)
        live(page)
        if prepare:
            expect(page.locator("#banner")).to_contain_text("Sonar B is silent")
        heights.append(page.locator("main").bounding_box()["y"])  # type: ignore[index]
    assert heights[0] == heights[1]


def test_values_that_stop_grey_out_and_tell_their_age(system: RunningSystem, open_page: OpenPage) -> None:
    passing = [True]
    page = open_page(
        system.dashboard,
        prepare=changed_messages(lambda message: message if passing[0] or message["topic"] == "status" else None),
    )
    live(page)
    passing[0] = False
    expect(page.locator(".card-depth")).to_have_class(re.compile(r"\bstale\b"))
    expect(page.locator(".card-depth .card-age")).to_have_text(re.compile(r"^\d.* s ago$"))
    expect(page.locator("[data-field=temperature]")).to_have_class(re.compile(r"\bstale\b"))
    expect(page.locator("[data-field=temperature] .age")).to_have_text(re.compile(r"^\d+(\.\d)? s$"))
    passing[0] = True
    expect(page.locator(".card-depth")).not_to_have_class(re.compile(r"\bstale\b"))


def test_the_page_says_what_is_cut_off_and_returns_by_itself(
    system: RunningSystem, open_page: OpenPage, watch: Watch
) -> None:
    watch.expect_complaints(*LOST)
    sockets: list[WebSocketRoute] = []
    cut = [False]

    def handle(route: WebSocketRoute) -> None:
        if cut[0]:
            route.close()
            return
        sockets.append(route)
        route.connect_to_server()

    page = open_page(system.dashboard, prepare=lambda page: page.route_web_socket(re.compile("^ws:"), handle))
    live(page)
    cut[0] = True
    sockets[-1].close()
    expect(page.locator("#connection-text")).to_have_text(re.compile(r"^Status only \d"))
    expect(page.locator("#banner")).to_contain_text("No live values reach this page")
    expect(page.locator(".card-depth")).to_have_class(re.compile("stale"))
    page.route("**/api/**", lambda route: route.abort())
    expect(page.locator("#banner")).to_contain_text("does not hear the extension")
    expect(page.locator("#strip")).to_have_class(re.compile("stale"))
    cut[0] = False
    live(page)
    expect(page.locator("#strip")).not_to_have_class(re.compile("stale"))
    expect(page.locator("#panel-live .card.stale")).to_have_count(0)


def test_the_page_outlives_a_restart_of_the_extension(system: RunningSystem, open_page: OpenPage, watch: Watch) -> None:
    watch.expect_complaints(*LOST)
    heard: list[WebSocket] = []

    def follow(socket: WebSocket) -> None:
        socket.on("framereceived", lambda _: heard.append(socket) if socket not in heard else None)

    def extensions() -> list[psutil.Process]:
        children = psutil.Process(system.process.pid).children()
        return [child for child in children if "extension" in child.cmdline()]

    page = open_page(system.dashboard, prepare=lambda page: page.on("websocket", follow))
    live(page)
    until(page, lambda: heard)  # told to this test a little after the page has heard it
    (killed,) = extensions()
    before = len(heard)
    killed.send_signal(signal.SIGKILL)
    until(page, lambda: len(heard) > before)
    assert killed not in extensions(), "only a new one can have been heard"
    live(page)
    expect(page.locator("#panel-live .card.stale")).to_have_count(0)


def test_without_any_data_the_page_says_so(system: RunningSystem, open_page: OpenPage, watch: Watch) -> None:
    watch.expect_complaints(*LOST)

    def cut(page: Page) -> None:
        page.route("**/api/**", lambda route: route.abort())
        page.route_web_socket(re.compile("ws:"), lambda route: route.close())

    page = open_page(system.dashboard, prepare=cut)
    expect(page.locator("#banner")).to_contain_text("does not hear the extension")
    expect(page.locator("#connection-text")).to_have_text(re.compile("Reconnecting|Connecting"))
    expect(page.locator(".card-depth .hero .number")).to_have_text("-")
    for tab in TABS[1:]:
        open_tab(page, tab)
    expect(page.locator("#panel-health")).to_be_visible()


def test_the_keyboard_reaches_all_tabs(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard)
    live(page)
    page.get_by_role("tab", name="Live").focus()
    for name in (*TABS[1:], TABS[0]):
        page.keyboard.press("ArrowRight")
        tab = page.get_by_role("tab", name=name)
        expect(tab).to_be_focused()
        expect(tab).to_have_attribute("aria-selected", "true")
        expect(page.locator(f"#panel-{name.lower()}")).to_be_visible()
        assert page.locator("[role=tabpanel]:visible").count() == 1
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"


@pytest.mark.parametrize("size", SIZES)
def test_nothing_sticks_out_at_any_width(system: RunningSystem, open_page: OpenPage, size: str) -> None:
    width, height = SIZES[size]
    page = open_page(system.dashboard, width=width, height=height)
    live(page)
    for tab in TABS:
        open_tab(page, tab)
        expect(page.locator(f"#panel-{tab.lower()} .card").first).to_be_visible()
        assert page.evaluate(OVERFLOW) <= 0, f"{tab} at {size}"
        cut = page.evaluate("""[...document.querySelectorAll('.card')].filter(card => card.offsetParent)
            .flatMap(card => [...card.querySelectorAll('button, .number, h2, canvas, select')]
                .filter(node => node.getBoundingClientRect().right > card.getBoundingClientRect().right + 1)
                .map(node => node.outerHTML.slice(0, 80)))""")
        assert cut == [], f"{tab} at {size}"


def test_fingers_find_their_targets_on_a_phone(system: RunningSystem, open_page: OpenPage) -> None:
    page = open_page(system.dashboard, width=360, height=740, has_touch=True)
    live(page)
    for tab in TABS:
        open_tab(page, tab)
        expect(page.locator(f"#panel-{tab.lower()} .card").first).to_be_visible()
        small = page.evaluate("""[...document.querySelectorAll('button, a[href], select, summary, input, textarea')]
            .filter(node => node.offsetParent && node.type !== 'file')
            .filter(node => node.getBoundingClientRect().height < 43.5)
            .map(node => node.outerHTML.slice(0, 80))""")
        assert small == [], tab


def test_nothing_jumps_while_values_come_and_go(system: RunningSystem, open_page: OpenPage) -> None:
    count = iter(range(10**9))

    def flicker(message: dict[str, Any]) -> dict[str, Any]:
        return in_data(blank)(message) if message["topic"] == "sensors" and next(count) % 2 else message

    page = open_page(system.dashboard, prepare=changed_messages(flicker))
    expect(page.locator("#connection-text")).to_have_text("Live")
    page.evaluate("""window.jumps = [];
        new PerformanceObserver(list => list.getEntries().forEach(entry => entry.hadRecentInput ||
            window.jumps.push(...entry.sources.map(source => [entry.value, source.node?.nodeName,
                (source.node?.outerHTML ?? source.node?.data)?.slice(0, 80)]))))
            .observe({type: 'layout-shift'})""")
    seen: set[str] = set()

    def seen_coming_and_going() -> bool:
        seen.add(value(page, "roll").inner_text())
        return "-" in seen and len(seen) >= 4

    until(page, seen_coming_and_going)
    assert page.evaluate("window.jumps") == []


def test_the_theme_follows_system_address_and_switch(system: RunningSystem, open_page: OpenPage) -> None:
    theme = "document.documentElement.dataset.theme"
    page = open_page(system.dashboard, color_scheme="light")
    assert page.evaluate(theme) == "light"
    page.emulate_media(color_scheme="dark")
    until(page, lambda: page.evaluate(theme) == "dark")
    page.get_by_role("button", name="Switch to the light theme").click()
    assert page.evaluate(theme) == "light"
    page.reload()
    assert page.evaluate(theme) == "light"
    page.goto(f"{system.dashboard}?theme=dark")
    assert page.evaluate(theme) == "dark"


def test_it_works_under_a_prefix_in_an_iframe(
    system: RunningSystem, open_page: OpenPage, prefix_proxy: Callable[..., PrefixProxy]
) -> None:
    proxy = prefix_proxy(system.dashboard)
    page = open_page(proxy.frame_url)
    frame = page.frame_locator("iframe")
    live(frame)
    expect(frame.locator(".card-plots .uplot")).to_have_count(4)
    frame.get_by_role("tab", name="Settings").click()
    expect(frame.locator("[data-key='recording.max_file_mb']")).to_be_visible()
    frame.get_by_role("tab", name="Recordings").click()
    expect(frame.locator(".recording").first).to_be_visible()


def test_behind_a_proxy_without_websockets_it_takes_the_direct_port(
    system: RunningSystem, open_page: OpenPage, prefix_proxy: Callable[..., PrefixProxy], watch: Watch
) -> None:
    watch.expect_complaints("WebSocket connection to")
    proxy = prefix_proxy(system.dashboard, websockets=False)
    page = open_page(proxy.url)
    live(page)
    expect(page.locator(".sonars tbody tr").first.locator("td").first).to_have_text(re.compile(r"^\d+\.\d$"))
    before = value(page, "roll").inner_text()
    expect(value(page, "roll")).not_to_have_text(before)


@pytest.mark.parametrize("panel", ["attitude", "depth", "ctd", "link"])
def test_the_widget_fills_its_frame(system: RunningSystem, open_page: OpenPage, panel: str) -> None:
    page = open_page(f"{system.dashboard}widget?theme=light&panel={panel}", width=300, height=220, color_scheme="dark")
    expect(page.locator(".number").first).not_to_have_text("-")
    expect(page.locator(".badge")).to_have_text("SIMULATED")
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    assert page.evaluate(OVERFLOW) <= 0
    low = page.evaluate("""[...document.querySelectorAll('.number')]
        .filter(node => node.getBoundingClientRect().bottom > innerHeight + 1).length""")
    assert low == 0


def test_the_page_names_no_other_host() -> None:
    web = Path(os.path.dirname(__file__)).parents[1] / "web"
    files = [file for folder in ("dashboard", "shared") for file in (web / folder).iterdir()]
    assert len(files) > 40
    for file in files:
        text = file.read_text().replace("http://www.w3.org/2000/svg", "")
        text = text.replace('xmlns="http://www.topografix.com/GPX/1/1"', "")
        assert not re.search(r"https?://[\w.]", text), file
        if file.suffix in (".html", ".js"):
            assert not re.search(r"""(?:src|href)=["']/|fetch\(["'`]/|call\(["'`]/""", text), file
