"""Options that every service command takes, and how their log lines look."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from bluerov_slam.config import from_text

Command = TypeVar("Command", bound=Callable[..., Any])
LEVELS = ("DEBUG", "INFO", "WARNING", "ERROR")
FIRMWARES = ("auto", "native", "reference")


def service_options(command: Command) -> Command:
    """--config, --set and --log-level."""
    options = (
        click.option("--config", type=click.Path(path_type=Path), help="Settings file; see config/example.toml."),
        click.option("--set", "flags", multiple=True, metavar="GROUP.KEY=VALUE", help="One setting; repeatable."),
        click.option("--log-level", type=click.Choice(LEVELS, case_sensitive=False), default="INFO", show_default=True),
    )
    for option in reversed(options):
        command = option(command)
    return command


def parse_flags(flags: tuple[str, ...]) -> dict[str, object]:
    """The values of --set by dotted key."""
    values: dict[str, object] = {}
    for flag in flags:
        key, separator, text = flag.partition("=")
        if not separator:
            raise click.BadParameter(f"{flag!r}: expected GROUP.KEY=VALUE, such as http.port=8099")
        values[key] = from_text(key, text)
    return values


def start_logging(level: str) -> None:
    """One event a line, the level first: BlueOS reads it there."""
    logging.basicConfig(level=level.upper(), format="%(levelname)s %(asctime)s %(name)s: %(message)s")
