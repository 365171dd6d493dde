"""`bluerov-slam run`: the whole system, each service a process of its own."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
import tempfile
from pathlib import Path

import click

from bluerov_slam.cli.service_options import FIRMWARES, parse_flags, service_options, start_logging
from bluerov_slam.config import Settings
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.services.supervisor import ChildSpec, Supervisor, stop_signals


@click.command("run")
@service_options
@click.option("--simulate", is_flag=True, help="Run on a virtual ESP32 instead of a real one.")
@click.option("--scenario", help="What is simulated [default: simulation.scenario].")
@click.option("--xtf", type=click.Path(path_type=Path), help="Simulate with a real side-scan recording.")
@click.option(
    "--firmware",
    type=click.Choice(FIRMWARES),
    help="Simulate with the native firmware core or the Python reference [default: auto, native if it is built].",
)
@click.option(
    "--autopilot/--no-autopilot",
    default=None,
    help="Simulate the vehicle's MAVLink, too, on loopback [default: yes, unless mavlink.enabled or --xtf].",
)
@click.option(
    "--acoustics/--no-acoustics",
    default=None,
    help="Simulate a beacon and an acoustic array, too [default: if the scenario has them, as 'beacon' does].",
)
@click.option("--fault", "faults", multiple=True, help="Simulate a fault, for example 'at=10 kind=reset'; repeatable.")
def command(
    config: Path | None,
    flags: tuple[str, ...],
    log_level: str,
    simulate: bool,
    scenario: str | None,
    xtf: Path | None,
    firmware: str | None,
    autopilot: bool | None,
    acoustics: bool | None,
    faults: tuple[str, ...],
) -> None:
    """Run extension and viewer, and with --simulate the virtual ESP32; Ctrl-C stops them all."""
    if not simulate and (scenario or xtf or firmware or autopilot or acoustics or faults):
        raise click.UsageError("--scenario, --xtf, --firmware, --autopilot, --acoustics and --fault need --simulate")
    start_logging(log_level)
    settings = SettingsStore.open(config, parse_flags(flags)).settings
    common = [*(["--config", str(config)] if config else []), *_repeated("--set", flags), "--log-level", log_level]
    with tempfile.TemporaryDirectory(prefix="bluerov-slam-") as folder:
        port = Path(folder) / "esp32"
        children = [_child("viewer", *common)]
        if simulate:
            chosen = scenario or settings.simulation.scenario
            extra = ["--scenario", chosen, *_repeated("--fault", faults)]
            extra += ["--xtf", str(xtf)] if xtf else []
            extra += ["--firmware", firmware or "auto"]
            listen = ["--simulated"]
            # A real vehicle's MAVLink may come in where that is switched on: two vehicles at once would be nonsense.
            if autopilot or (autopilot is None and xtf is None and not settings.mavlink.enabled):
                address = f"127.0.0.1:{_free_udp_port()}"
                extra += ["--autopilot", address]
                listen += ["--simulated-autopilot", address]
            if xtf is None and acoustics is not False:
                board, fitted = _acoustics(chosen, wanted=bool(acoustics))
                extra += board
                listen += fitted
            children.insert(0, _simulator(settings, port, extra))
            children.append(_child("extension", *common, *listen, "--set", f"serial.port={port}"))
        else:
            children.append(_child("extension", *common))
        _announce(settings, simulate)
        code = asyncio.run(_supervise(children))
    sys.exit(code)


async def _supervise(children: list[ChildSpec]) -> int:
    with stop_signals() as stop:
        return await Supervisor(children).run(stop)


def _child(name: str, *arguments: str) -> ChildSpec:
    return ChildSpec(name, (sys.executable, "-m", "bluerov_slam", name, *arguments))


def _simulator(settings: Settings, port: Path, extra: list[str]) -> ChildSpec:
    baud, seed = str(settings.serial.baud), str(settings.simulation.seed)
    return _child("simulate", "--link", str(port), "--baud", baud, "--seed", seed, *extra)


def _acoustics(scenario_name: str, *, wanted: bool) -> tuple[list[str], list[str]]:
    """What tells the simulator to play the acoustic board, and the extension that such an array is fitted."""
    from bluerov_slam.cli.simulate import load_scenario
    from bluerov_slam.simulation.acoustic_board import fitted_array
    from bluerov_slam.simulation.acoustic_plan import AcousticPlan

    plan = load_scenario(scenario_name, seed=None, legacy=False, faults=()).acoustics
    if plan is None:
        if not wanted:
            return [], []
        plan = AcousticPlan()
    port = _free_udp_port()
    array = fitted_array(plan)
    settings = {
        "enabled": "true",
        "udp_port": str(port),
        "array": "places",
        "places_m": "; ".join(",".join(f"{part:.6f}" for part in place) for place in array.positions_m.tolist()),
        "sample_skew_us": json.dumps([round(1e6 * skew_s, 6) for skew_s in array.sample_skew_s.tolist()]),
        "mounting_rpy_deg": json.dumps(plan.mounting_rpy_deg),
        "lever_arm_frd_m": json.dumps(plan.lever_arm_frd_m),
    }
    flags = _repeated("--set", tuple(f"acoustics.{key}={value}" for key, value in settings.items()))
    return ["--acoustics", f"127.0.0.1:{port}"] if plan.link == "udp" else [], flags


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _repeated(option: str, values: tuple[str, ...]) -> list[str]:
    return [part for value in values for part in (option, value)]


def _announce(settings: Settings, simulate: bool) -> None:
    click.echo(f"Dashboard  http://localhost:{settings.http.port}")
    click.echo(f"Sonar      http://localhost:{settings.viewer.port}")
    click.echo("Data is SIMULATED: a virtual ESP32" if simulate else f"Serial port: {settings.serial.port}")
    click.echo("Stop with Ctrl-C")
