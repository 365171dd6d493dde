"""The check of a rig on a real one: it goes to each place, then the receiver's line tells the attitude there.

The receiver answers to a depth with a line of fifteen values once it has heard a pulse; only its attitude is used. The
rig stands still meanwhile, and is asked afterwards whether it still does: a press of its button sends it home.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import LinkError
from bluerov_slam.protocol.rig_link import MAX_STEPS, STEP_S, RigAck, RigMode, RigResult, RigState, StopCause
from bluerov_slam.protocol.rig_receiver import NumberReply
from bluerov_slam.rig.check import Ended, Missing
from bluerov_slam.rig.collection import DEPTH_TRIES, RESULT_TIMEOUT_S, Damaged, Replied, Result
from bluerov_slam.rig.dimensions import FO_SHIP, FO_SHIP_PLATFORM
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.rig.stack import stack_pose
from bluerov_slam.rig.trajectory import SERVO_SPEED_RADPS
from bluerov_slam.services.rig import (
    PLATFORMS,
    RECEIVER_BAUD,
    RIG_BAUD,
    SAME_SET_POINT,
    Line,
    ReceiverLink,
    RigLink,
    refusal,
    stopped_words,
    wait_at_home,
)
from bluerov_slam.services.rig_way import BUTTON

_MM_PER_M = 1e3

Floats = NDArray[np.float64]


class RealBench:
    """A rig and its receiver. `share` of the servos' speed is used."""

    def __init__(
        self, rig: RigLink, receiver: ReceiverLink, share: float, result_timeout_s: float = RESULT_TIMEOUT_S
    ) -> None:
        self._rig, self._receiver = rig, receiver
        self._share, self._timeout_s = share, result_timeout_s
        self._at = np.zeros((PLATFORMS, 6))

    def attitude_at(self, set_points: Floats) -> Floats:
        """What the board says there. Raises Missing and Ended."""
        try:
            self._go(set_points)
            attitude = self._read(set_points)
            self._still_at(set_points)
        except LinkError as error:
            raise Ended(str(error)) from error
        return attitude

    def go_home(self) -> None:
        """At the same speed. Raises Missing and Ended."""
        try:
            self._go(np.zeros((PLATFORMS, 6)))
        except LinkError as error:
            raise Ended(str(error)) from error

    def _go(self, set_points: Floats) -> None:
        if np.array_equal(set_points, self._at):
            return
        answer = self._rig.move(set_points, steps_between(self._at, set_points, self._share))
        match answer:
            case None:
                raise Ended("the link to the rig is silent")
            case RigAck(result=RigResult.NOT_NOW) | RigState(stopped_by=StopCause.BUTTON):
                raise Ended(BUTTON)
            case RigAck():
                raise Missing(f"the rig refused to move: {refusal(answer)}")  # and stands where it stood
            case RigState(stopped_by=cause) if cause != StopCause.ARRIVED:
                raise Ended(stopped_words(answer))
        self._at = set_points.copy()

    def _read(self, set_points: Floats) -> Floats:
        depth_m = float(stack_pose(set_points, FO_SHIP).position_mm[0]) / _MM_PER_M
        for _ in range(DEPTH_TRIES):
            reply = self._receiver.tell(depth_m)
            if isinstance(reply, Replied) and reply.code != NumberReply.REPEAT:
                break
        if not isinstance(reply, Replied):
            raise Missing("the link to the receiver is silent")
        if reply.code != NumberReply.GOOD:
            how = "given up by the receiver" if reply.code == NumberReply.GIVEN_UP else "wrong checksum"
            raise Missing(f"the depth did not arrive: {how}")
        result = self._receiver.result(self._timeout_s)
        if isinstance(result, Damaged):
            raise Missing(f"the receiver's line is damaged: {result.line[:60]!r}")
        if not isinstance(result, Result):
            raise Missing("the receiver sent no line: it hears no pulse")
        if not np.isfinite(result.attitude_rad).all():
            raise Missing("the receiver's line holds no number for its attitude: its IMU is silent")
        return np.asarray(result.attitude_rad)

    def _still_at(self, set_points: Floats) -> None:
        state = self._rig.where()
        if state.mode in (RigMode.WAITING, RigMode.HOMING):
            raise Ended(BUTTON)
        if not np.abs(state.set_points - set_points).max() <= SAME_SET_POINT:  # NaN is nowhere
            raise Ended("the rig is not where it was sent: were its servo boards without supply?")


def steps_between(start: Floats, end: Floats, share: float) -> int:
    """Steps of 50 ms that a straight move takes at so much of the servos' speed."""
    ways = start + np.linspace(0.0, 1.0, 5)[:, None, None] * (end - start)
    angles = servo_angles_rad(ways, FO_SHIP_PLATFORM)
    fastest = float(np.abs(np.diff(angles, axis=0)).max()) * (len(ways) - 1)
    if not math.isfinite(fastest):
        return 1  # out of reach: the firmware refuses it by name
    return min(MAX_STEPS, max(1, math.ceil(fastest / (share * SERVO_SPEED_RADPS * STEP_S))))


@contextlib.contextmanager
def check_bench(port: Path, receiver_port: Path, share: float, say: Callable[[str], None]) -> Iterator[RealBench]:
    """A rig at home and allowed to move, and its receiver. On every way out nothing moves. Raises LinkError."""
    with contextlib.ExitStack() as at_the_end:
        lines = []
        for path, baud in ((port, RIG_BAUD), (receiver_port, RECEIVER_BAUD)):
            lines.append(Line(path, baud))
            at_the_end.callback(lines[-1].close)
        rig = RigLink(lines[0])
        wait_at_home(rig, say)
        at_the_end.callback(rig.stop)
        yield RealBench(rig, ReceiverLink(lines[1]), share)
