import asyncio
import json

import aiohttp
import pytest

from bluerov_slam.protocol.kogger_frame import KoggerFrameDecoder
from bluerov_slam.records import Channel, Ping, SonarFrames
from bluerov_slam.services.extension import Extension
from bluerov_slam.sinks.websocket import HEARTBEAT_S
from bluerov_slam.sources.udp import open_udp_source
from patience import PATIENCE_S
from running_extension import open_store, running_extension, running_simulator, serial_port

SEED_KEYS = {
    "ts": None,
    "imu": ["r", "p", "y", "ax", "ay", "az", "alive"],
    "gps": ["lat", "lon", "alt", "sat", "alive"],
    "ec": ["conductivity", "salinity", "alive"],
    "depth": ["press", "temp", "ok"],
    "celsius": ["temp", "ok"],
    "ctd": ["sv", "d", "s", "t"],
    "ka": ["pkts", "bytes", "alive"],
    "kb": ["pkts", "bytes", "alive"],
}
# Before the heartbeat of the WebSocket would have found out by itself that its client is gone.
STOP_PATIENCE_S = 0.9 * HEARTBEAT_S
CHIPS = [
    "link", "sonar_a", "sonar_b", "imu", "depth", "ctd", "gps", "recorder", "mavlink", "navigation", "acoustics",
]  # fmt: skip


def assert_seed_shape(frame):
    assert list(frame) == list(SEED_KEYS)
    for key, names in SEED_KEYS.items():
        if names is not None:
            assert list(frame[key]) == names


@pytest.fixture
async def diving(tmp_path):
    """A dive under way on the simulator, with the first sensor frame in."""
    async with (
        running_simulator(tmp_path / "dev", mission_start_s=60.0),
        running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running,
    ):
        await running.until("/api/latest", lambda frame: frame["ts"] is not None)
        yield running


@pytest.fixture
async def unplugged(tmp_path):
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
        yield running


async def test_the_answers_have_exactly_the_keys_of_the_users_present_system(diving):
    assert_seed_shape(await diving.get("/api/latest"))
    assert set(await diving.get("/health")) == {"status", "serial", "frames", "protocol"}
    assert set(await diving.get("/api/dvl")) == {"vx", "vy", "vz", "valid"}
    ctd = await diving.until("/api/ctd", lambda answer: answer["sound_velocity_ms"] is not None)
    assert list(ctd) == [
        "timestamp", "depth_m", "temperature_c", "conductivity_us", "salinity_psu", "sound_velocity_ms",
        "pressure_mbar",
    ]  # fmt: skip
    assert 5.0 < ctd["depth_m"] < 15.0
    assert 30_000 < ctd["conductivity_us"] < 60_000
    assert 1450 < ctd["sound_velocity_ms"] < 1550
    status = await diving.get("/api/status")
    assert {
        "frames", "clients", "port", "serial_connected", "log", "ws_port", "crc_errors", "protocol", "udp_targets",
        "mavlink_enabled", "mavlink_target", "mavlink_sent",
    } <= set(status)  # fmt: skip
    assert status["serial_connected"] is True
    assert status["udp_targets"] == ["127.0.0.1"]
    assert status["mavlink_target"] == "127.0.0.1:14401"


async def test_without_a_link_it_is_healthy_and_every_value_is_unknown(unplugged):
    health = await unplugged.get("/health")
    assert health == {"status": "healthy", "serial": False, "frames": 0, "protocol": "binary_v4"}
    latest = await unplugged.get("/api/latest")
    assert_seed_shape(latest)
    values = [value for part in latest.values() if isinstance(part, dict) for value in part.values()]
    assert latest["ts"] is None
    assert set(values) == {None, False}, "neither a count nor a value before the first frame"
    assert await unplugged.get("/api/dvl") == {"vx": 0.0, "vy": 0.0, "vz": 0.0, "valid": False}
    assert set((await unplugged.get("/api/ctd")).values()) == {None}


