"""`bluerov-slam health`: asks the running services; the container's health check."""

from __future__ import annotations

import json
import urllib.error
import urllib.request

import click

from bluerov_slam.errors import ExpectedError

TIMEOUT_S = 3.0


@click.command("health")
@click.option("--only", type=click.Choice(["extension", "viewer"]), help="Ask one service only.")
@click.option("--extension-port", default=8099, show_default=True, envvar="BLUEROV_SLAM_HTTP__PORT", type=int)
@click.option("--viewer-port", default=8100, show_default=True, envvar="BLUEROV_SLAM_VIEWER__PORT", type=int)
def command(only: str | None, extension_port: int, viewer_port: int) -> None:
    """Ask the running services how they are; exit code 1 when one does not answer."""
    ports = {"extension": extension_port, "viewer": viewer_port}
    for name, port in ports.items():
        if only in (None, name):
            click.echo(f"{name}: {_ask(name, port)}")


def _ask(name: str, port: int) -> str:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=TIMEOUT_S) as answer:
            document = json.load(answer)
    except (urllib.error.URLError, OSError, ValueError) as error:
        raise ExpectedError(f"{name}: no answer on port {port} ({error}): is it running?") from error
    status = str(document.get("status", "says nothing"))
    if status != "healthy":
        raise ExpectedError(f"{name}: {status}")
    return status
