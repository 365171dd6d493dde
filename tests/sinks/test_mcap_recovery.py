import shutil
from pathlib import Path

import orjson
import pytest
from mcap.reader import make_reader

from bluerov_slam.errors import RecordingError
from bluerov_slam.sinks.mcap_recovery import is_complete, recover_mcap, scan_mcap
from bluerov_slam.sinks.session_recovery import recover_sessions
from recording_samples import FakeClocks, feed, recorder


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished MCAP file of three seconds: seven chunks."""
    folder = tmp_path_factory.mktemp("finished")
    clock = FakeClocks()
    target = recorder(folder, clock)
    feed(target, clock, 3.0)
    target.finish()
    return next(folder.glob("*/link_000.mcap"))


def raw_messages(path: Path) -> list[tuple[int, bytes]]:
    """By the seeking reader, which uses the index."""
    with path.open("rb") as stream:
        return [(m.publish_time, m.data) for _, _, m in make_reader(stream).iter_messages(["/link/raw"])]


def test_a_file_cut_anywhere_reads_again_up_to_its_last_whole_chunk(finished, tmp_path):
    data = finished.read_bytes()
    whole = raw_messages(finished)
    ends = [chunk.chunk_start_offset + chunk.chunk_length for chunk in scan_mcap(finished).chunks]
    path = tmp_path / "link_000.mcap"
    for cut in range(len(data) - 1, ends[0], -97):
        path.write_bytes(data[:cut])
        recover_mcap(path)
        assert is_complete(path)
        recovered = raw_messages(path)
        assert recovered == whole[: len(recovered)]
        if cut >= ends[-1]:
            assert recovered == whole


def test_a_cut_before_the_first_chunk_leaves_a_valid_empty_file(finished, tmp_path):
    path = tmp_path / "link_000.mcap"
    first = scan_mcap(finished).chunks[0]
    path.write_bytes(finished.read_bytes()[: first.chunk_start_offset + 20])
    recover_mcap(path)
    assert raw_messages(path) == []


def test_zeros_after_a_power_cut_are_cut_away(finished, tmp_path):
    path = tmp_path / "link_000.mcap"
    third = scan_mcap(finished).chunks[3]
    path.write_bytes(finished.read_bytes()[: third.chunk_start_offset] + bytes(4096))
    recover_mcap(path)
    assert raw_messages(path) == raw_messages(finished)[: len(raw_messages(path))]
    assert len(raw_messages(path)) > 0


def test_a_damaged_chunk_ends_the_readable_part_and_a_long_rest_is_kept(finished, tmp_path, monkeypatch):
    monkeypatch.setattr("bluerov_slam.sinks.mcap_recovery._KEPT_TAIL_BYTES", 100)
    path = tmp_path / "link_000.mcap"
    data = bytearray(finished.read_bytes()[:-8])
    damaged = scan_mcap(finished).chunks[4]
    data[damaged.chunk_start_offset + damaged.chunk_length // 2] ^= 0xFF
    path.write_bytes(data)
    recover_mcap(path)
    assert 0 < len(raw_messages(path)) < len(raw_messages(finished))
    assert path.with_name("link_000.mcap.cut").read_bytes() == bytes(data[damaged.chunk_start_offset :])


def test_a_complete_file_is_left_as_it_is(finished):
    before = finished.read_bytes()
    content = recover_mcap(finished)
    assert finished.read_bytes() == before
    assert content.messages_by_topic["/link/raw"] == 30


def test_something_else_is_not_touched(tmp_path):
    path = tmp_path / "link_000.mcap"
    path.write_bytes(b"not a recording at all")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        recover_mcap(path)
    assert path.read_bytes() == b"not a recording at all"


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """A recordings folder whose recorder died in mid-session."""
    clock = FakeClocks()
    target = recorder(tmp_path / "live", clock)
    feed(target, clock, 3.0)
    shutil.copytree(tmp_path / "live", tmp_path / "killed")
    target.finish()
    return tmp_path / "killed"


def test_a_killed_session_is_repaired_at_the_next_start_and_its_counters_are_right(killed):
    (folder,) = killed.glob("session_*")
    assert not is_complete(folder / "link_000.mcap")
    assert recover_sessions(killed) == [folder.name]
    assert is_complete(folder / "link_000.mcap")
    session = orjson.loads((folder / "session.json").read_bytes())
    assert session["closed"] is True
    assert (session["pings_a"], session["pings_b"]) == (3, 3)
    assert session["duration_s"] == pytest.approx(2.9, abs=0.5)
    assert recover_sessions(killed) == [], "once is enough"


def test_titles_survive_the_repair(killed):
    (folder,) = killed.glob("session_*")
    session = orjson.loads((folder / "session.json").read_bytes())
    (folder / "session.json").write_bytes(orjson.dumps(session | {"title": "the wreck"}))
    recover_sessions(killed)
    assert orjson.loads((folder / "session.json").read_bytes())["title"] == "the wreck"


def test_a_session_without_its_description_gets_a_new_one(killed):
    (folder,) = killed.glob("session_*")
    (folder / "session.json").write_bytes(b'{"title": "cut sh')
    recover_sessions(killed)
    session = orjson.loads((folder / "session.json").read_bytes())
    assert session["started_unix_s"] == pytest.approx(1_700_000_005.0)
    assert session["started_mono_s"] == pytest.approx(5.0)
    assert session["pings_a"] == 3
    assert (folder / "session.json.damaged").read_bytes() == b'{"title": "cut sh'


def test_the_recorder_repairs_before_it_records(killed):
    told: list[str] = []
    clock = FakeClocks(mono_ns=100_000_000_000)
    target = recorder(killed, clock, on_event=lambda level, text: told.append(text))
    feed(target, clock, 1.0)
    target.finish()
    assert any("was cut short; it has been repaired" in text for text in told)
    assert all(is_complete(path) for path in killed.glob("*/link_*.mcap"))
