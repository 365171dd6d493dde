"""Acoustics through the real extension: UDP socket, worker process, WebSocket, recording and replay."""

import asyncio
import itertools
import json
import math
from pathlib import Path

import aiohttp
import pytest

from acoustic_board import AcousticBoard, pinging, sender
from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.message.report import BeaconReport
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import AcousticFix
from bluerov_slam.services.extension import Extension
from bluerov_slam.simulation.acoustic_paths import Medium
from bluerov_slam.simulation.acoustic_record import AcousticSetup, simulate_record
from bluerov_slam.sinks.mcap_log import encode_record
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.sources.replay import ReplaySource, decoder_for
from free_ports import free_port
from patience import PATIENCE_S
from running_extension import open_store, running_extension, running_simulator, serial_port

SOURCE = (20.0, 5.0, 8.0)
AZIMUTH_DEG, ELEVATION_DEG = math.degrees(math.atan2(5.0, 20.0)), math.degrees(math.atan2(8.0, math.hypot(20, 5)))


def settings(**changes):
    chosen = {
        "acoustics__enabled": True,
        "acoustics__udp_port": free_port(),
        "acoustics__beacon": "54.3219, 10.1356",
        "acoustics__sound_speed_source": "fixed",
        "recording__enabled": False,
    }
    return chosen | changes


@pytest.fixture
async def quiet(tmp_path):
    """An extension whose array has not heard anything; no serial link."""
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev"), **settings()) as running:
        yield running


async def test_a_pulse_by_udp_becomes_a_direction(quiet):
    board = AcousticBoard()
    pulses = (board.pulse(SOURCE) for _ in itertools.count())
    async with pinging(quiet.extension.acoustics.input.port, pulses):
        answer = await quiet.until("/api/acoustics", lambda answer: answer["direction"] is not None)
    assert answer["enabled"] is True
    assert answer["direction"]["azimuth_deg"] == pytest.approx(AZIMUTH_DEG, abs=0.5)
    assert answer["direction"]["elevation_deg"] == pytest.approx(ELEVATION_DEG, abs=0.5)
    assert 3.0 < answer["direction"]["std_deg"] < 3.1  # what one pulse is worth, and a little for its timing
    assert answer["slip"]["state"] == "sure"
    assert [receiver["state"] for receiver in answer["receivers"]] == ["used"] * 4
    assert [receiver["signal_counts"] for receiver in answer["receivers"]] == [300.0, 280.0, 310.0, 290.0]
    assert answer["raw_bits"] == "11110000000101"
    assert answer["range_m"] is None
    assert answer["fix"] is None
    assert answer["text"].startswith("Direction only: the attitude is not known yet")
    assert answer["beacon"]["source"] == "settings"
    assert answer["pings"] >= 1


async def test_the_topic_comes_with_every_pulse_and_before_the_first(quiet):
    board = AcousticBoard()
    async with quiet.client.ws_connect("/ws") as ws:
        await ws.send_str(json.dumps({"subscribe": ["acoustics"]}))
        first = await asyncio.wait_for(next_of(ws, "acoustics"), PATIENCE_S)
        assert first["state"] == "waiting"
        assert first["direction"] is None
        assert first["receivers"][2] == {
            "index": 2, "signal_counts": None, "snr_db": None, "state": None, "reason": "",
        }  # fmt: skip
        async with pinging(quiet.extension.acoustics.input.port, (board.pulse(SOURCE) for _ in itertools.count())):
            while first["direction"] is None:
                first = await asyncio.wait_for(next_of(ws, "acoustics"), PATIENCE_S)
    assert 0.0 <= first["age_s"] < PATIENCE_S


async def next_of(ws, topic):
    while True:
        message = await ws.receive()
        assert message.type is aiohttp.WSMsgType.TEXT
        content = json.loads(message.data)
        if content["topic"] == topic:
            return content["data"]


async def test_a_silent_receiver_is_named_with_its_cure(quiet):
    board = AcousticBoard()
    pulses = (board.pulse(SOURCE, std=(300.0, 280.0, 2.0, 290.0)) for _ in itertools.count())
    async with pinging(quiet.extension.acoustics.input.port, pulses):
        answer = await quiet.until("/api/acoustics", lambda answer: answer["pings"] >= 3)
        async with asyncio.timeout(PATIENCE_S):
            while (chip := quiet.extension.status.chips()[-1])["state"] != "warn":
                await asyncio.sleep(0.05)
    assert (chip["id"], chip["text"], chip["cure"]) == ("acoustics", "Receiver 2: silent", "Check its cable.")
    assert dict(chip["parts"])["Pulses"].endswith(" heard, 0 refused")
    assert any(fault.id == "acoustics_receiver" for fault in quiet.extension.status.health.faults)
    assert answer["state"] == "warn"
    assert answer["text"] == "Receiver 2: silent"
    assert answer["cure"] == "Check its cable."
    assert answer["receivers"][2]["state"] == "silent"
    assert answer["direction"]["azimuth_deg"] == pytest.approx(AZIMUTH_DEG, abs=2.0)


async def test_the_transmitter_tells_its_place(quiet):
    board = AcousticBoard()
    report = BeaconReport(54.4, 10.2, 2.0, None, 3.5)
    frames = itertools.cycle((board.message(report.pack(), 3), board.pulse(SOURCE)))
    async with pinging(quiet.extension.acoustics.input.port, frames):
        answer = await quiet.until(
            "/api/acoustics", lambda answer: answer["message"] and (answer["beacon"] or {}).get("source") == "message"
        )
    assert answer["beacon"]["latitude_deg"] == pytest.approx(54.4)
    assert answer["beacon"]["depth_m"] == 3.5
    assert answer["message"]["corrected_errors"] == 3
    assert answer["message"]["latitude_deg"] == pytest.approx(54.4)
    assert answer["message"]["text"] == "Position report"