async def test_every_documented_path_survives_a_bare_get(unplugged):
    document = await unplugged.get("/openapi.json")
    for path in document["paths"]:
        async with asyncio.timeout(PATIENCE_S):
            async with unplugged.client.get(path, headers={"Connection": "Upgrade"}) as response:
                assert response.status in (200, 404, 405), path
    for path in (
        "/ws",
        "/internal/viewer-link",
        "/api/recordings/{name}/export",
        "/api/recordings/{name}/files/{file}",
    ):
        assert path not in document["paths"]


async def test_the_document_and_the_router_agree(unplugged):
    document = await unplugged.get("/openapi.json")
    documented = {(method.upper(), path) for path, item in document["paths"].items() for method in item}
    table = {(route.method, route.path) for route in unplugged.extension.api.routes() if route.documented}
    assert table <= documented


async def test_the_seeds_socket_gets_the_bare_sensor_json(diving):
    url = f"http://127.0.0.1:{diving.extension.sensor_http.port}/"
    async with aiohttp.ClientSession() as session, session.ws_connect(url) as socket:
        for _ in range(2):
            assert_seed_shape(json.loads((await socket.receive(timeout=PATIENCE_S)).data))


async def test_the_topic_socket_greets_with_the_status_and_brings_sensors(diving):
    async with diving.client.ws_connect("/ws") as socket:
        first = json.loads((await socket.receive(timeout=PATIENCE_S)).data)
        assert first["topic"] == "status"
        assert [chip["id"] for chip in first["data"]["chips"]] == CHIPS
        await socket.send_json({"subscribe": ["sensors"]})
        while (message := json.loads((await socket.receive(timeout=PATIENCE_S)).data))["topic"] != "sensors":
            pass
        assert_seed_shape(message["data"])
        assert set(message["extra"]) == {
            "salinity_psu", "sound_speed_mps", "depth_m", "conductivity_us", "gps_fix", "hdop", "sender",
            "measured_unix_s",
        }  # fmt: skip
        assert message["extra"]["sender"] == "full_range"
        assert abs(message["t"] - message["extra"]["measured_unix_s"]) < PATIENCE_S


async def test_the_status_counts_what_came(diving):
    state = await diving.until("/api/state", lambda s: s["sonars"]["B"]["pings"] > 3 and s["link"]["bytes_per_s"] > 0)
    assert list(state["sonars"]) == ["A", "B"]
    assert state["link"]["connected"] is True
    assert state["link"]["by_id"].endswith("if00-port0")
    assert state["link"]["crc_errors"] == 0
    sonar = state["sonars"]["A"]
    assert (sonar["alive"], sonar["samples"], sonar["resolution_mm"], sonar["range_m"]) == (True, 1000, 20, 20.0)
    assert sonar["coding"] == "mean"
    assert state["source"] == "serial"
    assert state["versions"]["protocol"] == "binary_v4"
    assert state["firmware"]["boots"] == 7
    assert state["clock"]["device_offset_s"] is not None


async def test_metrics_say_what_the_status_says(diving):
    await diving.until("/api/state", lambda s: s["sonars"]["A"]["pings"] > 0)
    async with diving.client.get("/metrics") as response:
        text = await response.text()
    assert "bluerov_slam_link_connected 1.0" in text
    assert 'bluerov_slam_link_frames_by_type_total{type="0x01"}' in text
    assert 'bluerov_slam_sonar_pings_total{sonar="A"}' in text
    assert 'bluerov_slam_forwarding_frames_total{sonar="A",target="127.0.0.1"}' in text


async def test_both_sonars_arrive_by_udp_with_their_routes(tmp_path):
    got = {channel: asyncio.Event() for channel in Channel}
    routes: dict[Channel, set[int]] = {channel: set() for channel in Channel}

    def taker(channel):
        def take(data, _address):
            routes[channel] |= {frame.route for frame in KoggerFrameDecoder("mod256").feed(data)}
            got[channel].set()

        return take

    sources = {channel: await open_udp_source("127.0.0.1", 0, taker(channel)) for channel in Channel}
    ports = {f"viewer__udp_port_{channel.value.lower()}": source.port for channel, source in sources.items()}
    async with (
        running_simulator(tmp_path / "dev"),
        running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev"), **ports),
        asyncio.timeout(PATIENCE_S),
    ):
        for event in got.values():
            await event.wait()
    assert routes == {Channel.A: {1}, Channel.B: {2}}
    for source in sources.values():
        source.close()


