"""Where the transmitter is: as the settings say, or as it says itself, which ages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bluerov_slam.acoustics.message.report import BeaconReport, MessageContentError

if TYPE_CHECKING:
    from bluerov_slam.pipeline.acoustic_options import AcousticOptions
    from bluerov_slam.records import AcousticMessage

# A buoy drifts with the wind and the current since it told its place, and swings about its anchor if it has one.
DRIFT_MPS: Final = 0.3
FORGOTTEN_AFTER_S: Final = 600.0
# A GNSS receiver that states no error: two sigma of some meters.
UNSTATED_STD_M: Final = 3.0
SETTINGS: Final = "settings"
MESSAGE: Final = "message"


@dataclass(frozen=True, slots=True)
class Beacon:
    """The transmitter's place now. `depth_m` None: unknown; `source` "settings" or "message"."""

    latitude_deg: float
    longitude_deg: float
    depth_m: float | None
    std_m: float
    source: str

    @property
    def deg_m(self) -> tuple[float, float, float | None]:
        """Latitude, longitude, depth."""
        return self.latitude_deg, self.longitude_deg, self.depth_m


class Beacons:
    """Takes the transmitter's messages; `at` says what holds at an instant."""

    def __init__(self, options: AcousticOptions) -> None:
        self._options = options
        self._report: BeaconReport | None = None
        self._heard_s = -math.inf

    def hear(self, message: AcousticMessage) -> None:
        """Take a message; one that tells no place changes nothing."""
        try:
            report = BeaconReport.unpack(message.payload)
        except MessageContentError:
            return
        if report.latitude_deg is not None and report.longitude_deg is not None:
            self._report, self._heard_s = report, message.arrived_s

    def forget(self) -> None:
        """What was said came from another transmitter."""
        self._report, self._heard_s = None, -math.inf

    def at(self, now_s: float) -> Beacon | None:
        """The place at an instant; None while nobody has told it."""
        options, report = self._options, self._report
        age_s = max(0.0, now_s - self._heard_s)
        if options.beacon_from_message and report is not None and age_s <= FORGOTTEN_AFTER_S:
            assert report.latitude_deg is not None
            assert report.longitude_deg is not None
            own_m = UNSTATED_STD_M if report.horizontal_std_m is None else report.horizontal_std_m
            depth_m = options.beacon_depth_m if report.depth_m is None else report.depth_m
            std_m = math.hypot(own_m, DRIFT_MPS * age_s)
            return Beacon(report.latitude_deg, report.longitude_deg, depth_m, std_m, MESSAGE)
        if options.beacon_deg is None:
            return None
        return Beacon(*options.beacon_deg, options.beacon_depth_m, options.beacon_std_m, SETTINGS)
