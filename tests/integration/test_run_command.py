import asyncio
import contextlib
import os
import signal
import sys

import aiohttp
import psutil

from free_ports import free_port
from patience import PATIENCE_S


async def test_run_simulate_brings_both_pages_up_restarts_what_crashes_and_stops_it_all(tmp_path):
    ports = {
        key: free_port() for key in ("http.port", "http.sensor_ws_port", "viewer.port", "viewer.waterfall_ws_port")
    }
    flags = {
        **ports, "http.host": "127.0.0.1", "paths.state": tmp_path / "state", "recording.min_free_mb": 10,
        "viewer.udp_port_a": free_port(), "viewer.udp_port_b": free_port(),
    }  # fmt: skip
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "bluerov_slam", "run", "--simulate",
        *(part for key, value in flags.items() for part in ("--set", f"{key}={value}")),
        stdout=asyncio.subprocess.PIPE, stderr=(tmp_path / "log").open("wb"), start_new_session=True,
    )  # fmt: skip
    try:
        async with asyncio.timeout(PATIENCE_S):
            announced = b"".join([await process.stdout.readline() for _ in range(4)]).decode()
        assert f"http://localhost:{ports['http.port']}" in announced
        assert f"http://localhost:{ports['viewer.port']}" in announced
        assert "SIMULATED" in announced
        async with aiohttp.ClientSession() as client, asyncio.timeout(3 * PATIENCE_S):
            await until(client, ports["http.port"], lambda health: health["frames"] > 0)
            await until(client, ports["viewer.port"], lambda health: health["a_pings"] > 0 and health["b_pings"] > 0)
            children = psutil.Process(process.pid).children()
            assert {child.cmdline()[3] for child in children} == {"simulate", "viewer", "extension"}
            next(child for child in children if child.cmdline()[3] == "extension").kill()
            await until(client, ports["http.port"], lambda health: health["frames"] > 0)
            children = psutil.Process(process.pid).children()
        process.send_signal(signal.SIGTERM)
        async with asyncio.timeout(PATIENCE_S):
            assert await process.wait() == 0
        assert not [child for child in children if child.is_running()]
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        await process.wait()


async def until(client, port, condition):
    while True:
        try:
            async with client.get(f"http://127.0.0.1:{port}/health") as response:
                if condition(await response.json()):
                    return
        except aiohttp.ClientError:
            pass
        await asyncio.sleep(0.1)
