"""`bluerov-slam rig collect`: the thesis's experiment with a simulated rig, or a real one."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from numpy.typing import NDArray

from bluerov_slam.cli.rig_real import announced, move_option, port_option
from bluerov_slam.errors import ConfigError, LinkError, RecordingError

if TYPE_CHECKING:
    from bluerov_slam.evaluation.rig_experiment import SessionOutcome
    from bluerov_slam.evaluation.rig_table import Collected
    from bluerov_slam.rig.collection import Action, Point, Session
    from bluerov_slam.sinks.rig_session import RigSessionFiles

MOTIONS = ("stationary", "rapid", "gradual")
TESTS = 9
LARGEST_TILT_DEG = 8.0
"""The thesis's rig leant by three degrees at home."""


@click.command(name="collect", short_help="Run the thesis's experiment, simulated by default.")
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option("--tests", default="", help="Some of the nine published tests, as 1,4 [default: all].")
@click.option(
    "--transmitter",
    "transmitters",
    multiple=True,
    help="X,Y,Z of a transmitter, mm in the rig's frame, in place of the published tests; may be repeated.",
)
@click.option("--motion", "motions", multiple=True, type=click.Choice(MOTIONS), help="May be repeated [default: all].")
@click.option("--fixes", default=200, show_default=True, type=click.IntRange(1), help="Points of a stationary session.")
@click.option("--passes", default=1, show_default=True, type=click.IntRange(1), help="Of the axes in a moving session.")
@click.option(
    "--seed", default=1000, show_default=True, type=click.IntRange(0), help="Simulation: below 100 for tuning."
)
@click.option(
    "--fault", "faults", multiple=True, help="Simulation: 'stuck PLATFORM SERVO' or 'offset PLATFORM SERVO DEG'."
)
@click.option("--jobs", default=0, type=click.IntRange(0), help="Simulation: processes; 0: one for each processor.")
@port_option
@click.option(
    "--receiver-port", type=click.Path(path_type=Path), help="A real rig: the serial port of the acoustic receiver."
)
@move_option
@click.option(
    "--tilt-at-home",
    metavar="ROLL,PITCH",
    help="A real rig: what its receiver shows at home, degrees; what is set counts from there [default: 0,0].",
)
def command(
    folder: Path,
    tests: str,
    transmitters: tuple[str, ...],
    motions: tuple[str, ...],
    fixes: int,
    passes: int,
    seed: int,
    faults: tuple[str, ...],
    jobs: int,
    port: Path | None,
    receiver_port: Path | None,
    move_for_real: bool,
    tilt_at_home: str | None,
) -> None:
    """Collect data into FOLDER: for each session a log in the thesis's format, one of ours (JSONL) and a recording
    (MCAP), and report.html.

    A missing point has a reason in our log and no line in the thesis's. See docs/rig-collection.md.
    """
    sessions = _sessions(tests, transmitters, motions, fixes, passes)
    if port is None and (receiver_port is not None or move_for_real):
        raise ConfigError("--receiver-port and --move-for-real are for a real rig: give its --port, too")
    if port is not None and faults:
        raise ConfigError("--fault is for a simulated rig")
    if port is None and tilt_at_home is not None:
        raise ConfigError("--tilt-at-home is for a real rig; a simulated one measures its own")
    level_rad = _level_rad(tilt_at_home)
    if port is not None and port == receiver_port:
        raise ConfigError(f"{port} is given as the rig's port and as the receiver's; each has its own")
    if port is not None and not announced(_what_moves(sessions), move_for_real):
        return
    if port is not None and receiver_port is None:
        raise ConfigError("a real collection needs the receiver's port: --receiver-port")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise ConfigError(f"{folder} is not empty; a collection goes into a folder of its own")
    except OSError as error:
        raise ConfigError(f"cannot use {folder}: {error.strerror}; give a folder that can be written") from error
    if port is None or receiver_port is None:
        _simulated(folder, sessions, seed, faults, jobs)
    else:
        _real(folder, sessions, port, receiver_port, level_rad)


def _level_rad(text: str | None) -> tuple[float, float]:
    """Of "ROLL,PITCH" in degrees. Raises ConfigError."""
    try:
        roll, pitch = (float(part) for part in ("0,0" if text is None else text).split(","))
    except ValueError:
        roll = pitch = float("nan")
    if not (abs(roll) <= LARGEST_TILT_DEG and abs(pitch) <= LARGEST_TILT_DEG):  # NaN is too much
        raise ConfigError(
            f"--tilt-at-home '{text}': two numbers with a comma are expected, roll and pitch in degrees, each within "
            f"{LARGEST_TILT_DEG:g}; a rig that leans more at home needs its servos' zeros set (docs/rig-calibration.md)"
        )
    return float(np.radians(roll)), float(np.radians(pitch))


