"""TEOS-10 by the field's own library: the reference that our formulas are held against. Needs the extra `teos10`.

It asks for a place on earth, because the salt of the Baltic is not that of the Pacific. In fresh water far from its
anomaly atlas the library answers NaN, and so do we.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.errors import ExpectedError
from bluerov_slam.navigation.seawater.validity import PA_PER_DBAR

if TYPE_CHECKING:
    from numpy.typing import NDArray


def is_available() -> bool:
    """Whether the library is installed."""
    return importlib.util.find_spec("gsw") is not None


def practical_salinity_psu(
    conductivity_s_per_m: Any, temperature_degc: Any, sea_pressure_pa: Any
) -> NDArray[np.float64]:
    """Practical salinity, as PSS-78 with the low-salinity extension made continuous at 2 PSU."""
    return _array(
        _library().SP_from_C(np.asarray(conductivity_s_per_m) * 10.0, temperature_degc, _dbar(sea_pressure_pa))
    )


def density_kg_per_m3(
    temperature_degc: Any, salinity_psu: Any, sea_pressure_pa: Any, latitude_deg: float, longitude_deg: float
) -> NDArray[np.float64]:
    """In-situ density, from the Gibbs function itself."""
    absolute = _absolute_salinity(salinity_psu, sea_pressure_pa, latitude_deg, longitude_deg)
    return _array(_library().rho_t_exact(absolute, temperature_degc, _dbar(sea_pressure_pa)))


def sound_speed_mps(
    temperature_degc: Any, salinity_psu: Any, sea_pressure_pa: Any, latitude_deg: float, longitude_deg: float
) -> NDArray[np.float64]:
    """Sound speed, from the Gibbs function itself."""
    absolute = _absolute_salinity(salinity_psu, sea_pressure_pa, latitude_deg, longitude_deg)
    return _array(_library().sound_speed_t_exact(absolute, temperature_degc, _dbar(sea_pressure_pa)))


def standard_ocean_depth_m(sea_pressure_pa: Any, latitude_deg: float) -> NDArray[np.float64]:
    """Depth in the standard ocean."""
    return -_array(_library().z_from_p(_dbar(sea_pressure_pa), latitude_deg))


def gravity_mps2(sea_pressure_pa: Any, latitude_deg: float) -> NDArray[np.float64]:
    """Gravity below the surface."""
    return _array(_library().grav(latitude_deg, _dbar(sea_pressure_pa)))


def _absolute_salinity(salinity_psu: Any, sea_pressure_pa: Any, latitude_deg: float, longitude_deg: float) -> Any:
    return _library().SA_from_SP(salinity_psu, _dbar(sea_pressure_pa), longitude_deg, latitude_deg)


def _dbar(sea_pressure_pa: Any) -> Any:
    return np.asarray(sea_pressure_pa, dtype=np.float64) / PA_PER_DBAR


def _array(value: Any) -> NDArray[np.float64]:
    return np.asarray(value, dtype=np.float64)


def _library() -> Any:
    if not is_available():
        raise ExpectedError("TEOS-10 needs the package gsw: pip install 'bluerov-slam[teos10]'")
    return importlib.import_module("gsw")
