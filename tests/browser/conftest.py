"""Fixtures of the browser tests: `bluerov-slam run --simulate` on free ports, and a real headless Chromium."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from browser_rig import OpenPage, PrefixProxy, RunningSystem, Watch
from patience import PATIENCE_S

expect.set_options(timeout=PATIENCE_S * 1000)

CHROMIUM = Path(os.environ.get("BLUEROV_SLAM_CHROMIUM", "/usr/bin/chromium"))
CHROMIUM_ARGS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]


@pytest.fixture(scope="session")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    """One running system for all browser tests."""
    running = RunningSystem(tmp_path_factory.mktemp("system"))
    try:
        running.until_up()
        yield running
    finally:
        running.stop()


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """The headless browser, or one clear line why there is none."""
    if not CHROMIUM.exists():
        pytest.skip(f"no browser at {CHROMIUM}: apt-get install chromium (or set BLUEROV_SLAM_CHROMIUM)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=CHROMIUM_ARGS)
        yield browser
        browser.close()


@pytest.fixture
def watch() -> Iterator[Watch]:
    """No console error, no page error, no request to another host, in any test."""
    watching = Watch()
    yield watching
    assert watching.unexpected() == []
    assert watching.foreign == []


@pytest.fixture
def open_page(chromium: Browser, watch: Watch) -> Iterator[OpenPage]:
    """Opens a watched page: `open_page(url, width=..., height=..., prepare=..., **context options)`."""
    contexts: list[BrowserContext] = []

    def open_(
        url: str, width: int = 1440, height: int = 900, prepare: Callable[[Page], None] | None = None, **options: Any
    ) -> Page:
        context = chromium.new_context(viewport={"width": width, "height": height}, **options)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_S * 1000)
        watch.follow(page, urlsplit(url).hostname)
        if prepare:
            prepare(page)
        page.goto(url)
        return page

    yield open_
    for context in contexts:
        context.close()


@pytest.fixture
def prefix_proxy() -> Iterator[Callable[..., PrefixProxy]]:
    """Puts a service under a path prefix: `prefix_proxy(system.dashboard, websockets=False)`."""
    proxies: list[PrefixProxy] = []

    def start(target: str, websockets: bool = True) -> PrefixProxy:
        proxies.append(PrefixProxy(target, websockets))
        return proxies[-1]

    yield start
    for proxy in proxies:
        proxy.close()
