"""`bluerov-slam rig`: the ground-truth rig, real or simulated; one module for each sub-command."""

from __future__ import annotations

import click

from bluerov_slam.cli.lazy_group import LazyGroup

# Sub-command name -> module of this package that holds a click command called `command`.
COMMANDS: dict[str, str] = {
    "check": "rig_check",
    "collect": "rig_collect",
    "demo": "rig_demo",
    "evaluate": "rig_evaluate",
    "page": "rig_page",
    "plan": "rig_plan",
    "pose": "rig_pose",
    "workspace": "rig_workspace",
}


@click.group(
    name="rig", cls=LazyGroup, modules=COMMANDS, short_help="The ground-truth rig: plan, move, check, collect."
)
def command() -> None:
    """Plan and know the motions of a stack of hexapod platforms (docs/rig.md)."""
