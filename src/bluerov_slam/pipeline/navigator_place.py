"""Where on Earth the dive is: the origin of the local frame, and what the Earth's field is like there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bluerov_slam.errors import OutOfValidityError
from bluerov_slam.navigation.attitude.declination import VALID_YEARS, decimal_year, magnetic_field
from bluerov_slam.navigation.local_frame import LocalFrame

if TYPE_CHECKING:
    from bluerov_slam.pipeline.navigator_options import NavigatorOptions

# Without a date the middle of the model's validity: the field turns by a tenth of a degree a year.
UNDATED_YEAR = 0.5 * (VALID_YEARS[0] + VALID_YEARS[1])


class Place:
    """Origin and declination; both unknown until something said where the vehicle is."""

    def __init__(self, options: NavigatorOptions) -> None:
        self._options = options
        self.frame: LocalFrame | None = None
        self.declination_rad = options.declination_rad or 0.0
        self.dip_rad: float | None = None
        self.utc_unix_s: float | None = None
        if options.origin_deg is not None:
            self.settle(*options.origin_deg)

    @property
    def origin_deg(self) -> tuple[float, float] | None:
        """Of the local frame."""
        return None if self.frame is None else (self.frame.latitude_deg, self.frame.longitude_deg)

    @property
    def latitude_deg(self) -> float | None:
        """Of the origin."""
        return None if self.frame is None else self.frame.latitude_deg

    def settle(self, latitude_deg: float, longitude_deg: float) -> float:
        """Take this as the origin. Returns by how much the declination changed, rad."""
        self.frame = LocalFrame(float(latitude_deg), float(longitude_deg))
        before_rad = self.declination_rad
        year = UNDATED_YEAR if self.utc_unix_s is None else decimal_year(self.utc_unix_s)
        try:
            field = magnetic_field(latitude_deg, longitude_deg, min(max(year, VALID_YEARS[0]), VALID_YEARS[1]))
        except OutOfValidityError:
            # Too near a magnetic pole for a compass: its priors are wide enough to say so.
            self.dip_rad = None
            return 0.0
        self.dip_rad = field.inclination_rad
        if self._options.declination_rad is None:
            self.declination_rad = field.declination_rad
        return math.remainder(self.declination_rad - before_rad, math.tau)

    def offset_m(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """North and east of the origin."""
        assert self.frame is not None
        north, east, _ = self.frame.to_ned_m(latitude_deg, longitude_deg)
        return north, east
