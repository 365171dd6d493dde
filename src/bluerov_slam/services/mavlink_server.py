"""Stands where a vehicle's MAVLink router has its UDP endpoint: binds an address and answers whoever speaks to it.

Like the router's UDP server it is silent until somebody has spoken, and forgets who has not for a minute.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from bluerov_slam.errors import LinkError

FORGET_PEER_S = 60.0


class MavlinkServer(asyncio.DatagramProtocol):
    """One endpoint. `what` names in events and errors what is heard there."""

    def __init__(
        self, address: tuple[str, int], what: str, on_event: Callable[[str], None] = lambda _text: None
    ) -> None:
        self.address = address
        self.frames_sent = 0
        self.datagrams_received = 0
        self._what = what
        self._on_event = on_event
        self._peers: dict[tuple[str, int], float] = {}
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Bind. Raises LinkError when the port is taken."""
        loop = asyncio.get_running_loop()
        try:
            transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=self.address)
        except OSError as error:
            host, port = self.address
            raise LinkError(
                f"cannot play {self._what} at {host}:{port}: {error.strerror}; "
                "stop what uses that port or choose another"
            ) from error
        self._transport = transport
        self.address = transport.get_extra_info("sockname")[:2]

    def close(self) -> None:
        """Let the port go."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def listeners(self) -> list[tuple[str, int]]:
        """Who has spoken lately."""
        now_s = time.monotonic()
        for peer in [peer for peer, heard_s in self._peers.items() if now_s - heard_s > FORGET_PEER_S]:
            del self._peers[peer]
        return list(self._peers)

    def send(self, data: bytes) -> None:
        """To everybody who listens."""
        for peer in self.listeners():
            if self._transport is not None:
                self._transport.sendto(data, peer)
        self.frames_sent += 1

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        if addr not in self._peers:
            self._on_event(f"{addr[0]}:{addr[1]} listens to {self._what}")
        self._peers[addr] = time.monotonic()
        self.datagrams_received += 1
