"""Navigation and the autopilot: ODOMETRY down, its parameters, and positions that others send it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from bluerov_slam.config import Settings
from bluerov_slam.protocol.mavlink_navigation import position_fix
from bluerov_slam.records import NavState
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.navigation_autopilot import AutopilotParameters, needed_parameters
from bluerov_slam.services.navigation_odometry import OdometryOptions, OdometrySender
from bluerov_slam.sinks.mavlink_bridge import MavlinkBridge

# Instruments of the vehicle that speak as a ground station's scripts do (BlueOS's DVL as 255/0).
_GUEST_SYSTEM: Final = 255


class NavigationVehicle:
    """Listens to the MAVLink bridge and to the navigator's states on the hub. `tick` once a second."""

    def __init__(
        self,
        bridge: MavlinkBridge,
        hub: Hub,
        settings: Callable[[], Settings],
        now_s: Callable[[], float],
        *,
        replay: bool,
        simulated: bool,
    ) -> None:
        self._bridge = bridge
        self._hub = hub
        self._settings = settings
        self._now_s = now_s
        self._replay = replay
        self._simulated = simulated
        self._position_before: tuple[float, float] | None = None
        self.frozen_positions = 0
        self.odometry = OdometrySender(bridge, self._odometry_options, now_s)
        self.parameters = AutopilotParameters(
            bridge,
            lambda: needed_parameters(settings().navigation.odometry_heading),
            lambda: bridge.facts().peer_alive,
            now_s,
        )
        bridge.listeners.append(self._on_message)
        hub.subscribe(self.odometry.take, NavState, name="odometry")

    def tick(self) -> None:
        """Once a second."""
        if not self._bridge.facts().peer_alive:
            self.odometry.forget_autopilot()

    def _on_message(self, system_id: int, component_id: int, name: str, fields: Mapping[str, Any]) -> None:
        if name == "GPS_INPUT":
            self._on_gps_input(system_id, fields)
        else:
            self.parameters.on_message(system_id, component_id, name, fields)
            self.odometry.on_message(system_id, component_id, name, fields)

    def _on_gps_input(self, system_id: int, fields: Mapping[str, Any]) -> None:
        wanted = self._settings().navigation.external_position == "gps_input" and not self._replay
        if not wanted or system_id not in (self._bridge.system_id, _GUEST_SYSTEM):
            return
        try:
            fix = position_fix(fields, self._now_s())
        except (KeyError, TypeError, ValueError):
            return
        if fix is None:
            return
        # To the last digit the same place twice is no second measurement: the system repeats what it once had.
        place = (fix.latitude_deg, fix.longitude_deg)
        if place == self._position_before:
            self.frozen_positions += 1
            return
        self._position_before = place
        self._hub.publish(fix)

    def _odometry_options(self) -> OdometryOptions:
        settings = self._settings()
        navigation = settings.navigation
        return OdometryOptions(
            enabled=navigation.odometry_enabled,
            rate_hz=navigation.odometry_rate_hz,
            max_std_m=navigation.odometry_max_std_m,
            forbidden_because=self._forbidden(settings),
        )

    def _forbidden(self, settings: Settings) -> str | None:
        if self._replay:
            return "Nothing is sent: this is a replay, and the dive is over"
        if self._simulated and not settings.navigation.odometry_when_simulated:
            return "Nothing is sent: the vehicle is simulated (navigation.odometry_when_simulated)"
        if not settings.mavlink.enabled:
            return "Nothing is sent: MAVLink is off; switch it on under Settings, mavlink"
        if settings.mavlink.mavlink2rest_url:
            return "Nothing is sent: mavlink2rest cannot carry values that are unknown; use the UDP endpoint"
        return None
