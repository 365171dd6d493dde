from dataclasses import replace

import pytest

from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.esp32_messages import (
    ConfigKey,
    Esp32FrameDecoder,
    MessageType,
    StatusFields,
    encode_config,
    encode_frame,
    encode_kogger_command,
    encode_time_sync,
    unpack_command_ack,
    unpack_gps,
    unpack_imu_burst,
    unpack_kogger_raw,
    unpack_status,
)
from bluerov_slam.protocol.kogger_bundle import Bundle, expand
from bluerov_slam.protocol.kogger_frame import FrameType, KoggerFrameDecoder, KoggerId, build_frame
from bluerov_slam.protocol.sensor_frame import SensorFields, unpack_sensors
from bluerov_slam.records import AckResult, Channel, Ping
from bluerov_slam.simulation.boot_text import PROBE_BYTES
from bluerov_slam.simulation.faults import parse_fault
from bluerov_slam.simulation.scenario import SCENARIOS, Scenario
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from simulated import link_bytes

UNDER_WAY = replace(SCENARIOS["survey"], mission_start_s=60.0)
Frames = list[tuple[int, bytes]]


def run(board: VirtualEsp32, until_s: float, decoder: Esp32FrameDecoder | None = None) -> Frames:
    return (decoder or Esp32FrameDecoder()).feed(board.advance(until_s))


def of_type(frames: Frames, wanted: MessageType) -> list[bytes]:
    return [payload for frame_type, payload in frames if frame_type == wanted]


def sensors(frames: Frames) -> list[SensorFields]:
    fields = [unpack_sensors(payload) for payload in of_type(frames, MessageType.SENSORS)]
    return [field for field in fields if field is not None]


def last_status(frames: Frames) -> StatusFields:
    status = unpack_status(of_type(frames, MessageType.STATUS)[-1])
    assert status is not None
    return status


def acks(frames: Frames) -> list[tuple[int, int, AckResult]]:
    unpacked = [unpack_command_ack(payload) for payload in of_type(frames, MessageType.COMMAND_ACK)]
    return [(ack.acked_type, ack.sequence, ack.result) for ack in unpacked if ack is not None]


def sonar_frames(frames: Frames, wanted: MessageType = MessageType.KOGGER_RAW_A) -> list[bytes]:
    raw = [unpack_kogger_raw(payload) for payload in of_type(frames, wanted)]
    return [frame.raw for fields in raw if fields for frame in KoggerFrameDecoder("mod256").feed(fields.frames)]


def test_same_seed_gives_the_same_bytes_however_time_is_sliced() -> None:
    scenario = replace(UNDER_WAY, faults=(parse_fault("kind=bit_errors at=1 duration=2 rate=1e-3"),))
    whole = VirtualEsp32(scenario).advance(4.0)
    board = VirtualEsp32(scenario)
    sliced = b"".join(board.advance(step * 0.0137) for step in range(1, 292)) + board.advance(4.0)
    assert sliced == whole
    assert VirtualEsp32(replace(scenario, seed=2)).advance(4.0) != whole


def test_same_host_bytes_at_the_same_times_give_the_same_bytes() -> None:
    def with_host(steps: int) -> bytes:
        board = VirtualEsp32(UNDER_WAY)
        out = b""
        for step in range(steps):
            out += board.advance(1.0 * (step + 1) / steps)
        board.receive(encode_time_sync(3, 123_456), 1.0)
        return out + board.advance(2.0)

    assert with_host(1) == with_host(7)


def test_commands_and_settings_take_effect_at_the_same_instant_however_time_is_sliced() -> None:
    faults = ("kind=silent sensor=imu at=1.03 duration=0.5", "kind=i2c_errors at=2 duration=1", "kind=reset at=3.21")
    scenario = replace(UNDER_WAY, new_sensors=True, faults=tuple(map(parse_fault, faults)))
    said = (
        (0.7, encode_config(1, {ConfigKey.IMU_RATE_MHZ: 5_000})),
        (1.4, b"".join(encode_kogger_command(channel, 2, chart_setup(300)) for channel in Channel) * 3),
        (1.9, encode_config(3, {ConfigKey.BAUD: 921_600, ConfigKey.SENSORS_RATE_MHZ: 10_000})),
        (5.0, encode_kogger_command(Channel.B, 4, chart_setup(1_500))),
    )

    def heard(step_s: float) -> bytes:
        board = VirtualEsp32(scenario)
        out, step = b"", 0
        for at_s, data in (*said, (6.0, b"")):
            while (step + 1) * step_s < at_s:
                step += 1
                out += board.advance(step * step_s)
            board.receive(data, at_s)
        return out + board.advance(6.0)

    whole = heard(100.0)
    assert len(whole) > 35_000
    for step_s in (0.01, 0.0037, 0.0005):
        assert heard(step_s) == whole


