"""The rig's firmware as a program of this machine, behind a pseudo terminal: the angles that it makes of set points.

Through the link that a real rig has (`services/rig.RigLink`), its button pressed by a signal.
"""

from __future__ import annotations

import contextlib
import json
import select
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import LinkError
from bluerov_slam.protocol.rig_link import POLL_S, RigAck, RigMode, RigResult, StopCause
from bluerov_slam.services.parent_death import end_with_parent
from bluerov_slam.services.rig import RIG_BAUD, SAME_SET_POINT, Line, RigLink, refusal

FIRMWARE = Path(__file__).resolve().parents[3] / "firmware"
BUILD = FIRMWARE / "build"
PROGRAM, REPORT = "brov-rig", "report.json"
SOURCES = ("lib", "native", "xtensa")
PATIENCE_S = 10.0
_NO_ANGLES = (RigResult.LIMIT, RigResult.UNREACHABLE, RigResult.SERVO_RANGE)

Floats = NDArray[np.float64]


def firmware_angles_rad(set_points: Floats, build: Path = BUILD) -> Floats:
    """Servo angles (n, 4, 6) of set points (n, 4, 6), each reached in one step; NaN where the firmware refuses them.

    Raises LinkError where the program is not there, not up to date, or falls silent.
    """
    program = build / PROGRAM
    _check(program, "`make firmware` builds it")
    angles = np.full(set_points.shape, np.nan)
    with running(program) as rig:
        for number, points in enumerate(set_points):
            state = rig.move(points, 1)
            if state is None:
                raise LinkError(f"{program} fell silent at set points {number + 1} of {len(set_points)}; run it again")
            if isinstance(state, RigAck):
                if state.result in _NO_ANGLES:
                    continue
                raise LinkError(f"{program} does not move: {refusal(state)}; run it again")
            there = np.abs(state.set_points - points).max() <= SAME_SET_POINT
            if state.stopped_by != StopCause.ARRIVED or not there:
                raise LinkError(f"{program} did not arrive at set points {number + 1} of {len(set_points)}")
            angles[number] = state.servo_angles_rad
    return angles


def instruction_counts(build: Path = BUILD) -> Mapping[str, float]:
    """Values of the rows of the firmware's report, by their ids. Raises LinkError where there is none of now."""
    path = build / REPORT
    cure = "firmware/xtensa/try_all counts anew (it needs QEMU and the Xtensa compilers: `make system-setup`)"
    _check(path, cure)
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
        found = {str(row["id"]): float(row["value"]) for row in rows}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LinkError(f"{path} does not read; {cure}") from error
    if not any(name.startswith("ik_") for name in found):
        raise LinkError(f"{path} has no counts of the inverse kinematics; {cure}")
    return found


@contextlib.contextmanager
def running(program: Path) -> Iterator[RigLink]:
    """The program with its button pressed, ready to move; it is ended on the way out. Raises LinkError."""
    try:
        process = subprocess.Popen(  # noqa: S603
            [str(program), "--link", "auto"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, preexec_fn=end_with_parent,
        )  # fmt: skip
    except OSError as error:
        raise LinkError(f"{program} cannot be started: {error.strerror}; `make firmware` builds it anew") from error
    with contextlib.ExitStack() as at_the_end:
        at_the_end.callback(_end, process)
        assert process.stdout is not None
        at_the_end.callback(process.stdout.close)
        told = select.select([process.stdout], [], [], PATIENCE_S)[0]
        name = process.stdout.readline().decode(errors="replace").strip() if told else ""
        if not name:
            raise LinkError(f"{program} names no pseudo terminal: it is not the rig's firmware; run `make firmware`")
        line = Line(Path(name), RIG_BAUD)
        at_the_end.callback(line.close)
        rig = RigLink(line)
        _wait_for(rig, RigMode.WAITING, program)
        process.send_signal(signal.SIGUSR1)
        _wait_for(rig, RigMode.READY, program)
        yield rig


def _wait_for(rig: RigLink, mode: RigMode, program: Path) -> None:
    until = time.monotonic() + PATIENCE_S
    while rig.where().mode != mode:
        if time.monotonic() > until:
            raise LinkError(f"{program} was not {mode.name.lower()} within {PATIENCE_S:g} s; run it again")
        time.sleep(POLL_S)


def _check(path: Path, cure: str) -> None:
    """What was built from older sources says nothing of these. Raises LinkError."""
    if not path.is_file():
        raise LinkError(f"there is no {path}; {cure}")
    folder = path.parent.parent
    newest = max(
        (file.stat().st_mtime for name in SOURCES for file in (folder / name).rglob("*") if file.is_file()), default=0.0
    )
    if path.stat().st_mtime < newest:
        raise LinkError(f"{path} is older than the firmware's source; {cure}")


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
