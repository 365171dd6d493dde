import asyncio
import time

import pytest

from bluerov_slam.pipeline.health import LinkFacts, PortState
from bluerov_slam.pipeline.link_counters import SonarCounters
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.esp32_messages import (
    CommandAckFields,
    ConfigKey,
    Esp32FrameDecoder,
    MessageType,
    encode_frame,
    pack_command_ack,
)
from bluerov_slam.protocol.kogger import build_frame
from bluerov_slam.protocol.kogger_commands import uart_baud_frame, version_get_frame
from bluerov_slam.records import (
    AckResult,
    Channel,
    CommandAck,
    DeviceStatus,
    ImuBurst,
    LinkBytes,
    LinkBytesSent,
    Ping,
)
from bluerov_slam.services.channel_swap import swapped, swapped_counters
from bluerov_slam.services.esp_link import TIME_SYNC_TRIES, CommandOutcome, EspLink
from bluerov_slam.services.hub import Hub
from patience import PATIENCE_S
from pipeline.esp32_stream import imu
from samples import sensor_sample

FRAME = version_get_frame(0)


class Source:
    """A link source in memory; `answer` plays the firmware: it gets each frame sent and may return bytes."""

    kind = "serial"

    def __init__(self):
        self.sent, self.answer, self.open, self.now = [], lambda _kind, _payload: b"", True, 100.0

    def now_s(self):
        return self.now

    def start(self, on_data, on_change):
        self.on_data, self.on_change = on_data, on_change
        on_change()

    async def stop(self):
        pass

    def facts(self):
        return LinkFacts(PortState.CONNECTED if self.open else PortState.ABSENT)

    def send(self, data):
        if not self.open:
            return False
        [frame] = Esp32FrameDecoder().feed(data)
        self.sent.append(frame)
        reply = self.answer(*frame)
        if reply:
            asyncio.get_running_loop().call_soon(self.on_data, reply, self.now)
        return True


def acknowledging(result):
    def answer(kind, payload):
        return encode_frame(MessageType.COMMAND_ACK, pack_command_ack(CommandAckFields(kind, payload[0], result)))

    return answer


@pytest.fixture
def source():
    return Source()


@pytest.fixture
def hub():
    return Hub()


@pytest.fixture
def link(source, hub):
    link = EspLink(source, LinkDecoder(), hub, ack_timeout_s=PATIENCE_S)
    link.start(lambda: None)
    return link


@pytest.fixture
def hasty_link(source, hub):
    """For what is never answered."""
    link = EspLink(source, LinkDecoder(), hub, ack_timeout_s=0.05)
    link.start(lambda: None)
    return link


def collect(hub, *types):
    seen = []
    hub.subscribe(seen.append, *types)
    return seen


@pytest.mark.parametrize(
    ("result", "outcome"),
    [
        (AckResult.OK, CommandOutcome.OK),
        (AckResult.BAD_INNER_CHECKSUM, CommandOutcome.BAD_CHECKSUM),
        (AckResult.UNKNOWN, CommandOutcome.UNKNOWN),
        (AckResult.REJECTED, CommandOutcome.REJECTED),
        (AckResult.BUSY, CommandOutcome.BUSY),
    ],
)
async def test_a_command_is_answered_by_its_acknowledgement(link, source, result, outcome):
    source.answer = acknowledging(result)
    answer = await link.command(Channel.B, FRAME)
    assert answer.outcome is outcome
    assert answer.message
    [(kind, payload)] = source.sent
    assert (kind, payload[1:]) == (MessageType.KOGGER_COMMAND_B, FRAME)


async def test_silence_is_a_timeout_and_the_next_command_goes_through(hasty_link, source):
    assert (await hasty_link.command(Channel.A, FRAME)).outcome is CommandOutcome.TIMEOUT
    source.answer = acknowledging(AckResult.OK)
    assert (await hasty_link.command(Channel.A, FRAME)).outcome is CommandOutcome.OK


async def test_an_acknowledgement_that_a_held_up_process_finds_with_its_deadline_counts(hasty_link, source):
    loop = asyncio.get_running_loop()

    def answer(kind, payload):
        reply = acknowledging(AckResult.OK)(kind, payload)
        loop.call_later(0.04, source.on_data, reply, source.now)
        loop.call_soon(time.sleep, 0.1)
        return b""

    source.answer = answer
    assert (await hasty_link.command(Channel.A, FRAME)).outcome is CommandOutcome.OK


async def test_an_acknowledgement_of_another_sequence_does_not_count(hasty_link, source):
    source.answer = lambda kind, payload: acknowledging(AckResult.OK)(kind, bytes((payload[0] ^ 1,)))
    assert (await hasty_link.command(Channel.A, FRAME)).outcome is CommandOutcome.TIMEOUT


async def test_one_command_at_a_time_for_each_sonar_but_both_sonars_at_once(link, source):
    first = asyncio.create_task(link.command(Channel.A, FRAME))
    await asyncio.sleep(0)
    assert (await link.command(Channel.A, FRAME)).outcome is CommandOutcome.BUSY
    [(kind, payload)] = source.sent
    source.answer = acknowledging(AckResult.OK)
    assert (await link.command(Channel.B, FRAME)).outcome is CommandOutcome.OK
    assert not first.done()
    source.on_data(acknowledging(AckResult.OK)(kind, payload), source.now)
    assert (await first).outcome is CommandOutcome.OK


