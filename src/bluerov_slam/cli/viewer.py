"""`bluerov-slam viewer`: the sonar viewer service alone."""

from __future__ import annotations

import asyncio
from pathlib import Path

import click

from bluerov_slam.cli.service_options import parse_flags, service_options, start_logging
from bluerov_slam.config import Settings
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.services.supervisor import serve
from bluerov_slam.services.viewer import ViewerService


@click.command("viewer")
@service_options
def command(config: Path | None, flags: tuple[str, ...], log_level: str) -> None:
    """Serve the sonar waterfalls on :8100 and :8101, fed by the extension through UDP 14555 and 14556."""
    start_logging(log_level)
    asyncio.run(_serve(SettingsStore.open(config, parse_flags(flags)).settings))


async def _serve(settings: Settings) -> None:
    await serve(ViewerService(settings))
