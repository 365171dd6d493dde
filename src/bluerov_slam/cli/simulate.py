"""`bluerov-slam simulate`: the virtual ESP32 on a pseudo-terminal, and a vehicle's log over UDP."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import tempfile
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import click

from bluerov_slam.cli.firmware_choice import choose_board
from bluerov_slam.cli.service_options import FIRMWARES
from bluerov_slam.errors import ConfigError
from bluerov_slam.services.acoustic_player import AcousticPlayer
from bluerov_slam.services.autopilot_player import AutopilotPlayer
from bluerov_slam.services.simulator import Simulator
from bluerov_slam.services.vehicle_log_player import VehicleLogPlayer
from bluerov_slam.simulation.acoustic_board import acoustic_board
from bluerov_slam.simulation.faults import parse_fault
from bluerov_slam.simulation.scenario import SCENARIOS, Scenario, scenario_from_mapping
from bluerov_slam.simulation.scene import FlownScene, RecordedScene, Scene, SimulatedScene
from bluerov_slam.simulation.virtual_autopilot import VirtualAutopilot
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from bluerov_slam.sources.vehicle_log import read_vehicle_log
from bluerov_slam.sources.xtf import read_xtf

XTF_SAMPLES = 1000
Part = Simulator | VehicleLogPlayer | AutopilotPlayer | AcousticPlayer


def default_link() -> Path:
    """Where the port's name appears unless told otherwise."""
    return Path(tempfile.gettempdir()) / f"bluerov-slam-{os.getuid()}" / "esp32"


@click.command("simulate")
@click.option("--baud", type=click.Choice(["115200", "921600"]), default="115200", show_default=True)
@click.option(
    "--link", type=click.Path(path_type=Path), help="Symbolic link to the port [default: in the temp folder]."
)
@click.option(
    "--device-folder", type=click.Path(path_type=Path), help="A folder to play /dev: ttyUSB<n>, serial/by-id."
)
@click.option("--seed", type=int, help="World, vehicle and noise follow from it.")
@click.option(
    "--scenario", "scenario_name", default="survey", show_default=True, help="A name, or a TOML or JSON file."
)
@click.option("--list-scenarios", is_flag=True, help="Name the built-in scenarios and stop.")
@click.option("--xtf", type=click.Path(path_type=Path), help="Play a real side-scan recording through the sonars.")
@click.option(
    "--firmware",
    type=click.Choice(FIRMWARES),
    default="auto",
    show_default=True,
    help="What the board is: the native firmware core or the Python reference; auto: native if it is built.",
)
@click.option("--legacy", is_flag=True, help="Old firmware: SENSORS and compressed pings only, fields that wrap.")
@click.option("--fault", "faults", multiple=True, help="For example 'at=10 kind=garbage duration=2'. Repeatable.")
@click.option("--tlog", type=click.Path(path_type=Path), help="Play a vehicle's MAVLink log as well.")
@click.option(
    "--tlog-target",
    default="127.0.0.1:14401",
    show_default=True,
    help="Where the log is played: the vehicle's endpoint to which the extension sends.",
)
@click.option("--tlog-only", is_flag=True, help="Play the vehicle's log without the virtual ESP32.")
@click.option(
    "--autopilot", help="HOST:PORT at which the vehicle's autopilot speaks MAVLink, for example 127.0.0.1:14402."
)
@click.option(
    "--acoustics", help="HOST:PORT to which an acoustic board sends, for example 127.0.0.1:14557; adds a beacon."
)
@click.option("--duration", type=click.FloatRange(min=0.0, min_open=True), help="Stop after so many seconds.")
def command(
    baud: str,
    link: Path | None,
    device_folder: Path | None,
    seed: int | None,
    scenario_name: str,
    list_scenarios: bool,
    xtf: Path | None,
    firmware: str,
    legacy: bool,
    faults: tuple[str, ...],
    tlog: Path | None,
    tlog_target: str,
    tlog_only: bool,
    autopilot: str | None,
    acoustics: str | None,
    duration: float | None,
) -> None:
    """Simulate the ESP32 with all its sensors on a pseudo-terminal, in real time."""
    if list_scenarios:
        for name in SCENARIOS:
            click.echo(name)
        return
    if tlog_only and tlog is None:
        raise ConfigError("--tlog-only needs --tlog FILE")
    if autopilot is not None and (xtf or tlog or tlog_only):
        raise ConfigError("--autopilot flies the simulated dive: it goes neither with --xtf nor with --tlog")
    if acoustics is not None and (xtf or tlog_only):
        raise ConfigError("--acoustics needs the simulated dive: it goes neither with --xtf nor with --tlog-only")
    parts: list[Part] = []
    if not tlog_only:
        scenario = load_scenario(scenario_name, seed=seed, legacy=legacy, faults=faults)
        simulator = make_simulator(scenario, int(baud), link or default_link(), device_folder, xtf, firmware)
        parts.append(simulator)
        if autopilot is not None:
            parts.append(make_autopilot(simulator.board, _address("--autopilot", autopilot)))
        if acoustics is not None:
            parts.append(make_acoustics(simulator.board, _address("--acoustics", acoustics)))
    if tlog is not None:
        target = _address("--tlog-target", tlog_target)
        parts.append(VehicleLogPlayer(read_vehicle_log(tlog), target, on_event=_say))
    asyncio.run(_run_all(parts, duration))


