"""Pause, scrolling back, the time line; palettes, levels, layouts."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect

from browser_rig import OpenPage, RunningSystem
from viewer_page import difference, live, pixels, put_cursor, settled, until

pytestmark = pytest.mark.browser


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


def test_pings_of_before_the_page_was_opened_have_places(system: RunningSystem, open_page: OpenPage) -> None:
    first = open_page(system.viewer)
    live(first)
    until(first, "viewer.track.states.length >= 6")
    oldest = first.evaluate("viewer.track.states[0].timeS")
    late = open_page(system.viewer)
    live(late)
    until(late, f"viewer.track.states.length >= 6 && viewer.track.states[0].timeS <= {oldest} + 1")
    times = late.evaluate("viewer.track.states.map((state) => state.timeS)")
    assert times == sorted(times)
    assert late.evaluate("viewer.track.states[1].depth_m") is not None
