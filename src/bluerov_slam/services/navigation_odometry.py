"""ODOMETRY to the autopilot: only when the user wants it, while the position is known well enough, at a steady rate.

The autopilot counts positions from an origin of its own. We ask for it, give it ours where it has none, and tell our
position from the autopilot's; where it does not say, both are taken to be the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.protocol.mavlink_navigation import (
    ask_origin_fields,
    horizontal_std_m,
    odometry_fields,
    origin_deg,
    set_origin_fields,
)
from bluerov_slam.records import NavMode, NavState

AUTOPILOT_COMPONENT: Final = 1
# States come at some 20 Hz: one that is a little early is the one that is due.
EARLY_S: Final = 0.02
ASK_ORIGIN_PERIOD_S: Final = 2.0
# Asked so often without an answer, an autopilot has no origin yet: it gets ours. Once more, and it just does not tell.
ASKS_BEFORE_GIVING: Final = 2
ASKS_BEFORE_ASSUMING: Final = 4
# Beyond this the plane about one origin is not the plane about the other.
FARTHEST_ORIGIN_M: Final = 10_000.0
SAME_ORIGIN_M: Final = 0.5


class Out(Protocol):
    """What of the MAVLink bridge is used here."""

    @property
    def system_id(self) -> int: ...
    def send(self, name: str, fields: Mapping[str, Any]) -> bool: ...


@dataclass(frozen=True, slots=True)
class OdometryOptions:
    """What the user decided, and why nothing may be sent all the same: a replay, a simulated vehicle, MAVLink off."""

    enabled: bool = False
    rate_hz: float = 5.0
    max_std_m: float = 10.0
    forbidden_because: str | None = None


class OdometrySender:
    """Hand it each new state with `take`, messages of the autopilot with `on_message`."""

    def __init__(self, out: Out, options: Callable[[], OdometryOptions], now_s: Callable[[], float]) -> None:
        self.sent = 0
        self._out = out
        self._options = options
        self._now_s = now_s
        self._text = ""
        self._due_s = -math.inf
        self._asked_s = -math.inf
        self._asks = 0
        self._gave_origin = False
        self._autopilot_origin: tuple[float, float] | None = None
        self._offset_m: tuple[float, float, float] | None = None
        self._origin_told: tuple[float, float] | None = None
        self._resets = 0
        self._sending = False

    @property
    def problem(self) -> str | None:
        """Why nothing is sent although the user wants it; None while all is well or ODOMETRY is off."""
        options = self._options()
        return (
            None if not options.enabled or (self._sending and not options.forbidden_because) else self._text_of(options)
        )

    def json(self) -> dict[str, Any]:
        """The topic's `odometry`."""
        options = self._options()
        return {"enabled": options.enabled, "sent": self.sent, "text": self._text_of(options)}

    def take(self, state: NavState) -> None:
        """Send this state if one is due and it may be sent."""
        options = self._options()
        if not options.enabled or options.forbidden_because:
            return
        now_s = self._now_s()
        if now_s < self._due_s - EARLY_S:
            return
        refusal = self._refusal(state, options)
        if refusal is None:
            refusal = self._origin_refusal(state, now_s)
        if refusal is None:
            refusal = self._send(state, options)
        self._text, self._sending = refusal or self._success(), refusal is None
        period_s = 1.0 / options.rate_hz
        self._due_s = max(self._due_s + period_s, now_s + 0.5 * period_s)

    def on_message(self, system_id: int, component_id: int, name: str, fields: Mapping[str, Any]) -> None:
        """GPS_GLOBAL_ORIGIN of the autopilot."""
        if name != "GPS_GLOBAL_ORIGIN" or (system_id, component_id) != (self._out.system_id, AUTOPILOT_COMPONENT):
            return
        try:
            self._autopilot_origin = origin_deg(fields)
        except (KeyError, TypeError, ValueError):
            return

    def forget_autopilot(self) -> None:
        """Another autopilot, or the same one started anew: its origin is to be asked for again."""
        self._autopilot_origin, self._asks, self._gave_origin = None, 0, False

    def _refusal(self, state: NavState, options: OdometryOptions) -> str | None:
        if state.mode not in (NavMode.AIDED, NavMode.DEAD_RECKONING) or state.position_ned_m is None:
            return "Nothing is sent: the position is not known yet"
        std_m = horizontal_std_m(state.pose_covariance)
        if std_m is None:
            return "Nothing is sent: the position is not known yet"
        if std_m > options.max_std_m:
            return f"Nothing is sent: the position is known to {std_m:.1f} m only, the limit is {options.max_std_m:g} m"
        return None

    def _origin_refusal(self, state: NavState, now_s: float) -> str | None:
        assert state.origin_deg is not None
        if self._autopilot_origin is None:
            self._look_for_origin(state.origin_deg, now_s)
            if self._asks <= ASKS_BEFORE_ASSUMING:
                return "Asking the autopilot for its origin"
        offset_m = self._offset(state.origin_deg)
        if math.hypot(*offset_m) > FARTHEST_ORIGIN_M:
            away_km = math.hypot(*offset_m) / 1000.0
            return f"Nothing is sent: the autopilot's origin lies {away_km:.0f} km away; restart it to give it another"
        moved = self._offset_m is not None and math.dist(self._offset_m, offset_m) > SAME_ORIGIN_M
        if moved and self._origin_told == state.origin_deg:  # else ours moved, and our position with it
            self._resets += 1
        self._offset_m, self._origin_told = offset_m, state.origin_deg
        return None

    def _look_for_origin(self, ours_deg: tuple[float, float], now_s: float) -> None:
        if now_s - self._asked_s < ASK_ORIGIN_PERIOD_S:
            return
        self._asked_s = now_s
        self._asks += 1
        system_id = self._out.system_id
        if self._asks > ASKS_BEFORE_GIVING and not self._gave_origin:
            ours = set_origin_fields(system_id, *ours_deg, int(now_s * 1e6))
            self._gave_origin = self._out.send("SET_GPS_GLOBAL_ORIGIN", ours)
        self._out.send("COMMAND_LONG", ask_origin_fields(system_id, AUTOPILOT_COMPONENT))

    def _offset(self, ours_deg: tuple[float, float]) -> tuple[float, float, float]:
        """Our origin as seen from the autopilot's; depth is depth for both."""
        if self._autopilot_origin is None:
            return (0.0, 0.0, 0.0)
        north_m, east_m, _ = LocalFrame(*self._autopilot_origin).to_ned_m(*ours_deg)
        return (north_m, east_m, 0.0)

    def _send(self, state: NavState, options: OdometryOptions) -> str | None:
        offset_m = self._offset_m or (0.0, 0.0, 0.0)
        fields = odometry_fields(state, max_std_m=options.max_std_m, offset_ned_m=offset_m, resets=self._resets)
        if fields is None:
            return "Nothing is sent: velocity or attitude are not known"
        if not self._out.send("ODOMETRY", fields):
            return "Nothing is sent: there is no way to the autopilot; see the MAVLink chip"
        self.sent += 1
        return None

    def _success(self) -> str:
        if self._autopilot_origin is None:
            return "Position goes to the autopilot; it does not say its origin, which is taken to be ours"
        return "Position goes to the autopilot"

    def _text_of(self, options: OdometryOptions) -> str:
        if not options.enabled:
            return "Nothing is sent to the autopilot"
        return options.forbidden_because or self._text or "Nothing is sent: the position is not known yet"
