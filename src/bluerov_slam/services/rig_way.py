"""A way in time on a real rig: sent piece by piece, so that it flows, and never faster than it was planned.

The firmware goes straight from set point to set point in steps of 50 ms. It is given the next piece while the last step
of the one before is still to come; a computer that is late makes the rig wait, and what is late is not caught up. Where
the way rests, the rig arrives before it goes on. The firmware checks every step, and stops by itself when it hears
nothing for half a second.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.protocol.rig_link import RigMode, RigResult, RigState, StopCause
from bluerov_slam.services.rig import RigLink, refusal, stopped_words

PIECE_STEPS = 3
"""Of a piece: fewer follow the way closer, more leave the computer time."""
EARLY_STEPS = 1
"""Left of a piece when the next is sent."""
SAME = 1e-9
"""mm or rad: a set point so near to a waypoint is it."""
BUTTON = "its button was pressed: it goes home and is paused"

Floats = NDArray[np.float64]


def run_way(
    rig: RigLink, set_points: Floats, waypoints: Floats, seen: Callable[[RigState], None] = lambda _: None
) -> str:
    """Along set points (n, 4, 6), 50 ms from one to the next, of which the rig holds the first.

    At those that are waypoints (m, 4, 6) it arrives, the others it may pass a little inside. `seen` gets every state
    that is heard. Returns why it ended early, "" if it did not. However it ends, nothing moves afterwards but the
    button's own way home. Raises LinkError where the rig falls silent: by then it has stopped by itself.
    """
    stops = [k for k, point in enumerate(set_points) if np.abs(waypoints - point).max(axis=(1, 2)).min() <= SAME]
    try:
        for begin, end in pieces(len(set_points), stops):
            left = 0
            if begin:
                state = rig.follow(0 if begin in stops else EARLY_STEPS, seen)
                if why := _why_not(state):
                    return why
                left = state.steps - state.steps_done if state.mode == RigMode.MOVING else 0
            answer = rig.begin(set_points[end], end - begin + left)
            if answer.result != RigResult.OK:
                return BUTTON if answer.result == RigResult.NOT_NOW else f"it refused to move: {refusal(answer)}"
        return _why_not(rig.follow(0, seen))
    finally:
        rig.stop()


def pieces(count: int, stops: Sequence[int]) -> list[tuple[int, int]]:
    """First and last index of each piece of so many set points; none goes over a stop."""
    edges = sorted({0, count - 1, *stops})
    found: list[tuple[int, int]] = []
    for first, last in pairwise(edges):
        begins = [*range(first, last, PIECE_STEPS), last]
        found += pairwise(begins)
    return found


def _why_not(state: RigState) -> str:
    """Why the way cannot go on, "" where it can."""
    if state.mode in (RigMode.WAITING, RigMode.HOMING):
        return BUTTON
    if state.mode == RigMode.READY and state.stopped_by != StopCause.ARRIVED:
        return stopped_words(state)
    return ""
