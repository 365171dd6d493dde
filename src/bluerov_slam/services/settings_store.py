"""The settings in force, and the file in the state folder that holds what was changed from the page."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from bluerov_slam.config import (
    InvalidSettingsError,
    Layer,
    Settings,
    combine,
    environment_layer,
    flatten,
    setting_infos,
    toml_layer,
    values_of,
)
from bluerov_slam.errors import ConfigError

FILE_NAME: Final = "settings.json"
VERSION: Final = 1
HIDDEN: Final = "********"
# The folder of the settings file cannot be a setting inside it.
_ONLY_AT_START: Final = frozenset({"paths.state"})


@dataclass(frozen=True, slots=True)
class _Fixed:
    """What the user gave at start: below the saved file, and above it."""

    below: tuple[Layer, ...]
    above: tuple[Layer, ...]


class SettingsStore:
    """Settings from all layers. `change` and `restore` are all or nothing and write the file before they return.

    `notices` are what the user should be told about the file, such as that it was unreadable.
    """

    def __init__(self, fixed: _Fixed) -> None:
        self._fixed = fixed
        self.notices: list[str] = []
        # Refused values here come from the user's own file, environment or flags: those stop the start.
        at_start = combine([*fixed.below, *fixed.above])
        self.file = at_start.state_folder / FILE_NAME
        self._saved = self._load()
        self.settings = self._combined(self._saved)
        self._running = values_of(self.settings)

    @classmethod
    def open(
        cls,
        config_file: Path | None = None,
        flags: Mapping[str, object] | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> SettingsStore:
        """Read every layer. Raises ConfigError, one line per fault, for what is wrong in the user's own layers."""
        below = (toml_layer(config_file),) if config_file else ()
        variables = os.environ if environment is None else environment
        above = (environment_layer(variables), Layer("command line", dict(flags or {})))
        return cls(_Fixed(below, above))

    def listing(self) -> dict[str, Any]:
        """What GET /api/settings answers. `fixed_by` names what overrules the page, `pending` needs a restart."""
        values = values_of(self.settings)
        return {
            "version": VERSION,
            "file": str(self.file),
            "settings": [
                {
                    "key": info.key,
                    "value": _shown(values[info.key], info.secret),
                    "default": info.default,
                    "unit": info.unit,
                    "minimum": info.minimum,
                    "maximum": info.maximum,
                    "choices": info.choices,
                    "reason": info.reason,
                    "group": info.group,
                    "restart": info.restart,
                    "pending": info.restart and values[info.key] != self._running[info.key],
                    "fixed_by": self._fixed_by(info.key),
                }
                for info in setting_infos()
            ],
        }

    def change(self, values: Mapping[str, object]) -> frozenset[str]:
        """Set these dotted keys; null takes a key back to what it would be without the page. The keys that changed.

        A secret that comes back as it was shown stays what it is.

        Raises ConfigError and changes nothing when one of them is unknown, out of range or fixed at start.
        """
        secret = _secret_keys()
        values = {key: value for key, value in values.items() if not (key in secret and value == HIDDEN)}
        fixed = [f"{key} is set by {origin}; change it there" for key in values if (origin := self._fixed_by(key))]
        if fixed:
            raise ConfigError("\n".join(fixed))
        saved = {**self._saved, **values}
        return self._replace({key: value for key, value in saved.items() if value is not None})

    def backup(self) -> dict[str, Any]:
        """What the page changed, as a file to keep; without secrets."""
        secret = _secret_keys()
        return {"version": VERSION, "settings": {k: v for k, v in self._saved.items() if k not in secret}}

    def restore(self, data: Mapping[str, Any]) -> frozenset[str]:
        """Take a backup, of any version, in place of what the page changed. The keys that changed.

        Keys that are fixed at start are left out; secrets, which no backup holds, stay. Raises ConfigError and changes
        nothing when it does not fit.
        """
        values = {key: value for key, value in _migrated(data).items() if key not in _ONLY_AT_START}
        secrets = {key: value for key, value in self._saved.items() if key in _secret_keys()}
        return self._replace({**secrets, **values})

    def _replace(self, saved: dict[str, object]) -> frozenset[str]:
        settings = self._combined(saved)
        try:
            _write_atomically(self.file, {"version": VERSION, "settings": saved})
        except OSError as error:
            raise ConfigError(f"the settings cannot be saved in {self.file}: {error.strerror or error}") from error
        before, after = values_of(self.settings), values_of(settings)
        self._saved, self.settings = saved, settings
        return frozenset(key for key in after if before[key] != after[key])

    def _combined(self, saved: Mapping[str, object]) -> Settings:
        return combine([*self._fixed.below, Layer("the page", saved), *self._fixed.above])

    def _fixed_by(self, key: str) -> str | None:
        if key in _ONLY_AT_START:
            return "configuration file, environment or command line"
        return next((layer.origin for layer in reversed(self._fixed.above) if key in layer.values), None)

    def _load(self) -> dict[str, object]:
        """What the file holds and still fits; what does not is dropped with a notice, an unreadable file set aside."""
        try:
            text = self.file.read_text(encoding="utf-8")
        except FileNotFoundError:
            return {}
        except (OSError, UnicodeDecodeError) as error:
            self._set_aside(f"cannot be read ({error})")
            return {}
        try:
            data = json.loads(text)
            if not isinstance(data, dict):
                raise ConfigError("it holds no JSON object")
            values = _migrated(data)
        except (json.JSONDecodeError, ConfigError) as error:
            self._set_aside(f"is damaged ({error})")
            return {}
        return self._without_misfits({key: value for key, value in values.items() if key not in _ONLY_AT_START})

    def _without_misfits(self, values: dict[str, object]) -> dict[str, object]:
        try:
            combine([*self._fixed.below, Layer(str(self.file), values)])
        except InvalidSettingsError as error:
            misfits = {key for key, origin in error.keys if origin == str(self.file)}
            self.notices += [f"{line}; this setting is ignored" for line in error.lines]
            if not misfits:  # values that only clash with each other: none of them can be trusted
                return {}
            return self._without_misfits({key: value for key, value in values.items() if key not in misfits})
        return values

    def _set_aside(self, reason: str) -> None:
        aside = self.file.with_name(f"{FILE_NAME}.damaged")
        try:
            self.file.replace(aside)
            kept = f"it was kept as {aside.name}"
        except OSError as error:
            kept = f"it could not be set aside ({error.strerror})"
        self.notices.append(f"{self.file} {reason}; {kept}, and the settings of the page are at their defaults")


