"""The thesis's data-collection sequence as a state machine: what the rig does, for any list of transmitter places.

    collection = Collection(plan)
    actions = collection.next(Start())
    # carry the actions out in order; the last one brings about the next event
    actions = collection.next(Replied(1))

Of every axis in turn (first A, B, C, then X, Y, Z) all four platforms go alike from its first value to its last. A
point is: the receiver is told the x that the array will have (its "depth", metres, up to three tries), the rig moves,
the receiver hears a pulse and sends its result. At a change of axis a DISCARD stands in the log and the first point is
done twice, because the truth of its first go is that of a large move; the log names that go by the value one step
before.

What goes wrong stops the motion, and the point is missing with its reason, never a number: a depth that does not
arrive, a link that is silent, a damaged line, a place that cannot be reached, an attitude too far from what was set.
Three in a row, or the attitude twice, end the collection: the rig holds where it is, because a rig that does not do
what it is told is not sent home.

Truth stands twice in a point. As published: kinematics of equal platforms, turned by the attitude of the point before
and the step since, which is known before the move and is what the receiver was told. As it should be: what `truth`
makes of the set points and of the attitude measured at the point itself, with its covariance.

Source: thesis section 2.5.3 and its public program, checked against its 27 logs (docs/rig-collection.md). Pure: time
and bytes are the caller's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.geometry.platform_stack import PLATFORMS, stack_tip_mm
from bluerov_slam.rig.collection_records import (
    Action,
    AwaitResult,
    Button,
    Close,
    Damaged,
    Discard,
    Event,
    Finished,
    Hold,
    Keep,
    Move,
    Moved,
    Open,
    Point,
    Pressed,
    Refused,
    Replied,
    Result,
    SendDepth,
    Session,
    Silent,
    Start,
)
from bluerov_slam.rig.published_tests import (
    AXES,
    PUBLISHED_TESTS,
    TRANSLATIONS,
    TURNS,
    Motion,
    PublishedTest,
    step_of,
)

__all__ = [
    "AXES",
    "PUBLISHED_TESTS",
    "Action",
    "AwaitResult",
    "Button",
    "Close",
    "Collection",
    "CollectionPlan",
    "Damaged",
    "Discard",
    "Event",
    "Finished",
    "Hold",
    "Keep",
    "Motion",
    "Move",
    "Moved",
    "Open",
    "Point",
    "Pressed",
    "PublishedTest",
    "Refused",
    "Replied",
    "Result",
    "SendDepth",
    "Session",
    "Silent",
    "Start",
]

Floats = NDArray[np.float64]

DEPTH_TRIES = 3
STEP_S = 0.05
STEPS = {Motion.STATIONARY: 0, Motion.RAPID: 6, Motion.GRADUAL: 16}
AXIS_CHANGE_STEPS = {Motion.STATIONARY: 0, Motion.RAPID: 20, Motion.GRADUAL: 24}
HOME_STEPS = 20
RESULT_TIMEOUT_S = 20.0
"""The receiver waits for a pulse each second, and in the logs a result came after at most fifteen of them."""
MOST_MISSING = 3
LARGEST_RESIDUAL_RAD = float(np.radians(8.0))
"""In the 27 logs roll and pitch lie within 5.7 degrees of the set point once the tilt at home is taken off."""
_MM_PER_M = 1e3
_BEFORE, _SENT, _MOVED = 1, 2, 3


@dataclass(frozen=True, slots=True)
class CollectionPlan:
    """All sessions, one after another, and when to stop.

    `level_rad`: roll and pitch that the receiver shows at home; its residual is counted from there.
    """

    sessions: Sequence[Session]
    level_rad: tuple[float, float] = (0.0, 0.0)
    largest_residual_rad: float = LARGEST_RESIDUAL_RAD
    most_missing: int = MOST_MISSING
    result_timeout_s: float = RESULT_TIMEOUT_S

    @classmethod
    def published(
        cls,
        tests: Sequence[PublishedTest] = PUBLISHED_TESTS,
        motions: Sequence[Motion] = tuple(Motion),
        fixes: int = 200,
        passes: int = 1,
    ) -> CollectionPlan:
        """The thesis's experiment, or some of it."""
        return cls([published_session(test, motion, fixes, passes) for test in tests for motion in motions])


def published_session(test: PublishedTest, motion: Motion, fixes: int = 200, passes: int = 1) -> Session:
    """One of the 27, by the name of its log."""
    return Session(
        session_name(test.transmitter_mm, motion),
        test.transmitter_mm,
        motion,
        test.ranges_of(motion),
        test.order,
        test.repeats_last,
        fixes,
        passes,
        test.number,
    )


