import itertools
from dataclasses import astuple
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bluerov_slam.pipeline.link_decoder import LinkDecoder, SonarActivity
from bluerov_slam.protocol.checksums import kogger_mod255
from bluerov_slam.protocol.esp32_messages import KoggerRawFields, MessageType, encode_frame, pack_kogger_raw
from bluerov_slam.protocol.sensor_frame import SensorFields, sensor_sample
from bluerov_slam.records import (
    AckResult,
    Channel,
    CommandAck,
    CtdSample,
    DeviceStatus,
    GpsFix,
    ImuBurst,
    Ping,
    Record,
    Sender,
    SensorSample,
    SonarFrames,
    UnknownFrame,
)
from pipeline.esp32_stream import (
    chart_frames,
    compressed_ping,
    golden,
    gps,
    raw_ping,
    sensors,
    status,
)

PING = bytes(k * 37 >> 3 & 0xFF for k in range(1000))


def held(samples: bytes) -> bytes:
    groups = [samples[at : at + 4] for at in range(0, len(samples), 4)]
    return b"".join(bytes((int(sum(group) / len(group) + 0.5),)) * len(group) for group in groups)


def only(records: list[Record], record_type: type) -> list[Any]:
    return [record for record in records if isinstance(record, record_type)]


def plain(record: Any) -> Any:
    """Comparable even where it holds arrays."""
    return type(record), [value.tobytes() if isinstance(value, np.ndarray) else value for value in astuple(record)]


def test_every_message_becomes_its_record() -> None:
    names = ["imu_burst", "command_ack_busy", "gps_3d", "status", "kogger_raw_a"]
    records = LinkDecoder().feed(sensors() + b"".join(map(golden, names)), 10.0)
    kinds = [SensorSample, CtdSample, ImuBurst, CommandAck, GpsFix, DeviceStatus, SonarFrames]
    assert [type(record) for record in records] == kinds
    assert all(record.arrived_s == 10.0 for record in only(records, object))
    assert only(records, CommandAck) == [CommandAck(10.0, 0x20, 21, AckResult.BUSY)]


def test_sea_water_is_computed_from_full_range_values() -> None:
    ctd = LinkDecoder().feed(sensors(), 1.0)[1]
    assert isinstance(ctd, CtdSample)
    assert ctd.salinity_psu == pytest.approx(34.0, abs=0.2)
    assert ctd.depth_m == pytest.approx((106_350 - 101_325) / (1025 * 9.80665))
    assert ctd.sound_speed_mps == pytest.approx(1507.9)


@pytest.mark.parametrize("make", [compressed_ping, lambda samples, channel, **rest: [raw_ping(samples, channel)]])
@pytest.mark.parametrize("channel", list(Channel))
def test_a_ping_comes_out_whole_with_its_frames(make: Any, channel: Channel) -> None:
    decoder = LinkDecoder(expected_samples={channel: len(PING)})
    records = decoder.feed(b"".join(make(PING, channel, number=1, t_us=5_000_000)), 7.0)
    [ping] = only(records, Ping)
    decimated = make is compressed_ping
    assert ping.samples.tobytes() == (held(PING) if decimated else PING)
    assert (ping.channel, ping.resolution_m, ping.gaps, ping.measured_s) == (channel, 0.02, (), 7.0)
    assert ping.decimation == (4 if decimated else 1)
    frames = [frame for group in only(records, SonarFrames) for frame in group.frames]
    assert frames == chart_frames(held(PING) if decimated else PING)


def test_the_last_frame_flag_brings_the_ping_out_early() -> None:
    decoder = LinkDecoder()
    frames = compressed_ping(PING)
    assert [only(decoder.feed(frame, 1.0), Ping) != [] for frame in frames] == [False, True]


def test_a_ping_is_dated_by_its_first_byte_on_the_host_clock() -> None:
    decoder = LinkDecoder()
    for k in range(40):
        decoder.feed(sensors(device_ms=500 * k), 100.0 + 0.5 * k)
    records = decoder.feed(b"".join(compressed_ping(PING, t_us=19_400_000)), 119.6)
    assert only(records, Ping)[0].measured_s == pytest.approx(119.4, abs=1e-3)


def test_both_sonars_are_kept_apart() -> None:
    decoder = LinkDecoder()
    a, b = compressed_ping(PING, Channel.A), compressed_ping(PING[::-1], Channel.B)
    records = decoder.feed(b"".join(itertools.chain(*zip(a, b, strict=True))), 1.0)
    pings = {ping.channel: ping.samples.tobytes() for ping in only(records, Ping)}
    assert pings == {Channel.A: held(PING), Channel.B: held(PING[::-1])}


def test_a_lost_frame_leaves_a_gap_that_is_counted() -> None:
    decoder = LinkDecoder()
    last = compressed_ping(PING)[-1]
    records = decoder.feed(last + b"".join(compressed_ping(PING, number=1, t_us=100_000)), 1.0)
    pings = only(records, Ping)
    assert [ping.gaps for ping in pings] == [((0, 600),), ()]
    counters = decoder.counters.sonars[Channel.A]
    assert (counters.pings, counters.pings_incomplete, counters.gap_samples) == (2, 1, 600)


