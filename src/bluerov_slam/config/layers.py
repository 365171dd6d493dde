"""How the layers of values combine, and what is said about a value that does not fit.

Later layers win: default < TOML file < what the page changed < environment < flag. `config/example.toml` is
`example_toml()`; a test keeps them the same.
"""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Literal, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from bluerov_slam.config.kinds import Group
from bluerov_slam.config.tree import Settings
from bluerov_slam.errors import ConfigError

ENVIRONMENT_PREFIX = "BLUEROV_SLAM_"


@dataclass(frozen=True, slots=True)
class Layer:
    """Values of one origin by dotted key. `origin` is what an error names: a file, 'environment', 'command line'."""

    origin: str
    values: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class SettingInfo:
    """What a page shows about one setting."""

    key: str
    default: object
    unit: str | None
    minimum: float | None
    maximum: float | None
    choices: tuple[object, ...] | None
    reason: str
    group: str
    restart: bool
    secret: bool


class InvalidSettingsError(ConfigError):
    """One line per fault in `lines`; `keys` are those at fault, by dotted key with their origin."""

    def __init__(self, lines: Sequence[str], keys: Iterable[tuple[str, str]] = ()) -> None:
        super().__init__("\n".join(lines))
        self.lines = tuple(lines)
        self.keys = tuple(keys)


def combine(layers: Sequence[Layer]) -> Settings:
    """The settings that these layers give, later ones winning. Raises InvalidSettingsError naming every fault."""
    known = {info.key for info in setting_infos()}
    unknown = [(key, layer.origin) for layer in layers for key in layer.values if key not in known]
    lines = [_unknown_key(key, origin, known) for key, origin in unknown]
    merged: dict[str, tuple[object, str]] = {}
    for layer in layers:
        merged.update({key: (value, layer.origin) for key, value in layer.values.items() if key in known})
    tree: dict[str, dict[str, object]] = {}
    for key, (value, _) in merged.items():
        group, name = key.split(".", 1)
        tree.setdefault(group, {})[name] = value
    at_fault = list(unknown)
    settings = None
    try:
        settings = Settings.model_validate(tree)
    except ValidationError as error:
        for fault in error.errors():
            key = fault.get("ctx", {}).get("key") or ".".join(str(part) for part in fault["loc"][:2])
            value, origin = merged.get(key, (None, ""))
            at_fault.append((key, origin))
            reason = str(fault["msg"]).removeprefix("Value error, ")
            own_words = reason if fault["type"] in ("value_error", "setting") else None
            lines.append(_bad_value(key, value, origin, own_words) if key else reason)
    if settings is None or lines:
        raise InvalidSettingsError(list(dict.fromkeys(lines)), at_fault)
    return settings


def toml_layer(path: Path) -> Layer:
    """The values of a TOML file. Raises ConfigError when it cannot be read or is not TOML."""
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    return Layer(str(path), flatten(tree))


def environment_layer(environment: Mapping[str, str]) -> Layer:
    """The values of BLUEROV_SLAM_<GROUP>__<KEY>; lists as JSON or separated by commas."""
    values: dict[str, object] = {}
    if "MAV_SYSTEM_ID" in environment:  # BlueOS 1.5 tells every extension the vehicle's MAVLink system this way
        values["mavlink.system_id"] = from_text("mavlink.system_id", environment["MAV_SYSTEM_ID"])
    for name, text in environment.items():
        if name.startswith(ENVIRONMENT_PREFIX) and "__" in name:
            key = name.removeprefix(ENVIRONMENT_PREFIX).lower().replace("__", ".", 1)
            values[key] = from_text(key, text)
    return Layer("environment", values)


def from_text(key: str, text: str) -> object:
    """A value for `key` from the text of a variable or flag; text that fits no type is left for `combine` to refuse."""
    annotation = _annotations().get(key)
    if annotation is str:
        return text
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        if _is_list(annotation):
            return [part.strip() for part in text.split(",") if part.strip()]
        return {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}.get(
            text.lower(), text
        )


def flatten(tree: Mapping[str, object]) -> dict[str, object]:
    """`{"serial": {"port": "x"}}` as `{"serial.port": "x"}`; a value where a group belongs keeps its own name."""
    flat: dict[str, object] = {}
    for group, values in tree.items():
        if isinstance(values, Mapping):
            flat.update({f"{group}.{name}": value for name, value in values.items()})
        else:
            flat[group] = values
    return flat


def values_of(settings: Settings) -> dict[str, object]:
    """Every setting's value by dotted key, tuples as lists."""
    return flatten(settings.model_dump(mode="json"))


def setting_infos() -> tuple[SettingInfo, ...]:
    """Every setting with its default, unit, range and reason, in the order of the tree."""
    return tuple(
        _info(group, name, field) for group, model in _groups().items() for name, field in model.model_fields.items()
    )


