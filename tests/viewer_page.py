"""What the browser tests of the viewer read from the page, and the pings they put in place of real ones."""

from __future__ import annotations

import json
import re
import struct
import time
from collections.abc import Callable
from typing import Any

from playwright.sync_api import FrameLocator, Page, WebSocketRoute, expect

from patience import PATIENCE_S

SIZES = {"320 px": (320, 640), "phone": (360, 740), "tablet": (820, 1180), "laptop": (1440, 900), "4K": (3840, 2160)}
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
LOST = ("WebSocket", "ERR_CONNECTION", "Failed to load resource", "ERR_FAILED", "ERR_EMPTY_RESPONSE")
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


def with_vehicle(**values: Any) -> Callable[[Page], None]:
    """Puts these into every message about the vehicle; pings pass."""

    def handle(route: WebSocketRoute) -> None:
        server = route.connect_to_server()

        def downward(data: str | bytes) -> None:
            message = json.loads(data) if isinstance(data, str) else None
            if message and message["topic"] == "vehicle":
                data = json.dumps({**message, "data": message["data"] | values})
            route.send(data)

        server.on_message(downward)

    return lambda page: page.route_web_socket(re.compile(r"/ws$"), handle)


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