def load_scenario(name: str, *, seed: int | None, legacy: bool, faults: tuple[str, ...]) -> Scenario:
    """The scenario of that name or file with what the command line adds."""
    scenario = SCENARIOS[name] if name in SCENARIOS else _scenario_file(Path(name))
    if seed is not None:
        scenario = replace(scenario, seed=_checked_seed(seed))
    return replace(
        scenario,
        legacy=legacy or scenario.legacy,
        faults=scenario.faults + tuple(parse_fault(fault) for fault in faults),
    )


def make_simulator(
    scenario: Scenario,
    baud: int,
    link: Path,
    device_folder: Path | None = None,
    xtf: Path | None = None,
    firmware: str = "auto",
) -> Simulator:
    """The board of a scenario, or of a recording, on its line; says what it simulates. GPS time is now."""
    loop_length_s = None
    scene: Scene
    if xtf is None:
        scene = SimulatedScene(scenario)
        _say(f"scenario {scenario.name}, seed {scenario.seed}, {baud} baud")
    else:
        survey = read_xtf(xtf)
        loop_length_s = survey.duration_s
        resolution_mm = max(1, round(survey.slant_range_m * 1000.0 / XTF_SAMPLES))
        scenario = replace(
            scenario,
            name=survey.name,
            samples=XTF_SAMPLES,
            resolution_mm=resolution_mm,
            ping_period_ms=round(survey.period_s * 1000.0),
        )
        scene = RecordedScene(survey)
        _say(
            f"plays {survey.name}: {len(survey.time_s)} real pings in {survey.duration_s:.1f} s, "
            f"{XTF_SAMPLES} samples of {resolution_mm} mm, amplitudes 16 bit / 128; starts again at the end"
        )
    for fault in scenario.faults:
        _say(f"fault: {fault.text}")
    board, which = choose_board(firmware, scenario.legacy)
    _say(which)
    # The scene takes a second to build: the board is switched on after that.
    esp32 = VirtualEsp32(replace(scenario, utc_start_unix_s=time.time()), baud, scene, board)
    return Simulator(esp32, link, device_folder, on_event=_say, loop_length_s=loop_length_s)


def make_autopilot(board: VirtualEsp32, address: tuple[str, int]) -> AutopilotPlayer:
    """The autopilot of the vehicle that this board is on."""
    scene, scenario = board.scene, board.scenario
    assert isinstance(scene, FlownScene)
    autopilot = VirtualAutopilot(
        scene.truth,
        board.instruments.errors,
        scenario.seed,
        mission_start_s=scenario.mission_start_s,
        water=scenario.water,
        dvl=scenario.dvl,
    )
    return AutopilotPlayer(autopilot, lambda: board.now_s, address, on_event=_say)


def make_acoustics(board: VirtualEsp32, address: tuple[str, int]) -> AcousticPlayer:
    """An acoustic board on the same vehicle; the scenario's, or the usual one."""
    if board.acoustics is not None:
        raise ConfigError("--acoustics: this scenario's acoustic board sends over the ESP32's line (link = serial)")
    return AcousticPlayer(acoustic_board(board.scenario, board.scene), lambda: board.now_s, address, on_event=_say)


async def _run_all(parts: list[Part], duration_s: float | None) -> None:
    """Run until one fails, a signal comes or the time is up."""
    loop = asyncio.get_running_loop()
    running = [asyncio.create_task(part.run()) for part in parts]
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    stopped = asyncio.create_task(stop.wait())
    try:
        done, _ = await asyncio.wait([*running, stopped], timeout=duration_s, return_when=asyncio.FIRST_COMPLETED)
        for task in done - {stopped}:
            task.result()
    finally:
        for task in [*running, stopped]:
            task.cancel()
        for task in [*running, stopped]:
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await task


def _scenario_file(path: Path) -> Scenario:
    if not path.exists():
        raise ConfigError(f"--scenario {path}: neither a file nor one of {', '.join(SCENARIOS)}")
    try:
        text = path.read_text(encoding="utf-8")
        values = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: must be one table of scenario keys")
    try:
        return scenario_from_mapping(values)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _checked_seed(seed: int) -> int:
    return scenario_from_mapping({"seed": seed}).seed


def _address(option: str, text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit() or not 0 <= int(port) <= 65535:
        raise ConfigError(f"{option} '{text}': expected HOST:PORT, for example 127.0.0.1:14401")
    return host, int(port)


def _say(text: str) -> None:
    click.echo(f"SIMULATED: {text}")