async def test_without_a_port_the_answer_is_no_link_at_once(link, source):
    source.open = False
    assert (await link.command(Channel.A, FRAME)).outcome is CommandOutcome.NO_LINK


@pytest.mark.parametrize(
    ("frame", "outcome"),
    [
        (b"", CommandOutcome.BAD_CHECKSUM),
        (b"hello", CommandOutcome.BAD_CHECKSUM),
        (FRAME[:-1] + b"\0", CommandOutcome.BAD_CHECKSUM),
        (FRAME + FRAME, CommandOutcome.BAD_CHECKSUM),
        (uart_baud_frame(1, 9600), CommandOutcome.REJECTED),
        (build_frame(3, b"", frame_type=1), CommandOutcome.REJECTED),
    ],
)
async def test_what_must_not_reach_a_sonar_is_never_sent(link, source, frame, outcome):
    assert (await link.command(Channel.A, frame)).outcome is outcome
    assert source.sent == []


async def test_what_is_sent_down_is_published_for_the_recording(link, source, hub):
    sent = collect(hub, LinkBytesSent)
    source.answer = acknowledging(AckResult.OK)
    assert (await link.configure({ConfigKey.DECIMATION: 2})).outcome is CommandOutcome.OK
    [record] = sent
    assert Esp32FrameDecoder().feed(record.data) == source.sent


async def test_raw_bytes_are_published_before_the_records_they_hold(link, source, hub):
    seen = collect(hub, LinkBytes, CommandAck)
    data = encode_frame(MessageType.COMMAND_ACK, pack_command_ack(CommandAckFields(0x22, 1, AckResult.OK)))
    source.on_data(data[:4], 1.0)
    source.on_data(data[4:], 2.0)
    assert [type(record).__name__ for record in seen] == ["LinkBytes", "LinkBytes", "CommandAck"]


def syncs(source):
    return [payload for kind, payload in source.sent if kind == MessageType.TIME_SYNC]


async def test_firmware_that_never_answers_gets_three_time_syncs_until_it_reconnects(link, source):
    for second in range(100):
        source.now = 100.0 + second
        link.tick(source.now)
    assert len(syncs(source)) == TIME_SYNC_TRIES
    source.open = False
    source.on_change()
    source.open = True
    source.on_change()
    link.tick(source.now)
    assert len(syncs(source)) == TIME_SYNC_TRIES + 1


async def test_firmware_that_answers_is_synchronised_every_ten_seconds(link, source, hub):
    for second in range(100):
        source.now = 100.0 + second
        before = len(syncs(source))
        link.tick(source.now)
        if len(syncs(source)) > before:
            hub.publish(status(echoed_host_us=int.from_bytes(syncs(source)[-1][1:9], "little")))
    assert len(syncs(source)) == 10
    assert int.from_bytes(syncs(source)[-1][1:9], "little") == 190_000_000


async def test_what_waited_for_more_is_decoded_when_the_port_is_lost(link, source, hub):
    blocks, bursts = collect(hub, LinkBytes), collect(hub, ImuBurst)
    frame = imu(0)
    source.on_data(frame[:10], 100.0)
    source.on_data(frame[10:] + imu(50_000)[:8], 100.01)
    assert (len(blocks), bursts) == (1, []), "it waits for the frame behind it"
    source.open = False
    source.on_change()
    assert (len(blocks), len(bursts)) == (2, 1)


async def test_crossed_cables_are_put_right_in_both_directions(link, source):
    link.swap = True
    source.answer = acknowledging(AckResult.OK)
    await link.command(Channel.A, FRAME)
    assert source.sent[-1][0] == MessageType.KOGGER_COMMAND_B


def status(**changes):
    values = dict.fromkeys(DeviceStatus.__slots__, 0) | {"firmware_version": (1, 0, 0)} | changes
    return DeviceStatus(**values)


def test_swapping_exchanges_everything_that_belongs_to_a_sonar_and_nothing_else():
    sample = swapped(sensor_sample(a_packets=1, a_bytes=2, b_packets=3, b_bytes=4))
    assert (sample.a_packets, sample.a_bytes, sample.b_packets, sample.b_bytes) == (3, 4, 1, 2)
    device = swapped(status(a_pings_dropped=1, b_pings_dropped=2, a_frame_errors=3, b_overflow_bytes=4))
    assert (device.a_pings_dropped, device.b_pings_dropped) == (2, 1)
    assert (device.b_frame_errors, device.a_overflow_bytes) == (3, 4)
    ping = Ping(Channel.A, 0, 0, 7, 1.0, 1.0, 0.02, 0, None)
    assert swapped(ping).channel is Channel.B
    block = LinkBytes(b"", 1.0)
    assert swapped(block) is block
    assert swapped(sample) == sensor_sample(a_packets=1, a_bytes=2, b_packets=3, b_bytes=4)
    counters = {Channel.A: SonarCounters(pings=1), Channel.B: SonarCounters(pings=2)}
    assert swapped_counters(counters)[Channel.A].pings == 2