@pytest.mark.parametrize("baud", [115_200, 921_600])
@pytest.mark.parametrize("name", ["survey", "saturated"])
def test_never_sends_faster_than_the_line(baud: int, name: str) -> None:
    sent = 0
    for arrived_s, data in link_bytes(5.0, baud=baud, scenario=name):
        sent += len(data)
        assert sent <= arrived_s * baud / 10 + 1
    assert sent > 20_000


def test_every_byte_belongs_to_a_frame_without_faults() -> None:
    decoder = Esp32FrameDecoder()
    run(VirtualEsp32(UNDER_WAY), 10.0, decoder)
    counters = decoder.counters
    assert counters.bytes_skipped == counters.checksum_errors == counters.length_errors == 0
    assert counters.frames_by_type == {0x01: 20, 0x04: counters.frames_by_type[0x04], 0x05: 99, 0x06: 10, 0x0B: 9}


def test_sends_every_sensors_frame_on_a_saturated_line_and_drops_whole_pings_in_turn() -> None:
    frames = run(VirtualEsp32(replace(SCENARIOS["saturated"], mission_start_s=60.0)), 20.0)
    assert len(sensors(frames)) == 40
    status = last_status(frames)
    assert status.link_load_percent >= 99
    assert status.a_pings_dropped > 10
    assert abs(status.a_pings_dropped - status.b_pings_dropped) <= 1
    for channel in Channel:
        filled: int | None = None
        for payload in of_type(frames, MessageType.KOGGER_COMPRESSED):
            bundle = expand(payload)
            assert isinstance(bundle, Bundle)
            if bundle.channel is channel:
                assert filled is None or bundle.chunks[0].seq_offset == filled
                filled = 0 if bundle.last_of_ping else bundle.chunks[-1].seq_offset + len(bundle.chunks[-1].samples)


def test_sends_whole_untouched_pings_where_the_line_has_room() -> None:
    frames = run(VirtualEsp32(UNDER_WAY, 921_600), 4.0)
    charts = sonar_frames(frames[100:])
    assert len(charts) > 50
    assert all(len(frame) == 214 for frame in charts)
    assert all(len(payload) <= 512 for _, payload in frames)


def test_payloads_stay_short_on_a_slow_line() -> None:
    frames = run(VirtualEsp32(UNDER_WAY), 5.0)
    assert max(len(payload) for _, payload in frames) <= 224


def test_conductivity_and_salinity_need_the_full_range_fields() -> None:
    fields = sensors(run(VirtualEsp32(UNDER_WAY), 3.0))[-1]
    assert fields.conductivity_dus == 0xFFFF
    assert 380_000 < fields.full_conductivity_dus < 480_000
    assert fields.salinity_dpsu == 0xFF
    assert 89_000 < fields.full_pressure_pa - 101_325 < 92_000


def test_deep_water_needs_the_full_range_pressure() -> None:
    deep = replace(SCENARIOS["deep"], mission_start_s=400.0)
    fields = sensors(run(VirtualEsp32(deep), 2.0))[-1]
    assert fields.pressure_dmbar == 0xFFFF
    assert fields.full_pressure_pa > 655_350
    assert 7_700 < fields.depth_cm < 7_900


def test_legacy_firmware_wraps_and_sends_only_two_types() -> None:
    board = VirtualEsp32(replace(SCENARIOS["legacy"], mission_start_s=60.0))
    board.receive(encode_time_sync(1, 99), 0.5)
    frames = run(board, 5.0)
    assert {frame_type for frame_type, _ in frames} == {MessageType.SENSORS, MessageType.KOGGER_COMPRESSED}
    modern = sensors(run(VirtualEsp32(UNDER_WAY), 5.0))[-1]
    fields = sensors(frames)[-1]
    assert (fields.extension, fields.full_conductivity_dus, fields.full_pressure_pa) == (0, 0, 0)
    assert fields.conductivity_dus == modern.full_conductivity_dus & 0xFFFF


