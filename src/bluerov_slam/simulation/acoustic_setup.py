"""An acoustic set-up from a file's tables: every figure of `AcousticSetup` by its own name."""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.errors import ArrayGeometryError, ConfigError
from bluerov_slam.simulation.acoustic_record import AcousticSetup

_ARRAY_KEYS = ("arm_m", "centre", "positions_m", "sample_skew_s")
_MODES = ("blocks", "ring", "onset")


def acoustic_setup_from_mapping(values: Mapping[str, object]) -> AcousticSetup:
    """A set-up from tables named as the fields of `AcousticSetup`. Raises ConfigError with the key and what is wanted.

    `array` has `positions_m` (n x 3), or `arm_m` and `centre` of the cross, and `sample_skew_s` (by default that of the
    thesis's board: every second receiver 0.42 us late).
    """
    tables = dict(values)
    array = _array(tables.pop("array", {}))
    setup = cast(AcousticSetup, _built(AcousticSetup, {**tables, "array": array}, ""))
    window = setup.window
    if window.mode not in _MODES:
        raise ConfigError(f"setup: window.mode must be one of {', '.join(_MODES)}, not '{window.mode}'")
    if not 0 <= window.pre_trigger < window.samples:
        raise ConfigError(f"setup: window.pre_trigger must be 0..{window.samples - 1}, not {window.pre_trigger}")
    low_hz, high_hz = setup.carrier_hz
    if not 5_000.0 <= low_hz <= high_hz <= 0.4 * setup.sample_rate_hz:
        raise ConfigError(
            f"setup: carrier_hz must rise from 5000 on and stay below 0.4 of the rate, not {low_hz}, {high_hz}"
        )
    return setup


def _array(value: object) -> ReceiverArray:
    if not isinstance(value, Mapping) or set(value) - set(_ARRAY_KEYS):
        raise ConfigError(f"setup: array must be a table with keys out of {', '.join(_ARRAY_KEYS)}")
    try:
        if "positions_m" in value:
            places_m = np.array(value["positions_m"], np.float64)
        else:
            places_m = ReceiverArray.cross(float(value.get("arm_m", 0.25)), bool(value.get("centre"))).positions_m
        usual_s = [THESIS_RANK_SKEW_S * (receiver % 2) for receiver in range(len(places_m))]
        return ReceiverArray(places_m, np.array(value.get("sample_skew_s", usual_s), np.float64), "array of the set-up")
    except (TypeError, ValueError, ArrayGeometryError) as error:
        raise ConfigError(f"setup: array: {error}") from error


def _built(kind: type, values: Mapping[str, object], path: str) -> object:
    """A dataclass from a table, its missing keys by default."""
    hints = get_type_hints(kind)
    known = {item.name for item in fields(kind)}
    if unknown := [key for key in values if key not in known]:
        raise ConfigError(f"setup: unknown key '{path}{unknown[0]}'; allowed: {', '.join(sorted(known))}")
    made = {key: _value(hints[key], value, f"{path}{key}") for key, value in values.items()}
    try:
        return kind(**made)
    except TypeError as error:
        raise ConfigError(f"setup: {path.removesuffix('.') or 'file'}: {error}") from error


def _value(wanted: Any, value: object, path: str) -> object:
    origin, parts = get_origin(wanted), get_args(wanted)
    if origin in (Union, types.UnionType):
        (wanted,) = (part for part in parts if part is not type(None))
        return _value(wanted, value, path)
    if origin is tuple:
        return _sequence(parts, value, path)
    if isinstance(wanted, type) and isinstance(value, wanted) and isinstance(value, bool) == (wanted is bool):
        return value
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if is_dataclass(wanted) and isinstance(value, Mapping):
        return _built(cast(type, wanted), value, f"{path}.")
    name = "table" if is_dataclass(wanted) else cast(type, wanted).__name__
    raise ConfigError(f"setup: {path} must be a {name}, not {value!r}")


def _sequence(parts: tuple[Any, ...], value: object, path: str) -> tuple[object, ...]:
    endless = len(parts) == 2 and parts[1] is Ellipsis
    if not isinstance(value, Sequence) or isinstance(value, str) or not (endless or len(value) == len(parts)):
        raise ConfigError(f"setup: {path} must be a list{'' if endless else f' of {len(parts)}'}, not {value!r}")
    kinds = [parts[0]] * len(value) if endless else parts
    return tuple(_value(kind, part, f"{path}[{n}]") for n, (kind, part) in enumerate(zip(kinds, value, strict=True)))
