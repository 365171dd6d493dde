"""`bluerov-slam extension`: the extension service alone."""

from __future__ import annotations

import asyncio
from pathlib import Path

import click

from bluerov_slam.cli.service_options import parse_flags, service_options, start_logging
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.services.supervisor import serve


@click.command("extension")
@service_options
@click.option("--simulated", is_flag=True, help="The port is a simulator's: say so on every page.")
@click.option("--simulated-autopilot", metavar="HOST:PORT", help="Listen to a simulator's autopilot there as well.")
def command(
    config: Path | None, flags: tuple[str, ...], log_level: str, simulated: bool, simulated_autopilot: str | None
) -> None:
    """Serve the dashboard on :8099 and the sensor data on :8766; forward, bridge and record."""
    start_logging(log_level)
    store = SettingsStore.open(config, parse_flags(flags))
    asyncio.run(_serve(store, simulated, simulated_autopilot))


async def _serve(store: SettingsStore, simulated: bool, simulated_autopilot: str | None) -> None:
    # Imported only now, so that a wrong setting is told at once.
    from bluerov_slam.services.extension import Extension

    await serve(Extension(store, simulated=simulated, simulated_autopilot=simulated_autopilot))