def test_position_only_at_the_surface() -> None:
    surfaced = [unpack_gps(p) for p in of_type(run(VirtualEsp32(SCENARIOS["survey"]), 15.0), MessageType.GPS)]
    assert surfaced[-1] is not None
    assert surfaced[-1].fix == 3
    assert abs(surfaced[-1].latitude_e7 - 476_123_000) < 1000
    submerged = [unpack_gps(p) for p in of_type(run(VirtualEsp32(UNDER_WAY), 5.0), MessageType.GPS)]
    assert {(gps.fix, gps.latitude_e7) for gps in submerged if gps} == {(0, 0)}


def test_imu_bursts_hold_two_samples_and_gravity() -> None:
    bursts = [unpack_imu_burst(p) for p in of_type(run(VirtualEsp32(UNDER_WAY), 3.0), MessageType.IMU_BURST)]
    assert len(bursts) == 29
    for burst in bursts:
        assert burst is not None
        assert abs(burst.dt_us - 50_000) <= 1_000  # bytes are seen tick by tick
        assert burst.samples.shape == (2, 9)
        assert -2_150 < burst.samples[:, 2].mean() < -1_950  # 1 g upwards, in 16 g / 32768


def test_time_sync_comes_back_in_a_status() -> None:
    board = VirtualEsp32(UNDER_WAY)
    board.receive(encode_time_sync(5, 987_654_321), 1.5)
    statuses = [unpack_status(p) for p in of_type(run(board, 1.7), MessageType.STATUS)]
    echoes = [status for status in statuses if status and status.echoed_host_us]
    [echo] = [(status.echoed_host_us, status.echo_device_us) for status in echoes]
    assert echo[0] == 987_654_321
    assert 1_501_300 < echo[1] <= 1_502_400  # 15 bytes on the line, and the tick that sees the last


def chart_setup(samples: int) -> bytes:
    payload = samples.to_bytes(2, "little") + (20).to_bytes(2, "little") + b"\0\0"
    return build_frame(KoggerId.CHART_SETUP, payload, frame_type=FrameType.SETTING, response=True)


def test_relays_a_command_and_the_sonar_answers_with_its_check_bytes() -> None:
    board = VirtualEsp32(UNDER_WAY)
    command = chart_setup(600)
    board.receive(encode_kogger_command(Channel.A, 9, command), 1.0)
    frames = run(board, 3.0)
    assert acks(frames) == [(MessageType.KOGGER_COMMAND_A, 9, AckResult.OK)]
    answer = KoggerFrameDecoder("mod256").feed(sonar_frames(frames)[0])[0]
    assert answer.response
    assert answer.payload == b"\x01" + command[-2:]
    last = [bundle for p in of_type(frames, MessageType.KOGGER_COMPRESSED) if isinstance(bundle := expand(p), Bundle)]
    assert max(c.seq_offset + len(c.samples) for b in last[-8:] if b.channel is Channel.A for c in b.chunks) == 600
    assert max(c.seq_offset + len(c.samples) for b in last[-8:] if b.channel is Channel.B for c in b.chunks) == 1000


@pytest.mark.parametrize(
    ("frame", "ack"),
    [
        (encode_kogger_command(Channel.B, 1, chart_setup(600)[:-1] + b"\0"), (0x21, 1, AckResult.BAD_INNER_CHECKSUM)),
        (encode_frame(0x2F, b"\x07"), (0x2F, 7, AckResult.UNKNOWN)),
        (encode_config(2, {ConfigKey.DECIMATION: 9}), (0x22, 2, AckResult.REJECTED)),
        (
            encode_kogger_command(Channel.A, 3, build_frame(0x18, bytes(9), frame_type=FrameType.SETTING)),
            (0x20, 3, AckResult.REJECTED),
        ),
    ],
)
def test_refuses_bad_commands_and_counts_them(frame: bytes, ack: tuple[int, int, AckResult]) -> None:
    board = VirtualEsp32(UNDER_WAY)
    board.receive(frame, 0.5)
    frames = run(board, 2.0)
    assert acks(frames) == [ack]
    assert last_status(frames).bad_commands == 1


