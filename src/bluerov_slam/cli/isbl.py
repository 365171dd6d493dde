"""`bluerov-slam isbl`: acoustic positioning and the thesis it comes from; one module for each sub-command."""

from __future__ import annotations

import click

from bluerov_slam.cli.lazy_group import LazyGroup

# Sub-command name -> module of this package that holds a click command called `command`.
COMMANDS: dict[str, str] = {
    "calibrate": "isbl_calibrate",
    "calibrate-array": "isbl_calibrate_array",
    "evaluate": "isbl_evaluate",
    "heldout": "isbl_heldout",
    "reproduce": "isbl_reproduce",
    "simulate": "isbl_simulate",
    "solve": "isbl_solve",
}


@click.group(
    name="isbl", cls=LazyGroup, modules=COMMANDS, short_help="Acoustic positioning: reproduce, solve, simulate."
)
def command() -> None:
    """Acoustic positioning with an inverted short baseline (docs/acoustics.md)."""
