"""The extension with its real navigation worker, a process of its own; only the estimator inside it is a plain one."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import os
import signal
from pathlib import Path

import aiohttp
import pytest

from bluerov_slam.records import NavState, SensorSample
from bluerov_slam.services.extension import Extension
from bluerov_slam.services.navigation_api import KINDS
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.simulation import sensors
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.sources.replay import ReplaySource, decoder_for
from fake_autopilot import fly
from patience import PATIENCE_S
from running_extension import Running, open_store, running_extension, running_simulator, serial_port
from simulated_dive import record_dive

PLAUSIBLE = "plausible_navigator:PlausibleNavigator"


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))


@pytest.fixture(autouse=True)
def early_fix(monkeypatch):
    """A GPS receiver that finds itself at once: how long one takes is the simulator's affair, and shown there."""
    monkeypatch.setattr(sensors, "FIRST_FIX_S", 0.5)


async def aided(running):
    return await running.until("/api/navigation", lambda data: data["mode"] == "aided")


async def estimating(running):
    """The first states, which need no fix and so no patience with the receiver."""
    return await running.until("/api/navigation", lambda data: data["attitude"]["heading_deg"] is not None)


def chip(state):
    return next(chip for chip in state["chips"] if chip["id"] == "navigation")


async def test_states_reach_the_page_the_api_and_the_metrics(tmp_path):
    async with (
        running_simulator(tmp_path),
        running_extension(tmp_path / "state", port=serial_port(tmp_path), navigator=PLAUSIBLE) as running,
    ):
        data = await aided(running)
        assert abs(data["position"]["latitude_deg"] - data["origin"]["latitude_deg"]) < 1e-3
        async with running.client.ws_connect("/ws") as socket:
            greeting = [json.loads((await socket.receive()).data)["topic"] for _ in range(2)]
            assert greeting == ["status", "navigation"]
            await socket.send_json({"subscribe": ["navigation"]})
            messages = []
            async with asyncio.timeout(PATIENCE_S):
                while len(messages) < 5:
                    message = json.loads((await socket.receive()).data)
                    messages += [message] if message["topic"] == "navigation" else []
        assert all(set(message["data"]) == set(data) for message in messages)
        times = [message["t"] for message in messages]
        assert times == sorted(times)
        track = await running.until("/api/navigation/track", lambda track: len(track["points"]) > 1)
        assert track["fixes"][0][4:] == ["gps", True]
        assert (await running.get("/api/navigation/track?since=9e9"))["points"] == []
        assert chip(await running.get("/api/state"))["state"] == "ok"
        async with running.client.get("/metrics") as response:
            metrics = await response.text()
        assert "bluerov_slam_navigation_running 1.0" in metrics
        assert "bluerov_slam_navigation_records_dropped_total 0.0" in metrics


async def test_the_water_that_the_vehicle_went_through_is_told(tmp_path):
    async with (
        running_simulator(tmp_path, mission_start_s=17.0),  # afloat for three seconds more
        running_extension(tmp_path / "state", port=serial_port(tmp_path), navigator=PLAUSIBLE) as running,
    ):
        assert (await running.get("/api/navigation/water"))["nodes"] == []
        water = await running.until("/api/navigation/water", lambda water: len(water["nodes"]) > 0)
        node = water["nodes"][-1]
        assert node["depth_m"] > 0.5
        assert node["samples"] >= 2
        assert 1400.0 < node["sound_speed_mps"] < 1600.0
        assert 990.0 < node["density_kg_per_m3"] < 1040.0
        assert 0.0 < node["sound_speed_std_mps"] < 3.0


async def test_a_crash_of_the_estimator_takes_nothing_else_down(tmp_path):
    async with (
        running_simulator(tmp_path),
        running_extension(tmp_path / "state", port=serial_port(tmp_path), navigator=PLAUSIBLE) as running,
    ):
        await aided(running)
        saved = tmp_path / "state" / "navigation.json"
        async with asyncio.timeout(PATIENCE_S):
            while not saved.exists() or b'"position_known":true' not in saved.read_bytes():
                await asyncio.sleep(0.05)
        frames = (await running.get("/health"))["frames"]
        os.kill(running.extension.navigation.process.facts().pid, signal.SIGKILL)
        state = await running.until("/api/state", lambda state: chip(state)["state"] == "fault")
        assert "SIGKILL" in chip(state)["cause"]
        assert chip(state)["cure"]
        await running.until("/health", lambda health: health["frames"] > frames)
        data = await running.until("/api/navigation", lambda data: data["reset_counter"] == 1)
        assert data["position"]["north_m"] is not None
        assert any("saved position" in text for text in running.events())
        await running.until("/api/state", lambda state: chip(state)["state"] == "ok")


