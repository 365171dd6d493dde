"""`bluerov-slam replay`: the very same services on a recorded dive."""

from __future__ import annotations

import asyncio
import sys
import time
from pathlib import Path

import click

from bluerov_slam.cli.service_options import parse_flags, service_options, start_logging
from bluerov_slam.clock import WallClock
from bluerov_slam.services.extension import Extension
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.services.supervisor import ChildSpec, Supervisor, serve, stop_signals
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.sources.replay import ReplaySource, decoder_for


def _speed(_context: click.Context, _option: click.Parameter, value: str) -> float | None:
    """None for `max`."""
    if value == "max":
        return None
    try:
        return float(value)
    except ValueError:
        raise click.BadParameter(f"{value!r}: expected a number such as 1 or 4, or max") from None


@click.command("replay")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--speed", callback=_speed, default="1", show_default=True, help="Times real time, or max.")
@click.option("--baud", type=click.IntRange(9600, 4_000_000), help="Pace of a plain capture [default: serial.baud].")
@click.option("--extension-only", is_flag=True, help="Without the viewer.")
@service_options
def command(
    file: Path,
    speed: float | None,
    baud: int | None,
    extension_only: bool,
    config: Path | None,
    flags: tuple[str, ...],
    log_level: str,
) -> None:
    """Serve both pages from FILE (a session folder, its zip, an MCAP file or a plain capture).

    Nothing is recorded, and no MAVLink is sent unless --set mavlink.enabled=true asks for it.
    """
    start_logging(log_level)
    store = SettingsStore.open(config, replay_flags(flags))
    source = ReplaySource(open_recording(file), speed, baud or store.settings.serial.baud)
    if extension_only:
        asyncio.run(_serve(store, source))
        return
    common = [*(["--config", str(config)] if config else []), *(part for flag in flags for part in ("--set", flag))]
    common += ["--log-level", log_level]
    own = [str(file), "--extension-only", "--speed", "max" if speed is None else str(speed), "--baud", str(source.baud)]
    children = [_child("viewer", *common), _child("replay", *own, *common)]
    click.echo(f"Replay of {file}")
    click.echo(f"Dashboard  http://localhost:{store.settings.http.port}")
    click.echo(f"Sonar      http://localhost:{store.settings.viewer.port}")
    click.echo("Stop with Ctrl-C")
    sys.exit(asyncio.run(_supervise(children)))


def replay_flags(flags: tuple[str, ...]) -> dict[str, object]:
    """The flags of a replay. MAVLink stays off unless a flag wants it: old attitude and position of a dive that is over
    must not reach a vehicle because its owner once switched MAVLink on.
    """
    return {"mavlink.enabled": False, **parse_flags(flags)}


async def _serve(store: SettingsStore, source: ReplaySource) -> None:
    await serve(Extension(store, source, decoder=decoder_for(source.recording), wall=_wall_clock(source)))


def _wall_clock(source: ReplaySource) -> WallClock:
    """The recording's own wall clock; for a capture, which has none, the present one."""
    offset_ns = source.recording.wall_offset_ns
    start_s = source.now_s()
    return WallClock(time.time() if offset_ns is None else start_s + offset_ns * 1e-9, start_s)


async def _supervise(children: list[ChildSpec]) -> int:
    with stop_signals() as stop:
        return await Supervisor(children).run(stop)


def _child(name: str, *arguments: str) -> ChildSpec:
    return ChildSpec(name, (sys.executable, "-m", "bluerov_slam", name, *arguments))
