"""Health of the estimator: its process, what it distrusts, what it could not keep."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bluerov_slam.pipeline.health_model import ChipState, FaultLevel, Finding, PortState, wrong
from bluerov_slam.protocol.navigation_json import LABELS
from bluerov_slam.records import NavMode, SensorTrust

if TYPE_CHECKING:
    from bluerov_slam.pipeline.health_memory import HealthMemory
    from bluerov_slam.pipeline.health_model import HealthFacts, NavigationFacts

STALE_S = 3.0
# So many are named on a chip.
_NAMED = 2


def check_navigation(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """The navigator: worst first."""
    navigation = facts.navigation
    if navigation is None or navigation.worker == "off":
        return Finding(ChipState.OFF, "Off")
    age_s = None if navigation.heard_s is None else max(0.0, now_s - navigation.heard_s)
    if navigation.worker == "restarting" or (navigation.error and navigation.worker != "running"):
        return wrong(
            "navigation_crashed",
            "Estimator starts anew",
            f"The estimator's process ended: {navigation.error}. Everything else goes on.",
            "Nothing to do if it happens once: it goes on from its last saved state, less certain. If it happens "
            "again, keep the recording and report it with the extension's log.",
            age_s=age_s,
        )
    if navigation.mode is None or age_s is None:
        return Finding(ChipState.UNKNOWN, "Waiting for data")
    return _too_slow(navigation, age_s) or _state(navigation, age_s, facts)


def _too_slow(navigation: NavigationFacts, age_s: float) -> Finding | None:
    if navigation.dropped:
        return wrong(
            "navigation_drops",
            "Sensor data left out",
            f"The computer was too slow for the estimator: {navigation.dropped} records were left out of navigation "
            "(not of the recording).",
            "Stop other programs on the vehicle's computer, close pages that nobody needs; a replay of the recording "
            "has everything.",
            level=FaultLevel.WARNING,
            age_s=age_s,
        )
    if navigation.save_error:
        return wrong(
            "navigation_unsaved",
            "State not saved",
            f"The navigation state cannot be written: {navigation.save_error}. Navigation goes on; a restart in "
            "mid-dive would begin without it.",
            "Make room on the disk (Recordings tab) or make the state folder writable.",
            level=FaultLevel.WARNING,
            age_s=age_s,
        )
    return None


def _state(navigation: NavigationFacts, age_s: float, facts: HealthFacts) -> Finding:
    if age_s > STALE_S:
        # Why nothing comes is the link's fault, and said there.
        text = "Replay finished" if facts.link.state is PortState.FINISHED else f"No data for {age_s:.0f} s"
        return Finding(ChipState.UNKNOWN, text, age_s=age_s)
    if navigation.distrusted:
        count = len(navigation.distrusted)
        names = " and ".join(LABELS.get(sensor.name, sensor.name) for sensor in navigation.distrusted)
        names = names if count <= _NAMED else f"{count} sensors"
        rejected = any(sensor.trust is SensorTrust.REJECTED for sensor in navigation.distrusted)
        reasons = " ".join(
            f"{LABELS.get(sensor.name, sensor.name)}: {(sensor.reason or 'no reason given').rstrip('.')}."
            for sensor in navigation.distrusted
        )
        return wrong(
            "navigation_distrust",
            f"{names} not trusted",
            reasons,
            "The Navigation tab shows each sensor. Clear the cause it names; the estimate goes on without the sensor, "
            "with a growing uncertainty." + (" What was rejected disagrees with everything else." if rejected else ""),
            level=FaultLevel.WARNING,
            age_s=age_s,
        )
    if navigation.odometry_problem:
        return wrong(
            "odometry_stopped",
            "Autopilot gets no position",
            f"{navigation.odometry_problem}.",
            "Do not rely on position hold. Take a fix at the surface, or raise navigation.odometry_max_std_m; switch "
            "navigation.odometry_enabled off if you do not need it.",
            level=FaultLevel.WARNING,
            age_s=age_s,
        )
    known = navigation.mode in (NavMode.AIDED, NavMode.DEAD_RECKONING)
    return Finding(ChipState.OK if known else ChipState.UNKNOWN, navigation.text, age_s=age_s)