async def test_actions_take_the_guard_and_answer_in_words(tmp_path):
    async with (
        running_simulator(tmp_path),
        running_extension(tmp_path / "state", port=serial_port(tmp_path), navigator=PLAUSIBLE) as running,
    ):
        await aided(running)
        status, answer = await running.call("POST", "/api/navigation", json={"action": "zero_depth"})
        assert (status, answer) == (200, {"ok": True, "message": "zero_depth: done"})
        status, answer = await running.call("POST", "/api/navigation", json={"action": "zero_depth"}, headers={})
        assert status == 403
        for body, word in (
            ({"action": "fly"}, "expected one of zero_depth"),
            ({"action": "zero_depth", "kind": "gyro"}, "takes no kind"),
            ({"action": "start_calibration", "kind": "nose"}, "expected one of gyro"),
            ({"action": "set_origin", "latitude_deg": 54.0}, "both latitude_deg"),
            ({"action": "set_origin", "latitude_deg": 91.0, "longitude_deg": 0.0}, "-90 to 90"),
            ({"action": "set_origin", "latitude_deg": True, "longitude_deg": 0.0}, "-90 to 90"),
            ({"action": "set_origin", "latitude_deg": 0.0, "longitude_deg": 0.0}, "without a fix"),
        ):
            status, answer = await running.call("POST", "/api/navigation", json=body)
            assert status == 400, body
            assert word in answer["error"], body
        status, answer = await running.call(
            "POST", "/api/navigation", json={"action": "set_origin", "latitude_deg": 54.0, "longitude_deg": 10.0}
        )
        assert status == 200
        data = await running.until("/api/navigation", lambda data: data["origin"]["latitude_deg"] == 54.0)
        assert data["origin"]["longitude_deg"] == 10.0
        for query in ("points=1", "points=x", "since=nan"):
            async with running.client.get(f"/api/navigation/track?{query}") as response:
                assert response.status == 400, query


async def test_a_calibration_goes_through_its_states_and_the_assistant_follows(tmp_path):
    async with (
        running_simulator(tmp_path),
        running_extension(tmp_path / "state", port=serial_port(tmp_path), navigator=PLAUSIBLE) as running,
    ):
        await estimating(running)
        calibration = await running.get("/api/navigation/calibration")
        assert tuple(kind["kind"] for kind in calibration["kinds"]) == KINDS
        assert all(kind["label"] for kind in calibration["kinds"])
        for action, state in (("start_calibration", "running"), ("finish_calibration", "done")):
            await running.call("POST", "/api/navigation", json={"action": action, "kind": "gyro"})
            kinds = (await running.get("/api/navigation/calibration"))["kinds"]
            assert kinds[0]["state"] == state
        await running.call("POST", "/api/navigation", json={"action": "zero_depth"})
        steps = (await running.get("/api/navigation/calibration"))["assistant"]["steps"]
        sequence = ["zero_depth", "calibrate", "thruster_field", "swing", "surface_run", "set_origin"]
        assert [step["id"] for step in steps] == sequence
        assert [step["state"] for step in steps][:2] == ["done", "active"]


async def test_settings_switch_it_off_and_on_and_make_it_anew(tmp_path):
    async with (
        running_simulator(tmp_path),
        running_extension(tmp_path / "state", port=serial_port(tmp_path), navigator=PLAUSIBLE) as running,
    ):
        await estimating(running)
        process = running.extension.navigation.process
        before = process.facts().pid
        await running.call("PATCH", "/api/settings", json={"navigation.odometry_rate_hz": 8.0})
        assert process.facts().pid == before, "what concerns the autopilot needs no new estimate"
        await running.call("PATCH", "/api/settings", json={"navigation.origin": "54.5, 10.5"})
        await estimating(running)
        assert process.facts().pid != before
        await running.call("PATCH", "/api/settings", json={"navigation.enabled": False})
        data = await running.get("/api/navigation")
        assert (data["mode"], data["position"]["north_m"]) == ("off", None)
        assert chip(await running.get("/api/state"))["state"] == "off"
        status, answer = await running.call("POST", "/api/navigation", json={"action": "zero_depth"})
        assert (status, "switched off" in answer["error"]) == (409, True)
        await running.call("PATCH", "/api/settings", json={"navigation.enabled": True})
        await estimating(running)
        status, answer = await running.call("PATCH", "/api/settings", json={"navigation.origin": "95, 10"})
        assert (status, "latitude -90 to 90" in answer["error"]) == (400, True)