def _what_moves(sessions: list[tuple[int, Session]]) -> list[str]:
    from bluerov_slam.services.rig import what_moves

    return what_moves([session for _, session in sessions])


def _sessions(
    tests: str, transmitters: tuple[str, ...], motions: tuple[str, ...], fixes: int, passes: int
) -> list[tuple[int, Session]]:
    """With the number of the transmitter's place, from 1."""
    from bluerov_slam.cli.rig_numbers import transmitter_of
    from bluerov_slam.rig.collection import PUBLISHED_TESTS, Motion, PublishedTest, published_session, session_name

    kinds = [Motion(name) for name in MOTIONS if not motions or name in motions]
    if transmitters:
        if tests:
            raise ConfigError("--tests names the published places, --transmitter others: give one of them")
        places = [transmitter_of(text) for text in transmitters]
        named = [session_name(place, Motion.STATIONARY) for place in places]
        if len(set(named)) < len(named):
            raise ConfigError("--transmitter: two places are the same to the millimetre, by which logs are named")
        full = {"X": (20.0, -20.0), "Y": (20.0, -20.0), "Z": (64.0, -64.0)}
        turns = {"A": (24.0, -24.0), "B": (16.0, -8.0), "C": (16.0, -16.0)}
        chosen = [PublishedTest(number, place, full | turns) for number, place in enumerate(places, start=1)]
    else:
        wanted = [part.strip() for part in tests.split(",") if part.strip()]
        if bad := [part for part in wanted if not part.isdecimal() or not 1 <= int(part) <= TESTS]:
            raise ConfigError(f"--tests: {', '.join(bad)} is none of 1 to {TESTS}")
        chosen = [test for test in PUBLISHED_TESTS if not wanted or str(test.number) in wanted]
    return [(test.number, published_session(test, kind, fixes, passes)) for test in chosen for kind in kinds]


def _simulated(
    folder: Path, sessions: list[tuple[int, Session]], seed: int, faults: tuple[str, ...], jobs: int
) -> None:
    from bluerov_slam.evaluation.rig_experiment import SessionJob, run_session
    from bluerov_slam.evaluation.rig_table import collected
    from bluerov_slam.simulation.rig import ServoFault
    from bluerov_slam.survey.batch import Progress, run_batch

    wrong = tuple(ServoFault.parse(text) for text in faults)
    # The rig and its board are one for all sessions; what is noise is drawn for each.
    # By place and motion, so that a part of the sessions comes out as it does among all of them.
    kinds = {name: number for number, name in enumerate(MOTIONS)}
    tasks = [
        SessionJob(session, 1000 * seed + len(MOTIONS) * place + kinds[session.motion.value], seed, wrong)
        for place, session in sessions
    ]
    place_of = {session.name: place for place, session in sessions}
    progress = Progress(len(tasks), lambda line: click.echo(line, err=True))
    found: dict[str, SessionOutcome] = {}
    try:
        for job, outcome in run_batch(run_session, tasks, jobs or os.cpu_count() or 1):
            found[job.session.name] = outcome
            _write(folder, outcome)
            progress.done(str(job))
    except KeyboardInterrupt:
        click.echo("Stopped: the sessions that were complete are in their logs, there is no report", err=True)
        raise SystemExit(130) from None
    scored: list[Collected] = []
    for _, session in sessions:
        outcome = found[session.name]
        if outcome.reason:
            click.echo(f"{session.name}: ended early: {outcome.reason}", err=True)
        points = outcome.points
        scored.append(collected(session, place_of[session.name], points, outcome.ours_mm, outcome.true_mm))
    _report(folder, scored, "simulated", seed)


def _write(folder: Path, outcome: SessionOutcome) -> None:
    """The files of a simulated session; ours hold what only a simulation knows, too. Raises RecordingError."""
    from bluerov_slam.rig.collection import Keep
    from bluerov_slam.sinks.rig_session import SIMULATED, RigSessionFiles

    files = RigSessionFiles(folder, outcome.session.name, SIMULATED)
    try:
        heard = iter([*outcome.records, None])
        waiting = next(heard)
        number = 0
        for action, at_s in zip(outcome.actions, outcome.times_s, strict=True):
            while waiting is not None and waiting.measured_s <= at_s:
                files.record(waiting)
                waiting = next(heard)
            extra = None
            if isinstance(action, Keep):
                extra = {
                    "ours_mm": outcome.ours_mm[number],
                    "simulated_place_mm": outcome.true_mm[number],
                    "record_id": outcome.record_ids[number],
                }
                number += 1
            files.take(action, at_s, extra)
    finally:
        files.close()


