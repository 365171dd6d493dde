"""What the commands that move a real rig share: its port, the switch without which nothing moves, the warning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

Command = Callable[..., Any]

port_option = click.option(
    "--port", type=click.Path(path_type=Path), help="A real rig's serial port (its firmware's link)."
)
move_option = click.option(
    "--move-for-real", is_flag=True, help="Let a real rig move. Without it only what would move is said."
)


def announced(what: Sequence[str], move_for_real: bool) -> bool:
    """Says what will move; whether it may."""
    click.echo("The rig will move like this:" if move_for_real else "Nothing moves yet. With --move-for-real:")
    for line in what:
        click.echo(f"  {line}")
    if move_for_real:
        click.echo("Keep clear of it. Its button stops it and sends it home; Ctrl-C stops it where it is.")
    return move_for_real
