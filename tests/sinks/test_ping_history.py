import errno
import os
import threading
from pathlib import Path

import pytest

from bluerov_slam.records import Channel
from bluerov_slam.sinks.ping_history import BLOCK_BYTES, UNWRITTEN_BLOCKS, PingHistory

PING_BYTES = 1040


def packed(channel: Channel, number: int) -> bytes:
    return f"{channel}{number}".encode().ljust(PING_BYTES, b".")


def number_of(ping: bytes) -> int:
    return int(ping.rstrip(b".")[1:])


def fill(history: PingHistory, first: int, last: int) -> None:
    for number in range(first, last + 1):
        for channel in Channel:
            if history.append(channel, number, packed(channel, number)):
                history.write_pending()


def numbers(history: PingHistory, channel: Channel = Channel.A, **query: int) -> list[int]:
    pings = history.read(channel, **query)
    assert all(ping[:1] == channel.encode() for ping in pings)
    return [number_of(ping) for ping in pings]


@pytest.fixture
def history(tmp_path: Path) -> PingHistory:
    return PingHistory(tmp_path / "history", capacity_bytes=8 * BLOCK_BYTES, free_bytes=lambda _: 10**12)


def test_an_empty_history_has_no_span_and_no_pings(history: PingHistory) -> None:
    assert history.span(Channel.A) is None
    assert history.read(Channel.A) == []


def test_pings_come_back_by_number_from_file_and_memory_alike(history: PingHistory) -> None:
    fill(history, 1, 200)
    assert history.span(Channel.A) == (1, 200)
    assert numbers(history, limit=5) == [196, 197, 198, 199, 200]
    assert numbers(history, before=100, limit=50) == list(range(50, 100))
    assert numbers(history, after=10, limit=90) == list(range(11, 101))
    assert numbers(history, Channel.B, before=3, limit=50) == [1, 2]
    assert numbers(history, after=195, limit=50) == [196, 197, 198, 199, 200]
    assert numbers(history, after=200) == []
    assert numbers(history, before=1) == []
    assert numbers(history, after=20, before=25) == [21, 22, 23, 24]


def test_the_oldest_pings_make_room_and_the_file_stays_bounded(history: PingHistory) -> None:
    fill(history, 1, 2000)
    first, last = history.span(Channel.A) or (0, 0)
    assert last == 2000
    kept = numbers(history, limit=100_000)
    assert kept == list(range(first, 2001))
    assert 8 * 30 <= len(kept) <= 9 * 32
    assert numbers(history, before=first, limit=10) == []
    assert os.fstat(history._file or 0).st_size <= 8 * BLOCK_BYTES


def test_a_channel_that_stopped_long_ago_is_forgotten_only_when_overwritten(history: PingHistory) -> None:
    fill(history, 1, 20)
    for number in range(21, 200):
        if history.append(Channel.A, number, packed(Channel.A, number)):
            history.write_pending()
    assert numbers(history, Channel.B) == list(range(1, 21))
    assert history.span(Channel.B) == (1, 20)
    for number in range(200, 1500):
        if history.append(Channel.A, number, packed(Channel.A, number)):
            history.write_pending()
    assert history.span(Channel.B) is None


def test_nothing_is_left_in_the_folder(tmp_path: Path, history: PingHistory) -> None:
    fill(history, 1, 200)
    assert list((tmp_path / "history").iterdir()) == []


def test_a_disk_that_fills_up_shortens_the_ring_and_says_so(tmp_path: Path) -> None:
    free = [10**12]
    history = PingHistory(tmp_path, 1000 * BLOCK_BYTES, keep_free_bytes=10**6, free_bytes=lambda _: free[0])
    fill(history, 1, 200)
    assert history.message is None
    free[0] = 1000
    fill(history, 201, 1000)
    assert "nearly full" in (history.message or "")
    kept = numbers(history, limit=100_000)
    assert kept == list(range(kept[0], 1001))
    assert 100 < len(kept) < 300


def test_a_full_disk_while_writing_keeps_what_is_there_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = PingHistory(tmp_path, 1000 * BLOCK_BYTES, free_bytes=lambda _: 10**12)
    fill(history, 1, 200)
    pwrite = os.pwrite
    limit = (os.fstat(history._file or 0)).st_size

    def full(descriptor: int, data: bytes, offset: int) -> int:
        if offset >= limit:
            raise OSError(errno.ENOSPC, "No space left on device")
        return pwrite(descriptor, data, offset)

    monkeypatch.setattr(os, "pwrite", full)
    fill(history, 201, 800)
    assert "full" in (history.message or "")
    assert numbers(history, limit=5) == [796, 797, 798, 799, 800]
    assert os.fstat(history._file or 0).st_size == limit


def test_a_broken_disk_stops_scroll_back_but_not_the_live_pings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = PingHistory(tmp_path, 1000 * BLOCK_BYTES, free_bytes=lambda _: 10**12)

    def broken(descriptor: int, data: bytes, offset: int) -> int:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "pwrite", broken)
    fill(history, 1, 5000)
    assert "stopped" in (history.message or "")
    assert numbers(history, limit=3) == [4998, 4999, 5000]
    assert len(numbers(history, limit=100_000)) <= (UNWRITTEN_BLOCKS + 1) * 32


def test_a_read_only_folder_is_reported_and_recent_pings_still_scroll(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("in the way")
    history = PingHistory(blocker / "history", 8 * BLOCK_BYTES)
    fill(history, 1, 10)
    assert "cannot create" in (history.message or "")
    assert numbers(history) == list(range(1, 11))


def test_a_slow_disk_costs_the_oldest_unwritten_block_and_is_counted(history: PingHistory) -> None:
    for number in range(1, 64 * (UNWRITTEN_BLOCKS + 4)):
        history.append(Channel.A, number, packed(Channel.A, number))
    assert history.blocks_dropped > 0
    kept = numbers(history, limit=100_000)
    assert kept[-1] == 64 * (UNWRITTEN_BLOCKS + 4) - 1


def test_a_ping_larger_than_a_block_is_refused_and_counted(history: PingHistory) -> None:
    history.append(Channel.A, 1, bytes(BLOCK_BYTES))
    assert history.pings_refused == 1
    assert history.span(Channel.A) is None


def test_reading_while_the_writer_goes_round_never_gives_a_wrong_or_torn_ping(history: PingHistory) -> None:
    done = threading.Event()

    def write() -> None:
        fill(history, 1, 6000)
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    reads = 0
    while not done.is_set() or reads == 0:
        kept = numbers(history, limit=300)
        assert kept == sorted(set(kept))
        reads += 1
    writer.join()
    assert numbers(history, limit=2) == [5999, 6000]


def test_closing_ends_the_file_and_keeps_the_rest_harmless(history: PingHistory) -> None:
    fill(history, 1, 200)
    history.close()
    fill(history, 201, 300)
    assert numbers(history, limit=3) == [298, 299, 300]
    history.close()
