import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from bluerov_slam.protocol.kogger import FrameType, KoggerFrame, KoggerFrameDecoder, build_frame
from bluerov_slam.records import Channel
from bluerov_slam.services.kogger_gateway import MAXIMUM_PEERS, PEER_SILENCE_S, HostLimits, KoggerGateway
from bluerov_slam.services.sonar_session import SonarSession
from bluerov_slam.services.viewer_link_client import CommandResult

VECTORS = Path(__file__).parents[1] / "vectors" / "kogger_vectors.json"
COMMANDS = {
    entry["what"]: bytes.fromhex(entry["hex"]) for entry in json.loads(VECTORS.read_text())["commands"]["frames"]
}
ALL_COMMANDS = [bytes.fromhex(entry["hex"]) for entry in json.loads(VECTORS.read_text())["commands"]["frames"]]
VERSION_V0 = bytes.fromhex("bb5500832000a3c9")
MARK = COMMANDS["mark set"]
TOPSIDE = ("192.168.2.1", 14555)


class Sonar:
    """Stands where the extension and the sonar are: notes what came down, answers what it was told to."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []
        self.session = SonarSession(Channel.A, self, now_s=lambda: clock.now_s, answer_timeout_s=0.01)
        self.answers = False

    async def command(self, channel: Channel, frame: bytes) -> CommandResult:
        self.heard.append(frame)
        request = parse(frame)[0]
        if request.frame_type == FrameType.GETTING and self.answers:
            self.session.take(parse(build_frame(request.frame_id, b"\x01", version=request.version))[0])
        if request.frame_type == FrameType.SETTING:
            self.session.take(
                parse(
                    build_frame(
                        request.frame_id,
                        b"\x01" + frame[-2:],
                        version=request.version,
                        response=True,
                    )
                )[0]
            )
        return CommandResult("ok")


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0


clock = Clock()


def parse(data: bytes) -> list[KoggerFrame]:
    return KoggerFrameDecoder("mod256").feed(data)


def routed(frame: bytes, route: int) -> bytes:
    return parse(frame)[0].to_bytes(route)


def chart(seq_offset: int = 0, mark: bool = True) -> KoggerFrame:
    payload = seq_offset.to_bytes(2, "little") + bytes((20, 0, 0, 0)) + bytes(range(200))
    return parse(build_frame(3, payload, mark=mark))[0]


@pytest.fixture
def sonar() -> Sonar:
    clock.now_s = 1000.0
    sonar = Sonar()
    sonar.session.heard(mark=True)
    return sonar


@pytest.fixture
def sent() -> list[tuple[bytes, tuple[str, int]]]:
    return []


@pytest.fixture
async def gateway(sonar: Sonar, sent: list[tuple[bytes, tuple[str, int]]]) -> AsyncIterator[KoggerGateway]:
    gateway = KoggerGateway(
        Channel.A, sonar.session, lambda data, address: sent.append((data, address)), lambda: clock.now_s
    )
    asking = asyncio.create_task(sonar.session.run())
    yield gateway
    asking.cancel()
    await gateway.close()


async def settle() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


async def test_a_poller_gets_the_data_for_a_minute_after_its_last_poll(gateway, sent) -> None:
    gateway.share([chart()])
    assert sent == []
    gateway.take(routed(VERSION_V0, 1), TOPSIDE)
    sent.clear()
    gateway.share([chart(0), chart(200)])
    assert [address for _, address in sent] == [TOPSIDE]
    assert [(frame.route, frame.frame_id) for frame in parse(sent[0][0])] == [(1, 3), (1, 3)]
    clock.now_s += PEER_SILENCE_S - 1
    gateway.take(routed(VERSION_V0, 1), TOPSIDE)
    clock.now_s += PEER_SILENCE_S
    sent.clear()
    gateway.share([chart()])
    assert len(sent) == 1
    clock.now_s += 1
    gateway.share([chart()])
    assert len(sent) == 1
    assert gateway.peers() == []


async def test_who_the_extension_feeds_gets_answers_but_no_second_copy(gateway, sonar, sent) -> None:
    gateway.fed = frozenset({"192.168.2.1", "127.0.0.1"})
    gateway.take(routed(MARK, 1), TOPSIDE)
    assert len(sent) == 1
    gateway.share([chart()])
    assert len(sent) == 1
    assert gateway.peers()[0]["fed_by"] == "extension"


async def test_on_this_computer_the_fed_viewer_does_not_hide_a_local_kogger_app(gateway, sent) -> None:
    gateway.fed = frozenset({"127.0.0.1"})
    gateway.take(routed(MARK, 1), ("127.0.0.1", 40000))
    sent.clear()
    gateway.share([chart()])
    assert [address for _, address in sent] == [("127.0.0.1", 40000)]


async def test_version_is_answered_from_memory_as_the_public_address(gateway, sonar, sent) -> None:
    sonar.session.take(parse(build_frame(0x20, bytes(range(34)), mark=True))[0])
    gateway.take(routed(VERSION_V0, 1), TOPSIDE)
    await settle()
    assert sonar.heard == []
    (answer,) = parse(sent[0][0])
    assert (answer.route, answer.frame_id, answer.version, answer.mark) == (1, 0x20, 0, True)
    assert answer.payload == bytes(range(34))


async def test_polls_to_address_zero_are_answered_once_a_second_as_the_public_address(gateway, sonar, sent) -> None:
    sonar.session.take(parse(build_frame(0x20, bytes(34)))[0])
    for _ in range(10):
        gateway.take(VERSION_V0, TOPSIDE)
    assert len(sent) == 1
    assert parse(sent[0][0])[0].route == 1
    clock.now_s += 1.0
    gateway.take(VERSION_V0, TOPSIDE)
    assert len(sent) == 2


async def test_version_polls_reach_the_sonar_at_most_once_a_second(gateway, sonar) -> None:
    sonar.answers = True
    for _ in range(100):
        sonar.session.forget(0x20)
        gateway.take(routed(VERSION_V0, 1), TOPSIDE)
        await settle()
        clock.now_s += 0.05
    assert sonar.heard == [VERSION_V0] * 5


async def test_what_the_sonar_does_not_answer_is_left_alone_for_a_while(gateway, sonar) -> None:
    gateway.take(routed(VERSION_V0, 1), TOPSIDE)
    await settle()
    while sonar.session.busy:
        await asyncio.sleep(0)
    await settle()
    for _ in range(100):
        clock.now_s += 0.1
        gateway.take(routed(VERSION_V0, 1), TOPSIDE)
        await settle()
    assert sonar.heard == [VERSION_V0]
    clock.now_s += 10.0
    sonar.session.heard(mark=True)
    gateway.take(routed(VERSION_V0, 1), TOPSIDE)
    await settle()
    assert sonar.heard == [VERSION_V0] * 2


async def test_a_silent_sonar_is_not_impersonated(gateway, sonar, sent) -> None:
    sonar.session.take(parse(build_frame(0x20, bytes(34)))[0])
    clock.now_s += 60.0
    gateway.take(routed(VERSION_V0, 1), TOPSIDE)
    gateway.take(routed(MARK, 1), TOPSIDE)
    assert sent == []


async def test_mark_is_acknowledged_and_then_set_in_the_data(gateway, sonar, sent) -> None:
    mark = routed(MARK, 1)
    gateway.take(mark, TOPSIDE)
    (result,) = parse(sent[0][0])
    assert (result.route, result.response, result.payload) == (1, True, b"\x01" + mark[-2:])
    gateway.share([chart(mark=False)])
    (frame,) = parse(sent[1][0])
    assert frame.mark
    assert frame.payload == chart().payload


async def test_mark_with_a_wrong_key_is_refused(gateway, sent) -> None:
    gateway.take(build_frame(0x21, b"\0\0\0\0", frame_type=2, route=1, response=True), TOPSIDE)
    assert parse(sent[0][0])[0].payload[0] == 7


async def test_only_the_setup_round_passes_from_the_network_by_default(gateway, sonar) -> None:
    sonar.answers = True
    for command in ALL_COMMANDS:
        gateway.take(command, TOPSIDE)
        await settle()
    types = {parse(frame)[0].frame_type for frame in sonar.heard}
    assert types == {FrameType.GETTING}
    assert gateway.counters.settings_refused == 14
    # UART x3, FLASH x3, BOOT x2
    assert gateway.counters.refused == 8
    assert gateway.counters.wrong_route == 3


async def test_with_the_switch_settings_pass_and_the_result_quotes_the_apps_own_checks(gateway, sonar, sent) -> None:
    changed: list[int] = []
    gateway.settings_allowed = True
    gateway.on_setting = changed.append
    command = routed(COMMANDS["chart_setup set 1000x20mm off0"], 1)
    gateway.take(command, TOPSIDE)
    await settle()
    assert sonar.heard == [COMMANDS["chart_setup set 1000x20mm off0"]]
    (result,) = parse(sent[0][0])
    assert (result.route, result.payload) == (1, b"\x01" + command[-2:])
    assert changed == [0x12]


@pytest.mark.parametrize("payload", ["ffff14000000", "e80300000000", "e803", ""])
async def test_with_the_switch_an_impossible_setting_still_does_not_pass(gateway, sonar, sent, payload) -> None:
    gateway.settings_allowed = True
    gateway.take(build_frame(0x12, bytes.fromhex(payload), frame_type=2, route=1, response=True), TOPSIDE)
    await settle()
    assert sonar.heard == []
    assert parse(sent[0][0])[0].payload[0] == 3


async def test_with_the_switch_flash_boot_and_uart_still_never_pass(gateway, sonar, sent) -> None:
    gateway.settings_allowed = True
    for what in ("flash save v0", "boot reboot v0", "uart set baud 921600", "flash erase v2"):
        gateway.take(routed(COMMANDS[what], 1), TOPSIDE)
    await settle()
    assert sonar.heard == []
    assert [parse(data)[0].payload[0] for data, _ in sent] == [8, 8, 8, 8]


async def test_nothing_but_whole_valid_frames_is_taken(gateway, sonar, sent) -> None:
    poll = routed(VERSION_V0, 1)
    damaged = poll[:-1] + bytes((poll[-1] ^ 1,))
    for datagram in (b"", b"\xfe" + poll, poll[:-1], damaged, poll + b"\xbb\x55", b"$GPGGA", bytes(1000)):
        gateway.take(datagram, TOPSIDE)
    await settle()
    assert (sonar.heard, sent, gateway.peers()) == ([], [], [])
    assert gateway.counters.bad_datagrams == 7


async def test_sonar_data_from_the_network_is_not_taken_for_the_sonars(gateway) -> None:
    gateway.take(chart().to_bytes(1), TOPSIDE)
    assert gateway.counters.content_refused == 1
    assert gateway.peers() == []


async def test_strangers_never_push_out_a_peer_but_a_reopened_app_replaces_itself(gateway, sent) -> None:
    for host in range(1, MAXIMUM_PEERS + 1):
        gateway.take(routed(MARK, 1), (f"192.168.2.{host}", 14555))
    gateway.take(routed(MARK, 1), ("192.168.2.99", 14555))
    assert gateway.counters.peers_refused == 1
    gateway.take(routed(MARK, 1), ("192.168.2.1", 50000))
    sent.clear()
    gateway.share([chart()])
    assert {address for _, address in sent} == {("192.168.2.1", 50000)} | {
        (f"192.168.2.{host}", 14555) for host in range(2, MAXIMUM_PEERS + 1)
    }


async def test_a_forged_poll_cannot_aim_the_data_at_the_internet(gateway, sent) -> None:
    gateway.take(routed(MARK, 1), ("8.8.8.8", 53))
    gateway.share([chart()])
    assert sent == []
    assert gateway.counters.not_private == 1


async def test_a_flood_from_one_host_is_cut_and_leaves_the_others_alone(gateway, sent) -> None:
    for _ in range(1000):
        gateway.take(routed(MARK, 1), TOPSIDE)
    assert gateway.counters.rate_limited == 800
    sent.clear()
    gateway.take(routed(MARK, 1), ("192.168.2.2", 14555))
    assert len(sent) == 1


def test_the_table_of_hosts_is_bounded() -> None:
    limits = HostLimits(rate_per_s=1.0, burst=1.0)
    for host in range(10_000):
        assert limits.allows(str(host), 0.0)
    assert len(limits) <= 64
    assert not limits.allows("9999", 0.5)
    assert limits.allows("9999", 1.6)


async def test_data_goes_out_as_whole_frames_in_datagrams_that_fit(gateway, sent) -> None:
    gateway.take(routed(MARK, 1), TOPSIDE)
    sent.clear()
    frames = [chart(200 * index) for index in range(20)]
    gateway.share(frames)
    assert all(len(data) <= 1400 for data, _ in sent)
    assert [frame.payload for data, _ in sent for frame in parse(data)] == [frame.payload for frame in frames]


async def test_asking_everything_there_is_cannot_keep_the_sonar_busy(gateway, sonar) -> None:
    for step in range(40):
        for frame_id in range(0x10 + step, 0x10 + step + 20):
            gateway.take(build_frame(frame_id & 0xFF, bytes((step,)), frame_type=3, route=1, response=True), TOPSIDE)
        await settle()
        clock.now_s += 0.1
    assert len(sonar.heard) <= 32
    assert sonar.session.asks_dropped > 0
