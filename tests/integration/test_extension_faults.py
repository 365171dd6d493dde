import asyncio
import fcntl
import json
import os
import re
import signal
import sys
import time

import aiohttp
import pytest

from bluerov_slam.errors import ExpectedError
from bluerov_slam.services.extension import Extension
from bluerov_slam.simulation.faults import parse_fault
from free_ports import free_port
from patience import PATIENCE_S
from running_extension import (
    ORIGIN,
    open_store,
    running_extension,
    running_simulator,
    serial_port,
)


def chip(state, name):
    return next(entry for entry in state["chips"] if entry["id"] == name)


async def test_a_container_without_dev_is_named_with_its_cure(tmp_path):
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
        state = await running.until("/api/state", lambda s: chip(s, "link")["text"] == "Container sees no devices")
        assert "/dev:/dev" in chip(state, "link")["cure"]


async def test_port_absent_at_start_is_named_with_its_cure_and_found_when_it_appears(tmp_path):
    (tmp_path / "dev" / "serial").mkdir(parents=True)
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
        state = await running.until("/api/state", lambda s: chip(s, "link")["state"] == "fault")
        assert chip(state, "link")["text"] == "ESP32 not found"
        assert "USB" in chip(state, "link")["cure"]
        assert (await running.get("/health"))["status"] == "healthy"
        async with running_simulator(tmp_path / "dev"):
            await running.until("/health", lambda health: health["serial"] and health["frames"] > 0)


