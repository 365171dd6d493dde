"""Drives a real rig: the computer's link to its firmware, the link to the acoustic receiver, a collection over both.

Blocking, because one thing happens after another and a person stands beside it. Every way out of a motion that is not
its end sends STOP, and the firmware stops by itself when nothing is heard from here for half a second.
"""

from __future__ import annotations

import contextlib
import logging
import os
import select
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import BugError, LinkError
from bluerov_slam.protocol.rig_link import (
    ANSWER_WAIT_S,
    POLL_S,
    STEP_S,
    CommandExchange,
    RigAck,
    RigFrameDecoder,
    RigMode,
    RigResult,
    RigState,
    StopCause,
    encode_move,
    encode_stop,
    encode_where,
    unpack,
)
from bluerov_slam.protocol.rig_receiver import REPLY_WAIT_S, ReceiverText, encode_number
from bluerov_slam.rig.collection import (
    Action,
    AwaitResult,
    Button,
    Collection,
    Damaged,
    Event,
    Hold,
    Motion,
    Move,
    Moved,
    Refused,
    Replied,
    Result,
    SendDepth,
    Session,
    Silent,
    Start,
)
from bluerov_slam.sources.serial_port import open_port

_log = logging.getLogger(__name__)

RIG_BAUD, RECEIVER_BAUD = 115200, 9600
SAME_SET_POINT = 2e-6
"""mm or rad: the link counts in nanometres and nanoradians, the firmware in single precision."""
PLATFORMS = 4
QUIET_S = 0.1
"""A reply has no end: it is whole when nothing more comes for so long, a hundred characters at 9600 baud."""
MOVE_GRACE_S = 3.0
FOLLOW_S = 0.01
"""Between two questions where the answer must not come a step late."""
PAUSE_LIMIT_S = 3600.0
AT_HOME = 1e-3
"""Set points (mm, rad) nearer to home than this are home."""
_LAST_SEQUENCE = 255
_GONE = "plug it in again; a rig that moved has stopped by itself, and its button sends it home"
_NO_ANSWER = "is it switched on, and is this its port? One that moved has stopped by itself"

Floats = NDArray[np.float64]


Tap = Callable[[bytes, bool], None]
"""Bytes of a link, and whether they went down it."""


class Line:
    """One serial port, read with a time limit."""

    def __init__(self, path: Path, baud: int, tap: Tap = lambda _data, _down: None) -> None:
        """`tap` is given all bytes and must not raise. Raises LinkError."""
        self.path = path
        self._tap = tap
        self._descriptor = open_port(path, baud)

    def send(self, data: bytes) -> None:
        """All of it. Raises LinkError."""
        self._tap(data, True)
        try:
            while data:
                select.select([], [self._descriptor], [], ANSWER_WAIT_S)
                data = data[os.write(self._descriptor, data) :]
        except BlockingIOError as error:
            raise LinkError(f"{self.path} takes no more: nothing reads at its other end") from error
        except OSError as error:
            raise LinkError(f"{self.path} is gone ({error.strerror}): {_GONE}") from error

    def read(self, wait_s: float) -> bytes:
        """What comes within a time; empty where nothing does. Raises LinkError."""
        try:
            ready, _, _ = select.select([self._descriptor], [], [], max(0.0, wait_s))
            data = os.read(self._descriptor, 4096) if ready else b""
        except OSError as error:
            raise LinkError(f"{self.path} is gone ({error.strerror}): {_GONE}") from error
        if ready and not data:
            raise LinkError(f"{self.path} is gone: {_GONE}")
        if data:
            self._tap(data, False)
        return data

    def close(self) -> None:
        """Give the port free."""
        os.close(self._descriptor)


