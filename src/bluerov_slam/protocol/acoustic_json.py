"""An AcousticFix as the page, the session log and the API show it (docs/acoustics.md, section 5).

Degrees and microseconds only here, null for what is unknown.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bluerov_slam.protocol.navigation_json import ellipse_json, error_ellipse

if TYPE_CHECKING:
    from bluerov_slam.records import AcousticFix

# A carrier cell is sure below the first probability of a slip, and nobody may rely on it above the second.
SURE: Final = 0.01
AMBIGUOUS: Final = 0.2
_MICROSECONDS: Final = 1e6
_DELAYS_THAT_CAN_DISAGREE: Final = 3
_STATES: Final = ("dead", "silent", "clipped")


def fix_json(fix: AcousticFix | None, receivers: int = 0) -> dict[str, Any]:
    """What one pulse told; all null without one. `receivers`: how many the array has."""
    if fix is None:
        return {
            "accepted": None,
            "reason": "",
            "direction": None,
            "range_m": None,
            "range_std_m": None,
            "delays_us": [],
            "residuals_us": [],
            "slip": None,
            "receivers": [receiver_json(index, None) for index in range(receivers)],
            "sound_speed_mps": None,
            "raw_bits": None,
            "record_id": None,
            "place": None,
            "beacon": None,
        }
    count = max(receivers, len(fix.snr_db), len(fix.signal_std_counts))
    return {
        "accepted": fix.accepted,
        "reason": fix.reason,
        "direction": _direction(fix),
        "range_m": _rounded(fix.range_m, 2),
        "range_std_m": _rounded(fix.range_std_m, 2),
        "delays_us": [_rounded(value * _MICROSECONDS, 3) for value in fix.delays_s],
        "residuals_us": _residuals_us(fix),
        "slip": _slip(fix.slip_probability),
        "receivers": [receiver_json(index, fix) for index in range(count)],
        "sound_speed_mps": _rounded(fix.sound_speed_mps, 1),
        "raw_bits": None if fix.frame_bits is None else f"{fix.frame_bits:014b}",
        "record_id": fix.record_id,
        "place": _place(fix),
        "beacon": _beacon(fix),
    }


def receiver_json(index: int, fix: AcousticFix | None) -> dict[str, Any]:
    """One receiver: how loud it is and what became of it."""
    if fix is None:
        return {"index": index, "signal_counts": None, "snr_db": None, "state": None, "reason": ""}
    reason = next((reason for receiver, reason in fix.excluded if receiver in (index, -1)), "")
    first = reason.partition(":")[0].partition(" ")[0]
    state = "used" if index in fix.receivers else first if first in _STATES else "excluded"
    return {
        "index": index,
        "signal_counts": _rounded(_at(fix.signal_std_counts, index), 1),
        "snr_db": _rounded(_at(fix.snr_db, index), 1),
        "state": state,
        "reason": "" if state == "used" else reason or fix.reason,
    }


def _residuals_us(fix: AcousticFix) -> list[float | None]:
    """Two delays have exactly one direction: that they fit it says nothing."""
    if len(fix.delays_s) < _DELAYS_THAT_CAN_DISAGREE:
        return []
    return [_rounded(value * _MICROSECONDS, 3) for value in fix.residuals_s]


def _direction(fix: AcousticFix) -> dict[str, Any] | None:
    if fix.azimuth_rad is None or fix.elevation_rad is None:
        return None
    return {
        "azimuth_deg": _rounded(math.degrees(fix.azimuth_rad), 2),
        "elevation_deg": _rounded(math.degrees(fix.elevation_rad), 2),
        "std_deg": _direction_std_deg(fix),
    }


def _direction_std_deg(fix: AcousticFix) -> float | None:
    """The larger standard deviation of the direction as an angle on the sphere."""
    if fix.direction_covariance_rad2 is None or fix.elevation_rad is None:
        return None
    (azimuth, both), (_, elevation) = fix.direction_covariance_rad2
    shrink = math.cos(fix.elevation_rad)
    azimuth, both = azimuth * shrink * shrink, both * shrink
    larger = (azimuth + elevation) / 2.0 + math.hypot((azimuth - elevation) / 2.0, both)
    return _rounded(math.degrees(math.sqrt(larger)), 3) if larger >= 0.0 else None


def _slip(probability: float | None) -> dict[str, Any] | None:
    if probability is None:
        return None
    state = "sure" if probability < SURE else "likely" if probability <= AMBIGUOUS else "ambiguous"
    return {"state": state, "probability": round(probability, 4)}


def _place(fix: AcousticFix) -> dict[str, Any] | None:
    if fix.position_deg is None:
        return None
    covariance = None if fix.covariance_ned_m2 is None else np.array(fix.covariance_ned_m2)
    return {
        "latitude_deg": _rounded(fix.position_deg[0], 8),
        "longitude_deg": _rounded(fix.position_deg[1], 8),
        "ellipse": ellipse_json(error_ellipse(covariance)),
    }


def _beacon(fix: AcousticFix) -> dict[str, Any] | None:
    if fix.beacon_deg_m is None:
        return None
    latitude_deg, longitude_deg, depth_m = fix.beacon_deg_m
    return {
        "latitude_deg": _rounded(latitude_deg, 8),
        "longitude_deg": _rounded(longitude_deg, 8),
        "depth_m": _rounded(depth_m, 2),
        "source": fix.beacon_source,
    }


def _at(values: tuple[float | None, ...], index: int) -> float | None:
    return values[index] if index < len(values) else None


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)
