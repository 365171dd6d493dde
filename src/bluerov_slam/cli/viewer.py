"""`bluerov-slam viewer`: the sonar viewer service alone."""

from __future__ import annotations

import asyncio
import logging
import signal
from pathlib import Path

import click

from bluerov_slam.config import Settings, from_text
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.services.viewer import ViewerService


@click.command("viewer")
@click.option("--config", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="Settings file (TOML).")
@click.option("--set", "flags", multiple=True, metavar="GROUP.KEY=VALUE", help="Override one setting; repeatable.")
@click.option("--log-level", default="INFO", show_default=True, help="Least severe message to print.")
def command(config: Path | None, flags: tuple[str, ...], log_level: str) -> None:
    """Serve the sonar waterfalls on :8100 and :8101, fed by the extension through UDP 14555 and 14556."""
    logging.basicConfig(level=log_level.upper(), format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    store = SettingsStore.open(config, dict(_parsed(flag) for flag in flags))
    asyncio.run(_serve(store.settings))


def _parsed(flag: str) -> tuple[str, object]:
    key, separator, value = flag.partition("=")
    if not separator:
        raise click.BadParameter(f"{flag!r}: expected GROUP.KEY=VALUE, such as viewer.port=8100")
    return key, from_text(key, value)


async def _serve(settings: Settings) -> None:
    stopping = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stopping.set)
    service = ViewerService(settings)
    await service.start()
    try:
        await stopping.wait()
    finally:
        await service.stop()
