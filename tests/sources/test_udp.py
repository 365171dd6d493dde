import asyncio
import socket

import pytest

from bluerov_slam.errors import LinkError
from bluerov_slam.sources.udp import MAXIMUM_DATAGRAM_BYTES, Address, UdpSource, open_udp_source
from patience import PATIENCE_S


async def listening() -> tuple[UdpSource, asyncio.Queue[tuple[bytes, Address]]]:
    heard: asyncio.Queue[tuple[bytes, Address]] = asyncio.Queue()
    return await open_udp_source("127.0.0.1", 0, lambda data, address: heard.put_nowait((data, address))), heard


async def test_hands_over_whole_datagrams_and_answers_from_the_same_port() -> None:
    source, heard = await listening()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(PATIENCE_S)
        peer.sendto(b"one", ("127.0.0.1", source.port))
        data, address = await asyncio.wait_for(heard.get(), PATIENCE_S)
        assert (data, address) == (b"one", peer.getsockname())
        source.send(b"two", address)
        assert peer.recvfrom(100) == (b"two", ("127.0.0.1", source.port))
    source.close()


async def test_an_oversized_datagram_is_counted_and_ignored() -> None:
    source, heard = await listening()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.sendto(bytes(MAXIMUM_DATAGRAM_BYTES + 1), ("127.0.0.1", source.port))
        peer.sendto(b"fine", ("127.0.0.1", source.port))
        data, _ = await asyncio.wait_for(heard.get(), PATIENCE_S)
    assert data == b"fine"
    assert source.counters.oversized == 1
    source.close()


async def test_an_unreachable_peer_is_counted() -> None:
    source, _ = await listening()
    source.send(b"x", ("127.0.0.1", 0))
    assert source.counters.send_errors == 1
    source.close()


async def test_a_port_in_use_is_named_with_its_cure() -> None:
    source, _ = await listening()
    with pytest.raises(LinkError, match=f"{source.port} is in use.*KoggerApp"):
        await open_udp_source("127.0.0.1", source.port, lambda data, address: None)
    source.close()
