"""The picture itself: pings, gaps, scale, both ways of drawing."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, WebSocketRoute, expect

from browser_rig import OpenPage, RunningSystem, Watch
from viewer_page import LOADED, difference, instead_of_pings, live, packed_ping, pixels, put_cursor, settled, until

pytestmark = pytest.mark.browser


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
