import asyncio
import io
import threading
import zipfile
from contextlib import asynccontextmanager
from pathlib import Path

import aiohttp
import orjson
import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.services.annotations import MAX_TEXT
from bluerov_slam.services.change_guard import ChangeGuard
from bluerov_slam.services.http import ServicePage, WebServer, build_app
from bluerov_slam.services.recording_api import recording_routes
from bluerov_slam.services.recordings import RecordingStore, UnknownRecordingError
from bluerov_slam.sinks.mcap_recorder import Recorder
from recording_samples import FakeClocks, feed, recorder

PAGE = ServicePage("Test", "for tests", "mdi-radar", "1.0.0", "dashboard")
FIRST = "session_20231114_221325"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A recordings folder with two finished dives."""
    root = tmp_path / "recordings"
    for mono_ns in (5_000_000_000, 500_000_000_000):
        clock = FakeClocks(mono_ns=mono_ns)
        target = recorder(root, clock)
        feed(target, clock, 3.0)
        target.finish()
    return root


@asynccontextmanager
async def served(store: RecordingStore, target: Recorder | None = None):
    app = build_app(
        PAGE, recording_routes(store, target), guard=ChangeGuard(lambda: (), lambda: ""), metrics=lambda: b""
    )
    server = WebServer(app)
    await server.start("127.0.0.1", 0, "http.port")
    base = f"http://127.0.0.1:{server.port}"
    try:
        async with aiohttp.ClientSession(base, headers={"Origin": base}) as session:
            yield session
    finally:
        await server.stop()


def test_lists_dives_newest_first_with_everything_the_page_shows(folder):
    overview = RecordingStore(folder).overview()
    assert overview["folder"] == str(folder)
    assert overview["active"] is None
    assert overview["total_bytes"] > overview["free_bytes"] > 0
    newest, oldest = overview["recordings"]
    assert oldest["name"] == FIRST
    assert newest["name"] > oldest["name"]
    assert {file["name"] for file in oldest["files"]} == {f"{FIRST}.jsonl", "link_000.mcap", "session.json"}
    assert oldest["bytes"] == sum((folder / FIRST / file["name"]).stat().st_size for file in oldest["files"])
    assert oldest["duration_s"] == pytest.approx(2.9)
    assert (oldest["pings_a"], oldest["pings_b"]) == (3, 3)
    assert set(oldest) == {
        "name", "title", "notes", "started_unix_s", "duration_s", "bytes", "files", "pings_a", "pings_b", "active",
        "wall_clock_trusted", "gps_utc_offset_s", "annotations",
    }  # fmt: skip


def test_a_missing_folder_is_an_empty_list(tmp_path):
    assert RecordingStore(tmp_path / "none").overview()["recordings"] == []


def test_title_and_notes_are_kept(folder):
    store = RecordingStore(folder)
    store.rename(FIRST, {"title": "Épave du Nord", "notes": "strong current\nat 12 m"})
    assert store.details(FIRST)["title"] == "Épave du Nord"
    assert store.details(FIRST)["notes"] == "strong current\nat 12 m"
    assert store.details(FIRST)["pings_a"] == 3


@pytest.mark.parametrize(
    "changes", [{"title": 5}, {"title": None}, {"closed": False}, {"notes": "x" * (MAX_TEXT + 1)}, {"../x": "y"}]
)
def test_a_rename_that_makes_no_sense_changes_nothing(folder, changes):
    before = (folder / FIRST / "session.json").read_bytes()
    with pytest.raises(RecordingError):
        RecordingStore(folder).rename(FIRST, changes)
    assert (folder / FIRST / "session.json").read_bytes() == before


def test_annotations_are_added_changed_and_removed(folder):
    store = RecordingStore(folder)
    note = store.add_annotation(FIRST, {"text": "thermocline", "time_unix_s": 1.7e9})
    contact = store.add_annotation(
        FIRST, {"kind": "contact", "name": "anchor", "channel": "A", "ping_number": 7, "range_m": 12.5}
    )
    assert note["kind"] == "note"
    changed = store.change_annotation(FIRST, contact["id"], {"name": "big anchor", "latitude_deg": None})
    assert changed["name"] == "big anchor"
    assert changed["range_m"] == 12.5
    store.remove_annotation(FIRST, note["id"])
    assert store.annotations(FIRST) == [changed]
    with pytest.raises(UnknownRecordingError):
        store.remove_annotation(FIRST, note["id"])


@pytest.mark.parametrize(
    "given",
    [
        {"kind": "virus"}, {"channel": "C"}, {"range_m": "far"}, {"id": "../x"}, {"latitude_deg": 91},
        {"time_unix_s": float("nan")}, {"time_unix_s": True}, {"text": ["a"]}, {"x": 1}, {"name": "n" * (MAX_TEXT + 1)},
    ],
)  # fmt: skip
def test_an_annotation_that_makes_no_sense_is_refused(folder, given):
    store = RecordingStore(folder)
    with pytest.raises(RecordingError):
        store.add_annotation(FIRST, given)
    assert store.annotations(FIRST) == []


def test_adding_an_annotation_twice_keeps_one(folder):
    store = RecordingStore(folder)
    store.add_annotation(FIRST, {"id": "abc123", "kind": "contact", "name": "first"})
    store.add_annotation(FIRST, {"id": "abc123", "kind": "contact", "name": "again", "range_m": -12.0})
    (kept,) = store.annotations(FIRST)
    assert (kept["name"], kept["range_m"]) == ("again", -12.0)


def test_annotations_of_the_dive_being_recorded_survive_its_end(tmp_path):
    clock = FakeClocks()
    target = recorder(tmp_path, clock)
    store = RecordingStore(tmp_path, lambda: target.active_name)
    with pytest.raises(RecordingError, match="nothing is being recorded"):
        store.add_annotation("active", {"text": "too early"})
    feed(target, clock, 1.0)
    note = store.add_annotation("active", {"text": "on the bottom"})
    feed(target, clock, 1.0)
    target.finish()
    (recording,) = store.overview()["recordings"]
    assert recording["annotations"] == [note]
    assert recording["pings_a"] == 2


def test_the_recorder_and_the_page_may_write_the_description_at_the_same_time(folder):
    store = RecordingStore(folder)
    threads = [
        threading.Thread(target=lambda n=n: [store.add_annotation(FIRST, {"text": f"{n}.{k}"}) for k in range(10)])
        for n in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(store.annotations(FIRST)) == 40


@pytest.mark.parametrize(
    "name",
    ["..", ".", "", "/etc", "../" + FIRST, FIRST + "/..", "session_2023", FIRST + "\n", FIRST + "\x00", "active/.."],
)
def test_names_cannot_leave_the_folder(folder, name):
    store = RecordingStore(folder)
    for call in (store.details, store.delete, store.export, store.annotations):
        with pytest.raises(RecordingError):
            call(name)
    assert len(store.overview()["recordings"]) == 2


@pytest.mark.parametrize(
    "file", ["../secret", "secret", "/etc/passwd", "..", "link_000.mcap/..", "session.json.new", ""]
)
def test_files_cannot_leave_their_dive(folder, file):
    (folder / "secret").write_text("secret")
    with pytest.raises(UnknownRecordingError):
        RecordingStore(folder).file(FIRST, file)


def test_links_out_of_the_folder_are_not_followed(folder, tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "session.json").write_text("{}")
    (folder / "session_20990101_000000").symlink_to(outside)
    (folder / FIRST / "link_001.mcap").symlink_to("/etc/passwd")
    store = RecordingStore(folder)
    assert len(store.overview()["recordings"]) == 2
    with pytest.raises(UnknownRecordingError):
        store.delete("session_20990101_000000")
    with pytest.raises(UnknownRecordingError):
        store.file(FIRST, "link_001.mcap")
    names = zipfile.ZipFile(io.BytesIO(b"".join(store.export(FIRST)))).namelist()
    assert f"{FIRST}/link_001.mcap" not in names
    assert outside.exists()


def test_the_dive_being_recorded_cannot_be_deleted(tmp_path):
    clock = FakeClocks()
    target = recorder(tmp_path, clock)
    feed(target, clock, 1.0)
    store = RecordingStore(tmp_path, lambda: target.active_name)
    with pytest.raises(RecordingError, match="stop the recording first"):
        store.delete(str(target.active_name))
    name = str(target.active_name)
    target.finish()
    store.delete(name)
    assert store.overview()["recordings"] == []


def test_an_export_holds_every_file_as_it_is(folder):
    archive = zipfile.ZipFile(io.BytesIO(b"".join(RecordingStore(folder).export(FIRST))))
    assert archive.testzip() is None
    for name in ("link_000.mcap", f"{FIRST}.jsonl", "session.json"):
        assert archive.read(f"{FIRST}/{name}") == (folder / FIRST / name).read_bytes()


def test_an_export_is_made_in_small_blocks(folder):
    (folder / FIRST / "link_001.mcap").write_bytes(bytes(3_000_000))
    blocks = list(RecordingStore(folder).export(FIRST))
    assert max(len(block) for block in blocks) < 300_000
    assert len(blocks) >= 12


async def test_the_api_lists_renames_annotates_and_deletes(folder):
    async with served(RecordingStore(folder)) as client:
        listed = await (await client.get("/api/recordings")).json()
        assert [r["name"] for r in listed["recordings"]][-1] == FIRST
        answer = await client.patch(f"/api/recordings/{FIRST}", json={"title": "wreck"})
        assert (await answer.json())["title"] == "wreck"
        answer = await client.post(f"/api/recordings/{FIRST}/annotations", json={"text": "here"})
        assert answer.status == 201
        answer = await client.delete(f"/api/recordings/{FIRST}")
        assert answer.status == 400
        assert "X-Confirm" in (await answer.json())["error"]
        answer = await client.delete(f"/api/recordings/{FIRST}", headers={"X-Confirm": FIRST})
        assert answer.status == 200
        answer = await client.get(f"/api/recordings/{FIRST}")
        assert answer.status == 404
        assert "there is no recording" in (await answer.json())["error"]


async def test_a_foreign_page_changes_nothing(folder):
    async with served(RecordingStore(folder)) as client:
        headers = {"Origin": "https://evil.example", "X-Confirm": FIRST}
        answer = await client.delete(f"/api/recordings/{FIRST}", headers=headers)
        assert answer.status == 403
        assert (folder / FIRST).is_dir()


async def test_downloads_honour_ranges(folder):
    whole = (folder / FIRST / "link_000.mcap").read_bytes()
    async with served(RecordingStore(folder)) as client:
        url = f"/api/recordings/{FIRST}/files/link_000.mcap"
        answer = await client.get(url)
        assert await answer.read() == whole
        assert "attachment" in answer.headers["Content-Disposition"]
        answer = await client.get(url, headers={"Range": "bytes=100-199"})
        assert answer.status == 206
        assert await answer.read() == whole[100:200]


@pytest.mark.parametrize(
    "path",
    [
        f"/api/recordings/{FIRST}/files/..%2F..%2Fsecret",
        f"/api/recordings/..%2F{FIRST}/files/link_000.mcap",
        "/api/recordings/..%2F../files/passwd",
        f"/api/recordings/{FIRST}/files/%2Fetc%2Fpasswd",
    ],
)
async def test_no_request_path_leaves_the_folder(folder, path):
    (folder.parent / "secret").write_text("secret")
    async with served(RecordingStore(folder)) as client:
        answer = await client.get(path)
        assert answer.status == 404
        assert b"secret\n" not in await answer.read()


async def test_the_export_call_streams_a_valid_zip(folder):
    async with served(RecordingStore(folder)) as client:
        answer = await client.get(f"/api/recordings/{FIRST}/export")
        assert answer.headers["Content-Type"] == "application/zip"
        archive = zipfile.ZipFile(io.BytesIO(await answer.read()))
        assert archive.testzip() is None
        answer = await client.get("/api/recordings/session_20000101_000000/export")
        assert answer.status == 404


async def test_start_and_stop_act_before_they_answer(tmp_path):
    clock = FakeClocks()
    target = recorder(tmp_path, clock)
    store = RecordingStore(tmp_path, lambda: target.active_name)
    feed(target, clock, 1.0)
    target.start()
    try:
        async with served(store, target) as client:
            answer = await client.post("/api/recording", json={"action": "stop"})
            assert (await answer.json())["state"] == "off"
            session = orjson.loads(next(tmp_path.glob("*/session.json")).read_bytes())
            assert session["closed"] is True
            answer = await client.post("/api/recording", json={"action": "start"})
            assert (await answer.json())["state"] == "waiting"
            answer = await client.post("/api/recording", json={"action": "explode"})
            assert answer.status == 400
    finally:
        await asyncio.to_thread(target.stop)


async def test_a_replay_cannot_be_recorded(folder):
    async with served(RecordingStore(folder), None) as client:
        answer = await client.post("/api/recording", json={"action": "start"})
        assert answer.status == 409
        assert "replay" in (await answer.json())["error"]
