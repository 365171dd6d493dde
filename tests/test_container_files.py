"""Dockerfile and compose file, without building them: labels as BlueOS's store and Kraken read them."""

import json
import re
from pathlib import Path

import pytest

from bluerov_slam import __version__

ROOT = Path(__file__).parent.parent
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")
TYPES = {"device-integration", "education", "example", "other", "theme", "tool"}


def labels():
    joined = DOCKERFILE.replace("\\\n", "")
    found = re.findall(r"""^LABEL (\w+)=(?:'(.*)'|"(.*)")$""", joined, re.MULTILINE)
    return {name: single or double for name, single, double in found}


@pytest.mark.parametrize("name", ["permissions", "authors", "company", "tags", "links"])
def test_label_is_strict_json(name):
    json.loads(labels()[name])


def test_authors_have_name_and_email():
    assert all(author["name"] and author["email"] for author in json.loads(labels()["authors"]))


def test_type_and_tags_survive_the_store():
    tags = json.loads(labels()["tags"])
    assert labels()["type"] in TYPES
    assert len(tags) <= 10
    assert all(re.fullmatch(r"[a-z0-9-]+", tag) for tag in tags)


def test_permissions_bind_the_folders_that_must_survive():
    permissions = json.loads(labels()["permissions"])
    binds = permissions["HostConfig"]["Binds"]
    assert "/dev:/dev" in binds
    assert any(bind.startswith("/usr/blueos/extensions/bluerov-slam:") for bind in binds)
    assert "BLUEROV_SLAM_PATHS__STATE=/usr/blueos/extensions/bluerov-slam" in DOCKERFILE


def test_version_label_is_the_packages():
    assert re.search(r"^ARG VERSION=(.+)$", DOCKERFILE, re.MULTILINE).group(1) == __version__


def test_lock_files_name_no_index():
    locks = [*(ROOT / "requirements").glob("*.lock"), ROOT / "package-lock.json"]
    assert locks
    for lock in locks:
        text = lock.read_text(encoding="utf-8")
        assert "--index-url" not in text
        assert '"resolved"' not in text
        if lock.suffix == ".lock":
            pinned = [line for line in text.splitlines() if re.match(r"[a-z0-9_.-]+==", line)]
            assert pinned
            assert text.count("--hash=sha256:") >= len(pinned)
