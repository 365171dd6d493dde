"""Where the vehicle was during the pings that can be scrolled back to: a page that opens late asks for it."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import orjson
from numpy.typing import NDArray

STATE_KEYS: Final = ("heading_deg", "depth_m", "latitude_deg", "longitude_deg")
ESTIMATE_KEYS: Final = ("latitude_deg", "longitude_deg", "within_m", "heading_deg", "heading_std_deg", "altitude_m")
COLUMNS: Final = ("monotonic_s", *STATE_KEYS, *(f"estimate.{key}" for key in ESTIMATE_KEYS))
# Nearly three hours at two a second, in 2 MB.
MOST_STATES: Final = 20_000
# A clock that went back is another replay, or the host was started anew.
RESTART_S: Final = 5.0


class VehicleTrack:
    """States by the time of the newest ping, which is how the pages place them."""

    def __init__(self) -> None:
        self._values = array("d")
        self._last_s = -math.inf

    def add(self, ping_s: float, vehicle: Mapping[str, Any]) -> None:
        """One state. Where no ping came since the last one there is nothing to place by it."""
        if ping_s < self._last_s - RESTART_S:
            self._values, self._last_s = array("d"), -math.inf
        if not ping_s > self._last_s:
            return
        self._last_s = ping_s
        estimate = vehicle.get("estimate") or {}
        self._values.append(ping_s)
        self._values.extend(_number(vehicle.get(key)) for key in STATE_KEYS)
        self._values.extend(_number(estimate.get(key)) for key in ESTIMATE_KEYS)
        if len(self._values) > MOST_STATES * len(COLUMNS):
            del self._values[: MOST_STATES // 10 * len(COLUMNS)]

    def states(self) -> NDArray[np.float64]:
        """All of them now, (n, columns); NaN is unknown."""
        return np.array(self._values, dtype=np.float64).reshape(-1, len(COLUMNS))


def track_json(states: NDArray[np.float64]) -> bytes:
    """What GET /api/track answers; unknown is null."""
    return orjson.dumps({"columns": COLUMNS, "states": states}, option=orjson.OPT_SERIALIZE_NUMPY)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else math.nan