def _migrated(data: Mapping[str, Any]) -> dict[str, object]:
    """The dotted values of a settings file of any version. Raises ConfigError for one of a later version."""
    version = data.get("version", 0)
    if not isinstance(version, int) or not 0 <= version <= VERSION:
        raise ConfigError(
            f"version {version!r} of the settings is not known here (up to {VERSION}); update the extension"
        )
    current = dict(data)
    for step in range(version, VERSION):
        current = _MIGRATIONS[step](current)
    values = current.get("settings")
    if not isinstance(values, dict):
        raise ConfigError('the settings lack the object "settings"')
    return values


def _from_unversioned(data: dict[str, Any]) -> dict[str, Any]:
    """Version 0 had no version and held the tree itself, like the TOML file."""
    return {"version": 1, "settings": flatten({key: value for key, value in data.items() if key != "version"})}


_MIGRATIONS: Final[dict[int, Callable[[dict[str, Any]], dict[str, Any]]]] = {0: _from_unversioned}


def _secret_keys() -> frozenset[str]:
    return frozenset(info.key for info in setting_infos() if info.secret)


def _shown(value: object, secret: bool) -> object:
    return HIDDEN if secret and value else value


def _write_atomically(path: Path, data: object) -> None:
    """Whoever reads sees the old file or the new one, also after a power cut."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f".{path.name}.new")
    with fresh.open("w", encoding="utf-8") as file:
        json.dump(data, file, indent=2)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
