"""The dive-start assistant: what to do before leaving the surface, and how far each step is.

It judges by what the navigator says; a step that could not be finished is a warning, never a gate.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

from bluerov_slam.protocol.navigation_json import euler_angles_rad
from bluerov_slam.records import NavMode, NavState

# What the current and thrusters' scale need to be told apart: two legs, far enough from parallel, long enough.
LEG_S: Final = 30.0
LEG_WITHIN_RAD: Final = math.radians(20.0)
LEGS_APART_RAD: Final = math.radians(60.0)
SLOWEST_LEG_MPS: Final = 0.15
ENOUGH_CURRENT_STD_MPS: Final = 0.08
SURFACE_M: Final = 0.5
# Steps of their own, below: the rest of the sensors is one step.
SWINGS: Final = ("swing", "course_swing")
THRUSTER_FIELD: Final = "thruster_field"
# Once per vehicle, and a dive without it is only a little worse: it keeps no other step waiting.
OPTIONAL: Final = (THRUSTER_FIELD,)
_LONGEST_STEP_S: Final = 2.0


class DiveStartAssistant:
    """`observe` every state, `done` every action that succeeded; `steps` as the API shows them."""

    def __init__(self) -> None:
        self._zeroed = False
        self._origin_set = False
        self._legs: list[tuple[float, float]] = []  # heading, seconds
        self._at_s: float | None = None

    def done(self, action: str) -> None:
        """An action of the user was carried out."""
        if action == "zero_depth":
            self._zeroed = True
        elif action == "set_origin":
            self._origin_set = True
        elif action == "reset":
            self._legs.clear()

    def observe(self, state: NavState) -> None:
        """Follow the surface run: time under GPS, moving, by heading."""
        elapsed_s = 0.0 if self._at_s is None else min(max(state.measured_s - self._at_s, 0.0), _LONGEST_STEP_S)
        self._at_s = state.measured_s
        if state.mode is not NavMode.AIDED or state.velocity_ned_mps is None or state.quaternion_ned_frd is None:
            return
        north_mps, east_mps, _ = state.velocity_ned_mps
        under_water = state.depth_m is not None and state.depth_m > SURFACE_M
        if under_water or math.hypot(north_mps, east_mps) < SLOWEST_LEG_MPS:
            return
        heading = euler_angles_rad(state.quaternion_ned_frd)[2]
        for index, (leg, seconds) in enumerate(self._legs):
            if abs(math.remainder(heading - leg, math.tau)) < LEG_WITHIN_RAD:
                self._legs[index] = (leg, seconds + elapsed_s)
                return
        self._legs.append((heading, elapsed_s))
        self._legs = sorted(self._legs, key=lambda leg: -leg[1])[:12]

    def steps(self, state: NavState | None, calibrations: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """Every step; the first one that is not done is active."""
        kinds = {str(kind["kind"]): kind for kind in calibrations}
        sensors = [kind for name, kind in kinds.items() if name not in (*SWINGS, THRUSTER_FIELD)]
        steps = [
            self._zero_depth(state),
            self._calibrate(sensors),
            _guided(
                THRUSTER_FIELD,
                "Measure the thrusters' field",
                "Once per vehicle: hold it in the water and run one thruster after the other, so that their currents "
                "turn the compass no more",
                kinds,
                (THRUSTER_FIELD,),
            ),
            _guided(
                "swing",
                "Swing the compass",
                "Away from the boat, two slow turns on the spot; or drive at one speed on all headings under GPS "
                "(under Calibration), which also shows how the IMU is turned in the hull",
                kinds,
                SWINGS,
            ),
            self._surface_run(state),
            self._set_origin(state),
        ]
        todo = [step for step in steps if step["state"] == "todo"]
        for step in sorted(todo, key=lambda step: step["id"] in OPTIONAL)[:1]:
            step["state"] = "active"
        return steps

    def _zero_depth(self, state: NavState | None) -> dict[str, Any]:
        text = "Let the vehicle float, or hold it in the air, and zero the depth"
        depth_m = None if state is None else state.depth_m
        if self._zeroed:
            text = "Zeroed" if depth_m is None else f"Zeroed; depth now {depth_m:.2f} m"
        return _step("zero_depth", "Zero the depth", self._zeroed, text, "zero_depth")

    def _calibrate(self, kinds: list[Mapping[str, Any]]) -> dict[str, Any]:
        missing = [str(kind["kind"]) for kind in kinds if kind["state"] != "done"]
        running = [kind for kind in kinds if kind["state"] in ("running", "ready")]
        done = bool(kinds) and not missing
        text = (
            f"Not done yet: {', '.join(missing)}" if missing else "All done" if kinds else "Waiting for the estimator"
        )
        if running:
            text = f"{running[0]['kind']}: {running[0].get('instruction') or 'running'}"
        return _step("calibrate", "Calibrate gyro, accelerometer, magnetometer", done, text, "show_calibration")

    def _surface_run(self, state: NavState | None) -> dict[str, Any]:
        legs = [leg for leg in self._legs if leg[1] >= LEG_S]
        apart = any(
            LEGS_APART_RAD < abs(math.remainder(a[0] - b[0], math.tau)) < math.pi + 1e-9 for a in legs for b in legs
        )
        std_mps = None if state is None or state.current_std_mps is None else max(state.current_std_mps)
        text = "Under GPS, steer straight for half a minute, then again on a heading at least 60 degrees away"
        if apart and std_mps is not None:
            text = f"Current known to {std_mps:.2f} m/s"
        elif self._legs:
            leg = max(self._legs, key=lambda leg: leg[1])
            text = f"{math.degrees(leg[0]):.0f} deg for {leg[1]:.0f} s, {len(legs)} of 2 legs done. {text}"
        step = _step("surface_run", "Surface run on two headings", apart, text, None)
        if apart and (std_mps is None or std_mps > ENOUGH_CURRENT_STD_MPS):
            known = "is not known" if std_mps is None else f"is known only to {std_mps:.2f} m/s"
            step.update(state="warning", text=f"Both legs are done, but the current {known}: go on for a while")
        return step

    def _set_origin(self, state: NavState | None) -> dict[str, Any]:
        origin = None if state is None else state.origin_deg
        text = "Set where the map's zero lies: here, or at given coordinates"
        if origin is not None:
            text = f"Origin at {origin[0]:.6f}, {origin[1]:.6f}"
            if not self._origin_set:
                text += " (the first fix); set it here if you want another"
        return _step("set_origin", "Set the origin", origin is not None, text, "set_origin")


def _guided(
    identifier: str, title: str, text: str, kinds: Mapping[str, Mapping[str, Any]], ways: tuple[str, ...]
) -> dict[str, Any]:
    """A step that is one guided calibration, which may be made in several ways; the first is the one to begin here."""
    known = [kinds[way] for way in ways if way in kinds]
    running = [kind for kind in known if kind["state"] in ("running", "ready")]
    made = next((kind for kind in known if kind["state"] == "done"), None)
    if running:
        text = str(running[0].get("instruction") or "Running")
        if running[0]["state"] == "ready":
            text += " Take the result under Calibration"
    elif made is not None:
        residual = made.get("residual")
        text = "Made" if residual is None else f"Made; {residual:.2g} {made.get('unit') or ''} are left"
    return _step(identifier, title, made is not None and not running, text, "start_calibration", ways[0])


def _step(
    identifier: str, title: str, done: bool, text: str, action: str | None, kind: str | None = None
) -> dict[str, Any]:
    state = "done" if done else "todo"
    return {"id": identifier, "title": title, "state": state, "text": text, "action": action, "kind": kind}
