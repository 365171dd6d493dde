"""Plays a vehicle's telemetry log over UDP, standing where the vehicle's MAVLink router has its endpoint.

Like a router's UDP server endpoint it binds an address, sends to whoever has spoken to it lately, and is silent until
somebody does.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence

from bluerov_slam.errors import LinkError
from bluerov_slam.sources.vehicle_log import LoggedFrame

FORGET_PEER_S = 60.0
LONGEST_GAP_S = 2.0
_LOOK_FOR_PEER_S = 0.1


class VehicleLogPlayer(asyncio.DatagramProtocol):
    """One log in a loop, at its own pace (times `speed`); pauses in the log are cut to `LONGEST_GAP_S`."""

    def __init__(
        self,
        frames: Sequence[LoggedFrame],
        address: tuple[str, int],
        speed: float = 1.0,
        on_event: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self.frames_sent = 0
        self.datagrams_received = 0
        self.address = address
        self._frames = frames
        self._speed = speed
        self._on_event = on_event
        self._peers: dict[tuple[str, int], float] = {}
        self._transport: asyncio.DatagramTransport | None = None

    async def run(self) -> None:
        """Play until cancelled."""
        loop = asyncio.get_running_loop()
        try:
            transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=self.address)
        except OSError as error:
            host, port = self.address
            raise LinkError(
                f"cannot play the log at {host}:{port}: {error.strerror}; stop what uses that port or choose another"
            ) from error
        self._transport = transport
        self.address = transport.get_extra_info("sockname")[:2]
        self._on_event(f"plays {len(self._frames)} MAVLink frames to whoever speaks to {self.address}")
        try:
            while True:
                await self._play_once()
                self._on_event("the vehicle log has ended and starts again")
        finally:
            transport.close()

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        if addr not in self._peers:
            self._on_event(f"{addr[0]}:{addr[1]} listens to the vehicle log")
        self._peers[addr] = time.monotonic()
        self.datagrams_received += 1

    async def _play_once(self) -> None:
        due_s = time.monotonic()
        before_s = self._frames[0].time_unix_s
        for frame in self._frames:
            gap_s = min(max(frame.time_unix_s - before_s, 0.0), LONGEST_GAP_S)
            before_s = frame.time_unix_s
            due_s += gap_s / self._speed
            while not self._listeners():
                await asyncio.sleep(_LOOK_FOR_PEER_S)
                due_s = time.monotonic()
            wait_s = due_s - time.monotonic()
            if wait_s > 0.0:
                await asyncio.sleep(wait_s)
            self._send(frame.data)
        await asyncio.sleep(_LOOK_FOR_PEER_S)

    def _listeners(self) -> list[tuple[str, int]]:
        now_s = time.monotonic()
        for peer in [peer for peer, heard_s in self._peers.items() if now_s - heard_s > FORGET_PEER_S]:
            del self._peers[peer]
        return list(self._peers)

    def _send(self, data: bytes) -> None:
        for peer in self._listeners():
            if self._transport is not None:
                self._transport.sendto(data, peer)
        self.frames_sent += 1
