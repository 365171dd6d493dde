"""What all browser tests of the viewer share."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from browser_rig import Watch
from viewer_page import READING

CHROMIUM = os.environ.get("BLUEROV_SLAM_CHROMIUM", "/usr/bin/chromium")
WITHOUT_GL = ["--no-sandbox", "--disable-gpu", "--disable-3d-apis"]


@pytest.fixture(autouse=True)
def _reading_allowed(watch: Watch) -> None:
    watch.expect_complaints(*READING)


@pytest.fixture(scope="module")
def flat_browser(chromium: Browser) -> Iterator[Browser]:
    """A second browser, without WebGL."""
    browser = chromium.browser_type.launch(executable_path=CHROMIUM, args=WITHOUT_GL)
    yield browser
    browser.close()
