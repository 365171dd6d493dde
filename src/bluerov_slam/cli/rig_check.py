"""`bluerov-slam rig check`: which servo is stuck, or off its zero, on a simulated rig or a real one."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bluerov_slam.cli.finite_range import FiniteRange
from bluerov_slam.cli.rig_demo import CAREFUL
from bluerov_slam.cli.rig_real import announced, move_option, port_option
from bluerov_slam.errors import ConfigError

if TYPE_CHECKING:
    from bluerov_slam.rig.check import CheckReadings, RigCheck
    from bluerov_slam.sinks.rig_check_file import CheckFile

FAULT_STATUS, UNKNOWN_STATUS = 3, 4
"""1 and 2 are of errors and of the command line."""
_SECONDS_A_PLACE = 7.0
_LARGEST_RUN = 1000


@click.command(name="check", short_help="Find a stuck servo or a wrong zero, simulated by default.")
@click.option("--seed", default=1000, show_default=True, type=click.IntRange(0), help="Simulation: which rig.")
@click.option(
    "--run",
    "run_number",
    type=click.IntRange(0, _LARGEST_RUN),
    help="Simulation: runs of the same rig differ in play and noise [default: 0, 1 with --compare].",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    help="Simulation: 'stuck PLATFORM SERVO' or 'offset PLATFORM SERVO DEG', counted from 0.",
)
@click.option(
    "--compare",
    "earlier_file",
    type=click.Path(path_type=Path),
    help="--json of an earlier run of this rig that found no fault: half as large a wrong zero shows.",
)
@click.option("--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), help="Readings and verdict.")
@click.option(
    "--speed",
    "share",
    default=CAREFUL,
    show_default=True,
    type=FiniteRange(0.02, 1.0),
    help="A real rig: share of the servos' speed.",
)
@port_option
@click.option(
    "--receiver-port", type=click.Path(path_type=Path), help="A real rig: the serial port of the acoustic receiver."
)
@move_option
def command(
    seed: int,
    run_number: int | None,
    faults: tuple[str, ...],
    earlier_file: Path | None,
    json_file: Path | None,
    share: float,
    port: Path | None,
    receiver_port: Path | None,
    move_for_real: bool,
) -> None:
    """Move one servo at a time, then all to 80 stances, and tell by the receiver's attitude what is wrong with which.

    Ends with 0 where no fault is found, 3 where one is, 4 where it cannot tell. See docs/rig-calibration.md.
    """
    from bluerov_slam.rig.check import RigCheck
    from bluerov_slam.rig.check_words import FAULT, UNKNOWN, outcome, words
    from bluerov_slam.sinks.rig_check_file import read_check, write_check

    if port is None and (receiver_port is not None or move_for_real):
        raise ConfigError("--receiver-port and --move-for-real are for a real rig: give its --port, too")
    if port is not None and (faults or run_number is not None):
        raise ConfigError("--fault and --run are for a simulated rig")
    if port is not None and port == receiver_port:
        raise ConfigError(f"{port} is given as the rig's port and as the receiver's; each has its own")
    check = RigCheck()
    if port is not None and not announced(_what_moves(check), move_for_real):
        return
    if port is not None and receiver_port is None:
        raise ConfigError("the attitude comes from the receiver: give its --receiver-port")
    run_number = int(earlier_file is not None) if run_number is None else run_number
    source = f"simulated, seed {seed}, run {run_number}" if port is None else str(port)
    earlier = None if earlier_file is None else read_check(earlier_file, check)
    if earlier is not None:
        _comparable(earlier, source)
    if port is None or receiver_port is None:
        readings = _simulated(check, seed, run_number, faults)
    else:
        readings = _real(check, port, receiver_port, share)
    verdict = check.judge(readings, None if earlier is None else earlier.readings)
    result, lines = outcome(verdict), words(verdict)
    if port is None:  # a real rig's were said as they came
        for line in readings.missing:
            click.echo(f"Missing: {line}", err=True)
    if readings.ended:
        click.echo(f"Ended early: {readings.ended}", err=True)
    for line in lines:
        click.echo(line)
    if json_file is not None:
        write_check(json_file, check, readings, verdict, result, lines, source, time.time())
        click.echo(f"Readings and verdict: {json_file}")
    raise SystemExit({FAULT: FAULT_STATUS, UNKNOWN: UNKNOWN_STATUS}.get(result, 0))


def _what_moves(check: RigCheck) -> list[str]:
    places = len(check.servo_places) + len(check.zero_places)
    return [
        "every platform leans another way by 9 degrees; from there each of 24 servos by itself, 10 degrees up and down",
        f"if all move as told: all platforms to {len(check.zero_places)} stances all over the workspace; then home",
        f"some {places * _SECONDS_A_PLACE / 60.0:.0f} minutes; the transmitter must be on, the receiver sends its "
        "attitude with a pulse that it heard",
    ]


def _comparable(earlier: CheckFile, source: str) -> None:
    """Raises ConfigError where one run says nothing of the other."""
    from bluerov_slam.rig.check_words import FAULT

    if earlier.outcome == FAULT:
        raise ConfigError(
            "--compare: the earlier run found a fault, which would pass for the rig's own; "
            "mend it, check without --compare, and compare with that run"
        )
    was, now = (text.rpartition(", run ")[0] for text in (earlier.source, source))
    if was != now:
        raise ConfigError(f"--compare: the earlier run is of another rig ({earlier.source}; this is {source})")
    if was and earlier.source == source:
        raise ConfigError("--compare: the earlier run has the same play and noise; give another --run")


def _simulated(check: RigCheck, seed: int, run_number: int, faults: tuple[str, ...]) -> CheckReadings:
    from bluerov_slam.evaluation.rig_check_bench import SimulatedBench
    from bluerov_slam.simulation.rig import ServoFault

    built_in = [ServoFault.parse(text) for text in faults]
    click.echo(f"Simulated rig of seed {seed}, run {run_number}")
    for each in built_in:
        off = "" if each.kind == "stuck" else f" by {math.degrees(each.angle_rad):+g} degrees"
        click.echo(f"  built in: servo {each.servo + 1} of platform {each.platform + 1} is {each.kind}{off}")
    return check.run(SimulatedBench(seed, run_number, built_in))


def _real(check: RigCheck, port: Path, receiver_port: Path, share: float) -> CheckReadings:
    from bluerov_slam.rig.check import Ended, Missing
    from bluerov_slam.services.rig_check import check_bench

    try:
        with check_bench(port, receiver_port, share, click.echo) as bench:
            readings = check.run(bench, click.echo)
            if not readings.ended and not readings.held:
                try:
                    bench.go_home()
                    click.echo("The rig is at home")
                except (Missing, Ended) as error:
                    click.echo(f"The rig did not go home: {error}", err=True)
            else:
                click.echo("The rig holds where it is. Its button sends it home")
    except KeyboardInterrupt:
        click.echo("Stopped by Ctrl-C: the rig holds where it is. Its button sends it home", err=True)
        raise SystemExit(130) from None
    return readings