async def test_a_replay_navigates_too_keeps_nothing_and_sends_nothing(tmp_path):
    session, _, _ = record_dive(tmp_path / "recordings", 40.0)
    recording = open_recording(session)
    source = ReplaySource(recording, 8.0)
    flags = {"mavlink__enabled": True, "navigation__odometry_enabled": True}
    store = open_store(tmp_path / "state", **flags)
    extension = Extension(store, source, decoder=decoder_for(recording), navigator=PLAUSIBLE)
    await extension.start()
    try:
        async with aiohttp.ClientSession(f"http://127.0.0.1:{extension.http.port}") as client:
            running = Running(extension, client)
            data = await aided(running)
            assert "replay" in data["odometry"]["text"]
            await asyncio.wait_for(source.finished.wait(), PATIENCE_S)
    finally:
        await extension.stop()
    assert "ODOMETRY" not in extension.mavlink.counters()["sent"]
    assert not list((tmp_path / "state").glob("navigation*.json"))


async def test_a_replay_as_fast_as_can_be_leaves_nothing_out_of_navigation(tmp_path):
    session, _, records = record_dive(tmp_path / "recordings", 60.0)
    recording = open_recording(session)
    source = ReplaySource(recording, None)
    extension = Extension(open_store(tmp_path / "state"), source, decoder=decoder_for(recording), navigator=PLAUSIBLE)
    states = []
    extension.hub.subscribe(states.append, NavState)
    await extension.start()
    try:
        await asyncio.wait_for(source.finished.wait(), PATIENCE_S)
        samples = sum(isinstance(record, SensorSample) for record in records)
        assert samples > 100
        async with asyncio.timeout(PATIENCE_S):
            while len(states) < samples:
                await asyncio.sleep(0.02)
        assert extension.navigation.process.facts().dropped == 0
    finally:
        await extension.stop()


async def test_the_estimators_position_reaches_the_autopilot_and_is_the_pages(tmp_path):
    """Everything real but the autopilot: bytes of the virtual ESP32, the navigator in its process, datagrams."""
    autopilot = await fly()
    settings = {
        "mavlink__enabled": True, "mavlink__target_port": autopilot.port, "navigation__odometry_enabled": True,
        "navigation__odometry_when_simulated": True, "navigation__odometry_max_std_m": 100.0,
    }  # fmt: skip
    async with (
        running_simulator(tmp_path),
        running_extension(tmp_path / "state", port=serial_port(tmp_path), simulated=True, **settings) as running,
    ):
        data = await running.until("/api/navigation", lambda data: data["odometry"]["sent"] >= 10)
        assert data["odometry"]["text"] == "Position goes to the autopilot"
        assert autopilot.dropped_frames == 0
        assert autopilot.origin == pytest.approx(
            [data["origin"][key] * 1e7 for key in ("latitude_deg", "longitude_deg")], abs=1
        )
        taken = autopilot.odometry[-1]
        north_m, east_m, _ = taken.position_ned_m
        assert math.hypot(north_m - data["position"]["north_m"], east_m - data["position"]["east_m"]) < 3.0
        times = [entry.message.time_usec for entry in autopilot.odometry]
        gaps_s = [(b - a) * 1e-6 for a, b in itertools.pairwise(times)]
        assert sorted(gaps_s)[len(gaps_s) // 2] == pytest.approx(0.2, abs=0.051)
        rows = await running.get("/api/navigation/autopilot")
        assert {row["name"]: row["current"] for row in rows}["EK3_SRC1_POSXY"] == 3.0
        body = {"action": "set_parameters"}
        status, answer = await running.call("POST", "/api/navigation/autopilot", json=body)
        assert (status, "confirm" in answer["error"], autopilot.writes) == (400, True, [])
        status, answer = await running.call("POST", "/api/navigation/autopilot", json=body | {"confirm": True})
        assert (status, answer["ok"], len(autopilot.writes)) == (200, True, 4)
    autopilot.transport.close()


async def test_a_simulated_vehicle_leaves_the_real_ones_state_alone(tmp_path):
    state = tmp_path / "state"
    async with (
        running_simulator(tmp_path),
        running_extension(state, port=serial_port(tmp_path), navigator=PLAUSIBLE, simulated=True) as running,
    ):
        assert (await estimating(running))["simulated"] is True
    assert (state / "navigation-simulated.json").exists()
    assert not (state / "navigation.json").exists()


def test_an_unreadable_origin_never_gets_into_the_settings(tmp_path):
    store = SettingsStore.open(None, {"paths.state": str(tmp_path)}, {})
    assert store.settings.navigation.origin_deg is None
    store.change({"navigation.origin": " -54.25 , 10.125"})
    assert store.settings.navigation.origin_deg == (-54.25, 10.125)
