"""The `bluerov-slam` command: each sub-command lives in its own module and is imported only when it is used."""

from __future__ import annotations

import importlib
import sys
import traceback

import click

from bluerov_slam import __version__
from bluerov_slam.errors import ExpectedError

# Sub-command name -> module of this package that holds a click command called `command`.
COMMANDS = {
    "convert": "convert",
    "evaluate": "evaluate",
    "extension": "extension",
    "health": "health",
    "import": "import_log",
    "navigate": "navigate",
    "replay": "replay",
    "run": "run",
    "simulate": "simulate",
    "viewer": "viewer",
}


# Told apart by the supervisor: the first will fail again, the second may not.
EXPECTED_FAILURE = 1
CRASH = 70  # EX_SOFTWARE of sysexits.h


class LazyGroup(click.Group):
    """A group whose sub-commands are imported on first use: `--help` must not cost an import of the whole product."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"bluerov_slam.cli.{COMMANDS[cmd_name]}")
        command: click.Command = module.command
        return command


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="bluerov-slam")
def cli() -> None:
    """BlueROV SLAM: localization and side-scan sonar imaging for the BlueROV2."""


def main() -> None:
    """Run the command line; an expected error is one line and exit code 1, a fault of ours a traceback and 70."""
    try:
        cli()
    except ExpectedError as error:
        click.echo(f"bluerov-slam: {error}", err=True)
        sys.exit(EXPECTED_FAILURE)
    except Exception:
        traceback.print_exc()
        sys.exit(CRASH)