async def test_what_is_no_acoustic_frame_does_not_pass(quiet):
    board = AcousticBoard()
    sensors = encode_frame(MessageType.GPS, bytes(32))
    with sender(quiet.extension.acoustics.input.port) as udp:
        for _ in range(3):
            udp.send(sensors)
            udp.send(b"\xaa\x55 nonsense \xff" * 20)
            udp.send(bytes(3000))
            udp.send(encode_frame(MessageType.ACOUSTIC_TDOA, bytes(16)))
    await quiet.until("/api/acoustics", lambda answer: answer["sources"])
    counters = quiet.extension.acoustics.input.counters
    async with asyncio.timeout(PATIENCE_S):
        while counters()["acoustics_malformed"] < 3:
            await asyncio.sleep(0.02)
    assert counters()["acoustics_refused"] == 3
    assert counters()["acoustics_oversized"] == 3
    assert quiet.extension.link.counters.link.frames_ok == 0
    async with pinging(quiet.extension.acoustics.input.port, (board.pulse(SOURCE) for _ in itertools.count())):
        await quiet.until("/api/acoustics", lambda answer: answer["direction"] is not None)


async def test_the_newest_record_is_given_out_and_judged(quiet):
    status, answer = await quiet.call("GET", "/api/acoustics/record")
    assert status == 404
    assert "921600" in answer["error"]
    setup = AcousticSetup(ReceiverArray.cross(), medium=Medium(1500.0), snr_db=25.0)
    simulated = simulate_record(setup, SOURCE, 3)
    frames = AcousticBoard().record(simulated.samples, simulated.sample_rate_hz, 7)
    with sender(quiet.extension.acoustics.input.port) as udp:
        for frame in frames:
            udp.send(frame)
            await asyncio.sleep(0)
    answer = await quiet.until("/api/acoustics", lambda answer: answer["record_id"] == 7)
    assert answer["direction"]["azimuth_deg"] == pytest.approx(AZIMUTH_DEG, abs=1.0)
    assert all(receiver["snr_db"] > 10.0 for receiver in answer["receivers"])
    record = await quiet.get("/api/acoustics/record")
    assert record["samples"] == simulated.samples.tolist()
    assert (record["record_id"], record["bits"], record["missing_samples"]) == (7, 12, 0)


async def test_without_an_array_there_is_one_quiet_line(tmp_path):
    chosen = settings()
    del chosen["acoustics__enabled"]  # what a flag says no page can change
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev"), **chosen) as running:
        answer = await running.get("/api/acoustics")
        assert (answer["enabled"], answer["state"], answer["text"]) == (False, "off", "No acoustic array is fitted")
        assert running.extension.acoustics.input.port is None
        # Switched on while it runs, the port opens and pulses are judged.
        status, _ = await running.call("PATCH", "/api/settings", json={"acoustics.enabled": True})
        assert status == 200
        board = AcousticBoard()
        async with pinging(running.extension.acoustics.input.port, (board.pulse(SOURCE) for _ in itertools.count())):
            await running.until("/api/acoustics", lambda answer: answer["direction"] is not None)
        status, answer = await running.call("PATCH", "/api/settings", json={"acoustics.enabled": False})
        assert (await running.get("/api/acoustics"))["enabled"] is False


async def test_a_dive_with_pulses_replays_to_the_same_fixes_byte_for_byte(tmp_path):
    board = AcousticBoard()
    chosen = settings(recording__enabled=True, acoustics__beacon="47.6, -2.75", acoustics__beacon_depth_m=15.0)
    async with (
        running_simulator(tmp_path / "dev", mission_start_s=60.0),
        running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev"), **chosen) as running,
    ):
        await running.until("/api/navigation", lambda answer: answer["attitude"]["heading_deg"] is not None)
        pulses = (board.pulse(SOURCE) + (board.message(b"hello") if k % 3 == 0 else b"") for k in itertools.count())
        async with pinging(running.extension.acoustics.input.port, pulses, 0.1):
            answer = await running.until(
                "/api/acoustics", lambda answer: answer["fix"] is not None and answer["pings"] > 10
            )
        assert answer["fix"]["ellipse"]["major_m"] > 0.0
        assert answer["message"]["text"] == "hello"
    [folder] = (tmp_path / "state" / "recordings").glob("session_*")
    recording = open_recording(folder)
    recorded = [message.data for message in recording.messages(("/acoustics/fix",))]
    assert len(recorded) > 10
    lines = [json.loads(line) for line in next(folder.glob("*.jsonl")).read_text().splitlines()]
    assert sum(line.get("type") == "acoustics" for line in lines) == len(recorded)
    again = await replayed(recording, tmp_path / "other", chosen)
    # Pulses of the last moment before the stop are recorded raw; their fixes come out of the replay only.
    assert again[: len(recorded)] == recorded


async def replayed(recording, state: Path, chosen) -> list[bytes]:
    """The fixes that the same services make of the recording."""
    source = ReplaySource(recording, None)
    extension = Extension(open_store(state, **chosen), source, decoder=decoder_for(recording))
    fixes: list[AcousticFix] = []
    extension.hub.subscribe(fixes.append, AcousticFix)
    count = sum(1 for _ in recording.messages(("/acoustics/fix",)))
    await extension.start()
    try:
        async with asyncio.timeout(PATIENCE_S):
            await source.finished.wait()
            while len(fixes) < count:
                await asyncio.sleep(0.02)
    finally:
        await extension.stop()
    return [encode_record(fix) for fix in fixes]