def session_name(transmitter_mm: Sequence[float], motion: Motion) -> str:
    """As the thesis names its logs: whole millimetres and the kind of motion."""
    x, y, z = (f"{value:.0f}" for value in transmitter_mm)
    suffix = {Motion.STATIONARY: "s", Motion.RAPID: "d_r", Motion.GRADUAL: "d_g"}[motion]
    return f"test_x{x}_y{y}_z{z}_{suffix}"


Truth = Callable[[Floats, Floats], tuple[Floats, Floats]]
"""Set point (6,) of each platform and measured attitude (3,) -> array centre (3,) mm and its covariance (3, 3) mm2."""
Reachable = Callable[[Floats], str]
"""Set point (6,) of each platform -> why it cannot be reached, "" if it can."""


@dataclass(frozen=True, eq=False)
class _Stop:
    """A value of an axis to go to."""

    axis: str
    label: float
    set_point: Floats
    first: bool


class Collection:
    """The sequence; `next` takes what happened and says what to do."""

    def __init__(self, plan: CollectionPlan, truth: Truth | None = None, reachable: Reachable | None = None) -> None:
        self._plan = plan
        self._truth = truth
        self._reachable = reachable
        self._sessions = iter(plan.sessions)
        self._session: Session | None = None
        self._stops: Iterator[_Stop] = iter(())
        self._stop: _Stop | None = None
        self._at = np.zeros(6)
        self._attitude = np.zeros(3)
        self._attitude_at = np.zeros(6)
        self._number = 0
        self._attempt = 0
        self._missing = 0
        self._far_off = 0
        self._discarded = False
        self._place = _BEFORE
        self._paused = False
        self.finished = False

    @property
    def set_point(self) -> Floats:
        """Where every platform was last sent, (6,)."""
        return self._at.copy()

    @property
    def paused(self) -> bool:
        """Whether the button was pressed and the next press is waited for."""
        return self._paused

    def next(self, event: Event) -> list[Action]:
        """What to do now; empty where the event asks for nothing."""
        if self.finished:
            return []
        if isinstance(event, Button):
            return self._button()
        if self._paused:
            return []
        match event:
            case Start():
                return self._advance()
            case Replied(code):
                return self._replied(code)
            case Moved():
                return self._moved()
            case Refused(reason):
                return self._lost(f"the rig refused to move: {reason}")
            case Result():
                return self._result(event)
            case Damaged(line):
                return self._lost(f"the receiver's line is damaged: {line[:60]!r}", discard=True)
            case Silent():
                if self._place == _SENT and self._attempt < DEPTH_TRIES:
                    return self._send()
                return self._lost("the link to the receiver is silent", discard=True)

    def _advance(self) -> list[Action]:
        """To the next value that can be reached, of this session or the next."""
        actions: list[Action] = []
        while True:
            self._stop = next(self._stops, None)
            if self._stop is None:
                actions += [] if self._session is None else [Close()]
                self._session = next(self._sessions, None)
                if self._session is None:
                    self.finished = True
                    return [*actions, Finished()]
                self._stops, self._number = _stops_of(self._session), 0
                actions.append(Open(self._session))
                continue
            if self._stop.first:
                actions.append(Discard())
                self._discarded = True
            why = "" if self._reachable is None else self._reachable(self._stop.set_point)
            if not why:
                self._attempt = 0
                return [*actions, *self._send()]
            # Nothing was sent and nothing moved: the next value may well be within reach.
            actions.append(Keep(self._point(self._ahead_mm(), missing=f"cannot be reached: {why}")))

    def _send(self) -> list[Action]:
        self._attempt += 1
        self._place = _SENT
        return [SendDepth(float(self._ahead_mm()[0]) / _MM_PER_M, self._attempt)]

    def _ahead_mm(self) -> Floats:
        """Truth as published: where the array will be by the last attitude and the step since, (3,)."""
        assert self._stop is not None
        attitude = self._attitude + PLATFORMS * (self._stop.set_point - self._attitude_at)[3:]
        ahead: Floats = stack_tip_mm(PLATFORMS * self._stop.set_point[None, :3], attitude[None])[0]
        return ahead

    def _replied(self, code: int) -> list[Action]:
        assert self._stop is not None
        assert self._session is not None
        if code == 1:
            motion = self._session.motion
            steps = (AXIS_CHANGE_STEPS if self._stop.first else STEPS)[motion]
            if steps == 0:
                return self._moved()
            return [Move(self._at.copy(), self._stop.set_point, steps)]
        if code == 0 and self._attempt < DEPTH_TRIES:
            return self._send()
        how = "given up by the receiver" if code == -1 else f"wrong checksum in {self._attempt} tries"
        return self._lost(f"the depth did not arrive: {how}", discard=True)

    def _moved(self) -> list[Action]:
        assert self._stop is not None
        self._at = self._stop.set_point.copy()
        self._place = _MOVED
        return [AwaitResult(self._plan.result_timeout_s)]

    def _result(self, result: Result) -> list[Action]:
        assert self._stop is not None
        parts = (result.acoustic_mm, result.fused_mm, result.raw_mm, result.attitude_rad)
        if not all(np.isfinite(part).all() for part in parts):
            return self._lost("the receiver's line holds no number in a field", discard=True)
        residual = result.attitude_rad[:2] - PLATFORMS * self._at[3:5] - self._plan.level_rad
        worst = float(np.max(np.abs(residual)))
        published = self._ahead_mm()
        self._attitude, self._attitude_at = result.attitude_rad.copy(), self._at.copy()
        if worst > self._plan.largest_residual_rad:
            self._far_off += 1
            which = "roll" if abs(residual[0]) >= abs(residual[1]) else "pitch"
            why = f"the array's {which} is {np.degrees(worst):.1f} degrees from what was set"
            if self._far_off > 1:
                return self._lost(f"{why}, twice: `rig check` moves one servo at a time", ends=True)
            return self._lost(f"{why}: a servo may be stuck or off")
        self._far_off = 0
        truth, covariance = (None, None) if self._truth is None else self._truth(self._at, result.attitude_rad)
        point = self._point(published, result=result, truth_mm=truth, truth_covariance_mm2=covariance)
        self._missing, self._discarded = 0, False
        return [Keep(point), *self._advance()]

    def _lost(self, reason: str, *, discard: bool = False, ends: bool = False) -> list[Action]:
        """The point is missing. What comes next says DISCARD first where a line may come late."""
        actions: list[Action] = [Hold(reason), Keep(self._point(self._ahead_mm(), missing=reason))]
        self._missing += 1
        if discard and not self._discarded:
            actions.append(Discard())
            self._discarded = True
        if ends or self._missing >= self._plan.most_missing:
            self.finished = True
            why = reason if ends else f"{self._missing} points in a row are missing, the last because {reason}"
            return [*actions, Close(why), Finished(why)]
        return [*actions, *self._advance()]

    def _point(
        self,
        published_truth_mm: Floats,
        *,
        result: Result | None = None,
        truth_mm: Floats | None = None,
        truth_covariance_mm2: Floats | None = None,
        missing: str = "",
    ) -> Point:
        assert self._stop is not None
        assert self._session is not None
        self._number += 1
        return Point(
            self._session.name,
            self._number,
            self._stop.axis,
            self._stop.label,
            self._stop.set_point,
            published_truth_mm,
            self._discarded,
            result,
            truth_mm,
            truth_covariance_mm2,
            missing,
        )

    def _button(self) -> list[Action]:
        if self._session is None:
            return []
        if self._paused:
            self._paused = False
            self._stops = _stops_of(self._session)
            return self._advance()
        self._paused = True
        start, self._at = self._at, np.zeros(6)
        return [Move(start, self._at.copy(), HOME_STEPS), Pressed(self._place)]


