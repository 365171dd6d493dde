"""The parameter file of the filters over the thesis's logs: shipped with the package, made by `isbl calibrate`."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

from bluerov_slam.evaluation.thesis_held_out import Parameters, as_json, from_json

FILE = "thesis_parameters.json"
_HOW = (
    "Made by: bluerov-slam isbl calibrate --train-only. Truth is used in the first half of each log only; what is "
    "chosen is chosen by nested quarters of it; without_truth is by the likelihood of innovations of first halves. "
    "Data: J. Frabosilio, master's thesis, Cal Poly San Luis Obispo, 2024 (CC BY-SA 4.0)."
)


def shipped_parameters() -> Parameters:
    """What the package has."""
    return from_json(json.loads(shipped_text()))


def shipped_text() -> str:
    """The file as it is."""
    return files("bluerov_slam.survey").joinpath(FILE).read_text(encoding="utf-8")


def as_text(parameters: Parameters) -> str:
    """The file that holds these parameters, the same to the last byte for the same parameters."""
    content: dict[str, Any] = {"about": _HOW} | as_json(parameters)
    return json.dumps(content, indent=1) + "\n"
