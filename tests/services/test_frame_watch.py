import itertools
import random

import pytest

from bluerov_slam.pipeline.health import LinkFacts, PortState
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType, encode_frame
from bluerov_slam.records import LinkBytes, SensorSample
from bluerov_slam.services.esp_link import EspLink
from bluerov_slam.services.frame_watch import FrameWatch
from bluerov_slam.services.hub import Hub
from simulated import link_bytes

PART = encode_frame(MessageType.KOGGER_COMPRESSED, bytes((0, 0, 4, 1)) + bytes(150))
LAST = encode_frame(MessageType.KOGGER_COMPRESSED, bytes((0, 0x40, 4, 1)) + bytes(90))
SENSORS = encode_frame(MessageType.SENSORS, bytes(76))
IMU = encode_frame(MessageType.IMU_BURST, bytes(46))


def watch_after(data):
    """A watch and the bytes to wait for, after `data` was decoded."""
    decoder, watch = Esp32FrameDecoder(), FrameWatch()
    decoder.feed(data)
    return watch, watch.decoded(data, decoder.bytes_wanted, 0.0), decoder.bytes_wanted


def test_the_last_bytes_of_sensors_are_watched_as_they_come():
    _, wait, wanted = watch_after(PART + SENSORS[:10])
    assert wanted == len(SENSORS) - 10
    assert wait == wanted - 16
    _, wait, _ = watch_after(PART + SENSORS[:-10])
    assert wait == 0


def test_the_very_last_bytes_of_sensors_are_still_known_to_be_its():
    watch, _, _ = watch_after(SENSORS[:20])
    decoder = Esp32FrameDecoder()
    decoder.feed(SENSORS[:20])
    for start, end in ((20, 40), (40, len(SENSORS) - 3)):
        decoder.feed(SENSORS[start:end])
        wait = watch.decoded(SENSORS[start:end], decoder.bytes_wanted, 0.0)
    assert wait == 0


@pytest.mark.parametrize("frame", [PART, LAST])
def test_other_frames_are_waited_for_with_the_next_header(frame):
    _, wait, wanted = watch_after(frame[:20])
    assert wait == wanted + 8


@pytest.mark.parametrize("rest", [b"", b"\xaa", b"\xaa\x55\x01"])
def test_before_the_header_is_known_the_wait_is_shorter_than_any_sensors_frame(rest):
    _, wait, _ = watch_after(LAST + rest)
    assert 0 < wait + len(rest) < len(SENSORS)


def test_a_part_of_a_ping_may_wait_for_the_frame_behind_it():
    watch, _, wanted = watch_after(PART[:20])
    data = PART[20:] + LAST[:9]
    assert len(data) == wanted + 9
    assert watch.bytes_to_wait(data, 0.0) == len(LAST) - 9 + 8  # and the header behind it


def test_an_imu_burst_and_the_ping_behind_it_wait_for_the_pings_end():
    watch, _, _ = watch_after(IMU[:20])
    assert watch.bytes_to_wait(IMU[20:] + PART[:9], 0.0) == len(PART) - 9 + 8
    assert watch.bytes_to_wait(PART[9:] + LAST[:8], 0.0) == len(LAST) - 8 + 8
    assert watch.bytes_to_wait(LAST[8:] + IMU[:8], 0.0) == 0


def test_sensors_behind_a_part_of_a_ping_are_waited_for_up_to_their_last_bytes():
    watch, _, _ = watch_after(PART[:20])
    assert watch.bytes_to_wait(PART[20:] + SENSORS[:9], 0.0) == len(SENSORS) - 9 - 16


@pytest.mark.parametrize(
    ("opened", "data"),
    [
        (LAST[:20], LAST[20:] + PART[:9]),  # the end of a ping
        (SENSORS[:20], SENSORS[20:] + PART[:9]),
        (PART[:20], PART[20:]),  # nothing behind it
        (PART[:20], PART[20:] + LAST[:6]),  # too little behind it
        (PART[:20], PART[20:] + b"garbage and more"),
        (PART[:20], PART[20:40]),  # not complete
        (PART[:20], PART[20:] + LAST),  # the next one is complete too
        (PART[:3], PART[3:] + LAST[:9]),  # its type was not known
    ],
)
def test_everything_else_is_decoded_at_once(opened, data):
    watch, _, _ = watch_after(opened)
    assert watch.bytes_to_wait(data, 0.0) == 0