async def test_port_busy_is_named_and_taken_as_soon_as_it_is_free(tmp_path):
    async with running_simulator(tmp_path / "dev"):
        holder = os.open(tmp_path / "dev" / "ttyUSB0", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        fcntl.flock(holder, fcntl.LOCK_EX)
        async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
            state = await running.until("/api/state", lambda s: "in use" in chip(s, "link")["text"])
            assert "Stop the other program" in chip(state, "link")["cure"]
            os.close(holder)
            await running.until("/health", lambda health: health["serial"] and health["frames"] > 0)


async def test_unplugged_and_replugged_under_a_new_name_it_goes_on_by_itself(tmp_path):
    async with (
        running_simulator(tmp_path / "dev") as simulator,
        running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running,
    ):
        before = await running.until("/api/status", lambda s: s["serial_connected"])
        simulator.inject(parse_fault("at=0 kind=unplug duration=1e6"))
        await running.until("/health", lambda health: not health["serial"])
        assert (await running.get("/health"))["status"] == "healthy"
        simulator.board.replug()
        after = await running.until("/api/status", lambda s: s["serial_connected"])
        assert after["port"] != before["port"]
        frames = (await running.get("/health"))["frames"]
        await running.until("/health", lambda health: health["frames"] > frames)
        assert (await running.get("/api/state"))["link"]["reconnects"] == 1
        assert any("no link: the port was lost" in text for text in running.events())


async def test_an_unreachable_udp_target_is_shown_and_the_others_get_their_data(tmp_path):
    async with (
        running_simulator(tmp_path / "dev"),
        running_extension(
            tmp_path / "state",
            port=serial_port(tmp_path / "dev"),
            forwarding__targets=["127.0.0.1", "255.255.255.255"],
        ) as running,
    ):
        state = await running.until("/api/state", lambda s: s["forwarding"] and s["forwarding"][1]["errors"] > 3)
        assert state["forwarding"][1]["last_error"]
        frames = state["link"]["frames"]
        await running.until("/api/state", lambda s: s["link"]["frames"] > frames)


async def test_a_target_nobody_listens_on_is_shown_as_refused(tmp_path):
    async with (
        running_simulator(tmp_path / "dev"),
        running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running,
    ):
        state = await running.until("/api/state", lambda s: s["forwarding"] and s["forwarding"][0]["errors"] > 0)
        assert state["forwarding"][0]["last_error"] == "Connection refused"


async def test_a_megabyte_or_nonsense_on_the_socket_hurts_only_its_sender(tmp_path):
    async with (
        running_simulator(tmp_path / "dev"),
        running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running,
        running.client.ws_connect("/ws") as good,
        running.client.ws_connect("/ws") as huge,
        running.client.ws_connect("/ws") as nonsense,
    ):
        await huge.send_str("x" * 1_000_000)
        await nonsense.send_str("{malformed")
        async with asyncio.timeout(PATIENCE_S):
            while (message := await huge.receive()).type != aiohttp.WSMsgType.CLOSE:
                pass
            assert message.data == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
            while "error" not in (answer := json.loads((await nonsense.receive()).data)):
                pass
            assert "not JSON" in answer["error"]
            for socket in (good, nonsense):
                while json.loads((await socket.receive()).data).get("topic") != "sensors":
                    pass


async def test_malformed_json_is_answered_with_the_reason(tmp_path):
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
        for method, path in (
            ("PATCH", "/api/settings"),
            ("POST", "/api/settings/restore"),
            ("POST", "/api/esp32"),
            ("POST", "/api/recording"),
        ):
            status, answer = await running.call(method, path, data=b"{malformed", headers=ORIGIN)
            assert (status, "not JSON" in answer["error"]) == (400, True), path


async def test_a_hundred_slow_loris_clients_do_not_hold_up_the_page(tmp_path):
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
        port = running.extension.http.port
        loris = [await asyncio.open_connection("127.0.0.1", port) for _ in range(100)]
        for _, writer in loris:
            writer.write(b"GET / HTTP/1.1\r\nHost: x\r\n")
        answers = [asyncio.create_task(reader.read(1)) for reader, _ in loris]
        assert (await running.get("/health"))["status"] == "healthy"
        assert not any(answer.done() for answer in answers), "the page came first: none of them had been cut off"
        for answer, (_, writer) in zip(answers, loris, strict=True):
            answer.cancel()
            writer.close()


async def test_the_wall_clock_stepped_by_an_hour_disturbs_neither_order_nor_ages(tmp_path):
    step_s = 0.0

    def wall_time():
        return time.time() + step_s

    async with (
        running_simulator(tmp_path / "dev", sensors_rate_mhz=10_000),
        running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev"), wall_time=wall_time) as running,
    ):
        arrived = []
        await running.until("/api/latest", lambda frame: frame["ts"] is not None)
        extension = running.extension
        extension.hub.subscribe(lambda sample: arrived.append(sample), type(extension.sensors.sample))
        before = (await running.get("/api/ctd"))["timestamp"]
        step_s = -3600.0
        state = await running.until("/api/state", lambda s: s["clock"]["steps"])
        assert state["clock"]["steps"][0]["by_s"] == pytest.approx(-3600.0, abs=10.0)
        assert any(re.search(r"the wall clock was set by -3[56]\d\d\.\d s", text) for text in running.events())
        assert chip(state, "link")["age_s"] < 60.0
        assert chip(state, "depth")["age_s"] < 60.0
        count = len(arrived)
        await running.until("/api/state", lambda _state: len(arrived) > count + 5)
        measured = [sample.measured_s for sample in arrived]
        assert measured == sorted(measured)
        assert all(abs(sample.arrived_s - sample.measured_s) < 60.0 for sample in arrived)
        assert (await running.get("/api/ctd"))["timestamp"] < before


async def test_a_second_extension_on_the_same_port_says_so_and_harms_nothing(tmp_path):
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
        token = (tmp_path / "state" / "viewer-link.token").read_text()
        second = Extension(
            open_store(tmp_path / "state", http__port=running.extension.http.port), serial_port(tmp_path / "dev")
        )
        with pytest.raises(
            ExpectedError, match=r"http.port\): Address already in use; is another BlueROV SLAM running"
        ):
            await second.start()
        assert (tmp_path / "state" / "viewer-link.token").read_text() == token
        assert (await running.get("/health"))["status"] == "healthy"


@pytest.fixture
async def command():
    """Starts `bluerov-slam` with these words; what has not ended by itself ends with the test."""
    started = []

    async def start(*arguments):
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "bluerov_slam", *arguments,
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        started.append(process)
        return process

    yield start
    for process in started:
        if process.returncode is None:
            process.kill()
            await process.communicate()


def extension_arguments(tmp_path, *more):
    flags = {
        "paths.state": tmp_path / "state", "http.host": "127.0.0.1", "http.port": 0, "http.sensor_ws_port": 0,
        "viewer.udp_port_a": free_port(), "viewer.udp_port_b": free_port(),
        "serial.port": tmp_path / "dev" / "ttyUSB0", "recording.min_free_mb": 10,
    }  # fmt: skip
    return ["extension", *(part for key, value in flags.items() for part in ("--set", f"{key}={value}")), *more]


async def test_a_bad_config_ends_the_start_with_one_line_each_naming_file_key_and_range(tmp_path, command):
    config = tmp_path / "dive.toml"
    config.write_text(
        '[serial]\nbauds = 115200\n[recording]\nmax_file_mb = "10 MB"\n[sensors]\nsurface_pressure_pa = 1013.25\n'
    )
    process = await command("extension", "--config", str(config), "--set", f"paths.state={tmp_path}")
    async with asyncio.timeout(PATIENCE_S):
        _, errors = await process.communicate()
    assert process.returncode == 1
    unknown, unit, absurd = errors.decode().splitlines()
    assert unknown == f"bluerov-slam: {config}: serial.bauds: unknown setting; did you mean serial.baud?"
    assert unit.startswith(f'{config}: recording.max_file_mb = "10 MB": expected a whole number from 1 to 4096 in MB')
    assert absurd.startswith(
        f"{config}: sensors.surface_pressure_pa = 1013.25: expected a number from 50000 to 110000 in Pa"
    )


async def test_two_extensions_started_at_once_the_second_exits_with_one_clear_line(tmp_path, command):
    async with running_extension(tmp_path / "state", port=serial_port(tmp_path / "dev")) as running:
        process = await command(*extension_arguments(tmp_path), "--set", f"http.port={running.extension.http.port}")
        async with asyncio.timeout(PATIENCE_S):
            _, errors = await process.communicate()
        assert process.returncode == 1
        port = running.extension.http.port
        last = errors.decode().splitlines()[-1]
        assert last.startswith(f"bluerov-slam: cannot listen on 127.0.0.1:{port} (http.port): Address already in use")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_a_signal_ends_the_service_with_the_recording_closed(tmp_path, command, number):
    async with running_simulator(tmp_path / "dev"):
        process = await command(*extension_arguments(tmp_path))
        folder = tmp_path / "state" / "recordings"
        async with asyncio.timeout(PATIENCE_S):
            while not list(folder.glob("*/*.jsonl")) or not next(folder.glob("*/*.jsonl")).stat().st_size:
                await asyncio.sleep(0.05)
            process.send_signal(number)
        async with asyncio.timeout(PATIENCE_S):
            _, errors = await process.communicate()
        assert process.returncode == 0, errors.decode()
        assert "Traceback" not in errors.decode()
        [log] = folder.glob("*/*.jsonl")
        assert all(json.loads(line) for line in log.read_text().splitlines())
        assert next(folder.glob("*/link_000.mcap")).read_bytes().endswith(b"\x89MCAP0\r\n")