async def test_crossed_cables_are_put_right_everywhere_by_one_switch(tmp_path):
    async with (
        running_simulator(tmp_path / "dev", "at=0 kind=silent sensor=b duration=1000"),
        running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running,
    ):
        state = await running.until("/api/state", lambda s: s["sonars"]["A"]["pings"] > 0)
        assert state["sonars"]["B"]["pings"] == 0
        status, answer = await running.call("PATCH", "/api/settings", json={"sonar.swap_a_b": True})
        assert status == 200
        assert next(s for s in answer["settings"] if s["key"] == "sonar.swap_a_b")["value"] is True
        channels = set()
        running.extension.hub.subscribe(lambda record: channels.add(record.channel), Ping, SonarFrames)
        state = await running.until("/api/state", lambda s: s["sonars"]["B"]["pings"] > 3)
        assert state["sonars"]["A"]["pings"] == 0
        assert channels == {Channel.B}
        latest = await running.until("/api/latest", lambda frame: (frame["kb"]["pkts"] or 0) > 0)
        assert latest["ka"]["pkts"] == 0
        assert "settings changed: sonar.swap_a_b" in running.events()


async def test_settings_are_refused_whole_with_the_range_and_live_ones_act_at_once(unplugged):
    status, answer = await unplugged.call(
        "PATCH", "/api/settings", json={"recording.max_file_mb": 0, "forwarding.targets": []}
    )
    assert status == 400
    assert "recording.max_file_mb = 0: expected a whole number from 1 to 4096 in MB" in answer["error"]
    assert (await unplugged.get("/api/status"))["udp_targets"] == ["127.0.0.1"]
    await unplugged.call("PATCH", "/api/settings", json={"forwarding.targets": ["127.0.0.1", "127.0.0.2"]})
    forwarding = (await unplugged.get("/api/state"))["forwarding"]
    assert {entry["target"] for entry in forwarding} == {"127.0.0.1", "127.0.0.2"}


async def test_changes_at_the_same_moment_are_all_kept(unplugged):
    keys = [key for key, value in (await changeable(unplugged)).items() if value is False]
    assert len(keys) > 3
    answers = await asyncio.gather(*(unplugged.call("PATCH", "/api/settings", json={key: True}) for key in keys))
    assert {status for status, _ in answers} == {200}
    kept = await changeable(unplugged)
    assert all(kept[key] is True for key in keys)
    saved = json.loads(unplugged.extension.store.file.read_text())
    assert set(saved["settings"]) == set(keys)


async def changeable(running):
    listing = await running.get("/api/settings")
    return {entry["key"]: entry["value"] for entry in listing["settings"] if not entry["fixed_by"]}


async def test_settings_can_be_backed_up_and_restored(unplugged):
    await unplugged.call("PATCH", "/api/settings", json={"display.theme": "dark"})
    backup = await unplugged.get("/api/settings/backup")
    await unplugged.call("PATCH", "/api/settings", json={"display.theme": "light"})
    status, _ = await unplugged.call("POST", "/api/settings/restore", json=backup)
    assert status == 200
    assert unplugged.extension.store.settings.display.theme == "dark"
    status, answer = await unplugged.call("POST", "/api/settings/restore", json={"version": 9})
    assert (status, "not known here" in answer["error"]) == (400, True)


async def test_a_foreign_page_cannot_change_anything(unplugged):
    foreign = {"Origin": "http://evil.example"}
    for method, path in (
        ("PATCH", "/api/settings"),
        ("POST", "/api/settings/restore"),
        ("POST", "/api/esp32"),
        ("POST", "/api/recording"),
        ("DELETE", "/api/recordings/session_20260101_000000"),
    ):
        status, answer = await unplugged.call(method, path, json={}, headers=foreign)
        assert (status, "evil.example" in answer["error"]) == (403, True), path
        status, _ = await unplugged.call(method, path, json={}, headers={})
        assert status == 403, path


