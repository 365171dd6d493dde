"""Where the viewer is put, and what goes wrong."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, WebSocketRoute, expect

from browser_rig import OpenPage, PrefixProxy, RunningSystem, Watch
from viewer_page import LOST, OVERFLOW, READING, instead_of_pings, live, until

pytestmark = pytest.mark.browser


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