def _report(folder: Path, scored: list[Collected], source: str, seed: int | None) -> None:
    from bluerov_slam.evaluation import rig_table
    from bluerov_slam.sinks.whole_output import in_whole
    from bluerov_slam.survey.rig_report import report_html

    if not any(len(each.rows) for each in scored):
        raise ConfigError(f"no point was collected; the reasons are in the logs in {folder}")
    try:
        with in_whole(folder / "report.html") as unfinished:
            unfinished.write_text(report_html(scored, source, seed), encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot write {folder / 'report.html'}: {error.strerror}; the logs are there") from error
    truth = "real" if source == "simulated" else "rig"
    click.echo(f"{source.capitalize()}: errors across the line of sight, mm, nothing removed")
    for name in rig_table.ESTIMATES:
        if (found := rig_table.honest(scored, name, truth)) is not None:
            click.echo(
                f"  {rig_table.LABELS[name]}: RMSE {found.rmse_mm:.1f}, median {found.median_mm:.1f}, "
                f"p95 {found.p95_mm:.1f} ({found.count} points)"
            )
    click.echo(f"Logs and report.html are in {folder}")


def _real(
    folder: Path, sessions: list[tuple[int, Session]], port: Path, receiver_port: Path, level_rad: tuple[float, float]
) -> None:
    from bluerov_slam.evaluation.rig_table import collected
    from bluerov_slam.rig.collection import Collection, CollectionPlan, Open
    from bluerov_slam.rig.collection_truth import CollectionTruth
    from bluerov_slam.rig.workspace import PlatformWorkspace
    from bluerov_slam.services.rig import connected

    space = PlatformWorkspace()

    def reachable(set_point: NDArray[np.float64]) -> str:
        limit = space.broken(set_point)
        return "" if limit is None else limit.words

    truth = CollectionTruth()

    def take(action: Action) -> None:
        if isinstance(action, Open):
            truth.restart()  # the transmitter was moved by hand: the board may have been started anew
        logs.take(action)

    plan = CollectionPlan([session for _, session in sessions], level_rad)
    logs = _Logs(folder, str(port))
    try:
        with connected(port, receiver_port, click.echo, logs.link) as rig:
            reason = rig.run(Collection(plan, truth, reachable), take)
    except KeyboardInterrupt:
        reason = "stopped by Ctrl-C"
    except RecordingError as error:
        raise RecordingError(f"{error}. The rig holds where it is; its button sends it home") from error
    except LinkError as error:
        if not logs.points:
            raise
        reason = str(error)
    finally:
        logs.close()
    if reason:
        click.echo(f"Ended early: {reason}", err=True)
    scored = [
        collected(session, place, logs.points[session.name])
        for place, session in sessions
        if session.name in logs.points
    ]
    _report(folder, scored, str(port), None)


class _Logs:
    """The files of each session in turn, and its points."""

    def __init__(self, folder: Path, source: str) -> None:
        self._folder, self._source = folder, source
        self._open: RigSessionFiles | None = None
        self.points: dict[str, list[Point]] = {}

    def take(self, action: Action) -> None:
        """Write what of an action belongs into the files. Raises RecordingError."""
        from bluerov_slam.rig.collection import Close, Keep, Open
        from bluerov_slam.sinks.rig_session import RigSessionFiles

        if isinstance(action, Open):
            self._open = RigSessionFiles(self._folder, action.session.name, self._source)
            self.points[action.session.name] = []
        if isinstance(action, Keep):
            point = action.point
            self.points[point.session].append(point)
            where = f"{point.session} {point.number}: {point.axis} {point.label:g}"
            click.echo(f"{where}: {point.missing or 'collected'}", err=bool(point.missing))
        if self._open is not None:
            try:
                self._open.take(action, time.monotonic())
            except RecordingError:
                with contextlib.suppress(RecordingError):  # the same once more
                    self.close()
                raise
        if isinstance(action, Close):
            self.close()

    def link(self, whose: str, data: bytes, down: bool) -> None:
        """Bytes of a link; those outside of a session are nobody's."""
        if self._open is not None:
            self._open.link(whose, down, data, time.monotonic())

    def close(self) -> None:
        """Close what is open. Raises RecordingError."""
        files, self._open = self._open, None
        if files is not None:
            files.close()
