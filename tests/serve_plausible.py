"""Serves the dashboard on a virtual ESP32 with the plausible navigator: for work on the page.

`PYTHONPATH=tests .venv/bin/python tests/serve_plausible.py [PORT]`, then http://localhost:PORT (8099).
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
from pathlib import Path

from bluerov_slam.services.extension import Extension
from running_extension import open_store, running_simulator, serial_port


async def main(port: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        async with running_simulator(Path(folder)):
            store = open_store(Path(folder) / "state", http__port=port)
            device = serial_port(Path(folder))
            extension = Extension(store, device, simulated=True, navigator="plausible_navigator:PlausibleNavigator")
            await extension.start()
            try:
                await asyncio.Event().wait()
            finally:
                await extension.stop()


asyncio.run(main(int(sys.argv[1]) if len(sys.argv) > 1 else 8099))
