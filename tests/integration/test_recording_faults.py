"""What may happen to a vehicle's disk and power, done to the real extension."""

import json
import os
import random
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader

from bluerov_slam.sinks.mcap_recovery import is_complete
from bluerov_slam.sources.recording_reader import open_recording
from extension_process import ExtensionProcess, Feeder, Witness, wait_for
from simulated import link_bytes

MEGABYTE = 1024 * 1024
SURE_AFTER_S = 1.0


@pytest.fixture(scope="module")
def link() -> list[tuple[float, bytes]]:
    """Forty seconds of a busy link."""
    return link_bytes(40.0)


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Path]:
    """A small disk of its own."""
    folder = tmp_path / "disk"
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", str(folder)], capture_output=True)
    if made.returncode != 0:
        pytest.skip(f"a small disk needs the right to mount: {made.stderr.decode().strip()}")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@dataclass(frozen=True)
class ReadOnly:
    """A folder that cannot be written until `release`, and what the recorder says about it."""

    folder: Path
    cure: str
    release: Callable[[], object]


@pytest.fixture
def read_only(tmp_path: Path, request: pytest.FixtureRequest) -> ReadOnly:
    """By its permissions; for root, whom they do not stop, by a read-only disk."""
    if os.geteuid() != 0:
        folder = tmp_path / "locked"
        folder.mkdir(mode=0o555)
        return ReadOnly(folder, "change its owner or set recording.folder", lambda: folder.chmod(0o755))
    disk = request.getfixturevalue("mounted")
    folder = disk / "recordings"
    folder.mkdir()

    def remount(mode: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{mode}", str(disk)], check=True)

    remount("ro")
    return ReadOnly(folder, "mounted read-only: bind a writable folder", lambda: remount("rw"))


def fill(path: Path) -> None:
    """Take all the space there is. Raises OSError, which is how it ends."""
    with path.open("wb", buffering=0) as stream:
        while True:
            stream.write(bytes(MEGABYTE // 4))


def recorded(folder: Path) -> bytes:
    return b"".join(block.data for block in open_recording(folder).blocks())


def library_reads(path: Path) -> bytes:
    """What the MCAP project's own sequential reader makes of a file, cut or not."""
    data = b""
    raw: set[int] = set()
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                if getattr(record, "topic", None) == "/link/raw":
                    raw.add(record.id)
                elif isinstance(record, Message) and record.channel_id in raw:
                    data += record.data
        except EndOfFile:
            pass
    return data


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_kill_at_any_moment_loses_less_than_the_last_second_and_the_next_start_is_clean(tmp_path, link, seed):
    with ExtensionProcess(tmp_path) as extension:
        extension.wait_until_open()
        feeder = Feeder(extension, link)
        feeder.start()
        wait_for(lambda: extension.recorder().get("state") == "recording", "recording")
        witness = Witness(extension)
        witness.watch(random.Random(seed).uniform(1.5, 4.0))  # the moment of the kill is the point of this test
        extension.kill()
        sent = b"".join(feeder.begun)
        feeder.end()
    (session,) = (tmp_path / "state" / "recordings").glob("session_*")
    sure = sent[: witness.bytes_received_before(SURE_AFTER_S)]
    kept = recorded(session)
    assert sent.startswith(kept)
    assert len(kept) >= len(sure) > 0
    assert library_reads(session / "link_000.mcap") == kept
    lines = [json.loads(line) for line in next(session.glob("*.jsonl")).read_text().splitlines()]
    assert len(lines) >= sure.count(b"\xaa\x55\x01\x00\x4c") - 1

    with ExtensionProcess(tmp_path) as extension:
        extension.wait_until_open()
        feeder = Feeder(extension, link)
        feeder.start()
        wait_for(lambda: extension.recorder().get("state") == "recording", "recording after the kill")
        listed = extension.get("/api/recordings")
        feeder.end()
        extension.terminate()
    assert is_complete(session / "link_000.mcap")
    assert recorded(session) == kept
    assert len(listed["recordings"]) == 2
    assert listed["active"] != session.name
    assert all(is_complete(path) for path in session.parent.glob("*/link_*.mcap"))


def test_a_full_disk_stops_the_recording_alone_and_nothing_is_lost_once_there_is_space(tmp_path, mounted, link):
    with ExtensionProcess(tmp_path, recording__folder=str(mounted / "recordings")) as extension:
        extension.wait_until_open()
        feeder = Feeder(extension, link)
        feeder.start()
        wait_for(lambda: extension.recorder().get("state") == "recording", "recording")
        ballast = mounted / "ballast"
        with pytest.raises(OSError, match="No space"):
            fill(ballast)
        facts = wait_for(lambda: (f := extension.recorder()).get("state") == "disk_full" and f, "full disk noticed")
        assert "delete or download old recordings" in facts["error"]
        frames = extension.get("/health")["frames"]
        wait_for(lambda: extension.get("/health")["frames"] > frames + 20, "frames with a full disk")
        chips = {chip["id"]: chip["state"] for chip in extension.get("/api/state")["chips"]}
        assert chips["recorder"] == "fault"
        ballast.unlink()
        wait_for(lambda: extension.recorder().get("state") == "recording", "recording with space again")
        feeder.end()
        wait_for(lambda: extension.recorder().get("queue") == 0, "empty queue")
        assert extension.recorder()["dropped"] == 0
        extension.terminate()
    (session,) = (mounted / "recordings").glob("session_*")
    sent = b"".join(feeder.written)
    assert recorded(session) == sent
    assert all(is_complete(path) for path in session.glob("link_*.mcap"))


def test_a_read_only_folder_is_named_with_its_cure_and_recording_begins_once_it_can(tmp_path, read_only, link):
    with ExtensionProcess(tmp_path, recording__folder=str(read_only.folder)) as extension:
        extension.wait_until_open()
        feeder = Feeder(extension, link)
        feeder.start()
        facts = wait_for(lambda: (f := extension.recorder()).get("state") == "failed" and f, "read-only folder noticed")
        assert read_only.cure in facts["error"]
        assert extension.get("/health")["status"] == "healthy"
        wait_for(lambda: (extension.get("/api/latest") or {}).get("ts"), "sensor data")
        read_only.release()
        wait_for(lambda: extension.recorder().get("state") == "recording", "recording")
        feeder.end()
        wait_for(lambda: extension.recorder().get("queue") == 0, "empty queue")
        extension.terminate()
    (session,) = read_only.folder.glob("session_*")
    assert recorded(session) == b"".join(feeder.written), "what came before waited"


def test_an_orderly_end_keeps_every_byte(tmp_path, link):
    with ExtensionProcess(tmp_path) as extension:
        extension.wait_until_open()
        feeder = Feeder(extension, link)
        feeder.start()
        wait_for(lambda: extension.recorder().get("state") == "recording", "recording")
        log_path = Path(extension.get("/api/status")["log"])
        wait_for(lambda: log_path.stat().st_size > 1000, "sensor lines")
        feeder.end()
        total = sum(map(len, feeder.written))
        wait_for(lambda: extension.get("/api/state")["link"]["bytes"] == total, "all bytes")
        extension.terminate()
    assert recorded(log_path.parent) == b"".join(feeder.written)
    assert is_complete(log_path.parent / "link_000.mcap")
    assert json.loads((log_path.parent / "session.json").read_text())["closed"] is True


def test_a_recorded_dive_replays_through_the_real_service(tmp_path, link):
    capture = tmp_path / "capture.bin"
    capture.write_bytes(b"".join(data for _, data in link))
    command = ("replay", str(capture), "--speed", "max", "--extension-only")
    with ExtensionProcess(tmp_path, command) as extension:
        state = wait_for(
            lambda: (s := extension.get("/api/state")) and s["link"]["bytes"] == capture.stat().st_size and s, "its end"
        )
        assert state["source"] == "replay"
        assert state["link"]["crc_errors"] == 0
        assert state["sonars"]["A"]["pings"] > 350
        assert state["recorder"]["state"] == "off"
        extension.terminate()
    assert not (tmp_path / "state" / "recordings").exists()
