"""How much sound of one frequency the medium swallows, in dB per metre.

The thesis has 128 dB/m for 40 kHz in air (it is 1.3) and 1 dB/km in sea water (it is 9 to 14).
"""

from __future__ import annotations

import math

from bluerov_slam.errors import OutOfValidityError

_REFERENCE_PA = 101_325.0
_REFERENCE_K = 293.15
_TRIPLE_POINT_K = 273.16
_ZERO_K = 273.15


def air_absorption_db_per_m(
    frequency_hz: float,
    temperature_degc: float = 20.0,
    humidity_percent: float = 50.0,
    pressure_pa: float = _REFERENCE_PA,
) -> float:
    """Absorption of a pure tone in still air.

    Raises OutOfValidityError outside -20..50 degC, 0.2..2 atm or where frequency over pressure leaves 4e-4..10 Hz/Pa.
    Source: ISO 9613-1:1993, equations 3 to 5, B.2, B.3. Check: 10 degC, 70 %, 4 kHz -> 32.8 dB/km (9613-2, table 2).
    """
    pressure = pressure_pa / _REFERENCE_PA
    _require("temperature", temperature_degc, -20.0, 50.0, "degC")
    _require("humidity", humidity_percent, 0.0, 100.0, "%")
    _require("pressure", pressure, 0.2, 2.0, "atm")
    _require("frequency over pressure", frequency_hz / pressure_pa, 4.0e-4, 10.0, "Hz/Pa")
    kelvin = temperature_degc + _ZERO_K
    warm = kelvin / _REFERENCE_K
    saturation = 10.0 ** (-6.8346 * (_TRIPLE_POINT_K / kelvin) ** 1.261 + 4.6151)
    h = humidity_percent * saturation / pressure  # molar concentration of water vapour, %
    oxygen_hz = pressure * (24.0 + 4.04e4 * h * (0.02 + h) / (0.391 + h))
    nitrogen_hz = pressure / math.sqrt(warm) * (9.0 + 280.0 * h * math.exp(-4.170 * (warm ** (-1.0 / 3.0) - 1.0)))
    square = frequency_hz**2
    oxygen = 0.01275 * math.exp(-2239.1 / kelvin) / (oxygen_hz + square / oxygen_hz)
    nitrogen = 0.1068 * math.exp(-3352.0 / kelvin) / (nitrogen_hz + square / nitrogen_hz)
    loss: float = 8.686 * square * (1.84e-11 / pressure * math.sqrt(warm) + warm**-2.5 * (oxygen + nitrogen))
    return loss


def sea_absorption_db_per_m(
    frequency_hz: float,
    temperature_degc: float = 10.0,
    salinity_psu: float = 35.0,
    depth_m: float = 0.0,
    acidity_ph: float = 8.0,
) -> float:
    """Absorption in sea water: boric acid, magnesium sulphate and the water itself. Fresh water is salinity 0.

    Raises OutOfValidityError outside 100 Hz..1 MHz, -2..35 degC, 0..45 PSU, 0..7000 m.
    Source: Francois and Garrison (1982), doi:10.1121/1.388170 and doi:10.1121/1.388673.
    Check: within 10 % of Ainslie and McColm (1998), doi:10.1121/1.421258; 38 kHz, 10 degC, 35 PSU -> 10.2 dB/km.
    """
    _require("frequency", frequency_hz, 100.0, 1.0e6, "Hz")
    _require("temperature", temperature_degc, -2.0, 35.0, "degC")
    _require("salinity", salinity_psu, 0.0, 45.0, "PSU")
    _require("depth", depth_m, 0.0, 7000.0, "m")
    t, s, d, square = temperature_degc, salinity_psu, depth_m, (1e-3 * frequency_hz) ** 2
    kelvin = 273.0 + t
    speed_mps = 1412.0 + 3.21 * t + 1.19 * s + 0.0167 * d
    boric_khz = 2.8 * math.sqrt(s / 35.0) * 10.0 ** (4.0 - 1245.0 / kelvin)
    sulphate_khz = 8.17 * 10.0 ** (8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (s - 35.0))
    boric = 8.86 / speed_mps * 10.0 ** (0.78 * acidity_ph - 5.0) * boric_khz / (boric_khz**2 + square)
    sulphate = 21.44 * s / speed_mps * (1.0 + 0.025 * t) * sulphate_khz / (sulphate_khz**2 + square)
    if t <= 20.0:
        water = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.50e-8 * t**3
    else:
        water = 3.964e-4 - 1.146e-5 * t + 1.45e-7 * t**2 - 6.5e-10 * t**3
    sulphate *= 1.0 - 1.37e-4 * d + 6.2e-9 * d**2
    water *= 1.0 - 3.83e-5 * d + 4.9e-10 * d**2
    loss: float = 1e-3 * square * (boric + sulphate + water)
    return loss


def _require(what: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise OutOfValidityError(f"{what} {value:g} {unit}, expected {low:g}..{high:g}")
