"""The `bluerov-slam` command: each sub-command lives in its own module and is imported only when it is used."""

from __future__ import annotations

import os
import sys
import traceback

import click

from bluerov_slam import __version__
from bluerov_slam.cli.lazy_group import LazyGroup
from bluerov_slam.errors import ExpectedError

# Sub-command name -> module of this package that holds a click command called `command`.
COMMANDS = {
    "convert": "convert",
    "evaluate": "evaluate",
    "extension": "extension",
    "health": "health",
    "import": "import_log",
    "isbl": "isbl",
    "navigate": "navigate",
    "replay": "replay",
    "rig": "rig",
    "run": "run",
    "simulate": "simulate",
    "viewer": "viewer",
}


# Told apart by the supervisor: the first will fail again, the second may not.
EXPECTED_FAILURE = 1
# Of the linear algebra below NumPy, which reads them when it is first imported; child processes inherit them. Matrices
# here have some tens of rows: threads of their own wait for each other at five times the processor time.
THREAD_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
CRASH = 70  # EX_SOFTWARE of sysexits.h


@click.group(cls=LazyGroup, modules=COMMANDS, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="bluerov-slam")
def cli() -> None:
    """BlueROV SLAM: localization and side-scan sonar imaging for the BlueROV2."""


def main() -> None:
    """Run the command line; an expected error is one line and exit code 1, a fault of ours a traceback and 70."""
    for variable in THREAD_COUNTS:
        os.environ.setdefault(variable, "1")
    try:
        cli()
    except ExpectedError as error:
        click.echo(f"bluerov-slam: {error}", err=True)
        sys.exit(EXPECTED_FAILURE)
    except Exception:
        traceback.print_exc()
        sys.exit(CRASH)
