"""The rig's page in a real browser, served by the command itself."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, Route, expect

from browser_rig import OpenPage, Watch
from patience import PATIENCE_S

GPU_REMARK = "GL Driver Message"

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    command = [sys.executable, "-m", "bluerov_slam", "rig", "page", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    said = re.search(r"http://\S+", process.stdout.readline())
    assert said is not None
    yield said[0]
    process.terminate()
    process.wait(PATIENCE_S)


def opened(open_page: OpenPage, watch: Watch, address: str, **options: int) -> Page:
    watch.expect_complaints(GPU_REMARK)
    page = open_page(address + "/", **options)
    expect(page.locator("#verdict")).to_have_text("Within reach")
    return page


def truth(page: Page, axis: str) -> str:
    return page.locator("#truth tr", has_text=axis).first.inner_text()


def test_the_stack_is_drawn_and_its_truth_told_with_uncertainty(
    open_page: OpenPage, watch: Watch, address: str
) -> None:
    page = opened(open_page, watch, address)
    expect(page.locator("#missing")).to_be_hidden()
    assert "+110.0" in truth(page, "x")
    assert re.search(r"±\d+\.\d", truth(page, "x"))
    expect(page.locator("#margins .platform")).to_have_count(4)
    picture = page.locator("#stack").screenshot()
    page.get_by_role("spinbutton", name="pitch, °, number").fill("10")
    page.get_by_role("spinbutton", name="pitch, °, number").press("Enter")
    expect(page.locator("#truth")).to_contain_text("+40.00")
    assert page.locator("#stack").screenshot() != picture


def test_what_is_out_of_reach_is_said_in_words(open_page: OpenPage, watch: Watch, address: str) -> None:
    page = opened(open_page, watch, address)
    for axis, value in (("roll, °", "15"), ("pitch, °", "15"), ("yaw, °", "5")):
        field = page.get_by_role("spinbutton", name=f"{axis}, number")
        field.fill(value)
        field.press("Enter")
    expect(page.locator("#verdict")).to_contain_text("Out of reach at platform 1")
    expect(page.locator("#verdict")).to_contain_text("ball joint would tilt")
    expect(page.locator("#truth")).not_to_contain_text("±")


def test_a_planned_pose_is_moved_to_and_an_unreachable_one_offers_the_nearest(
    open_page: OpenPage, watch: Watch, address: str
) -> None:
    page = opened(open_page, watch, address)
    x = page.locator("#pose input").first
    x.fill("130")
    page.get_by_role("button", name="Plan and move").click()
    expect(page.locator("#truth")).to_contain_text("+130.0")
    expect(page.locator("#truth")).to_contain_text("±")
    x.fill("900")
    page.get_by_role("button", name="Plan and move").click()
    expect(page.locator("#planned")).to_contain_text("nearest")
    x.fill("")
    page.get_by_role("button", name="Plan and move").click()
    expect(page.locator("#planned")).to_contain_text("6 numbers")
    watch.expect_complaints(GPU_REMARK, "400")


def test_a_demonstration_plays_pauses_and_can_be_gone_through_by_hand(
    open_page: OpenPage, watch: Watch, address: str
) -> None:
    page = opened(open_page, watch, address)
    page.get_by_role("button", name="Circle").click()
    expect(page.locator("#player")).to_be_visible()
    expect(page.locator("#verdict")).to_contain_text("Moving")
    page.get_by_role("button", name="Pause").click()
    page.locator("#time").fill("20")
    expect(page.locator("#time-text")).to_contain_text("0.8 of")
    told = truth(page, "x")
    page.locator("#time").fill("30")
    assert truth(page, "x") != told


def test_without_the_3d_library_the_numbers_remain(open_page: OpenPage, watch: Watch, address: str) -> None:
    watch.expect_complaints("Failed to load resource")

    def without(page: Page) -> None:
        def refuse(route: Route) -> None:
            route.fulfill(status=404, body="")

        page.route("**/vendor/three/**", refuse)

    page = open_page(address + "/", prepare=without)
    expect(page.locator("#missing")).to_contain_text("reinstall")
    expect(page.locator("#truth")).to_contain_text("+110.0")


def test_on_a_phone_nothing_is_wider_than_the_screen(open_page: OpenPage, watch: Watch, address: str) -> None:
    page = opened(open_page, watch, address, width=390, height=844)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
