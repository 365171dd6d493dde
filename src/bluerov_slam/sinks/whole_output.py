"""Output that is there whole or not at all: written beside its place, moved there once everything is written."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def in_whole(output: Path) -> Iterator[Path]:
    """A path beside `output` that takes its place only once everything is written. May raise OSError."""
    unfinished = output.with_name(output.name + ".part")
    remove_output(unfinished)
    try:
        yield unfinished
        if output.is_dir():
            remove_output(output)
        unfinished.replace(output)
    finally:
        remove_output(unfinished)


def remove_output(path: Path) -> None:
    """Delete a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
