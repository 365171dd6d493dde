"""The settings in one place: the tree in `tree`, layers of values in `layers`; import the names from here."""

from __future__ import annotations

from bluerov_slam.config.layers import (
    InvalidSettingsError,
    Layer,
    SettingInfo,
    combine,
    environment_layer,
    example_toml,
    flatten,
    from_text,
    setting_infos,
    toml_layer,
    values_of,
)
from bluerov_slam.config.tree import Settings

__all__ = [
    "InvalidSettingsError",
    "Layer",
    "SettingInfo",
    "Settings",
    "combine",
    "environment_layer",
    "example_toml",
    "flatten",
    "from_text",
    "setting_infos",
    "toml_layer",
    "values_of",
]
