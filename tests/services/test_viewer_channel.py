import numpy as np
import pytest

from bluerov_slam.protocol.kogger import ChartSetup, KoggerFrameDecoder, build_frame
from bluerov_slam.protocol.ping_stamp import PingStamp, pack_ping_stamp
from bluerov_slam.records import Channel, Ping
from bluerov_slam.services.kogger_gateway import KoggerGateway
from bluerov_slam.services.sonar_session import SonarSession
from bluerov_slam.services.viewer_channel import ViewerChannel
from bluerov_slam.services.viewer_link_client import CommandResult

EXTENSION = ("127.0.0.1", 50000)
STRANGER = ("192.0.2.7", 14555)
UNIX_OFFSET_S = 1.7e9


class NoLink:
    async def command(self, channel: Channel, frame: bytes) -> CommandResult:
        return CommandResult("no_link")


class Bench:
    def __init__(self) -> None:
        self.now_s = 100.0
        self.pings: list[Ping] = []
        session = SonarSession(Channel.A, NoLink(), lambda: self.now_s)
        gateway = KoggerGateway(Channel.A, session, lambda data, address: None, lambda: self.now_s)
        self.times_unix_s: list[float] = []
        self.channel = ViewerChannel(
            Channel.A, session, gateway, self.take, lambda: self.now_s, lambda: self.now_s + UNIX_OFFSET_S
        )
        self._count = 0

    def ping(self, size: int, first: int = 0) -> np.ndarray:
        """Send one ping, a chunk a datagram, 100 ms after the one before."""
        self.now_s += 0.1
        self._count += 1
        samples = np.random.default_rng(self._count).integers(1, 256, size, dtype=np.uint8)
        for start in range(first, size, 200):
            self.send(chunk(start, samples[start : start + 200]))
            self.now_s += 0.001
        return samples

    def take(self, ping: Ping, time_unix_s: float) -> None:
        self.pings.append(ping)
        self.times_unix_s.append(time_unix_s)

    def send(self, data: bytes) -> None:
        self.channel.take_datagram(data, EXTENSION)

    @property
    def sizes(self) -> list[int]:
        return [ping.samples.size for ping in self.pings]


def chunk(start: int, samples: np.ndarray) -> bytes:
    return build_frame(3, start.to_bytes(2, "little") + b"\x14\0\0\0" + samples.tobytes(), route=1, mark=True)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_ping_is_shown_when_the_next_begins_until_three_alike_taught_the_count(bench) -> None:
    shown = []
    for _ in range(6):
        bench.ping(1000)
        shown.append(len(bench.pings))
    assert shown == [0, 1, 2, 4, 5, 6]
    assert bench.sizes == [1000] * 6


def test_the_sonars_own_answer_makes_the_very_next_ping_early(bench) -> None:
    answer = KoggerFrameDecoder("mod256").feed(ChartSetup(1000, 20).content_frame())[0]
    bench.channel.take_answer(answer)
    sent = bench.ping(1000)
    assert [ping.samples.tobytes() for ping in bench.pings] == [sent.tobytes()]


def test_between_a_new_setting_and_its_read_back_no_ping_is_padded_or_cut(bench) -> None:
    def answer(data: bytes) -> None:
        bench.channel.take_answer(KoggerFrameDecoder("mod256").feed(data)[0])

    answer(ChartSetup(1000, 20).content_frame())
    bench.ping(1000)
    bench.pings.clear()
    answer(build_frame(0x12, b"\x01\0\0", response=True))
    bench.ping(600)
    bench.ping(600)
    answer(ChartSetup(600, 20).content_frame())
    bench.ping(600)
    assert bench.sizes == [600, 600, 600]
    assert not any(ping.gaps for ping in bench.pings)


def test_a_ping_that_became_shorter_is_shown_short_at_once_and_not_padded(bench) -> None:
    for _ in range(5):
        bench.ping(1000)
    bench.pings.clear()
    sent = [bench.ping(600) for _ in range(8)]
    assert [ping.samples.tobytes() for ping in bench.pings[:7]] == [ping.tobytes() for ping in sent[:7]]
    assert not any(ping.gaps for ping in bench.pings)
    assert len(bench.pings) == 8  # learned again: no waiting for the next


def test_a_ping_that_became_longer_is_shown_again_whole(bench) -> None:
    for _ in range(5):
        bench.ping(1000)
    bench.pings.clear()
    sent = [bench.ping(1500) for _ in range(8)]
    assert bench.sizes == [1000] + [1500] * 8
    assert [ping.samples.tobytes() for ping in bench.pings[1:]] == [ping.tobytes() for ping in sent]
    assert not any(ping.gaps for ping in bench.pings)


