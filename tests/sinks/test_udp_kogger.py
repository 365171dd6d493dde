import asyncio
import socket

import pytest

from bluerov_slam.protocol.checksums import kogger_mod255
from bluerov_slam.protocol.kogger_frame import KoggerFrameDecoder, KoggerId, build_frame
from bluerov_slam.protocol.ping_stamp import PingStamp, unpack_ping_stamp
from bluerov_slam.records import Channel, SonarFrames
from bluerov_slam.sinks.udp_kogger import DATAGRAM_BYTES, UdpKogger
from free_ports import free_port
from patience import PATIENCE_S

ROUTES = {Channel.A: 1, Channel.B: 2}


def chart(seq_offset, samples=200, version=0):
    header = b"".join(value.to_bytes(2, "little") for value in (seq_offset, 20, 0))
    return build_frame(KoggerId.CHART, header + bytes(range(256))[:samples], version=version)


def frames(channel, *raw, last=None):
    return SonarFrames(channel, 1.0, 1.0, raw, last)


class Peer:
    """A UDP socket that collects what arrives."""

    def __init__(self, address="127.0.0.1", port=None):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((address, free_port() if port is None else port))
        self.socket.setblocking(False)
        self.port = self.socket.getsockname()[1]

    async def datagram(self):
        async with asyncio.timeout(PATIENCE_S):
            return await asyncio.get_running_loop().sock_recv(self.socket, 65536)

    def is_empty(self):
        try:
            return not self.socket.recv(65536)
        except BlockingIOError:
            return True


@pytest.fixture
def peers():
    peers = {Channel.A: Peer(), Channel.B: Peer()}
    yield peers
    for peer in peers.values():
        peer.socket.close()


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
async def sink(peers):
    resolved = asyncio.Event()
    sink = UdpKogger({c: p.port for c, p in peers.items()}, on_addresses=lambda _a: resolved.set(), clock=Clock())
    sink.resolved = resolved
    yield sink
    await sink.stop()


async def aim(sink, *targets, seed=()):
    sink.resolved.clear()
    sink.configure(targets, ROUTES, seed)
    async with asyncio.timeout(PATIENCE_S):
        await sink.resolved.wait()


def parsed(datagram, checksum="mod256"):
    return KoggerFrameDecoder(checksum).feed(datagram)


async def test_each_sonar_goes_to_its_port_with_its_own_route(sink, peers):
    await aim(sink, "127.0.0.1")
    for channel in Channel:
        sink.take(frames(channel, chart(0)))
    for channel, route in ROUTES.items():
        [frame] = parsed(await peers[channel].datagram())
        assert (frame.route, frame.frame_id, frame.payload[6:]) == (route, KoggerId.CHART, bytes(range(200)))
    assert sink.addresses == ("127.0.0.1",)


async def test_a_ping_of_two_bundles_is_one_datagram(sink, peers):
    await aim(sink, "127.0.0.1")
    sink.take(frames(Channel.A, chart(0), chart(200), chart(400), last=False))
    sink.take(frames(Channel.A, chart(600), chart(800), last=True))
    assert len(parsed(await peers[Channel.A].datagram())) == 5
    assert peers[Channel.A].is_empty()


async def test_a_long_ping_is_cut_between_frames_below_the_limit(sink, peers):
    await aim(sink, "127.0.0.1")
    sink.take(frames(Channel.A, *(chart(200 * n) for n in range(10)), last=True))
    first, second = await peers[Channel.A].datagram(), await peers[Channel.A].datagram()
    assert max(len(first), len(second)) <= DATAGRAM_BYTES
    assert [f.payload[0] + 256 * f.payload[1] for f in parsed(first) + parsed(second)] == [200 * n for n in range(10)]


async def test_a_new_ping_pushes_out_an_unfinished_one(sink, peers):
    await aim(sink, "127.0.0.1")
    sink.take(frames(Channel.A, chart(0), last=False))
    sink.take(frames(Channel.A, chart(0), chart(200), last=True))
    assert len(parsed(await peers[Channel.A].datagram())) == 1
    assert len(parsed(await peers[Channel.A].datagram())) == 2


async def test_an_unfinished_ping_does_not_wait_for_ever(sink, peers):
    await aim(sink, "127.0.0.1")
    sink.take(frames(Channel.B, chart(0), last=False))
    assert len(parsed(await peers[Channel.B].datagram())) == 1


async def test_raw_frames_go_at_once(sink, peers):
    await aim(sink, "127.0.0.1")
    sink.take(frames(Channel.A, build_frame(KoggerId.TEMPERATURE, b"\x01\x02")))
    [frame] = parsed(await peers[Channel.A].datagram())
    assert frame.frame_id == KoggerId.TEMPERATURE


