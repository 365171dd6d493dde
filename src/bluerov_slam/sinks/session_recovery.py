"""At start: repairs every session that an earlier run could not close. Nothing is ever deleted."""

from __future__ import annotations

import datetime
import logging
import re
from pathlib import Path
from typing import Any

from bluerov_slam.errors import RecordingError
from bluerov_slam.sinks.mcap_log import PING_TOPICS, SESSION_METADATA
from bluerov_slam.sinks.mcap_recovery import McapContent, is_complete, recover_mcap
from bluerov_slam.sinks.session_file import change_session, new_session, read_session

_log = logging.getLogger(__name__)

SESSION_NAME = re.compile(r"session_\d{8}_\d{6}")


def recover_sessions(root: Path) -> list[str]:
    """Repair what is not closed; the names of the sessions that needed it. Raises OSError without `root`."""
    repaired = []
    for folder in sorted(root.iterdir()):
        if not SESSION_NAME.fullmatch(folder.name) or folder.is_symlink() or not folder.is_dir():
            continue
        session = read_session(folder)
        if session.get("closed"):
            continue
        try:
            _recover_session(folder, session)
        except OSError as error:
            _log.error("recording %s could not be repaired: %s", folder.name, error)
            continue
        repaired.append(folder.name)
    return repaired


def _recover_session(folder: Path, session: dict[str, Any]) -> None:
    contents = []
    for path in sorted(folder.glob("link_*.mcap")):
        cut = not is_complete(path)
        try:
            content = recover_mcap(path)
        except RecordingError as error:
            _log.warning("%s", error)
            continue
        contents.append(content)
        if cut:
            _log.warning("%s was cut short; index and footer rebuilt", path)
    facts = _facts(folder.name, session, contents)
    change_session(folder, lambda target: target.update({**facts, **target, **_counted(contents)}))


def _facts(name: str, session: dict[str, Any], contents: list[McapContent]) -> dict[str, Any]:
    """Defaults for whatever session.json does not say."""
    if session:
        return {}
    started_unix_s = _start_from_name(name)
    offset_ns = next(
        (int(c.metadata[SESSION_METADATA]["wall_offset_ns"]) for c in contents if SESSION_METADATA in c.metadata), None
    )
    started_mono_s = started_unix_s - offset_ns * 1e-9 if offset_ns is not None else 0.0
    return new_session(name, started_unix_s, started_mono_s)


def _counted(contents: list[McapContent]) -> dict[str, Any]:
    starts = [content.start_ns for content in contents if content.start_ns is not None]
    ends = [content.end_ns for content in contents if content.end_ns is not None]
    pings = {
        channel: sum(content.messages_by_topic.get(topic, 0) for content in contents)
        for channel, topic in PING_TOPICS.items()
    }
    return {
        "closed": True,
        "recovered": True,
        "duration_s": (max(ends) - min(starts)) * 1e-9 if starts and ends else 0.0,
        "pings_a": next(iter(pings.values())),
        "pings_b": list(pings.values())[1],
    }


def _start_from_name(name: str) -> float:
    try:
        return datetime.datetime.strptime(f"{name}+0000", "session_%Y%m%d_%H%M%S%z").timestamp()
    except ValueError:
        return 0.0