def test_both_sub_channels_of_a_dual_sonar_become_shorter_together(bench) -> None:
    def dual(size: int) -> None:
        bench.now_s += 0.1
        stream = np.arange(2 * size, dtype=np.uint32).astype(np.uint8)
        for start in range(0, 2 * size, 200):
            payload = start.to_bytes(2, "little") + b"\x14\0\0\0" + stream[start : start + 200].tobytes()
            bench.send(build_frame(3, payload, version=1, route=1, mark=True))

    for _ in range(6):
        dual(500)
    assert {ping.sub_channel for ping in bench.pings} == {0, 1}
    bench.pings.clear()
    for _ in range(3):
        dual(300)
    assert bench.sizes == [300] * 4
    assert not any(ping.gaps for ping in bench.pings)


def test_a_lost_head_is_a_gap_and_teaches_nothing(bench) -> None:
    for _ in range(5):
        bench.ping(1000)
    bench.pings.clear()
    bench.ping(1000, first=400)
    assert [ping.gaps for ping in bench.pings] == [((0, 400),)]
    bench.ping(1000)
    assert bench.sizes == [1000, 1000]


def test_a_lost_tail_is_shown_by_the_timeout(bench) -> None:
    for _ in range(5):
        bench.ping(1000)
    bench.pings.clear()
    bench.now_s += 0.1
    for start in (0, 200, 400):
        bench.send(chunk(start, np.ones(200, np.uint8)))
    bench.channel.flush()
    assert bench.pings == []
    bench.now_s += 1.0
    bench.channel.flush()
    assert bench.sizes == [600]


def test_sonar_data_of_a_stranger_paints_nothing(bench) -> None:
    bench.channel.take_datagram(chunk(0, np.ones(200, np.uint8)), STRANGER)
    assert bench.channel.counters.packets == 0
    assert bench.channel.gateway.counters.content_refused + bench.channel.gateway.counters.not_private == 1


def test_a_restarted_sonar_is_noticed_by_its_mark(bench) -> None:
    restarts = []
    bench.channel.on_restart = lambda: restarts.append(bench.now_s)
    bench.ping(200)
    unmarked = build_frame(3, b"\0\0\x14\0\0\0" + bytes(200), route=1, mark=False)
    bench.send(unmarked)
    bench.send(unmarked)
    assert len(restarts) == 1


def test_status_tells_rate_age_and_losses(bench) -> None:
    for _ in range(20):
        bench.ping(1000)
    bench.send(b"\xbb\x55\x01\x01\x03")
    bench.now_s += 1.0
    status = bench.channel.status()
    assert (status["pings"], status["samples"], status["resolution_mm"]) == (20, 1000, 20)
    assert status["age_s"] == pytest.approx(1.0, abs=0.01)
    assert status["pings_per_s"] == pytest.approx(9.5, abs=0.6)
    assert status["packets"] == 101


def stamped(measured_s: float, *frames: bytes, last: bool = True) -> bytes:
    return pack_ping_stamp(PingStamp(measured_s, 1.8e9 + measured_s, last), 1) + b"".join(frames)


def test_a_stamp_gives_time_and_end_of_a_ping_and_is_no_frame_of_the_sonar(bench) -> None:
    samples = np.arange(1, 201, dtype=np.uint8)
    bench.send(stamped(42.0, chunk(0, samples), chunk(200, samples)))
    assert bench.sizes == [400]
    assert bench.pings[0].measured_s == 42.0
    assert bench.times_unix_s == [1.8e9 + 42.0]
    assert bench.channel.status()["bb55"] == 2


def test_a_stalled_host_neither_splits_nor_smears_stamped_pings(bench) -> None:
    samples = np.arange(1, 201, dtype=np.uint8)
    for number in range(8):
        bench.send(stamped(number * 0.1, chunk(0, samples), last=False))
        bench.now_s += 0.3 if number == 5 else 0.01  # three periods late in the middle of a ping
        bench.send(stamped(number * 0.1, chunk(200, samples)))
    assert bench.sizes == [400] * 8
    assert np.allclose(np.diff([ping.measured_s for ping in bench.pings]), 0.1)


def test_without_a_stamp_a_ping_counts_from_its_arrival(bench) -> None:
    for _ in range(3):
        bench.ping(200)
    assert bench.times_unix_s[0] == UNIX_OFFSET_S + bench.pings[0].measured_s
