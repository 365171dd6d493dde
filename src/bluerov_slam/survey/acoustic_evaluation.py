"""Every case of `bluerov-slam isbl evaluate`: the simulated ones, and the thesis's real logs as two cases more."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob, all_cases
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.survey.thesis_parameters import shipped_parameters
from bluerov_slam.survey.thesis_study import FOLDER, held_out_rows, reproduced_rows, study_of


def every_case() -> dict[str, AcousticCase]:
    """By id, in the order of the table."""
    return all_cases() | {case.id: case for case in _REAL}


def run_reproduced(job: AcousticJob, files: Mapping[str, bytes]) -> list[Row]:
    """What `isbl reproduce` states."""
    return reproduced_rows(study_of(files))


def run_held_out(job: AcousticJob, files: Mapping[str, bytes]) -> list[Row]:
    """What `isbl heldout` states, with the package's parameters."""
    return held_out_rows(study_of(files), shipped_parameters())


def _as_they_are(cells: Mapping[str, Sequence[list[Row]]]) -> list[Row]:
    return [row for found in cells.values() for rows in found for row in rows]


def _real(name: str, title: str, run: Callable[[AcousticJob, Mapping[str, bytes]], list[Row]]) -> AcousticCase:
    return AcousticCase(name, title, ("logs",), run, _as_they_are, simulated=False, material=FOLDER)


_REAL = (
    _real("I20", "The thesis's table, filters and truth from its logs (real)", run_reproduced),
    _real("I21", "Held-out halves of the thesis's logs (real)", run_held_out),
)
