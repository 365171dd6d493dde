from pathlib import Path
from typing import Any

import pytest

from bluerov_slam.errors import ConfigError
from bluerov_slam.services.contacts import FILE_NAME, ContactBook
from bluerov_slam.services.viewer_link_client import AnnotationResult

DIVE = "session_20260101_000000"


class Recording:
    """The extension's annotations of the active recording."""

    def __init__(self) -> None:
        self.connected = True
        self.name: str | None = DIVE
        self.refusal = ""
        self.kept: dict[str, dict[str, Any]] = {}

    async def annotate(self, operation: str, annotation: dict[str, Any]) -> AnnotationResult:
        if self.refusal:
            return AnnotationResult(False, [], self.refusal)
        if operation in ("add", "change"):
            self.kept[annotation["id"]] = annotation
        elif operation == "remove":
            del self.kept[annotation["id"]]
        return AnnotationResult(True, list(self.kept.values()))


@pytest.fixture
def recording() -> Recording:
    return Recording()


@pytest.fixture
def book(recording: Recording, tmp_path: Path) -> ContactBook:
    return ContactBook(tmp_path, recording, lambda: recording.name)


async def test_a_contact_goes_to_the_recording_as_an_annotation(book, recording) -> None:
    made = await book.add({"name": "anchor", "channel": "B", "ping_number": 7, "range_m": 3.25})
    assert made["pending"] is False
    assert made["recording"] == DIVE
    (kept,) = recording.kept.values()
    assert kept["kind"] == "contact"
    assert (kept["id"], kept["name"], kept["channel"], kept["range_m"]) == (made["id"], "anchor", "B", 3.25)
    await book.change(made["id"], {"note": "two flukes"})
    assert recording.kept[made["id"]]["note"] == "two flukes"
    await book.remove(made["id"])
    assert (recording.kept, book.all()) == ({}, [])


@pytest.mark.parametrize("absent", ["link", "recording"])
async def test_while_link_or_recording_is_absent_it_waits_here_and_goes_later(book, recording, absent) -> None:
    recording.connected = absent != "link"
    recording.name = DIVE if absent == "link" else None
    made = await book.add({"name": "anchor"})
    gone = await book.add({"name": "mistake"})
    await book.remove(gone["id"])
    await book.change(made["id"], {"name": "anchor stone"})
    assert (made["pending"], book.unsent) == (True, 1)
    assert "kept here" in book.message
    recording.connected, recording.name = True, DIVE
    await book.send()
    assert [kept["name"] for kept in recording.kept.values()] == ["anchor stone"]
    assert (book.unsent, book.message) == (0, None)


async def test_unsent_contacts_survive_a_restart(book, recording, tmp_path) -> None:
    recording.connected = False
    await book.add({"name": "anchor"})
    recording.connected = True
    again = ContactBook(tmp_path, recording, lambda: recording.name)
    await again.send()
    assert [kept["name"] for kept in recording.kept.values()] == ["anchor"]


async def test_a_recording_that_refuses_is_quoted_and_asked_again(book, recording) -> None:
    recording.refusal = "the disk is full"
    await book.add({"name": "anchor"})
    assert "the disk is full" in book.message
    recording.refusal = ""
    await book.send()
    assert len(recording.kept) == 1


async def test_a_new_recording_begins_with_its_own_contacts_and_the_unsent_ones(book, recording) -> None:
    await book.add({"name": "of the first dive"})
    recording.connected = False
    await book.add({"name": "unsent"})
    recording.connected, recording.name, recording.kept = True, "session_20260101_120000", {}
    recording.kept["other"] = {"id": "other", "kind": "contact", "text": "from another page"}
    recording.kept["note"] = {"id": "note", "kind": "note", "text": "only a note"}
    await book.send()
    await book.adopt()
    assert [contact["name"] for contact in book.all()] == ["unsent", "from another page"]


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ({}, 'needs a "name"'),
        ({"name": "  "}, 'needs a "name"'),
        ({"name": "x" * 81}, "at most 80"),
        ({"name": "x", "channel": "C"}, '"A" or "B"'),
        ({"name": "x", "range_m": 1e9}, "range_m"),
        ({"name": "x", "range_m": float("inf")}, "expected a number"),
        ({"name": "x", "latitude_deg": 91}, "-90 to 90"),
        ({"name": "x", "colour": "red"}, "unknown field"),
    ],
)
async def test_bad_contacts_are_refused_by_field(book, body, text) -> None:
    with pytest.raises(ConfigError, match=text):
        await book.add(body)
    assert book.all() == []


async def test_an_unknown_contact_is_a_key_error(book) -> None:
    with pytest.raises(KeyError):
        await book.change("none", {})
    with pytest.raises(KeyError):
        await book.remove("none")


async def test_an_unreadable_file_is_kept_aside_and_reported(recording, tmp_path) -> None:
    (tmp_path / FILE_NAME).write_text("{broken")
    book = ContactBook(tmp_path, recording, lambda: recording.name)
    assert "cannot be read" in book.message
    assert [path.name for path in tmp_path.iterdir()] == ["viewer-contacts.unreadable.json"]


async def test_a_folder_that_cannot_be_written_keeps_the_contact_in_memory_and_says_so(recording, tmp_path) -> None:
    recording.connected = False
    (tmp_path / "file").write_text("")
    book = ContactBook(tmp_path / "file", recording, lambda: recording.name)
    await book.add({"name": "anchor"})
    assert [contact["name"] for contact in book.all()] == ["anchor"]