class RigLink:
    """Commands to the rig's firmware and its answers."""

    def __init__(self, line: Line, now: Callable[[], float] = time.monotonic) -> None:
        self._line, self._now = line, now
        self._decoder = RigFrameDecoder()
        self._sequence = 0

    def where(self) -> RigState:
        """Where the rig is. Raises LinkError where it does not answer."""
        answer = self._command(encode_where)
        if not isinstance(answer, RigState):
            raise LinkError(f"the rig at {self._line.path} does not answer: {_NO_ANSWER}")
        return answer

    def begin(self, set_points: Floats, steps: int) -> RigAck:
        """Set out for set points (4, 6) in steps of 50 ms, from where the rig is; whether it does. Raises LinkError."""
        answer = self._command(lambda sequence: encode_move(sequence, set_points, steps))
        if not isinstance(answer, RigAck):
            raise LinkError(f"the rig at {self._line.path} does not answer: {_NO_ANSWER}")
        return answer

    def stop(self) -> None:
        """Hold the step that is set now; whether the rig hears it or not."""
        with contextlib.suppress(LinkError):
            self._command(encode_stop)

    def move(self, set_points: Floats, steps: int) -> RigState | RigAck | None:
        """To set points (4, 6) in steps of 50 ms: the state it ended in, the refusal, None where the rig is silent.

        Raises LinkError where the port is gone, OutOfValidityError for what are no set points.
        """
        answer = self._command(lambda sequence: encode_move(sequence, set_points, steps))
        if not isinstance(answer, RigAck):
            return None
        if answer.result != RigResult.OK:
            return answer
        until = self._now() + steps * STEP_S + MOVE_GRACE_S
        while self._now() < until:
            state = self._command(encode_where)
            if not isinstance(state, RigState):
                return None
            if state.mode != RigMode.MOVING:
                return state
            # Asking keeps the rig moving: it stops by itself when it hears nothing for half a second.
            self._listen(POLL_S)
        self.stop()
        return None

    def follow(self, left: int, seen: Callable[[RigState], None]) -> RigState:
        """Asks where the rig is until it moves no more or has at most so many steps left. Raises LinkError."""
        state = self.where()
        seen(state)
        until = self._now() + max(0, state.steps - state.steps_done) * STEP_S + MOVE_GRACE_S
        while state.mode == RigMode.MOVING and state.steps - state.steps_done > left:
            if self._now() > until:
                raise LinkError(
                    f"the rig at {self._line.path} says that it moves, but comes no further: switch it off and on"
                )
            self._listen(FOLLOW_S)
            state = self.where()
            seen(state)
        return state

    def _command(self, encode: Callable[[int], bytes]) -> RigAck | RigState | object | None:
        """One command, at most three times; None without an answer."""
        self._sequence = self._sequence % _LAST_SEQUENCE + 1
        exchange = CommandExchange(encode(self._sequence))
        message = exchange.begin()
        while message:
            self._line.send(message)
            until = self._now() + ANSWER_WAIT_S
            while (left_s := until - self._now()) > 0.0:
                for kind, body in self._decoder.feed(self._line.read(left_s)):
                    if exchange.heard(unpack(kind, body)):
                        return exchange.answer
            message = exchange.timed_out()
        return None

    def _listen(self, wait_s: float) -> None:
        until = self._now() + wait_s
        while (left_s := until - self._now()) > 0.0:
            self._decoder.feed(self._line.read(left_s))


class ReceiverLink:
    """The receiver's text."""

    def __init__(self, line: Line, now: Callable[[], float] = time.monotonic) -> None:
        self._line, self._now = line, now
        self._text = ReceiverText()

    def tell(self, x_m: float) -> Event:
        """One try of a depth: Replied, or Silent after two seconds. Late text of the point before is dropped first."""
        while late := self._line.read(0.0):
            self._text.feed(late)
        if dropped := self._text.flush():
            _log.warning("the receiver said %r when nothing was asked", dropped[:80])
        self._line.send(encode_number(x_m))
        until = self._now() + REPLY_WAIT_S
        while (left_s := until - self._now()) > 0.0:
            data = self._line.read(min(left_s, QUIET_S))
            self._text.feed(data)
            if not data and (reply := self._text.take_reply()) is not None:
                return Replied(int(reply))
        return Silent()

    def result(self, timeout_s: float) -> Event:
        """Result, Damaged where something else came, or Silent."""
        until = self._now() + timeout_s
        while (left_s := until - self._now()) > 0.0:
            self._text.feed(self._line.read(min(left_s, QUIET_S)))
            if (found := self._text.take_result()) is not None:
                return Result(
                    np.array(found.acoustic_mm),
                    np.array(found.combined_mm),
                    np.array(found.raw_mm),
                    np.radians(found.attitude_deg),
                )
        rest = self._text.flush()
        return Damaged(rest.decode("latin-1")) if rest else Silent()


