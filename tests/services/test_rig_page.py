"""The rig's page: what it computes is what `rig/` computes, and bad questions get an answer that names the cure."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import aiohttp
import numpy as np
import pytest
import pytest_asyncio

from bluerov_slam.rig.dimensions import FO_SHIP
from bluerov_slam.rig.stack import stack_pose
from bluerov_slam.services.rig_page import FRAME_S, RigPageService

HOME_TOOL_MM = (110.0, 0.0, -648.38)


@pytest_asyncio.fixture
async def address() -> AsyncIterator[str]:
    service = RigPageService("127.0.0.1", 0, lambda _text: None)
    await service.start()
    yield f"http://127.0.0.1:{service.http.port}"
    await service.stop()


async def asked(address: str, path: str, status: int = 200) -> Any:
    async with aiohttp.ClientSession() as session, session.get(address + path) as response:
        assert response.status == status, await response.text()
        return await response.json()


async def test_scene_at_home_stands_on_the_foot_and_is_in_reach(address: str) -> None:
    told = await asked(address, "/api/rig/scene?set_points=0,0,0,0,0,0")
    assert told["tool"][:3] == pytest.approx(HOME_TOOL_MM, abs=1e-3)
    assert told["reached_here"]
    assert np.array(told["base_mm"])[0, :, 2] == pytest.approx(np.full(6, -64.0), abs=0.01)
    rods = np.linalg.norm(np.array(told["plate_mm"]) - np.array(told["arm_ends_mm"]), axis=-1)
    assert rods == pytest.approx(np.full((4, 6), 106.0), abs=0.05)
    assert np.all(np.linalg.eigvalsh(told["covariance_mm2"]) > 0.0)


async def test_four_set_points_turn_one_after_the_other(address: str) -> None:
    points = np.array([[0, 0, 1, 5, 0, 0], [0, 0, 0, 0, 5, 0], [1, 0, 0, 0, 0, 3], [0, 1, 0, -3, 2, 0]], dtype=float)
    text = ",".join(str(value) for value in points.ravel())
    told = await asked(address, f"/api/rig/scene?set_points={text}")
    points[:, 3:] = np.radians(points[:, 3:])
    expected = stack_pose(points, FO_SHIP)
    assert told["tool_mm"] == pytest.approx(expected.position_mm, abs=1e-3)
    assert np.array(told["tool_rotation"]) == pytest.approx(expected.rotation, abs=1e-6)
    joints = np.array(told["plate_mm"])[3].mean(axis=0)
    assert joints + expected.rotation @ FO_SHIP.tool_mm == pytest.approx(expected.position_mm, abs=0.05)


async def test_out_of_reach_is_said_and_has_no_truth(address: str) -> None:
    told = await asked(address, "/api/rig/scene?set_points=0,0,0,15,15,5")
    assert not told["reached_here"]
    assert told["covariance_mm2"] is None
    assert told["std"] == [None] * 6
    assert told["platforms"][0]["broken"]


async def test_a_plan_reaches_its_pose_or_offers_the_nearest(address: str) -> None:
    told = await asked(address, "/api/rig/plan?tool=115,10,-640,5,0,2&aim=margin")
    assert told["reached"]
    assert told["tool"] == pytest.approx([115, 10, -640, 5, 0, 2], abs=0.05)
    far = await asked(address, "/api/rig/plan?tool=110,0,-2000,0,0,0")
    assert not far["reached"]
    assert "nearest" in far["words"]
    assert far["reached_here"]


@pytest.mark.parametrize("name", ["axis-limits", "inverted-pairs", "circle", "tracking&transmitter=1500,300,-650"])
async def test_demonstrations_come_as_frames_in_time(address: str, name: str) -> None:
    told = await asked(address, f"/api/rig/demo?name={name}")
    times = np.array(told["times_s"])
    assert np.all(np.diff(times) >= 0.0)
    assert times[-1] == pytest.approx(told["duration_s"], abs=FRAME_S)
    assert {len(told[key]) for key in ("set_points", "base_mm", "plate_mm", "tool_mm", "reach")} == {len(times)}
    assert min(told["reach"]) >= 0.0


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("scene?set_points=1,2", "6 or 24 numbers"),
        ("scene?set_points=0,0,0,0,0,nan", "6 or 24 numbers"),
        ("scene", "6 or 24 numbers"),
        ("plan?tool=a,b,c,d,e,f", "6 numbers"),
        ("plan?tool=110,0,-640,0,0,0&aim=luck", "least_motion"),
        ("demo?name=dance", "circle"),
        ("demo?name=circle&radius_deg=400", "at most 15"),
        ("demo?name=tracking&transmitter=1,2", "3 numbers"),
        ("demo?name=move&start=0,0,0,0,0,0&end=0,0,0,15,15,5", ""),
    ],
)
async def test_bad_questions_name_the_cure(address: str, path: str, word: str) -> None:
    told = await asked(address, f"/api/rig/{path}", status=400)
    assert word in told["error"]


async def test_many_questions_at_once_are_all_answered(address: str) -> None:
    questions = [asked(address, "/api/rig/plan?tool=115,10,-640,5,0,2") for _ in range(20)]
    assert all(answer["reached"] for answer in await asyncio.gather(*questions))
