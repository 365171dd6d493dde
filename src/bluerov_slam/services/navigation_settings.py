"""The settings of the group `navigation` in the navigator's own words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from bluerov_slam.config import Layer, Settings, combine, setting_infos, values_of
from bluerov_slam.navigation.vehicle_model import BLUEROV2, BLUEROV2_HEAVY, ThrusterLayout
from bluerov_slam.pipeline.navigator import NavigatorOptions
from bluerov_slam.services.acoustic_settings import acoustic_options

NAVIGATOR: Final = "bluerov_slam.pipeline.navigator:Navigator"
# A change of one of these needs no new estimate.
_ONLY_SERVICES: Final = (
    "navigation.odometry_", "navigation.external_position", "navigation.enabled", "acoustics.udp_",
)  # fmt: skip
_GROUPS: Final = ("navigation.", "acoustics.")
_MILLISECOND: Final = 1e-3


def navigator_options(settings: Settings) -> NavigatorOptions:
    """Options as the settings have them; everything else keeps the navigator's own figures."""
    navigation = settings.navigation
    options = NavigatorOptions()
    return replace(
        options,
        imu=replace(
            options.imu,
            mounting_rpy_deg=navigation.imu_mounting_rpy_deg,
            latency_s=navigation.imu_latency_ms * _MILLISECOND,
        ),
        gps=replace(
            options.gps,
            lever_arm_frd_m=navigation.gps_lever_arm_frd_m,
            latency_s=navigation.gps_latency_ms * _MILLISECOND,
        ),
        thrust=replace(options.thrust, layout=_layout(navigation.thruster_frame, navigation.thruster_directions)),
        dvl=replace(options.dvl, lever_arm_frd_m=navigation.dvl_lever_arm_frd_m),
        fix=replace(
            options.fix,
            lever_arm_frd_m=navigation.position_lever_arm_frd_m,
            latency_s=navigation.position_latency_ms * _MILLISECOND,
        ),
        origin_deg=navigation.origin_deg,
        acoustics=acoustic_options(settings),
    )


def recorded_settings(settings: Settings) -> dict[str, object]:
    """What a recording keeps of the settings, so that the same estimate can be made again."""
    return {key: value for key, value in values_of(settings).items() if key.startswith(_GROUPS)}


def recorded_options(recorded: Mapping[str, object], flags: Mapping[str, object]) -> NavigatorOptions:
    """The options of the time of recording, changed by flags; what this version does not know any more is left out.

    Raises InvalidSettingsError.
    """
    return navigator_options(settings_of_recording(recorded, flags))


def settings_of_recording(recorded: Mapping[str, object], flags: Mapping[str, object]) -> Settings:
    """The settings of the time of recording that an estimate rests on. Raises InvalidSettingsError."""
    known = {info.key for info in setting_infos() if info.key.startswith(_GROUPS)}
    kept = {key: value for key, value in recorded.items() if key in known}
    return combine([Layer("recording", kept), Layer("command line", flags)])


def _layout(frame: str, directions: tuple[int, ...]) -> ThrusterLayout | None:
    if frame == "off":
        return None
    layout = BLUEROV2_HEAVY if frame == "heavy" else BLUEROV2
    return layout.with_directions(directions) if directions else layout


def changes_estimator(keys: frozenset[str]) -> bool:
    """Whether these changed settings need the navigator made anew."""
    return any(key.startswith(_GROUPS) and not key.startswith(_ONLY_SERVICES) for key in keys)
