"""Named contacts on the sonar picture: kept with the active recording, and here until it has them."""

from __future__ import annotations

import asyncio
import logging
import math
import os
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import orjson

from bluerov_slam.errors import ConfigError
from bluerov_slam.services.viewer_link_client import AnnotationResult

logger = logging.getLogger(__name__)

FILE_NAME = "viewer-contacts.json"
MAXIMUM_CONTACTS = 2000
TEXT_LENGTHS = {"name": 80, "note": 1000}
NUMBER_LIMITS = {
    "ping_number": (0, 2**32 - 1),
    "range_m": (-200.0, 200.0),
    "time_unix_s": (0.0, 1e11),
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-180.0, 180.0),
    # Radius of 95 % about the position; the way over ground to it, null where the slant range had to do.
    "position_within_m": (0.0, 1e6),
    "ground_range_m": (0.0, 200.0),
}
FIELDS = ("name", "note", "channel", *NUMBER_LIMITS)


class AnnotationLink(Protocol):
    """The way to the recording: what `ViewerLinkClient` offers."""

    connected: bool

    async def annotate(self, operation: str, annotation: dict[str, Any]) -> AnnotationResult: ...


@dataclass(slots=True)
class _Contact:
    """A contact, which recording holds it, and what that recording does not know yet."""

    values: dict[str, Any]
    recording: str | None = None
    unsent: str | None = "add"  # add, change, remove or None

    def as_json(self) -> dict[str, Any]:
        return {**self.values, "recording": self.recording, "pending": self.unsent is not None}


