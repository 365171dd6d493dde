"""The files of a session with the rig: what the readers of the product make of them, and a disk that takes no more."""

from collections import Counter

import numpy as np
import orjson
import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.protocol.rig_link import RigFrameDecoder, encode_where
from bluerov_slam.records import AcousticRecord
from bluerov_slam.rig.collection import Close, Discard, Keep, Motion, Move, Open, Point, Result, SendDepth, Session
from bluerov_slam.sinks.rig_recording import EVENT_TOPIC, LINK_TOPICS, POINT_TOPIC, SESSION_TOPIC, SET_POINT_TOPIC
from bluerov_slam.sinks.rig_session import SIMULATED, RigSessionFiles
from bluerov_slam.sources.acoustic_records import read_acoustic_records
from bluerov_slam.sources.isbl_thesis_log import parse_thesis_log
from bluerov_slam.sources.recording_reader import open_recording
from full_disk import largest_file

SESSION = Session("s", (1426.0, 0.0, -694.0), Motion.RAPID, {"Z": (8.0, 0.0)}, "Z")
COVARIANCE = (4.0 * np.eye(6))[:3, :3]  # part of a larger one, as `rig/collection_truth.py` gives it
RAISED = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])
RESULT = Result(np.ones(3), np.full(3, 2.0), np.full(3, 3.0), np.array([0.01, 0.02, 0.03]))
WHOLE = Point("s", 1, "Z", 8.0, RAISED, np.full(3, 4.0), True, RESULT, np.full(3, 5.0), COVARIANCE)
MISSING = Point("s", 2, "Z", 0.0, np.zeros(6), np.full(3, 4.0), False, missing="the link to the rig is silent")
ACTIONS = [
    Open(SESSION), Discard(), SendDepth(0.11, 1), Move(np.zeros(6), RAISED, 20), Keep(WHOLE), Keep(MISSING), Close(),
]  # fmt: skip


def record(number):
    samples = np.random.default_rng(number).integers(-2048, 2048, (4, 256), dtype=np.int16)
    return AcousticRecord(float(number), float(number), number, 851_393.0, samples, 12, 0)


def messages(path, topic):
    return [orjson.loads(message.data) for message in open_recording(path).messages((topic,))]


@pytest.fixture
def folder(tmp_path):
    files = RigSessionFiles(tmp_path, "s", SIMULATED)
    for number, action in enumerate(ACTIONS):
        files.record(record(number))
        files.take(action, float(number), {"ours_mm": np.full(3, np.nan)} if isinstance(action, Keep) else None)
    files.close()
    return tmp_path


def test_points_set_points_and_events_come_back(folder):
    path = folder / "s.mcap"
    recording = open_recording(path)
    assert recording.simulated
    assert recording.wall_offset_ns is None
    whole, missing = messages(path, POINT_TOPIC)
    assert whole["set_point_mm"] == [0.0, 0.0, 2.0]
    assert whole["truth_mm"] == [5.0] * 3
    assert whole["truth_std_mm"] == [2.0] * 3
    assert whole["raw_mm"] == [3.0] * 3
    assert whole["ours_mm"] == [None] * 3
    assert missing["missing"] == "the link to the rig is silent"
    assert (missing["raw_mm"], missing["truth_mm"]) == (None, None)
    (move,) = messages(path, SET_POINT_TOPIC)
    assert (move["end_mm"], move["steps"], move["step_s"]) == ([0.0, 0.0, 2.0], 20, 0.05)
    assert messages(path, SESSION_TOPIC)[0]["transmitter_mm"] == [1426.0, 0.0, -694.0]
    assert [each["type"] for each in messages(path, EVENT_TOPIC)] == ["rig_discard", "rig_depth", "rig_end"]
    assert recording.problems == []


def test_what_the_receiver_heard_is_read_as_any_arrays_records(folder):
    found = read_acoustic_records(folder / "s.mcap")
    assert [each.record_id for each in found] == list(range(len(ACTIONS)))
    for each in found:
        np.testing.assert_array_equal(each.samples, record(each.record_id).samples)
        assert each.bits == 12


def test_the_other_logs_hold_the_same_point(folder):
    rows = parse_thesis_log("test_x1426_y0_z-694_d_r", (folder / "s.log").read_text(encoding="ascii"), Counter()).rows
    assert rows.raw_mm[0].tolist() == [3.0] * 3
    lines = [orjson.loads(line) for line in (folder / "s.jsonl").read_bytes().splitlines()]
    points = [line for line in lines if line["type"] == "rig_point"]
    assert [{k: v for k, v in point.items() if k not in ("source", "t_unix")} for point in points] == messages(
        folder / "s.mcap", POINT_TOPIC
    )


def test_a_real_rigs_links_are_there_byte_by_byte(tmp_path):
    files = RigSessionFiles(tmp_path, "s", "/dev/ttyUSB0")
    files.take(ACTIONS[0], 5.0)
    for sequence in (1, 2):
        files.link("rig", True, encode_where(sequence), 5.0 + sequence)
    files.link("receiver", False, b"1", 8.0)
    files.close()
    recording = open_recording(tmp_path / "s.mcap")
    assert not recording.simulated
    assert recording.wall_offset_ns is not None
    down = b"".join(message.data for message in recording.messages((LINK_TOPICS["rig", True],)))
    assert [body[0] for _, body in RigFrameDecoder().feed(down)] == [1, 2]
    (heard,) = recording.messages((LINK_TOPICS["receiver", False],))
    assert (heard.data, heard.publish_ns) == (b"1", 8_000_000_000)
    with pytest.raises(RecordingError, match="no acoustic record"):
        read_acoustic_records(tmp_path / "s.mcap")


def test_a_name_that_is_taken_or_a_folder_that_is_none_is_said(tmp_path):
    RigSessionFiles(tmp_path, "s", SIMULATED).close()
    with pytest.raises(RecordingError, match="File exists"):
        RigSessionFiles(tmp_path, "s", SIMULATED)
    with pytest.raises(RecordingError, match="give a folder on another disk"):
        RigSessionFiles(tmp_path / "none", "s", SIMULATED)


def test_a_disk_that_takes_no_more_is_said_and_leaves_what_was_whole(tmp_path):
    files = RigSessionFiles(tmp_path, "s", SIMULATED)
    files.take(ACTIONS[0], 0.0)
    files.take(Keep(WHOLE), 1.0)
    files.record(record(1))
    with largest_file(256), pytest.raises(RecordingError, match=r"cannot write into .*; what was collected so far"):
        files.take(Keep(WHOLE), 2.0)
    files.close()
    assert len(messages(tmp_path / "s.mcap", POINT_TOPIC)) >= 1
    first = orjson.loads((tmp_path / "s.jsonl").read_bytes().splitlines()[1])
    assert first["raw_mm"] == [3.0] * 3