def example_toml() -> str:
    """The text of config/example.toml: every setting with default, unit, range and reason."""
    lines = [
        "# Every setting with its default. Copy, keep the lines you change, and start with",
        "#     bluerov-slam run --config my.toml",
        f"# Environment: {ENVIRONMENT_PREFIX}<GROUP>__<KEY>, such as {ENVIRONMENT_PREFIX}SERIAL__PORT=/dev/ttyUSB0.",
    ]
    infos = setting_infos()
    for group, model in _groups().items():
        lines += ["", f"# {model.__doc__}", f"[{group}]"]
        for info in infos:
            if info.group == group:
                notes = [*([f"unit {info.unit}"] if info.unit else []), *([allowed(info)] if allowed(info) else [])]
                lines += [f"# {info.reason}" + (f" ({'; '.join(notes)})" if notes else "")]
                lines += [f"{info.key.split('.', 1)[1]} = {_toml_value(info.default)}"]
    return "\n".join(lines) + "\n"


def allowed(info: SettingInfo) -> str:
    """The allowed range in words; empty where any text will do."""
    if info.choices:
        return "one of " + ", ".join(str(choice) for choice in info.choices)
    if info.minimum is not None and info.maximum is not None:
        return f"{_plain(info.minimum)} to {_plain(info.maximum)}"
    return ""


def _groups() -> dict[str, type[Group]]:
    return {name: _as_group(field.annotation) for name, field in Settings.model_fields.items()}


def _as_group(annotation: object) -> type[Group]:
    assert isinstance(annotation, type)
    assert issubclass(annotation, Group)
    return annotation


def _annotations() -> dict[str, object]:
    return {
        f"{group}.{name}": f.annotation for group, model in _groups().items() for name, f in model.model_fields.items()
    }


def _info(group: str, name: str, field: FieldInfo) -> SettingInfo:
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    limits = {bound: getattr(part, bound) for part in field.metadata for bound in ("ge", "le") if hasattr(part, bound)}
    choices = tuple(get_args(field.annotation)) if get_origin(field.annotation) is Literal else None
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    return SettingInfo(
        key=f"{group}.{name}", default=default, unit=_text_or_none(extra.get("unit")),
        minimum=limits.get("ge"), maximum=limits.get("le"), choices=choices, reason=field.description or "",
        group=group, restart=bool(extra.get("restart")), secret=bool(extra.get("secret")),
    )  # fmt: skip


def _text_or_none(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _is_list(annotation: object) -> bool:
    return get_origin(annotation) is tuple


def _unknown_key(key: str, origin: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(key, list(known), n=1)
    hint = f"; did you mean {close[0]}?" if close else "; config/example.toml lists them all"
    return f"{origin}: {key}: unknown setting{hint}"


def _bad_value(key: str, value: object, origin: str, expected: str | None = None) -> str:
    shown = json.dumps(value, default=str)
    shown = shown if len(shown) <= 80 else shown[:77] + "..."
    info = next((info for info in setting_infos() if info.key == key), None)
    if info is None:
        return f"{origin}: {key} = {shown}: expected a group of settings"
    return f"{origin}: {key} = {shown}: {expected or f'expected {_expectation(info)}'}"


def _expectation(info: SettingInfo) -> str:
    unit = f" in {info.unit}" if info.unit else ""
    if info.choices:
        return allowed(info) + unit
    kinds: dict[type, str] = {bool: "true or false", int: "a whole number", float: "a number", str: _text(info.key)}
    annotation = _annotations()[info.key]
    if _is_list(annotation):
        kind = _LISTS.get(info.key) or _LISTS.get(info.unit or "") or "a list of at most 16 names or addresses"
    else:
        kind = kinds.get(annotation if isinstance(annotation, type) else NoneType, "another value")
    limits = f" from {allowed(info)}" if allowed(info) else ""
    return f"{kind}{limits}{unit} ({info.reason})"


def _text(key: str) -> str:
    """What kind of text a setting takes."""
    if key in _TEXTS:
        return _TEXTS[key]
    group, name = key.split(".", 1)
    limits = {
        bound: getattr(part, bound)
        for part in _groups()[group].model_fields[name].metadata
        for bound in ("min_length", "max_length")
        if hasattr(part, bound)
    }
    most = limits.get("max_length")
    return f"text of {limits.get('min_length', 0)} to {most} characters" if most else "text"


def _plain(number: float) -> str:
    return str(int(number)) if number == int(number) else str(number)


_LISTS = {
    "m": "a list of three numbers from -10 to 10",
    "deg": "a list of three numbers from -360 to 360",
    "navigation.thruster_directions": "a list of 1 and -1, one for each thruster",
}
_TEXTS = {
    "navigation.origin": "nothing, or latitude and longitude such as 54.3219, 10.1356",
    "mavlink.target_host": "a host name or an address",
    "mavlink.mavlink2rest_url": "nothing, or an address that begins with ws:// or wss://",
}


def _toml_value(value: object) -> str:
    return json.dumps(value)
