"""The extension with its real navigation worker, a process of its own; only the estimator inside it is a plain one."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from patience import PATIENCE_S
from running_extension import running_extension, running_simulator, serial_port

PLAUSIBLE = "plausible_navigator:PlausibleNavigator"
UNDER_WAY = {"mission_start_s": 60.0}


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))


async def aided(running):
    return await running.until("/api/navigation", lambda data: data["mode"] == "aided")


async def test_states_reach_the_page_the_api_and_the_hub(tmp_path):
    async with (
        running_simulator(tmp_path),
        running_extension(tmp_path / "state", port=serial_port(tmp_path), navigator=PLAUSIBLE) as running,
    ):
        data = await aided(running)
        assert abs(data["position"]["latitude_deg"] - data["origin"]["latitude_deg"]) < 1e-3
        async with running.client.ws_connect("/ws") as socket:
            await socket.send_json({"subscribe": ["navigation"]})
            async with asyncio.timeout(PATIENCE_S):
                while (message := json.loads((await socket.receive()).data))["topic"] != "navigation":
                    pass
                message = json.loads((await socket.receive()).data)
        assert message["topic"] == "navigation"
        assert set(message["data"]) == set(data)
        track = await running.until("/api/navigation/track", lambda track: len(track["points"]) > 1)
        assert track["fixes"][0][4:] == ["gps", True]