def test_an_overdue_ping_comes_out_without_new_sonar_data() -> None:
    decoder = LinkDecoder()
    decoder.feed(compressed_ping(PING)[0], 1.0)
    assert decoder.flush(1.2) == []
    [ping] = decoder.flush(5.0)
    assert isinstance(ping, Ping)
    assert len(ping.samples) == 600


def test_a_host_pause_in_the_middle_of_a_ping_loses_nothing() -> None:
    decoder = LinkDecoder()
    for number in range(8):
        for frame in compressed_ping(PING, number=number, t_us=100_000 * number):
            decoder.feed(frame, 0.1 * number)
    first, last = compressed_ping(PING, number=8, t_us=800_000)
    assert decoder.feed(first, 0.8)[1:] == []
    [ping] = only(decoder.feed(last, 1.4), Ping)
    assert ping.gaps == ()


def test_unknown_and_undecoded_types_are_counted_not_errors() -> None:
    decoder = LinkDecoder()
    records = decoder.feed(encode_frame(0x7E, b"abc") + encode_frame(MessageType.TIME_SYNC, bytes(9)) + sensors(), 1)
    assert only(records, UnknownFrame) == [UnknownFrame(1, 0x7E, 3), UnknownFrame(1, 0x23, 9)]
    assert decoder.counters.unknown_types == {0x7E: 1}
    assert decoder.counters.undecoded == {0x23: 1}
    assert len(only(records, SensorSample)) == 1


def test_an_unknown_0x04_layout_is_counted_and_named() -> None:
    decoder = LinkDecoder()
    assert decoder.feed(encode_frame(MessageType.KOGGER_COMPRESSED, b"\1\2\3 something else entirely"), 1.0) == []
    assert decoder.counters.unknown_layouts == 1
    assert decoder.counters.unknown_layout_reason


@pytest.mark.parametrize(
    ("frame_type", "payload"),
    [
        (0x05, bytes(28)),
        (0x06, bytes(62)),
        (0x07, b"\1\2\3\4"[:2] + b"\x09"),
        (0x05, bytes(8) + b"\x01\x03" + bytes(18)),
    ],
)
def test_content_that_does_not_add_up_is_counted(frame_type: int, payload: bytes) -> None:
    decoder = LinkDecoder()
    assert decoder.feed(encode_frame(frame_type, payload), 1.0) == []
    assert decoder.counters.malformed == {frame_type: 1}


def test_mod_255_sonars_are_learned_and_forwarded_with_the_right_sum() -> None:
    decoder = LinkDecoder()
    good = chart_frames(PING)
    wrong = [frame[:-2] + kogger_mod255(frame[2:-2]) for frame in good]
    records = []
    for k in range(6):
        payload = pack_kogger_raw(KoggerRawFields(100_000 * k, b"".join(wrong)))
        records += decoder.feed(encode_frame(MessageType.KOGGER_RAW_B, payload), 0.1 * k)
    assert decoder.counters.sonars[Channel.B].checksum_in_use == "mod255"
    assert decoder.counters.sonars[Channel.A].checksum_in_use == "mod256"
    assert only(records, SonarFrames)[-1].frames == tuple(good)


def test_a_board_reset_starts_a_new_time_line() -> None:
    decoder = LinkDecoder()
    for k in range(10):
        decoder.feed(sensors(device_ms=3_600_000 + 500 * k), 50.0 + 0.5 * k)
    for device_ms, arrived_s in ((700, 58.0), (1200, 58.5)):
        [sample, _] = decoder.feed(sensors(device_ms=device_ms), arrived_s)
        assert isinstance(sample, SensorSample)
        assert sample.measured_s == arrived_s
    assert decoder.counters.device_resets == 1


def test_the_time_sync_echo_bounds_the_delay() -> None:
    decoder = LinkDecoder()
    decoder.feed(status(uptime_ms=10_000, echoed_host_us=99_000_000, echo_device_us=9_001_000), 100.004)
    assert decoder.clock.uncertainty_s == pytest.approx(0.005, abs=1e-6)


def legacy(**changes: int) -> bytes:
    """Without a depth on the wire, so that pressure is judged by its steps alone."""
    return sensors("sensors_legacy", **{"depth_cm": 0, **changes})