async def test_the_esp32_obeys_and_acknowledges(diving):
    status, answer = await diving.configure_esp32(sensors_rate_hz=10, decimation=2)
    assert (status, answer) == (200, {"result": "ok", "message": "done"})
    first = (await diving.get("/api/state"))["link"]["frames_by_type"]["0x01"]
    async with asyncio.timeout(PATIENCE_S):
        await diving.until("/api/state", lambda s: s["link"]["frames_by_type"]["0x01"] >= first + 10)


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ({}, "nothing to set"),
        ({"baud": 9600}, "baud: unknown"),
        ({"decimation": 9}, "decimation = 9: expected a whole number from 1 to 8"),
        ({"decimation": 1.5}, "decimation = 1.5: expected a whole number"),
        ({"sensors_rate_hz": "fast"}, "sensors_rate_hz = 'fast': expected a number from 0.5 to 20"),
        ({"imu_rate_hz": True}, "imu_rate_hz = True"),
    ],
)
async def test_nonsense_for_the_esp32_names_key_and_range(unplugged, body, text):
    status, answer = await unplugged.call("POST", "/api/esp32", json=body)
    assert status == 400
    assert text in answer["error"]


async def test_without_a_link_a_command_fails_at_once_and_says_why(unplugged):
    status, answer = await unplugged.call("POST", "/api/esp32", json={"decimation": 4})
    assert status == 409
    assert answer["error"].startswith("no_link: there is no link to the ESP32")


async def test_recording_begins_with_the_first_valid_frame_and_stops_on_request(diving):
    recordings = await diving.until("/api/recordings", lambda r: r["active"] is not None)
    assert recordings["active"].startswith("session_")
    status, answer = await diving.call("POST", "/api/recording", json={"action": "stop"})
    assert (status, answer["name"]) == (200, None)
    assert (await diving.get("/api/recordings"))["active"] is None


async def test_stopping_closes_the_recording_and_the_port(tmp_path):
    async with running_simulator(tmp_path / "dev"):
        extension = Extension(open_store(tmp_path / "state"), serial_port(tmp_path / "dev"))
        await extension.start()
        async with asyncio.timeout(PATIENCE_S):
            while extension.recorder.active_name is None:
                await asyncio.sleep(0.02)
        folder = tmp_path / "state" / "recordings" / extension.recorder.active_name
        async with asyncio.timeout(PATIENCE_S):
            await extension.stop()
        lines = (folder / f"{folder.name}.jsonl").read_text().splitlines()
        assert all(json.loads(line) for line in lines)
        assert not extension.link.source.send(b"x")


async def test_clients_that_do_not_answer_do_not_hold_up_the_end(tmp_path, monkeypatch):
    monkeypatch.setattr("bluerov_slam.services.http.BODY_TIMEOUT_S", 1000.0)
    extension = Extension(open_store(tmp_path / "state"), serial_port(tmp_path / "dev"))
    await extension.start()
    upgrade = (
        b"GET /ws HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
    )
    half = b"POST /api/esp32 HTTP/1.1\r\nHost: x\r\nOrigin: http://127.0.0.1\r\nContent-Length: 100\r\n\r\n{"
    writers = []
    for request in (upgrade, half):
        _, writer = await asyncio.open_connection("127.0.0.1", extension.http.port)
        writer.write(request)
        await writer.drain()
        writers.append(writer)
    async with asyncio.timeout(PATIENCE_S):
        while extension.topics.clients < 1:
            await asyncio.sleep(0.01)
    async with asyncio.timeout(STOP_PATIENCE_S):
        await extension.stop()
    for writer in writers:
        writer.close()


async def test_settings_notices_become_events(tmp_path):
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "settings.json").write_text("{broken")
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
        events = await running.get("/api/events")
        assert any("kept as settings.json.damaged" in e["text"] and e["level"] == "warning" for e in events)


async def test_options_of_the_page_are_relative_and_without_foreign_hosts(unplugged):
    async with unplugged.client.get("/register_service") as response:
        registration = await response.json()
    assert registration["name"] == "BlueROV SLAM"
    extras = await unplugged.get(registration["extras"]["cockpit"])
    assert (extras["targetSystem"], extras["targetCockpitApiVersion"]) == ("Cockpit", "1.0.0")
    for widget in extras["widgets"]:
        assert widget["iframeUrl"].startswith("/")
        assert widget["useExtensionPathAsBaseUrl"] is True