def test_answers_busy_while_too_many_commands_wait_for_a_silent_sonar() -> None:
    board = VirtualEsp32(replace(UNDER_WAY, faults=(parse_fault("kind=silent sensor=a at=0 duration=9"),)))
    for sequence in range(9):
        board.receive(encode_kogger_command(Channel.A, sequence, chart_setup(500)), 0.5)
    results = [result for _, _, result in acks(run(board, 1.0))]
    assert results == [AckResult.OK] * 8 + [AckResult.BUSY]


def test_config_changes_the_rates_at_once() -> None:
    board = VirtualEsp32(UNDER_WAY)
    before = len(sensors(run(board, 4.0)))
    board.receive(encode_config(1, {ConfigKey.SENSORS_RATE_MHZ: 20_000, ConfigKey.IMU_RATE_MHZ: 10_000}), 4.0)
    frames = run(board, 8.0)
    assert before == 8
    assert 70 <= len(sensors(frames)) <= 81
    burst = unpack_imu_burst(of_type(frames, MessageType.IMU_BURST)[-1])
    assert burst is not None
    assert burst.dt_us == 100_000


def test_baud_change_is_kept_only_when_the_host_is_heard_at_the_new_rate() -> None:
    board = VirtualEsp32(UNDER_WAY)
    change = encode_config(1, {ConfigKey.BAUD: 921_600})
    board.receive(change, 1.0)
    board.advance(2.0)
    assert board.baud == 921_600
    board.advance(6.5)
    assert board.baud == 115_200
    board.receive(change, 7.0)
    board.advance(8.0)
    board.receive(encode_time_sync(2, 1), 8.0)
    board.advance(20.0)
    assert board.baud == 921_600


def test_a_host_at_another_rate_reads_and_says_nonsense() -> None:
    board = VirtualEsp32(UNDER_WAY, 921_600)
    board.set_host_baud(115_200)
    board.receive(encode_config(1, {ConfigKey.DECIMATION: 2}), 0.5)
    assert run(board, 3.0) == []
    board.set_host_baud(921_600)
    assert last_status(run(board, 6.0)).bad_commands >= 1


def test_reset_prints_boot_text_and_starts_over() -> None:
    board = VirtualEsp32(replace(UNDER_WAY, faults=(parse_fault("kind=reset at=3 reason=9"),)))
    data = board.advance(6.0)
    assert b"RTCWDT_BROWN_OUT_RESET" in data
    frames = Esp32FrameDecoder().feed(data)
    status = last_status(frames)
    assert (status.boot_count, status.reset_reason) == (8, 9)
    assert status.uptime_ms < 3_000
    assert sensors(frames)[-1].device_ms < 3_000


def test_settings_outlive_a_reset_but_not_the_rate_of_the_line() -> None:
    board = VirtualEsp32(replace(UNDER_WAY, faults=(parse_fault("kind=reset at=3"),)))
    board.receive(encode_config(1, {ConfigKey.SENSORS_RATE_MHZ: 10_000, ConfigKey.BAUD: 921_600}), 1.0)
    board.advance(2.0)
    assert board.baud == 921_600
    board.advance(4.0)
    assert board.baud == 115_200
    assert len(sensors(run(board, 6.0))) == 20


def test_sensors_from_the_factory_are_set_up_and_remember_it() -> None:
    faults = (parse_fault("kind=unplug at=4 duration=1"),)
    frames = run(VirtualEsp32(replace(UNDER_WAY, new_sensors=True, faults=faults)), 9.0)
    bursts = [burst for p in of_type(frames, MessageType.IMU_BURST) if (burst := unpack_imu_burst(p))]
    assert bursts[0].dt_us == pytest.approx(100_000, abs=1_000)
    at_20_hz = [abs(burst.dt_us - 50_000) <= 1_000 for burst in bursts]
    assert sum(at_20_hz) == len(bursts) - 4  # as from the factory for the first 0.7 s, and never again
    assert last_status(frames).ec_errors == 0
    assert sensors(frames)[-1].ec_alive == 1


def test_unplugged_board_is_silent_and_boots_when_plugged_in_again() -> None:
    board = VirtualEsp32(replace(UNDER_WAY, faults=(parse_fault("kind=unplug at=2 duration=3"),)))
    assert board.advance(2.0)
    assert board.advance(4.9) == b""
    assert not board.plugged
    data = board.advance(8.0)
    assert board.plugged
    assert b"POWERON_RESET" in data
    assert sensors(Esp32FrameDecoder().feed(data))


