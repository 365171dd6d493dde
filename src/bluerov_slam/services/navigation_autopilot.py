"""The autopilot's parameters that ODOMETRY needs: shown beside what they are, set only when the user asks for it.

Each write is acknowledged by the autopilot (PARAM_VALUE) and then read back. Nothing is written while it is armed.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from bluerov_slam.errors import CommandError
from bluerov_slam.protocol.mavlink_navigation import parameter_name
from bluerov_slam.services.navigation_odometry import AUTOPILOT_COMPONENT, Out

TRIES: Final = 3
ANSWER_S: Final = 0.7
ARMED_BIT: Final = 128
MAV_PARAM_TYPE_REAL32: Final = 9
# Values of other parameters come by themselves; these are re-read when older.
FRESH_S: Final = 5.0
# One that the autopilot does not have costs seconds to ask for: not each time somebody looks.
MISSING_S: Final = 60.0
_EXTERNAL: Final = 6.0
_COMPASS: Final = 1.0
_BAROMETER: Final = 1.0


@dataclass(frozen=True, slots=True)
class NeededParameter:
    """One parameter. `optional`: firmware that does not have it needs nothing; `restart`: acts after one."""

    name: str
    needed: float
    text: str
    optional: bool = False
    restart: bool = False


@dataclass(frozen=True, slots=True)
class _Value:
    value: float
    kind: int
    at_s: float


def needed_parameters(heading_from_us: bool) -> tuple[NeededParameter, ...]:
    """In the order in which they are set. ArduSub 4.1 and later."""
    return (
        NeededParameter("AHRS_EKF_TYPE", 3.0, "EKF3 estimates"),
        NeededParameter("EK3_ENABLE", 1.0, "EKF3 is on", restart=True),
        NeededParameter("VISO_TYPE", 1.0, "ODOMETRY is taken, as it comes over MAVLink", restart=True),
        NeededParameter("VISO_ORIENT", 0.0, "our attitude is the vehicle's already", optional=True),
        NeededParameter("EK3_SRC1_POSXY", _EXTERNAL, "horizontal position from us (6), not from a GPS (3)"),
        NeededParameter("EK3_SRC1_VELXY", _EXTERNAL, "horizontal velocity from us"),
        NeededParameter("EK3_SRC1_POSZ", _BAROMETER, "depth from the autopilot's own pressure sensor"),
        NeededParameter("EK3_SRC1_VELZ", 0.0, "vertical velocity from its own accelerometer"),
        NeededParameter(
            "EK3_SRC1_YAW",
            _EXTERNAL if heading_from_us else _COMPASS,
            "heading from us" if heading_from_us else "heading from the autopilot's own compass",
        ),
        NeededParameter("EK3_GPS_TYPE", 3.0, "old firmware: a GPS is not used", optional=True),
    )


class AutopilotParameters:
    """`on_message` gets what the autopilot says; `read` and `set_needed` take seconds at most."""

    def __init__(
        self,
        out: Out,
        needed: Callable[[], tuple[NeededParameter, ...]],
        peer_alive: Callable[[], bool],
        now_s: Callable[[], float],
        *,
        answer_s: float = ANSWER_S,
    ) -> None:
        self._out = out
        self._needed = needed
        self._peer_alive = peer_alive
        self._now_s = now_s
        self._answer_s = answer_s
        self._values: dict[str, _Value] = {}
        self._missing_s: dict[str, float] = {}
        self._waiting: dict[str, asyncio.Future[_Value]] = {}
        self._armed = False
        self._busy = asyncio.Lock()

    def on_message(self, system_id: int, component_id: int, name: str, fields: Mapping[str, Any]) -> None:
        """PARAM_VALUE and HEARTBEAT of the autopilot."""
        if (system_id, component_id) != (self._out.system_id, AUTOPILOT_COMPONENT):
            return
        try:
            if name == "PARAM_VALUE":
                self._take_value(fields)
            elif name == "HEARTBEAT":
                mode = fields["base_mode"]
                self._armed = bool(int(mode["bits"] if isinstance(mode, Mapping) else mode) & ARMED_BIT)
        except (KeyError, TypeError, ValueError):
            return

    async def read(self) -> list[dict[str, Any]]:
        """Every needed parameter with what it is now; null where the autopilot does not say."""
        async with self._busy:
            if self._peer_alive():
                due = [parameter.name for parameter in self._needed() if self._is_due(parameter.name)]
                await asyncio.gather(*(self._read(name) for name in due))
        return [self._row(parameter) for parameter in self._needed()]

    async def set_needed(self) -> list[dict[str, Any]]:
        """Set every one that differs, one after the other. Raises CommandError saying what to do."""
        if not self._peer_alive():
            raise CommandError(
                "the autopilot is not heard: switch MAVLink on and see that its chip is green, then try again"
            )
        async with self._busy:
            if self._armed:
                raise CommandError("the vehicle is armed: disarm it, then set the parameters")
            for parameter in self._needed():
                await self._set_one(parameter)
        return [self._row(parameter) for parameter in self._needed()]

    def _is_due(self, name: str) -> bool:
        now_s = self._now_s()
        if now_s - self._missing_s.get(name, -math.inf) < MISSING_S:
            return False
        return name not in self._values or now_s - self._values[name].at_s > FRESH_S

    async def _set_one(self, parameter: NeededParameter) -> None:
        name = parameter.name
        before = await self._read(name)
        if before is None:
            if parameter.optional:
                return
            raise CommandError(
                f"{name}: the autopilot does not have it, or does not answer; what was set so far needs a restart of "
                "the autopilot first (BlueOS, Power), then set again. ArduSub older than 4.1 cannot take ODOMETRY"
            )
        if _same(before.value, parameter.needed):
            return
        acknowledged = await self._ask(name, "PARAM_SET", self._set_fields(parameter, before.kind))
        if acknowledged is None:
            raise CommandError(f"{name} = {parameter.needed:g} was not acknowledged; check the link and try again")
        after = await self._read(name)
        if after is None or not _same(after.value, parameter.needed):
            now = "nothing" if after is None else f"{after.value:g}"
            raise CommandError(
                f"{name} was set to {parameter.needed:g} and reads back as {now}: something else sets it too (another "
                "extension, a script); stop that and try again"
            )

    async def _read(self, name: str) -> _Value | None:
        fields = {**self._target(), "param_id": name.encode(), "param_index": -1}
        return await self._ask(name, "PARAM_REQUEST_READ", fields)

    async def _ask(self, name: str, message: str, fields: Mapping[str, Any]) -> _Value | None:
        """The value that comes in answer, None after so many tries."""
        for _ in range(TRIES):
            answer: asyncio.Future[_Value] = asyncio.get_running_loop().create_future()
            self._waiting[name] = answer
            try:
                if not self._out.send(message, fields):
                    return None
                async with asyncio.timeout(self._answer_s):
                    return await answer
            except TimeoutError:
                continue
            finally:
                self._waiting.pop(name, None)
        self._values.pop(name, None)
        self._missing_s[name] = self._now_s()
        return None

    def _take_value(self, fields: Mapping[str, Any]) -> None:
        kind = fields.get("param_type", MAV_PARAM_TYPE_REAL32)
        kind = kind if isinstance(kind, int) else _KINDS.get(str(dict(kind).get("type")), MAV_PARAM_TYPE_REAL32)
        name, number = parameter_name(fields["param_id"]), float(fields["param_value"])
        if not math.isfinite(number):
            return
        value = _Value(number, kind, self._now_s())
        self._values[name] = value
        waiting = self._waiting.get(name)
        if waiting is not None and not waiting.done():
            waiting.set_result(value)

    def _set_fields(self, parameter: NeededParameter, kind: int) -> dict[str, Any]:
        return {
            **self._target(),
            "param_id": parameter.name.encode(),
            "param_value": parameter.needed,
            "param_type": kind,
        }

    def _target(self) -> dict[str, int]:
        return {"target_system": self._out.system_id, "target_component": AUTOPILOT_COMPONENT}

    def _row(self, parameter: NeededParameter) -> dict[str, Any]:
        value = self._values.get(parameter.name)
        text = parameter.text
        if value is None and self._peer_alive():
            text += "; the autopilot does not have it" + (", which is fine" if parameter.optional else " (yet)")
        elif value is None:
            text += "; the autopilot is not heard"
        elif parameter.restart and not _same(value.value, parameter.needed):
            text += "; restart the autopilot after setting it"
        current = None if value is None else value.value
        return {"name": parameter.name, "needed": parameter.needed, "current": current, "text": text}


_KINDS: Final = {
    "MAV_PARAM_TYPE_INT8": 2,
    "MAV_PARAM_TYPE_INT16": 4,
    "MAV_PARAM_TYPE_INT32": 6,
    "MAV_PARAM_TYPE_REAL32": MAV_PARAM_TYPE_REAL32,
}


def _same(a: float, b: float) -> bool:
    return abs(a - b) < 1e-6
