"""A UDP port as a source of whole datagrams, with the means to answer from the same socket."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
from collections.abc import Callable
from dataclasses import dataclass

from bluerov_slam.errors import LinkError

logger = logging.getLogger(__name__)

Address = tuple[str, int]
# Bursts of both sonars must not overrun the kernel's buffer while the event loop is busy; half a second at 921600.
RECEIVE_BUFFER_BYTES = 512 * 1024
# Nobody has reason to send more in one datagram; our own forwarder stays below 1400 bytes.
MAXIMUM_DATAGRAM_BYTES = 2048


@dataclass(slots=True)
class UdpCounters:
    """What passed this socket since it was opened."""

    datagrams: int = 0
    bytes_received: int = 0
    oversized: int = 0
    sent: int = 0
    send_errors: int = 0


class UdpSource(asyncio.DatagramProtocol):
    """Hands each datagram to `on_datagram(data, address)`; oversized ones are counted and ignored."""

    def __init__(self, bound: socket.socket, on_datagram: Callable[[bytes, Address], None]) -> None:
        self.counters = UdpCounters()
        self.port: int = bound.getsockname()[1]
        self._socket = bound
        self._on_datagram = on_datagram
        self._transport: asyncio.BaseTransport | None = None

    def send(self, data: bytes, address: Address) -> None:
        """Send from this port now or never; a peer that cannot be reached is counted, never an exception.

        Past asyncio on purpose: its transport would queue without bound for a peer that takes nothing.
        """
        try:
            self._socket.sendto(data, address)
        except OSError:
            self.counters.send_errors += 1
        else:
            self.counters.sent += 1

    def close(self) -> None:
        """Release the port."""
        if self._transport is not None:
            self._transport.close()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def datagram_received(self, data: bytes, addr: Address) -> None:
        self.counters.datagrams += 1
        self.counters.bytes_received += len(data)
        if len(data) > MAXIMUM_DATAGRAM_BYTES:
            self.counters.oversized += 1
            return
        self._on_datagram(data, (addr[0], addr[1]))

    def error_received(self, exc: Exception) -> None:
        self.counters.send_errors += 1


async def open_udp_source(
    host: str, port: int, on_datagram: Callable[[bytes, Address], None], setting: str = ""
) -> UdpSource:
    """Bind a UDP port. Raises LinkError naming port and setting when another program holds it."""
    loop = asyncio.get_running_loop()
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        name = f"{port} ({setting})" if setting else str(port)
        if error.errno == errno.EADDRINUSE:
            raise LinkError(
                f"UDP port {name} is in use: another viewer or KoggerApp runs here; stop it, or choose another port"
            ) from error
        raise LinkError(f"UDP port {name} on {host} cannot be opened: {error.strerror}") from error
    _, source = await loop.create_datagram_endpoint(lambda: UdpSource(bound, on_datagram), sock=bound)
    return source