@pytest.mark.parametrize("fault", ["kind=bit_errors rate=1e-3", "kind=garbage rate=20", "kind=drop rate=1e-2"])
def test_line_faults_damage_some_frames_while_they_last(fault: str) -> None:
    decoder = Esp32FrameDecoder()
    board = VirtualEsp32(replace(UNDER_WAY, faults=(parse_fault(f"{fault} at=2 duration=2"),)))
    run(board, 1.9, decoder)
    assert decoder.counters.bytes_skipped == 0
    run(board, 4.5, decoder)
    damaged = decoder.counters
    assert damaged.bytes_skipped > 0
    run(board, 10.0, decoder)
    assert decoder.counters.bytes_skipped <= damaged.bytes_skipped + 300
    assert decoder.counters.frames_ok > damaged.frames_ok + 100


def test_probe_bytes_are_ignored_and_counted() -> None:
    quiet, probed = VirtualEsp32(UNDER_WAY), VirtualEsp32(UNDER_WAY)
    probed.receive(PROBE_BYTES, 0.5)
    assert len(run(quiet, 3.0)) == len(frames := run(probed, 3.0))
    assert acks(frames) == []
    assert last_status(frames).bad_commands == 1


@pytest.mark.parametrize(
    ("sensor", "alive"),
    [
        ("imu", "imu_alive"),
        ("gps", "gps_alive"),
        ("ec", "ec_alive"),
        ("depth", "depth_ok"),
        ("celsius", "temperature_ok"),
    ],
)
def test_a_silent_sensor_is_reported_and_comes_back(sensor: str, alive: str) -> None:
    fault = parse_fault(f"kind=silent sensor={sensor} at=2 duration=6")
    values = [getattr(field, alive) for field in sensors(run(VirtualEsp32(replace(UNDER_WAY, faults=(fault,))), 12.0))]
    assert values[3] == 1
    assert values[15] == 0
    assert values[-1] == 1


def test_a_silent_sonar_sends_nothing_and_the_other_goes_on() -> None:
    fault = parse_fault("kind=silent sensor=b at=0 duration=9")
    fields = sensors(run(VirtualEsp32(replace(UNDER_WAY, faults=(fault,))), 3.0))[-1]
    assert fields.b_bytes == fields.b_packets == 0
    assert fields.a_packets > 100


def test_sonar_b_begins_in_the_middle_of_a_ping() -> None:
    frames = run(VirtualEsp32(UNDER_WAY), 2.0)
    first = next(b for p in of_type(frames, 4) if isinstance(b := expand(p), Bundle) and b.channel is Channel.B)  # type: ignore[arg-type]
    assert first.chunks[0].seq_offset > 0
    assert last_status(frames).b_frame_errors == 0


def test_i2c_faults_show_in_the_counters_and_the_flags() -> None:
    fault = parse_fault("kind=i2c_errors at=1 duration=4")
    frames = run(VirtualEsp32(replace(UNDER_WAY, faults=(fault,))), 4.0)
    assert 8 <= last_status(frames).i2c_errors <= 12  # each device tries again every half second
    assert (sensors(frames)[-1].depth_ok, sensors(frames)[-1].temperature_ok) == (0, 0)


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_every_named_scenario_runs(name: str) -> None:
    scenario: Scenario = replace(SCENARIOS[name], mission_start_s=60.0)
    assert sensors(run(VirtualEsp32(scenario), 2.0))


def test_a_fault_added_late_starts_at_once_and_lasts_its_time() -> None:
    board = VirtualEsp32(UNDER_WAY)
    board.advance(5.0)
    board.add_fault(parse_fault("kind=silent sensor=depth at=0 duration=2"))
    values = [field.depth_ok for field in sensors(run(board, 9.0))]
    assert values[:4] == [1, 1, 0, 0]  # a reading counts for a second
    assert values[5:] == [1, 1, 1]


@pytest.mark.parametrize("coding", ["mean", "peak", "coded"])
def test_pings_travel_in_the_coding_of_the_scenario(coding: str) -> None:
    board = VirtualEsp32(replace(UNDER_WAY, coding=coding))
    decoder = LinkDecoder()

    pings = [record for record in decoder.feed(board.advance(2.0), 2.0) if isinstance(record, Ping)]

    assert decoder.counters.unknown_layouts == 0
    assert {sonar.coding for sonar in decoder.counters.sonars.values()} == {coding}
    assert len(pings) > 10
    assert {ping.samples.size for ping in pings if not ping.gaps} == {1000}
