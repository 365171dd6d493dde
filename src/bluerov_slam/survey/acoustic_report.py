"""What `bluerov-slam isbl evaluate` measured, as one HTML file: every figure, and plots of every case that was run."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

from bluerov_slam import __version__
from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob
from bluerov_slam.evaluation.acoustic_position import AIR_MPS, WATER_MPS, thesis_array
from bluerov_slam.evaluation.acoustic_timing import sources_ahead
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.records import AcousticRecord
from bluerov_slam.simulation.acoustic_paths import Medium
from bluerov_slam.simulation.acoustic_record import AcousticSetup, simulate_records
from bluerov_slam.survey.report_page import NO_PLOTS, drawn, figure_html, page_html, rows_html, verdict_html

DRAWS_ASKED = 1000
Found = Sequence[tuple[AcousticJob, Any]]

_CAPTIONS = {
    "timing": ("Timing over signal to noise", "One pair. Whoever is on the dashed line cannot be beaten."),
    "bands": ("Bands of slips", "Errors of the weakest signals: a slip is a whole period of the carrier."),
    "scatter": (
        "Errors of position",
        "All draws; the ellipse holds 95 % of a normal distribution that spreads as they do.",
    ),
    "range": (
        "Error over range and angle",
        "RMS of all draws; right: our chain in bins of the angle to the array's axis.",
    ),
    "echo": ("Wrong cells under a floor", "The floor lies 0.66 m under the array."),
    "radial": ("Honesty of the range", "Five receivers, no depth, no clock."),
    "bench": ("Errors of the whole chain", "How many fixes are within an error."),
    "yaw": ("Honesty of the start yaw", "Four minutes at rest under a compass that wobbles."),
    "dives": ("Dives", "Each seed is one dive of a kilometre."),
    "message": ("Message frames", "An ideal receiver knows amplitude, phase and timing."),
}
_SURFACES = {"I2": AIR_MPS, "I5": WATER_MPS}


def evaluation_report(cases: Sequence[AcousticCase], found: Found, rows: Sequence[Row]) -> str:
    """The whole page; a case without an outcome has its rows alone."""

    def draw() -> dict[str, str]:
        from bluerov_slam.survey import acoustic_plots

        return acoustic_plots.draw(found) | _surfaces(found)

    plots = drawn(draw)
    title = "Acoustic positioning: what was measured"
    jobs = [job for job, _ in found]
    draws = sum(job.draws for job in jobs)
    seeds = f", seeds {min(job.seed for job in jobs)} to {max(job.seed for job in jobs)}" if jobs else ""
    parts = [
        f"<h1>{title}</h1>",
        f"<p class=sub>bluerov-slam {__version__}, isbl evaluate: {draws} draws in all{seeds}. Titles say what is "
        "simulated and what is real; simulated rows are judged by the 95 % limit on the bad side.</p>",
        _few(jobs),
        verdict_html(rows),
        "" if plots is not None else NO_PLOTS,
    ]
    for case in cases:
        own = [row for row in rows if row.id.partition(".")[0] == case.id]
        parts.append(f"<h2>{escape(case.id)}: {escape(case.title)}</h2>")
        for kind, (heading, caption) in _CAPTIONS.items():
            parts.append(figure_html(plots, f"{case.id}.{kind}", "", f"{heading}. {caption}"))
        parts.append(
            figure_html(
                plots, f"{case.id}.surface", "",
                "Correlation surfaces of the first draw of the first cell. Above: the records, and the correlation of "
                "the reference with each other receiver. Below: how well all receivers agree for a pulse from every "
                "direction; neighbouring peaks are slips by carrier periods.",
            )
        )  # fmt: skip
        parts.append(rows_html(own))
    return page_html(title, parts)


def _few(jobs: Sequence[AcousticJob]) -> str:
    """A word where the limits are wide only because little was run."""
    draws: dict[tuple[str, str], int] = {}
    for job in jobs:
        if job.draws:
            draws[job.case, job.cell] = draws.get((job.case, job.cell), 0) + job.draws
    fewest = min(draws.values(), default=DRAWS_ASKED)
    if fewest >= DRAWS_ASKED:
        return ""
    return (
        f"<p class=banner>Only {fewest} draws in some cells: the targets ask for {DRAWS_ASKED}, and with fewer a limit "
        "may be missed for want of draws alone.</p>"
    )


def _surfaces(found: Found) -> dict[str, str]:
    """The correlation surface of one pulse of a case of positions, made again from its seed."""
    from bluerov_slam.survey.acoustic_solve import SolveOptions, solve_record
    from bluerov_slam.survey.acoustic_solve_report import surface_svg

    made = {}
    for case, sound_mps in _SURFACES.items():
        job = next((job for job, _ in found if job.case == case), None)
        if job is None:
            continue
        range_m, snr_db = float(job.cell.split()[0]), float(job.cell.split(" m ")[1].split()[0])
        array = thesis_array()
        setup = AcousticSetup(array, medium=Medium(sound_mps, 0.0), snr_db=snr_db)
        simulated = simulate_records(setup, sources_ahead(job.seed, 1, range_m), job.seed)
        record = AcousticRecord(
            0.0, 0.0, 0, simulated.sample_rate_hz, simulated.samples[0].astype("int16"), 12, simulated.trigger_index
        )
        svg = surface_svg(solve_record(record, SolveOptions(array, sound_mps)), SolveOptions(array, sound_mps))
        if svg:
            made[f"{case}.surface"] = svg
    return made