def test_legacy_conductivity_is_published_only_where_the_probe_agrees() -> None:
    decoder = LinkDecoder()
    [wrapped, ctd] = decoder.feed(legacy(conductivity_dus=26464), 1.0)  # 42 000.0 wrapped, the probe says 35.5 PSU
    assert isinstance(wrapped, SensorSample)
    assert isinstance(ctd, CtdSample)
    assert wrapped.sender is Sender.LEGACY
    assert wrapped.conductivity_s_per_m is ctd.salinity_psu is None
    assert decoder.counters.conductivity_distrusted
    [brackish, ctd] = decoder.feed(legacy(conductivity_dus=50000, ec_salinity_cpsu=330, pressure_dmbar=10133), 1.5)
    assert isinstance(brackish, SensorSample)
    assert isinstance(ctd, CtdSample)
    assert brackish.conductivity_s_per_m == pytest.approx(0.5)
    assert ctd.salinity_psu == pytest.approx(3.4, abs=0.2)
    assert not decoder.counters.conductivity_distrusted


def test_legacy_pressure_is_gone_after_it_wrapped_until_the_link_was_down() -> None:
    decoder = LinkDecoder()
    pressures = []
    for k, pressure in enumerate([60_000, 65_000, 500, 10_133]):
        sample = decoder.feed(legacy(pressure_dmbar=pressure, device_ms=500 * k), 0.5 * k)[0]
        assert isinstance(sample, SensorSample)
        pressures.append(sample.pressure_pa)
    assert pressures == [600_000, 650_000, None, None]
    assert decoder.counters.pressure_distrusted
    sample = decoder.feed(legacy(pressure_dmbar=10_133, device_ms=20_000), 20.0)[0]
    assert isinstance(sample, SensorSample)
    assert sample.pressure_pa == 101_330
    assert not decoder.counters.pressure_distrusted


def test_legacy_pressure_is_believed_again_after_a_reset() -> None:
    decoder = LinkDecoder()
    for k, pressure in enumerate([65_000, 500]):
        decoder.feed(legacy(pressure_dmbar=pressure, device_ms=100_000 + 500 * k), 0.5 * k)
    decoder.feed(legacy(pressure_dmbar=10_133, device_ms=100), 1.5)
    sample = decoder.feed(legacy(pressure_dmbar=10_133, device_ms=600), 2.0)[0]
    assert isinstance(sample, SensorSample)
    assert sample.pressure_pa == 101_330


def test_a_full_range_sender_may_dive_fast() -> None:
    decoder = LinkDecoder()
    decoder.feed(sensors(full_pressure_pa=101_325), 1.0)
    sample = decoder.feed(sensors(full_pressure_pa=1_500_000), 1.5)[0]
    assert isinstance(sample, SensorSample)
    assert sample.pressure_pa == 1_500_000


def test_alive_means_the_packet_counter_moved_within_two_seconds() -> None:
    activity = SonarActivity()
    seen = []
    for k, packets in enumerate([7, 7, 8, 8, 8, 8, 8, 8, 9]):
        fields = SensorFields(**{**dict.fromkeys(SensorFields.__slots__, 0), "a_packets": packets})
        activity.observe(sensor_sample(fields, 0.5 * k, 0.5 * k))
        seen.append(activity.alive(Channel.A))
    assert seen == [False, False, True, True, True, True, True, False, True]
    assert not activity.alive(Channel.B)


def dive() -> list[tuple[bytes, float]]:
    blocks = []
    for k in range(30):
        stream = sensors(device_ms=100 * k) + golden("imu_burst") + b"\xaa\x55noise\xbb\x55"
        stream += b"".join(compressed_ping(PING, Channel.A, number=k, t_us=100_000 * k)[: 1 + (k % 5 != 3)])
        stream += raw_ping(PING, Channel.B, t_us=100_000 * k) + gps(t_us=100_000 * k)
        blocks.append((stream, 0.1 * k + 0.003))
    return blocks


def run(blocks: list[tuple[bytes, float]], flush_between: bool = False) -> list[Any]:
    decoder = LinkDecoder()
    records = []
    for data, arrived_s in blocks:
        records += decoder.feed(data, arrived_s)
        if flush_between:
            records += decoder.flush(arrived_s + 0.05)
    return [plain(record) for record in records + decoder.finish()]


def test_the_same_blocks_give_the_same_records() -> None:
    assert run(dive()) == run(dive()) == run(dive(), flush_between=True)
    assert len(run(dive())) > 200


@settings(max_examples=20)
@given(st.integers(1, 400))
def test_cutting_a_block_changes_nothing(size: int) -> None:
    pieces = [(data[at : at + size], t) for data, t in dive()[:6] for at in range(0, len(data), size)]
    assert run(pieces) == run(dive()[:6])


def test_bytes_wanted_tells_the_rest_of_the_open_frame() -> None:
    decoder = LinkDecoder()
    frame = sensors()
    decoder.feed(frame[:30], 1.0)
    assert decoder.bytes_wanted == len(frame) - 30
    decoder.feed(frame[30:], 1.0)
    assert decoder.bytes_wanted == 0


def test_finish_gives_what_was_still_inside() -> None:
    decoder = LinkDecoder()
    records = decoder.feed(compressed_ping(PING)[0] + b"\xaa\x55\x7e\x0f\xff" + sensors(), 1.0)
    assert len(records) == 1
    assert [type(record) for record in decoder.finish()] == [SensorSample, CtdSample, Ping]