class ContactBook:
    """The contacts of this dive. A change is on disk here before anything else; the recording gets it when it can."""

    def __init__(self, folder: Path, link: AnnotationLink, recording: Callable[[], str | None]) -> None:
        self.message: str | None = None
        self._path = folder / FILE_NAME
        self._link = link
        self._recording = recording
        self._sending = asyncio.Lock()
        self._saving = asyncio.Lock()
        self._contacts = self._load()

    @property
    def unsent(self) -> int:
        """Changes that no recording holds yet."""
        return sum(contact.unsent is not None for contact in self._contacts.values())

    def all(self) -> list[dict[str, Any]]:
        """What the page shows, oldest first."""
        return [contact.as_json() for contact in self._contacts.values() if contact.unsent != "remove"]

    async def add(self, body: Mapping[str, object]) -> dict[str, Any]:
        """A new contact. Raises ConfigError for bad values or when there are too many."""
        if len(self._contacts) >= MAXIMUM_CONTACTS:
            raise ConfigError(f"there are {MAXIMUM_CONTACTS} contacts already: delete some, or start a new recording")
        values: dict[str, Any] = dict.fromkeys(FIELDS) | _checked(body)
        if not values["name"]:
            raise ConfigError('a contact needs a "name"')
        values = {"id": uuid.uuid4().hex[:12], **values, "note": values["note"] or ""}
        contact = self._contacts[values["id"]] = _Contact(values)
        await self._save()
        await self.send()
        return contact.as_json()

    async def change(self, identifier: str, body: Mapping[str, object]) -> dict[str, Any]:
        """Other values for some fields. Raises KeyError for an unknown contact, ConfigError for bad values."""
        contact = self._contacts[identifier]
        if contact.unsent == "remove":
            raise KeyError(identifier)
        contact.values.update(_checked(body))
        contact.unsent = contact.unsent or "change"
        await self._save()
        await self.send()
        return contact.as_json()

    async def remove(self, identifier: str) -> None:
        """Forget a contact. Raises KeyError for an unknown one."""
        contact = self._contacts[identifier]
        if contact.unsent == "add":
            del self._contacts[identifier]
        else:
            contact.unsent = "remove"
        await self._save()
        await self.send()

    async def send(self) -> None:
        """Give the recording what it does not have. Harmless at any time; called when link or recording come up."""
        async with self._sending:
            recording = self._recording()
            if not self._link.connected or recording is None:
                self._explain_waiting()
                return
            for identifier in list(self._contacts):
                contact = self._contacts.get(identifier)
                if contact is not None and not await self._send_one(contact, recording):
                    break
            await self._save()

    async def adopt(self) -> None:
        """Learn what the active recording holds: contacts of another page or of an earlier life of this viewer."""
        recording = self._recording()
        if not self._link.connected or recording is None:
            return
        result = await self._link.annotate("list", {})
        if not result.ok:
            return
        for identifier in [i for i, c in self._contacts.items() if c.unsent is None and c.recording != recording]:
            del self._contacts[identifier]  # they lie with their own recording
        for annotation in result.annotations:
            identifier = str(annotation.get("id", ""))
            if annotation.get("kind") == "contact" and identifier and identifier not in self._contacts:
                values = {"id": identifier, **{field: annotation.get(field) for field in FIELDS}}
                values["name"] = values["name"] or annotation.get("text") or identifier
                self._contacts[identifier] = _Contact(values, recording, None)
        await self._save()

    async def _send_one(self, contact: _Contact, recording: str) -> bool:
        """Send one change if there is one; False when it makes no sense to go on."""
        operation = contact.unsent
        if operation is None:
            return True
        if operation != "add" and contact.recording != recording:
            # Its dive is over: the recording's own page changes it. Here it would change a stranger.
            contact.unsent = None
            self._say(
                f"contact {contact.values['name']} belongs to {contact.recording}: change it on the recordings page"
            )
            return True
        sent = dict(contact.values)
        result = await self._link.annotate(operation, {"kind": "contact", "text": sent["name"], **sent})
        if not result.ok:
            self._say(f"contact {sent['name']} is kept here until the recording takes it: {result.message}")
            return False
        self.message = None
        if operation == "remove":
            self._contacts.pop(sent["id"], None)
        else:
            contact.recording = recording
            # It may have been changed again while it was sent.
            contact.unsent = None if contact.values == sent and contact.unsent == operation else "change"
        return True

    def _explain_waiting(self) -> None:
        if self.unsent:
            reason = "no recording runs" if self._link.connected else "the extension is not connected"
            self._say(f"{self.unsent} contacts are kept here until a recording takes them: {reason}")

    def _say(self, message: str) -> None:
        if message != self.message:
            logger.warning("%s", message)
        self.message = message

    def _load(self) -> dict[str, _Contact]:
        try:
            stored = orjson.loads(self._path.read_bytes())
            return {
                str(entry["values"]["id"]): _Contact(dict(entry["values"]), entry["recording"], entry["unsent"])
                for entry in stored["contacts"]
            }
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, KeyError, TypeError) as error:
            kept = self._path.with_suffix(".unreadable.json")
            self._say(f"{self._path} cannot be read ({error}); it is kept as {kept.name}")
            try:
                self._path.replace(kept)
            except OSError:
                logger.debug("cannot rename %s", self._path)
            return {}

    async def _save(self) -> None:
        async with self._saving:
            stored = [
                {"values": c.values, "recording": c.recording, "unsent": c.unsent} for c in self._contacts.values()
            ]
            data = orjson.dumps({"version": 1, "contacts": stored})
            try:
                await asyncio.to_thread(_write_whole, self._path, data)
            except OSError as error:
                cause = error.strerror or str(error)
                self._say(f"contacts cannot be saved in {self._path.parent} ({cause}): a restart loses the unsent ones")


def _write_whole(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".tmp")
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


def _checked(body: Mapping[str, object]) -> dict[str, Any]:
    """The fields of a request. Raises ConfigError naming the field and what it may be."""
    return {key: _checked_field(key, value) for key, value in body.items() if key != "id"}


def _checked_field(key: str, value: object) -> object:
    if key in TEXT_LENGTHS:
        if not isinstance(value, str) or len(value) > TEXT_LENGTHS[key]:
            raise ConfigError(f"{key}: expected text of at most {TEXT_LENGTHS[key]} characters")
        return value.strip()
    if key == "channel":
        if value not in ("A", "B"):
            raise ConfigError('channel: expected "A" or "B"')
        return value
    if key not in NUMBER_LIMITS:
        raise ConfigError(f"{key}: unknown field; known are {', '.join(FIELDS)}")
    low, high = NUMBER_LIMITS[key]
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigError(f"{key}: expected a number or null")
    if not low <= value <= high:
        raise ConfigError(f"{key} {value:g}: expected {low:g} to {high:g}")
    return value