def rhythm(watch):
    """SENSORS at 0.0 s and 0.5 s, then a whole ping in two parts, told to `watch`."""
    for at_s in (0.0, 0.5):
        watch.decoded(SENSORS[:10], len(SENSORS) - 10, at_s)
    watch.decoded(PART[:20], len(PART) - 20, 0.51)
    watch.bytes_to_wait(PART[20:] + LAST[:9], 0.52)


def test_a_ping_is_waited_for_to_its_end_once_its_rhythm_is_known():
    watch = FrameWatch(bytes_per_s=11_520.0)
    rhythm(watch)
    assert watch.decoded(PART[:20], len(PART) - 20, 0.6) == len(PART) - 20 + len(LAST) + 8


@pytest.mark.parametrize("now_s", [0.97, 0.99, 1.2])
def test_nobody_sleeps_through_the_sensors_frame_that_is_due(now_s):
    watch = FrameWatch(bytes_per_s=11_520.0)
    rhythm(watch)
    assert watch.decoded(PART[:20], len(PART) - 20, now_s) == len(PART) - 20 + 8


def test_on_a_fast_line_each_frame_is_looked_at():
    watch = FrameWatch()
    rhythm(watch)
    assert watch.decoded(PART[:20], len(PART) - 20, 0.6) == len(PART) - 20 + 8


class Wire:
    """A link source that plays bytes in blocks of the size asked for."""

    kind = "serial"

    def now_s(self):
        return 0.0

    def start(self, on_data, on_change):
        self.on_data = on_data

    async def stop(self):
        pass

    def send(self, frame):
        return False

    def facts(self):
        return LinkFacts(PortState.CONNECTED)


async def played(stream, blocks):
    """Records of the link, without raw bytes, and the raw blocks."""
    hub, wire = Hub(), Wire()
    records, raw = [], []
    hub.subscribe(records.append)
    hub.subscribe(raw.append, LinkBytes)
    link = EspLink(wire, LinkDecoder(), hub)
    link.start(lambda: None)
    at = 0
    for size in blocks:
        if at >= len(stream):
            break
        wire.on_data(stream[at : at + size], at * 1e-4)
        at += size
    await link.stop()
    return [record for record in records if not isinstance(record, LinkBytes)], raw


@pytest.mark.parametrize("faults", [(), ("at=0.5 kind=garbage duration=2", "at=1 kind=bit_errors duration=1")])
async def test_held_or_not_the_same_records_come_out_and_no_byte_is_lost(faults):
    stream = b"".join(data for _, data in link_bytes(4.0, faults=faults))
    sizes = random.Random(1)
    blocks = [sizes.choice((1, 7, 60, 130, 200, 300)) for _ in range(len(stream))]
    records, raw = await played(stream, blocks)
    decoder = LinkDecoder()
    expected = [record for block in raw for record in decoder.feed(block.data, block.arrived_s)] + decoder.finish()
    assert b"".join(block.data for block in raw) == stream
    assert repr(records) == repr(expected)
    assert sum(isinstance(record, SensorSample) for record in records) >= 3


async def test_silence_in_the_middle_of_a_ping_brings_out_what_was_held():
    hub, wire, raw = Hub(), Wire(), []
    hub.subscribe(raw.append, LinkBytes)
    EspLink(wire, LinkDecoder(), hub).start(lambda: None)
    stream = PART + LAST
    for start, end in itertools.pairwise((0, 20, len(PART) + 9)):
        wire.on_data(stream[start:end], 1.0)
    assert len(raw) == 1
    wire.on_data(b"", 2.0)
    assert b"".join(block.data for block in raw) == stream[: len(PART) + 9]
    assert raw[-1].arrived_s == 1.0
