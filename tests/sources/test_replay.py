import asyncio
import shutil
from pathlib import Path

import numpy as np
import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.pipeline.health import PortState
from bluerov_slam.protocol.waterfall_frame import pack_ping
from bluerov_slam.records import (
    ImuBurst,
    LinkBytes,
    NavMode,
    NavState,
    Ping,
    PositionFix,
    Record,
    SensorSample,
    SonarFrames,
    VehicleAttitude,
    VehicleBattery,
    VehicleDepth,
    VehicleMotionDelta,
    VehicleRange,
    VehicleServoOutput,
)
from bluerov_slam.sinks.mcap_log import JSON_TOPICS, encode_record
from bluerov_slam.sinks.mcap_recorder import RecordingLimits
from bluerov_slam.sinks.mcap_recovery import scan_mcap
from bluerov_slam.sources.recorded_json import VEHICLE_TOPICS
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.sources.replay import ReplaySource, decode
from recording_samples import FakeClocks, feed, nav_state, recorder
from simulated_dive import record_dive

FAULTS = ("kind=garbage at=6 duration=0.5", "kind=reset at=12")


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[LinkBytes], list[Record]]:
    """Twenty seconds with garbage and a reset in it, in several files."""
    limits = RecordingLimits(max_file_s=6.0, min_free_bytes=0)
    return record_dive(tmp_path_factory.mktemp("dive"), 20.0, limits, faults=FAULTS)


