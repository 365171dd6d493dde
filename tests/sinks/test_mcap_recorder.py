import errno
import json
import os
import random
import shutil
import tracemalloc
from dataclasses import replace
from pathlib import Path

import orjson
import pytest
from mcap.reader import make_reader

from bluerov_slam.pipeline.health import RecorderState
from bluerov_slam.protocol.waterfall_frame import unpack_ping
from bluerov_slam.records import Channel, Event, EventLevel, FixType, LinkBytes, LinkBytesSent
from bluerov_slam.sinks import append_file
from bluerov_slam.sinks.dive_track import DiveTrack
from bluerov_slam.sinks.mcap_log import SESSION_METADATA, McapLog
from bluerov_slam.sinks.mcap_recorder import PRE_ROLL_BYTES, RecordingLimits
from bluerov_slam.sinks.mcap_recovery import is_complete, scan_mcap
from bluerov_slam.sources.recording_reader import open_recording
from recording_samples import FakeClocks, feed, gps_fix, ping, recorder, sensor_sample


@pytest.fixture
def clock() -> FakeClocks:
    return FakeClocks()


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> "FullDisk":
    return FullDisk(monkeypatch)


class FullDisk:
    """Lets the kernel refuse writes of the recorder's files, after taking half of the block, until told otherwise."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.error: int | None = None
        self._write = os.write
        monkeypatch.setattr(append_file.os, "write", self)

    def __call__(self, descriptor: int, data: memoryview) -> int:
        if self.error is None:
            return self._write(descriptor, data)
        self._write(descriptor, data[: len(data) // 2])
        raise OSError(self.error, os.strerror(self.error))


def messages(path: Path, topic: str) -> list[tuple[int, int, bytes]]:
    with path.open("rb") as stream:
        return [(m.publish_time, m.log_time, m.data) for _, _, m in make_reader(stream).iter_messages([topic])]


def raw_messages(parts: list[Path]) -> list[tuple[int, int, bytes]]:
    return [message for part in parts for message in messages(part, "/link/raw")]


def only_session(folder: Path) -> Path:
    (session,) = folder.glob("session_*")
    return session


def test_names_a_session_for_its_start_and_records_from_the_first_valid_frame(tmp_path, clock):
    target = recorder(tmp_path, clock)
    target.observe(LinkBytes(b"before", clock.now_s))
    target.cycle()
    assert target.facts().state is RecorderState.WAITING
    assert not list(tmp_path.glob("session_*"))
    target.observe(sensor_sample(clock.now_s))
    target.cycle()
    assert target.facts().state is RecorderState.RECORDING
    assert target.active_name == "session_20231114_221325"
    assert target.log_path == str(tmp_path / "session_20231114_221325" / "session_20231114_221325.jsonl")
    target.finish()
    assert [data for _, _, data in messages(only_session(tmp_path) / "link_000.mcap", "/link/raw")] == [b"before"]


def test_keeps_every_block_with_its_own_arrival_time_and_one_fixed_wall_offset(tmp_path, clock):
    target = recorder(tmp_path, clock)
    blocks = feed(target, clock, 2.0)
    clock.wall_offset_ns += 3600_000_000_000
    blocks += feed(target, clock, 2.0)
    target.finish()
    recorded = messages(only_session(tmp_path) / "link_000.mcap", "/link/raw")
    assert [(publish / 1e9, data) for publish, _, data in recorded] == [(b.arrived_s, b.data) for b in blocks]
    assert {log - publish for publish, log, _ in recorded} == {1_700_000_000_000_000_000}


def test_a_wall_clock_step_is_recorded_as_an_event_and_in_the_session_file(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    clock.wall_offset_ns += 3600_000_000_000
    feed(target, clock, 1.0)
    target.finish()
    (event,) = messages(only_session(tmp_path) / "link_000.mcap", "/event")
    assert orjson.loads(event[2])["text"].startswith("the wall clock stepped by +3600.0 s")
    (step,) = orjson.loads((only_session(tmp_path) / "session.json").read_bytes())["wall_steps"]
    assert step["step_s"] == pytest.approx(3600.0)


def test_gps_time_dates_a_session_whose_wall_clock_was_wrong(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    utc = 1_760_000_000.0 + clock.now_s
    target.observe(gps_fix(clock.now_s, utc))
    target.cycle()
    session = orjson.loads((only_session(tmp_path) / "session.json").read_bytes())
    assert session["gps_utc_offset_s"] == pytest.approx(60_000_000.0)
    assert session["wall_clock_trusted"] is False
    assert session["started_unix_s"] == pytest.approx(1_700_000_005.1)


def test_the_time_of_a_receiver_without_a_fix_dates_nothing(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    own_clock = replace(gps_fix(clock.now_s, 1_000_000_000.0), fix=FixType.NONE, latitude_deg=None, longitude_deg=None)
    target.observe(own_clock)
    feed(target, clock, 1.0)
    target.finish()
    session = orjson.loads((only_session(tmp_path) / "session.json").read_bytes())
    assert (session["gps_utc_offset_s"], session["wall_clock_trusted"]) == (None, None)
    assert DiveTrack.of([own_clock], 5.0).utc_offset_s == 5.0


def test_gps_time_that_agrees_makes_the_wall_clock_trusted(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    target.observe(gps_fix(clock.now_s, 1_700_000_000.0 + clock.now_s - 0.4))
    target.observe(gps_fix(clock.now_s, None))
    target.finish()
    session = orjson.loads((only_session(tmp_path) / "session.json").read_bytes())
    assert session["wall_clock_trusted"] is True
    assert session["gps_utc_offset_s"] == pytest.approx(-0.4, abs=1e-6)


def test_decoded_records_stand_beside_the_raw_bytes(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    target.observe(LinkBytesSent(b"down", clock.now_s))
    target.observe(Event(clock.now_s, EventLevel.WARNING, "sonar B is silent"))
    target.finish()
    path = only_session(tmp_path) / "link_000.mcap"
    assert scan_mcap(path).messages_by_topic == {
        "/link/raw": 10, "/link/raw_down": 1, "/ping/a": 1, "/ping/b": 1, "/sensors": 1, "/ctd": 1, "/event": 1,
    }  # fmt: skip
    sample = orjson.loads(messages(path, "/sensors")[0][2])
    assert sample["gps_latitude_deg"] is None
    assert sample["temperature_degc"] == 15.2
    binary = unpack_ping(messages(path, "/ping/b")[0][2])
    assert binary.ping.samples.tolist() == list(range(100))
    assert binary.time_unix_s == pytest.approx(1_700_000_005.1)


def test_schemas_describe_the_recorded_json(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    target.finish()
    with (only_session(tmp_path) / "link_000.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(["/sensors", "/ctd"]):
            described = json.loads(schema.data)
            assert channel.message_encoding == "json"
            assert set(json.loads(message.data)) == set(described["properties"])


def test_the_text_log_holds_the_seed_keys_and_both_clocks(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 3.0)
    target.finish()
    lines = [json.loads(line) for line in next(only_session(tmp_path).glob("*.jsonl")).read_text().splitlines()]
    assert len(lines) == 3
    assert set(lines[0]) == {
        "ts", "imu", "gps", "ec", "depth", "celsius", "ctd", "ka", "kb", "t_mono", "t_unix",
    }  # fmt: skip
    assert lines[0]["t_unix"] - lines[0]["t_mono"] == pytest.approx(1.7e9)
    assert lines[0]["ctd"]["s"] == 35.2  # saturated on the wire, computed here
    assert [line["ka"]["alive"] for line in lines] == [False, True, True]
    assert [line["kb"]["alive"] for line in lines] == [False, False, False]


def test_begins_a_new_file_by_time_and_loses_no_block(tmp_path, clock):
    target = recorder(tmp_path, clock, RecordingLimits(max_file_s=2.0, min_free_bytes=0))
    blocks = feed(target, clock, 7.0)
    target.finish()
    parts = sorted(only_session(tmp_path).glob("link_*.mcap"))
    assert len(parts) >= 3
    assert all(is_complete(part) for part in parts)
    assert raw_messages(parts) == [
        (round(b.arrived_s * 1e9), round(b.arrived_s * 1e9) + 1_700_000_000_000_000_000, b.data) for b in blocks
    ]
    name = only_session(tmp_path).name
    assert (only_session(tmp_path) / f"{name}.1.jsonl").exists()


def test_begins_a_new_file_by_size(tmp_path, clock):
    target = recorder(tmp_path, clock, RecordingLimits(max_file_bytes=9_000, min_free_bytes=0))
    blocks = feed(target, clock, 5.0, random.Random(1).randbytes(2000))
    target.finish()
    parts = sorted(only_session(tmp_path).glob("link_*.mcap"))
    assert len(parts) >= 4
    assert sum(len(messages(part, "/link/raw")) for part in parts) == len(blocks)


def test_stops_before_the_disk_is_full_and_resumes_by_itself_without_losing_a_block(tmp_path, clock, monkeypatch):
    target = recorder(tmp_path, clock, RecordingLimits(min_free_bytes=1_000_000))
    free = [50_000_000]
    monkeypatch.setattr(
        "bluerov_slam.sinks.disk_guard.shutil.disk_usage",
        lambda path: type("Usage", (), {"free": free[0], "total": 100_000_000})(),
    )
    blocks = feed(target, clock, 3.0)
    free[0] = 900_000
    blocks += feed(target, clock, 4.0)
    facts = target.facts()
    assert facts.state is RecorderState.DISK_FULL
    assert "recording.min_free_mb" in facts.error
    assert facts.queue > 0
    free[0] = 1_050_000
    blocks += feed(target, clock, 4.0)
    assert target.facts().state is RecorderState.DISK_FULL, "resumes only with a margin"
    free[0] = 5_000_000
    blocks += feed(target, clock, 4.0)
    assert target.facts().state is RecorderState.RECORDING
    target.finish()
    parts = sorted(only_session(tmp_path).glob("link_*.mcap"))
    assert all(is_complete(part) for part in parts)
    recorded = raw_messages(parts)
    assert [publish / 1e9 for publish, _, _ in recorded] == [b.arrived_s for b in blocks]
    assert target.facts().dropped == 0


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO, errno.EROFS])
def test_a_disk_that_refuses_a_block_costs_nothing_once_it_takes_it_again(tmp_path, clock, full_disk, code):
    target = recorder(tmp_path, clock)
    blocks = feed(target, clock, 2.0)
    full_disk.error = code
    blocks += feed(target, clock, 5.0)
    facts = target.facts()
    assert facts.state is (RecorderState.DISK_FULL if code == errno.ENOSPC else RecorderState.FAILED)
    assert os.strerror(code) in facts.error
    full_disk.error = None
    blocks += feed(target, clock, 5.0)
    assert target.facts().state is RecorderState.RECORDING
    target.finish()
    parts = sorted(only_session(tmp_path).glob("link_*.mcap"))
    assert len(parts) == 2, "one part per interruption, however often it was tried"
    assert all(is_complete(part) for part in parts)
    recorded = raw_messages(parts)
    assert [publish / 1e9 for publish, _, _ in recorded] == [b.arrived_s for b in blocks]
    lines = [json.loads(line) for line in next(only_session(tmp_path).glob("*.jsonl")).read_text().splitlines()]
    assert len(lines) == 12
    assert target.facts().dropped == 0


def test_what_the_queue_cannot_hold_is_dropped_oldest_first_and_is_an_error(tmp_path, clock, full_disk):
    told: list[tuple[EventLevel, str]] = []
    limits = RecordingLimits(min_free_bytes=0, queue_bytes=20_000)
    target = recorder(tmp_path, clock, limits, on_event=lambda level, text: told.append((level, text)))
    feed(target, clock, 1.0)
    full_disk.error = errno.ENOSPC
    blocks = feed(target, clock, 30.0)
    assert target.facts().dropped > 0
    assert any(level is EventLevel.ERROR and "are lost" in text for level, text in told)
    full_disk.error = None
    clock.advance(3.0)
    target.finish()
    parts = sorted(only_session(tmp_path).glob("link_*.mcap"))
    recorded = raw_messages(parts)
    assert recorded[-1][0] / 1e9 == blocks[-1].arrived_s


def test_a_folder_that_cannot_be_made_is_named_with_its_cure_and_tried_again(tmp_path, clock):
    blocker = tmp_path / "recordings"
    blocker.write_text("a file where the folder should be")
    told: list[str] = []
    target = recorder(blocker, clock, on_event=lambda level, text: told.append(text))
    feed(target, clock, 5.0)
    assert target.facts().state is RecorderState.FAILED
    assert "remove it or set recording.folder" in target.facts().error
    assert len(told) == 1, "said once, not at every try"
    blocker.unlink()
    blocks = feed(target, clock, 5.0)
    assert target.facts().state is RecorderState.RECORDING
    target.finish()
    recorded = messages(only_session(blocker) / "link_000.mcap", "/link/raw")
    assert len(recorded) == 2 * len(blocks), "what came meanwhile waited in the queue"


def test_switching_off_closes_the_session_and_switching_on_begins_another(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    target.request_stop()
    feed(target, clock, 1.0)
    assert target.facts().state is RecorderState.OFF
    target.request_start()
    feed(target, clock, 1.0)
    assert target.facts().state is RecorderState.RECORDING
    target.finish()
    sessions = sorted(tmp_path.glob("session_*"))
    assert len(sessions) == 2
    assert [len(messages(s / "link_000.mcap", "/link/raw")) for s in sessions] == [10, 10]


def test_two_sessions_of_one_second_get_two_names(tmp_path, clock):
    first, second = recorder(tmp_path / "a", clock), recorder(tmp_path / "a", clock)
    feed(first, clock, 0.1)
    first.finish()
    clock.mono_ns -= 100_000_000
    feed(second, clock, 0.1)
    second.finish()
    assert len(list((tmp_path / "a").glob("session_*"))) == 2


def test_a_second_recorder_in_the_same_folder_is_refused_and_says_so(tmp_path, clock):
    first, second = recorder(tmp_path, clock), recorder(tmp_path, clock)
    feed(first, clock, 1.0)
    feed(second, clock, 1.0)
    assert second.facts().state is RecorderState.FAILED
    assert "another process records" in second.facts().error
    first.finish()
    assert len(list(tmp_path.glob("session_*"))) == 1


def test_switched_off_it_queues_nothing(tmp_path, clock):
    target = recorder(tmp_path, clock, enabled=False)
    feed(target, clock, 2.0)
    assert target.facts().queue == 0
    assert target.facts().state is RecorderState.OFF
    assert not list(tmp_path.iterdir())


def test_bytes_before_the_first_frame_are_bounded_and_not_called_lost(tmp_path, clock):
    target = recorder(tmp_path, clock)
    for _ in range(100):
        target.observe(LinkBytes(bytes(4096), clock.now_s))
    assert 0 < target.facts().queue <= PRE_ROLL_BYTES // 4096
    assert target.facts().dropped == 0


def test_the_thread_records_what_it_is_given_until_it_is_stopped(tmp_path):
    target = recorder(tmp_path, FakeClocks(mono_ns=9_000_000_000))
    target.start()
    target.observe(sensor_sample(9.0))
    for number in range(500):
        target.observe(LinkBytes(b"block %d" % number, 9.0 + number * 1e-3))
        target.observe(ping(Channel.A, 9.0 + number * 1e-3, number))
    target.stop()
    path = only_session(tmp_path) / "link_000.mcap"
    assert is_complete(path)
    assert scan_mcap(path).messages_by_topic == {"/link/raw": 500, "/ping/a": 500, "/sensors": 1}


def test_decoder_settings_travel_with_the_recording(tmp_path, clock):
    target = recorder(tmp_path, clock, decoder_settings={"kogger_checksum": "mod255"})
    feed(target, clock, 1.0)
    target.finish()
    metadata = scan_mcap(only_session(tmp_path) / "link_000.mcap").metadata[SESSION_METADATA]
    assert json.loads(metadata["decoder_settings"]) == {"kogger_checksum": "mod255"}


def test_a_record_that_cannot_be_encoded_costs_itself_and_no_raw_byte(tmp_path, clock):
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    target.observe(ping(Channel.A, clock.now_s, samples=70_000))  # its binary form counts up to 65535
    blocks = feed(target, clock, 2.0)
    target.finish()
    content = scan_mcap(only_session(tmp_path) / "link_000.mcap")
    assert content.messages_by_topic["/link/raw"] == 10 + len(blocks)
    assert content.messages_by_topic["/ping/a"] == 3


def test_an_hour_of_flushes_costs_little_memory(tmp_path, clock):
    log = McapLog(tmp_path / "link.mcap", 0, {})
    tracemalloc.start()
    try:
        for number in range(1500):
            log.write_raw(b"block", number)
            log.write_record(ping(Channel.A, clock.now_s))
            log.write_record(sensor_sample(clock.now_s))
            log.flush()
            if number == 99:
                before = tracemalloc.get_traced_memory()[0]
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    log.finish()
    assert grown / 1400 < 300, "bytes per flush"
    assert len(messages(tmp_path / "link.mcap", "/link/raw")) == 1500


def test_switching_off_on_a_full_disk_counts_what_is_lost_and_the_rest_is_repaired_later(tmp_path, clock, full_disk):
    target = recorder(tmp_path, clock)
    blocks = feed(target, clock, 2.0)
    full_disk.error = errno.ENOSPC
    feed(target, clock, 1.0)
    target.request_stop()
    clock.advance(3.0)
    target.cycle()
    assert target.facts().state is RecorderState.OFF
    assert target.facts().dropped > 0
    full_disk.error = None
    later = FakeClocks(mono_ns=100_000_000_000)
    target.finish()
    second = recorder(tmp_path, later)
    feed(second, later, 1.0)
    second.finish()
    parts = sorted(min(tmp_path.glob("session_*")).glob("link_*.mcap"))
    assert all(is_complete(part) for part in parts)
    assert [publish / 1e9 for publish, _, _ in raw_messages(parts)] == [
        b.arrived_s for b in blocks[: len(raw_messages(parts))]
    ]
    assert len(raw_messages(parts)) >= 16


def test_a_sample_without_a_line_costs_no_raw_byte(tmp_path, clock, monkeypatch):
    def broken(*_: object) -> None:
        raise ValueError("a sample nobody foresaw")

    monkeypatch.setattr("bluerov_slam.sinks.jsonl_log.sensor_json", broken)
    target = recorder(tmp_path, clock)
    blocks = feed(target, clock, 3.0)
    assert target.facts().state is RecorderState.RECORDING
    target.finish()
    (path,) = only_session(tmp_path).glob("link_*.mcap")
    assert len(messages(path, "/link/raw")) == len(blocks)


def test_when_much_waits_decoded_pings_give_way_to_raw_bytes(tmp_path, clock, full_disk):
    told: list[str] = []
    limits = RecordingLimits(min_free_bytes=0, queue_bytes=60_000)
    target = recorder(tmp_path, clock, limits, on_event=lambda level, text: told.append(text))
    blocks = feed(target, clock, 1.0)
    full_disk.error = errno.ENOSPC
    for _ in range(100):
        clock.advance(0.01)
        blocks.append(LinkBytes(b"block", clock.now_s))
        target.observe(blocks[-1])
        target.observe(ping(Channel.A, clock.now_s))
        target.cycle()
    full_disk.error = None
    blocks += feed(target, clock, 5.0)
    target.finish()
    parts = sorted(only_session(tmp_path).glob("link_*.mcap"))
    assert [publish / 1e9 for publish, _, _ in raw_messages(parts)] == [b.arrived_s for b in blocks]
    assert target.facts().dropped == 0
    pings = sum(len(messages(part, topic)) for part in parts for topic in ("/ping/a", "/ping/b"))
    assert 12 < pings < 112
    assert any(f"{112 - pings} decoded pings, IMU bursts and estimates were left out" in text for text in told)


@pytest.mark.parametrize("what", ["session", "moved", "mcap", "jsonl", "everything"])
def test_a_session_deleted_while_it_is_written_is_followed_by_a_new_one(tmp_path, clock, what):
    told: list[str] = []
    folder = tmp_path / "recordings"
    target = recorder(folder, clock, on_event=lambda level, text: told.append(text))
    feed(target, clock, 2.0)
    first = only_session(folder)
    {
        "session": lambda: shutil.rmtree(first),
        "moved": lambda: first.rename(tmp_path / "kept"),
        "mcap": (first / "link_000.mcap").unlink,
        "jsonl": next(first.glob("*.jsonl")).unlink,
        "everything": lambda: shutil.rmtree(folder),
    }[what]()
    blocks = feed(target, clock, 2.0)
    second = target.active_name
    assert target.facts().state is RecorderState.RECORDING
    target.finish()
    assert second != first.name
    assert [text for text in told if f"{first.name} was deleted or moved" in text]
    read = [LinkBytes(m.data, m.publish_ns / 1e9) for m in open_recording(folder / second).messages(("/link/raw",))]
    assert read[-len(blocks) :] == blocks, "nothing after the deletion is lost"