class RealRig:
    """What a collection asks for, on a real rig and receiver."""

    def __init__(self, rig: RigLink, receiver: ReceiverLink, say: Callable[[str], None]) -> None:
        self._rig, self._receiver, self._say = rig, receiver, say

    def ready(self) -> None:
        """Waits until the rig stands at home and may move. Raises LinkError."""
        wait_at_home(self._rig, self._say)

    def run(self, collection: Collection, kept: Callable[[Action], None]) -> str:
        """A whole collection; why it ended early, "" if it did not. However it ends, nothing moves afterwards."""
        try:
            pending = collection.next(Start())
            while pending:
                event: Event | None = None
                for action in pending:
                    kept(action)
                    event = self._do(action, collection.paused) or event
                if collection.finished:
                    return str(getattr(pending[-1], "reason", ""))
                if collection.paused:
                    # The firmware went home by itself and waits for the next press.
                    wait_until_ready(self._rig, self._say)
                    event = Button()
                if event is None:
                    raise BugError("a collection asked for nothing that brings an event")
                pending = collection.next(event)
            return ""
        finally:
            self._rig.stop()

    def _do(self, action: Action, pausing: bool) -> Event | None:
        match action:
            case SendDepth(x_m):
                if self._paused():
                    return Button()
                return self._receiver.tell(x_m)
            case Move(_, end, steps):
                if pausing:
                    return None  # the button's own way home: the firmware is on it
                return Button() if self._paused() else self._move(end, steps)
            case AwaitResult(timeout_s):
                if self._paused():
                    return Button()
                return self._receiver.result(timeout_s)
            case Hold(reason):
                self._rig.stop()
                self._say(f"Stopped: {reason}")
            case _:
                pass
        return None

    def _move(self, end: Floats, steps: int) -> Event:
        answer = self._rig.move(np.tile(end, (PLATFORMS, 1)), steps)
        if answer is None:
            return Refused("the link to the rig is silent")
        if isinstance(answer, RigAck):
            return Refused(refusal(answer))
        if answer.stopped_by == StopCause.ARRIVED:
            return Moved()
        if answer.stopped_by == StopCause.BUTTON:
            return Button()
        return Refused(stopped_words(answer))

    def _paused(self) -> bool:
        return self._rig.where().mode in (RigMode.WAITING, RigMode.HOMING)


def wait_until_ready(rig: RigLink, say: Callable[[str], None]) -> None:
    """Waits until the rig may move, which its button decides. Raises LinkError."""
    said = False
    until = time.monotonic() + PAUSE_LIMIT_S
    while (state := rig.where()).mode != RigMode.READY:
        if state.mode == RigMode.WAITING and not said:
            say("The rig is paused: press its button to let it move")
            said = True
        if time.monotonic() > until:
            raise LinkError("the rig stayed paused for an hour: start again and press its button")
        time.sleep(POLL_S)


def wait_at_home(rig: RigLink, say: Callable[[str], None]) -> None:
    """Waits until the rig may move, from home. Raises LinkError."""
    wait_until_ready(rig, say)
    if not np.all(np.abs(rig.where().set_points) <= AT_HOME):  # NaN is nowhere
        raise LinkError("the rig is not at home: press its button, which sends it there, and start again")


def stopped_words(state: RigState) -> str:
    """Why a motion ended on the way."""
    return f"it stopped on the way: {StopCause(state.stopped_by).name.lower().replace('_', ' ')}"


def refusal(ack: RigAck) -> str:
    """In words, with platform and servo counted from 1 at the base."""
    known = {int(each): each.name.lower().replace("_", " ") for each in RigResult}
    words = known.get(ack.result, f"result {ack.result}")
    if ack.platform is not None:
        words += f", platform {ack.platform + 1}"
    if ack.servo is not None:
        words += f", servo {ack.servo + 1}"
    return words


@contextlib.contextmanager
def connected_alone(port: Path, say: Callable[[str], None]) -> Iterator[RigLink]:
    """A rig without its receiver, at home and allowed to move. Raises LinkError."""
    line = Line(port, RIG_BAUD)
    try:
        rig = RigLink(line)
        wait_at_home(rig, say)
        yield rig
    finally:
        line.close()


@contextlib.contextmanager
def connected(
    port: Path,
    receiver_port: Path,
    say: Callable[[str], None],
    tap: Callable[[str, bytes, bool], None] = lambda _whose, _data, _down: None,
) -> Iterator[RealRig]:
    """A rig and its receiver on their serial ports, at home and allowed to move. Raises LinkError.

    `tap` is given all bytes of the link to the "rig" and to the "receiver", with whether they went down it.
    """
    with contextlib.ExitStack() as open_lines:
        lines = []
        for whose, path, baud in (("rig", port, RIG_BAUD), ("receiver", receiver_port, RECEIVER_BAUD)):
            lines.append(Line(path, baud, partial(tap, whose)))
            open_lines.callback(lines[-1].close)
        rig = RealRig(RigLink(lines[0]), ReceiverLink(lines[1]), say)
        rig.ready()
        yield rig


def what_moves(sessions: Sequence[Session]) -> list[str]:
    """For the person beside the rig: a line a session, before anything moves."""
    lines = []
    for session in sessions:
        if session.motion is Motion.STATIONARY:
            lines.append(f"{session.name}: nothing moves, {session.fixes} points at home")
            continue
        spans = ", ".join(
            f"{axis} {session.ranges[axis][0]:g} to {session.ranges[axis][1]:g} {'mm' if axis in 'XYZ' else 'deg'}"
            for axis in dict.fromkeys(session.order)
        )
        lines.append(f"{session.name}: all four platforms move ({session.motion.value}), {session.passes} x: {spans}")
    return lines