def _stops_of(session: Session) -> Iterator[_Stop]:
    if session.motion is Motion.STATIONARY:
        for _ in range(session.fixes):
            yield _Stop(session.order[0], 0.0, np.zeros(6), False)
        return
    for _ in range(session.passes):
        for axis in session.order:
            yield from _stops_of_axis(axis, session)


def _stops_of_axis(axis: str, session: Session) -> Iterator[_Stop]:
    begin, end = session.ranges[axis]
    step = step_of(axis, session.motion)
    values = [begin - step * k for k in range(int(np.floor((begin - end) / step + 1e-9)) + 1)]
    yield _Stop(axis, begin + step, set_point_of(axis, begin), True)
    for value in values[:-1]:
        yield _Stop(axis, value, set_point_of(axis, value), False)
    last = set_point_of(axis, values[-1])
    if session.repeats_last:
        yield _Stop(axis, values[-1] + step, last, False)
    yield _Stop(axis, values[-1], last, False)


def set_point_of(axis: str, value: float) -> Floats:
    """Each platform's quarter (6,) of one axis's value (mm or degrees, sum of four)."""
    set_point = np.zeros(6)
    if axis in TRANSLATIONS:
        set_point[TRANSLATIONS.index(axis)] = value / PLATFORMS
    else:
        set_point[3 + TURNS.index(axis)] = np.radians(value) / PLATFORMS
    return set_point
