"""`bluerov-slam rig workspace`: whether the tool can reach a pose, how far it is from the limits, and samples."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from bluerov_slam.cli.rig_numbers import FORM, euler_deg, pose_of, pose_words, write_csv
from bluerov_slam.errors import ConfigError


@click.command(name="workspace", short_help="What the tool can reach.")
@click.option("--tool", metavar=FORM, help="A pose of the tool in the rig's frame, mm and degrees.")
@click.option("--sample", "count", type=click.IntRange(1, 100_000), help="Draw so many reachable poses.")
@click.option("--csv", "csv_file", type=click.Path(dir_okay=False, path_type=Path), help="Where samples go.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0))
def command(tool: str | None, count: int | None, csv_file: Path | None, seed: int) -> None:
    """Membership, margin and the nearest reachable pose of --tool, or --sample poses into --csv (docs/rig.md)."""
    if bool(tool) == bool(count):
        raise ConfigError("give either --tool or --sample")
    if (count is None) != (csv_file is None):
        raise ConfigError("--sample and --csv go together")
    from bluerov_slam.rig.workspace import StackWorkspace

    space = StackWorkspace()
    if tool is not None:
        pose = pose_of(tool)
        nearest = space.nearest(pose)
        click.echo(nearest.words)
        if nearest.limit is None:
            click.echo(f"Largest margin {space.margin(pose):.3f} (1 at best, 0 at a limit)")
        else:
            click.echo(f"Nearest: {pose_words(nearest.pose)}")
        return
    assert count is not None
    assert csv_file is not None
    _, poses = space.sample(count, seed)
    angles = np.array([euler_deg(rotation) for rotation in poses.rotation])
    heads = ("x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg")
    write_csv(csv_file, heads, np.hstack([poses.position_mm, angles]))
    low, high = poses.position_mm.min(axis=0), poses.position_mm.max(axis=0)
    click.echo(
        f"{count} reachable poses in {csv_file}: "
        + ", ".join(f"{axis} {low[k]:.0f} to {high[k]:.0f}" for k, axis in enumerate("xyz"))
        + " mm"
    )