def cut_in_half(path: Path) -> bytes:
    """The file up to the middle of a chunk in its middle."""
    chunks = scan_mcap(path).chunks
    middle = chunks[len(chunks) // 2]
    return path.read_bytes()[: middle.chunk_start_offset + middle.chunk_length // 2]


def encoded(record: Record) -> bytes:
    if isinstance(record, Ping):
        return b"%r %r" % (record.arrived_s, record.sub_channel) + pack_ping(record, None)
    if isinstance(record, SonarFrames):
        return b"%r %r " % (record.measured_s, record.arrived_s) + b"|".join(record.frames)
    return type(record).__name__.encode() + encode_record(record)


def test_a_replay_gives_the_records_of_the_live_run_byte_for_byte(dive):
    session, _, live = dive
    replayed = list(decode(open_recording(session)))
    assert len(list(session.glob("link_*.mcap"))) > 2
    assert {type(r).__name__ for r in live} >= {"SensorSample", "Ping", "SonarFrames", "ImuBurst", "GpsFix"}
    assert [encoded(r) for r in replayed] == [encoded(r) for r in live]


def test_blocks_come_back_as_they_were_read(dive):
    session, blocks, _ = dive
    assert list(open_recording(session).blocks()) == blocks


def test_one_file_of_a_session_replays_alone(dive):
    session, blocks, _ = dive
    first = list(open_recording(session / "link_000.mcap").blocks())
    assert first == blocks[: len(first)]
    assert 0 < len(first) < len(blocks)


def test_an_exported_zip_replays_as_the_folder_does(dive, tmp_path):
    session, blocks, _ = dive
    archive = shutil.make_archive(str(tmp_path / "dive"), "zip", session.parent, session.name)
    assert list(open_recording(Path(archive)).blocks()) == blocks


def test_a_plain_capture_is_paced_by_the_baud_rate(dive, tmp_path):
    _, blocks, live = dive
    capture = tmp_path / "capture.bin"
    capture.write_bytes(b"".join(block.data for block in blocks))
    read = list(open_recording(capture).blocks(baud=115200))
    assert b"".join(block.data for block in read) == capture.read_bytes()
    assert read[-1].arrived_s == pytest.approx(capture.stat().st_size * 10 / 115200)
    records = list(decode(open_recording(capture)))
    pings = [r for r in records if isinstance(r, Ping)]
    live_pings = [r for r in live if isinstance(r, Ping)]
    assert [p.number for p in pings] == [p.number for p in live_pings]
    assert all(np.array_equal(p.samples, q.samples) for p, q in zip(pings, live_pings, strict=True))


def test_a_cut_file_replays_up_to_its_last_whole_chunk_and_says_so(dive, tmp_path):
    session, blocks, _ = dive
    cut = tmp_path / "link_000.mcap"
    cut.write_bytes(cut_in_half(session / "link_000.mcap"))
    recording = open_recording(cut)
    read = list(recording.blocks())
    assert read == blocks[: len(read)]
    assert len(read) > 100
    assert "was cut short" in recording.problems[0]


def test_a_damaged_chunk_is_passed_over_and_named(dive, tmp_path):
    session, blocks, _ = dive
    data = bytearray((session / "link_000.mcap").read_bytes())
    third = scan_mcap(session / "link_000.mcap").chunks[2]
    data[third.chunk_start_offset + third.chunk_length // 2] ^= 0xFF
    damaged = tmp_path / "link_000.mcap"
    damaged.write_bytes(data)
    recording = open_recording(damaged)
    read = list(recording.blocks())
    assert 0 < len(read) < len(blocks)
    assert read[0] == blocks[0]
    assert "damaged chunk" in recording.problems[0]


@pytest.mark.parametrize(
    ("name", "content", "cure"),
    [
        ("empty.mcap", b"", "is empty"),
        ("picture.png", b"\x89PNG\r\n" + bytes(100), "is no recording"),
        ("dive.klf", b"\xbb\x55\x00\x01\x03\x04\xaa\x55\x01\x02\x03\x04" * 50, "no frame of it inside"),
        ("session_20240101_000000.jsonl", b"{}\n", "give the session folder"),
        ("dive.zip", b"PK\x05\x06" + bytes(18), "holds no recording"),
    ],
)
def test_what_is_no_recording_is_refused_with_its_cure(tmp_path, name, content, cure):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=cure):
        open_recording(path)


def test_missing_and_empty_folders_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="No such file"):
        open_recording(tmp_path / "nowhere")
    with pytest.raises(RecordingError, match=r"expected a session folder with link_000\.mcap"):
        open_recording(tmp_path)


def test_the_decoder_is_set_as_it_was_when_the_dive_was_recorded(tmp_path):
    clock = FakeClocks()
    settings = {"surface_pressure_pa": 90000.0, "expected_samples": {"A": 500}, "unknown": 1}
    target = recorder(tmp_path, clock, decoder_settings=settings)
    feed(target, clock, 1.0)
    target.finish()
    recording = open_recording(next(tmp_path.glob("session_*")))
    assert recording.decoder_settings == settings
    assert list(decode(recording)) == []  # b"\xaa\x55 link bytes" holds no frame


VEHICLE = (
    VehicleAttitude(6.1, 1000, 0.1, -0.2, 3.0, (0.01, 0.02, 0.03)),
    VehicleServoOutput(6.2, 2000, tuple(range(1500, 1516))),
    VehicleBattery(6.3, None, 2.5, 80),
    VehicleMotionDelta(6.4, 3000, 0.5, (0.0, 0.0, 0.1), (0.5, 0.0, -0.1), 90.0),
    VehicleDepth(6.5, 4000, 123456.0, None, 12.5),
    VehicleRange(6.6, 4100, 3.25, None),
    PositionFix(6.65, 6.7, "gps_input", 48.1, -4.5, (1.0, 0.25, 2.0), 3.0),
    PositionFix(6.75, 6.8, "gps_input", 48.1, -4.5, None),
)


@pytest.fixture
def dive_with_vehicle(tmp_path):
    """Two seconds of link, and between its blocks what the vehicle's own messages said."""
    clock = FakeClocks()
    target = recorder(tmp_path, clock)
    blocks = feed(target, clock, 1.0)
    for record in VEHICLE:
        target.observe(record)
    blocks += feed(target, clock, 1.0)
    target.finish()
    return next(tmp_path.glob("session_*")), blocks


def test_the_vehicles_own_messages_come_back_as_the_same_records_in_their_place(dive_with_vehicle):
    session, blocks = dive_with_vehicle
    received = list(open_recording(session).received())
    assert received == [*blocks[:10], *VEHICLE, *blocks[10:]]
    assert list(decode(open_recording(session))) == list(VEHICLE)
    assert {topic: kind for kind, topic in JSON_TOPICS.items() if "/vehicle/" in topic} == VEHICLE_TOPICS


def test_estimates_come_back_as_they_were_two_a_second(tmp_path):
    clock = FakeClocks()
    target = recorder(tmp_path, clock)
    feed(target, clock, 0.1)
    states = [nav_state(clock.now_s + step * 0.05) for step in range(100)]
    for state in states:
        target.observe(state)
    target.finish()
    recording = open_recording(next(tmp_path.glob("session_*")))
    read = list(recording.navigation())
    assert len(read) == 10
    by_time = {state.measured_s: state for state in states}
    for state in read:
        original = by_time[state.measured_s]
        for name in NavState.__dataclass_fields__:
            np.testing.assert_equal(getattr(state, name), getattr(original, name))
    assert np.ptp(np.diff([state.measured_s for state in read])) < 1e-6
    assert not any(isinstance(record, NavState) for record in decode(recording))


def test_no_change_of_mode_and_no_jump_is_thinned_out(tmp_path):
    clock = FakeClocks()
    target = recorder(tmp_path, clock)
    feed(target, clock, 0.1)
    told = [(0.0, NavMode.AIDED, 0), (0.05, NavMode.DEAD_RECKONING, 0), (0.1, NavMode.DEAD_RECKONING, 1)]
    for after_s, mode, counter in told:
        target.observe(nav_state(clock.now_s + after_s, mode, counter))
    target.finish()
    read = list(open_recording(next(tmp_path.glob("session_*"))).navigation())
    assert [(state.mode, state.reset_counter) for state in read] == [told_[1:] for told_ in told]


async def test_a_replay_tells_what_the_vehicle_said(dive_with_vehicle):
    session, blocks = dive_with_vehicle
    source, told = ReplaySource(open_recording(session), None), []
    source.on_vehicle = told.append
    delivered, _ = await replayed(source)
    assert delivered == blocks
    assert told == list(VEHICLE)


async def replayed(source: ReplaySource) -> tuple[list[LinkBytes], list[PortState]]:
    blocks: list[LinkBytes] = []
    states: list[PortState] = []

    def on_data(data: bytes, arrived_s: float) -> int:
        assert arrived_s <= source.now_s()
        blocks.append(LinkBytes(data, arrived_s))
        return 0

    source.start(on_data, lambda: states.append(source.facts().state))
    await asyncio.wait_for(source.finished.wait(), 60)
    await source.stop()
    return blocks, states


@pytest.mark.parametrize("speed", [None, 200.0])
async def test_the_source_delivers_every_block_at_its_own_time_and_ends(dive, speed):
    session, blocks, _ = dive
    source = ReplaySource(open_recording(session), speed)
    delivered, states = await replayed(source)
    assert delivered == blocks
    assert states == [PortState.CONNECTED, PortState.FINISHED]
    assert source.facts().kind == "replay"
    assert source.now_s() >= blocks[-1].arrived_s
    assert not source.send(b"command")


async def test_the_source_says_what_it_could_not_read(dive, tmp_path):
    session, _, _ = dive
    cut = tmp_path / "link_000.mcap"
    cut.write_bytes(cut_in_half(session / "link_000.mcap"))
    source = ReplaySource(open_recording(cut), None)
    await replayed(source)
    assert "was cut short" in source.facts().detail


async def test_the_source_stops_at_once_when_asked(dive):
    session, blocks, _ = dive
    source = ReplaySource(open_recording(session), 0.001)
    delivered: list[bytes] = []
    first = asyncio.Event()

    def on_data(data: bytes, arrived_s: float) -> int:
        delivered.append(data)
        first.set()
        return 0

    source.start(on_data, lambda: None)
    await asyncio.wait_for(first.wait(), 10)
    await source.stop()
    assert len(delivered) < len(blocks)


@pytest.mark.parametrize("speed", [0.0, -1.0, 1e9])
def test_absurd_speeds_are_refused(dive, speed):
    with pytest.raises(RecordingError, match="expected above 0"):
        ReplaySource(open_recording(dive[0]), speed)


def test_records_carry_what_the_dive_held(dive):
    _, _, live = dive
    assert sum(isinstance(r, SensorSample) for r in live) > 30
    assert sum(isinstance(r, ImuBurst) for r in live) > 50
