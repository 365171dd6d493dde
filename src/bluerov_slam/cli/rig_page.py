"""`bluerov-slam rig page`: the rig in three dimensions in a browser."""

from __future__ import annotations

import asyncio

import click


@click.command(name="page", short_help="The rig in three dimensions, in a browser.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=8103, show_default=True, type=click.IntRange(0, 65535), help="0: any free one.")
def command(host: str, port: int) -> None:
    """Show the stack at any set points, plan poses and play the demonstrations. No rig is needed, and none is moved."""
    asyncio.run(_serve(host, port))


async def _serve(host: str, port: int) -> None:
    from bluerov_slam.services.rig_page import RigPageService
    from bluerov_slam.services.supervisor import serve

    await serve(RigPageService(host, port, click.echo))
