"""The named reference: frames cut from the same terminal and sent on as they are, nothing decoded, nothing kept.

`python -m bench.bare_relay TERMINAL PORT` serves `/ws`. What it costs is the floor that this machine's scheduler,
terminal, event loop and WebSockets set at this moment; our services are judged beside it.
"""

from __future__ import annotations

import asyncio
import os
import sys
import tty

from aiohttp import WSMsgType, web

from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder

SENSORS = 0x01


async def main(terminal: str, port: int) -> None:
    decoder = Esp32FrameDecoder()
    clients: list[web.WebSocketResponse] = []
    pending: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue()

    async def handle(request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(compress=False)
        await socket.prepare(request)
        clients.append(socket)
        async for message in socket:
            if message.type is WSMsgType.ERROR:
                break
        clients.remove(socket)
        return socket

    descriptor = os.open(terminal, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(descriptor)

    def readable() -> None:
        for frame in decoder.feed(os.read(descriptor, 65536)):
            pending.put_nowait(frame)

    asyncio.get_running_loop().add_reader(descriptor, readable)
    app = web.Application()
    app.router.add_get("/ws", handle)
    runner = web.AppRunner(app)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", port).start()
    while True:
        frame_type, payload = await pending.get()
        for socket in tuple(clients):
            if frame_type == SENSORS:
                device_ms = int.from_bytes(payload[:4], "little")
                await socket.send_str(f'{{"topic":"sensors","data":{{"ts":{device_ms}}}}}')
            else:
                await socket.send_bytes(payload)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
