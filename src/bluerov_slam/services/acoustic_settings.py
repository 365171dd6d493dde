"""The settings of the group `acoustics` in the acoustic pipeline's own words."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.acoustics.calibration.responses import ReceiverResponses
from bluerov_slam.config import Settings
from bluerov_slam.navigation.rotation import rotation_from_euler
from bluerov_slam.pipeline.acoustic_options import AcousticOptions

_MICROSECOND: Final = 1e-6


def acoustic_options(settings: Settings) -> AcousticOptions | None:
    """None where no array is fitted."""
    acoustics = settings.acoustics
    if not acoustics.enabled:
        return None
    skew_s = np.array(acoustics.sample_skew_us, float) * _MICROSECOND
    if acoustics.array == "places":
        array = ReceiverArray(np.array(acoustics.receiver_places_m), skew_s, "acoustics.places_m")
    else:
        array = ReceiverArray.cross(
            acoustics.arm_m,
            acoustics.array == "cross_with_centre",
            skew_s,
            stalk=acoustics.array == "cross_with_stalk",
        )
    roll, pitch, yaw = map(math.radians, acoustics.mounting_rpy_deg)
    return AcousticOptions(
        array=array,
        responses=ReceiverResponses.of_resonances(np.array(acoustics.receiver_khz) * 1e3)
        if acoustics.receiver_khz
        else None,
        mounting=ArrayMounting(rotation_from_euler(roll, pitch, yaw), np.array(acoustics.lever_arm_frd_m)),
        sound_speed_mps=acoustics.sound_speed_mps,
        sound_speed_fixed=acoustics.sound_speed_source == "fixed",
        beacon_deg=acoustics.beacon_deg,
        beacon_depth_m=acoustics.beacon_depth_m,
        beacon_std_m=acoustics.beacon_std_m,
        beacon_from_message=acoustics.beacon_from_message,
        carrier_hz=acoustics.carrier_khz * 1e3,
        delay_std_s=acoustics.delay_std_us * _MICROSECOND,
        use_for_navigation=acoustics.use_for_navigation,
    )
