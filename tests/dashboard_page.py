"""What the browser tests of the dashboard read from the page, and how they change what it is told."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from typing import Any

from playwright.sync_api import FrameLocator, Page, WebSocketRoute, expect

from patience import PATIENCE_S


def value(page: Page | FrameLocator, field: str) -> Any:
    """The number of a value cell."""
    return page.locator(f"[data-field={field}] .number").first


def live(page: Page | FrameLocator) -> None:
    """Wait until values come."""
    expect(page.locator("#connection-text")).to_have_text("Live")
    expect(value(page, "roll")).not_to_have_text("-")


def until(page: Page, condition: Callable[[], bool]) -> None:
    """Wait until something holds that no locator can tell; the page's own policy forbids to evaluate in it."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"not within {PATIENCE_S} s"
        page.wait_for_timeout(50)


def changed_messages(change: Callable[[dict[str, Any]], dict[str, Any] | None]) -> Callable[[Page], None]:
    """Puts a change between the real extension and the page; None drops the message."""

    def handle(route: WebSocketRoute) -> None:
        server = route.connect_to_server()

        def downward(text: str | bytes) -> None:
            message = change(json.loads(text))
            if message is not None:
                route.send(json.dumps(message))

        server.on_message(downward)

    return lambda page: page.route_web_socket(re.compile(r"/ws$"), handle)


def blank(value_: Any) -> Any:
    """The same shape with nothing known."""
    if isinstance(value_, dict):
        return {key: blank(item) for key, item in value_.items()}
    return False if isinstance(value_, bool) else None


def huge(value_: Any) -> Any:
    """The same shape with absurd numbers."""
    if isinstance(value_, dict):
        return {key: huge(item) for key, item in value_.items()}
    return value_ if isinstance(value_, bool | str) or value_ is None else 1.234567e22


def in_data(change: Callable[[Any], Any]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """A change of what the sensors say, and of the status's numbers."""

    def apply(message: dict[str, Any]) -> dict[str, Any]:
        if message["topic"] == "sensors":
            return {**message, "data": change(message["data"]), "extra": change(message["extra"])}
        if message["topic"] == "status":
            data = message["data"]
            return {**message, "data": {**data, "link": change(data["link"]), "sonars": change(data["sonars"])}}
        return message

    return apply


def open_tab(page: Page, name: str) -> None:
    """Choose a tab."""
    page.get_by_role("tab", name=name).click()