@pytest.mark.parametrize("seq_offset", [19_800, 20_001, 65_000, 65_535])
async def test_a_chunk_that_would_crash_kogger_app_is_dropped_and_counted(sink, peers, seq_offset):
    await aim(sink, "127.0.0.1")
    sink.take(frames(Channel.A, chart(seq_offset), chart(19_799)))
    [frame] = parsed(await peers[Channel.A].datagram())
    assert int.from_bytes(frame.payload[:2], "little") == 19_799
    assert sink.refused_chunks == 1


async def test_a_target_set_to_the_seeds_checksum_gets_it_and_the_others_do_not(sink, peers):
    other = {channel: Peer("127.0.0.2", peer.port) for channel, peer in peers.items()}
    await aim(sink, "127.0.0.1", seed=["127.0.0.2"])
    sink.take(frames(Channel.A, chart(0), chart(200)))
    assert len(parsed(await peers[Channel.A].datagram())) == 2
    datagram = await other[Channel.A].datagram()
    assert parsed(datagram) == []
    assert len(parsed(datagram, "mod255")) == 2
    assert datagram[206 + 6 : 206 + 8] == kogger_mod255(datagram[2 : 206 + 6])
    for peer in other.values():
        peer.socket.close()


async def test_an_unreachable_target_is_counted_shown_and_hurts_nobody(sink, peers):
    await aim(sink, "127.0.0.1", "255.255.255.255")  # the kernel refuses it before anything leaves
    for _ in range(10):
        sink.take(frames(Channel.A, chart(0)))
        assert len(parsed(await peers[Channel.A].datagram())) == 1
    by_target = {c.target: c for c in sink.counters if c.channel is Channel.A}
    assert (by_target["127.0.0.1"].frames, by_target["127.0.0.1"].errors) == (10, 0)
    broken = by_target["255.255.255.255"]
    assert broken.errors >= 10
    assert broken.frames == 0
    assert broken.last_error


async def test_a_name_without_address_is_named_and_the_others_are_served(sink, peers, monkeypatch):
    async def no_address(*_args, **_options):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    loop = asyncio.get_running_loop()
    real = loop.getaddrinfo
    monkeypatch.setattr(
        loop, "getaddrinfo", lambda host, *a, **o: no_address() if host == "boat" else real(host, *a, **o)
    )
    await aim(sink, "boat", "127.0.0.1")
    sink.take(frames(Channel.A, chart(0)))
    assert len(parsed(await peers[Channel.A].datagram())) == 1
    boat = next(c for c in sink.counters if c.target == "boat")
    assert boat.last_error == "boat has no address: Name or service not known"
    assert sink.addresses == ("127.0.0.1",)


async def test_a_closed_port_is_counted_and_served_again_once_it_opens(sink, peers):
    await aim(sink, "127.0.0.1")
    port = peers[Channel.A].port
    peers[Channel.A].socket.close()
    for _ in range(4):
        sink.take(frames(Channel.A, chart(0)))
    counters = next(c for c in sink.counters if c.channel is Channel.A)
    assert counters.errors > 0
    assert counters.last_error == "Connection refused"
    peers[Channel.A] = Peer(port=port)
    sink.take(frames(Channel.A, chart(0)))
    assert len(parsed(await peers[Channel.A].datagram())) == 1


async def test_targets_can_change_at_any_time(sink, peers):
    await aim(sink, "127.0.0.1")
    await aim(sink)
    sink.take(frames(Channel.A, chart(0)))
    assert sink.counters == ()
    await aim(sink, "127.0.0.1")
    sink.take(frames(Channel.A, chart(200)))
    [frame] = parsed(await peers[Channel.A].datagram())
    assert frame.payload[0] == 200


async def test_this_computers_viewer_learns_when_a_ping_was_measured_while_it_is_connected(peers):
    wanted, resolved = [True], asyncio.Event()
    sink = UdpKogger(
        {channel: peer.port for channel, peer in peers.items()},
        on_addresses=lambda addresses: resolved.set() if addresses else None,
        stamps_wanted=lambda: wanted[0],
        unix_s=lambda monotonic_s: 1.8e9 + monotonic_s,
    )
    sink.configure(["127.0.0.1"], ROUTES)
    async with asyncio.timeout(PATIENCE_S):
        await resolved.wait()
    sink.take(SonarFrames(Channel.B, 7.0, 7.1, (chart(0),), False))
    sink.take(SonarFrames(Channel.B, 7.0, 7.2, (chart(200),), True))
    stamp, *charts = KoggerFrameDecoder("mod256").feed(await peers[Channel.B].datagram())
    assert unpack_ping_stamp(stamp) == PingStamp(7.0, 1.8e9 + 7.0, last_of_ping=True)
    assert [frame.route for frame in (stamp, *charts)] == [2, 2, 2]
    wanted[0] = False
    sink.take(SonarFrames(Channel.B, 7.5, 7.5, (chart(0),), True))
    (only,) = KoggerFrameDecoder("mod256").feed(await peers[Channel.B].datagram())
    assert only.frame_id == KoggerId.CHART
    await sink.stop()
