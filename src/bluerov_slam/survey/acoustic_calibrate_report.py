"""What `bluerov-slam isbl calibrate-array` found, as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from bluerov_slam import __version__
from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.records import AcousticRecord
from bluerov_slam.survey.acoustic_calibrate import ArrayCalibration
from bluerov_slam.survey.report_page import NO_PLOTS, drawn, figure_html, page_html, table_html

_RECEIVERS_DRAWN = 20.0
"""Times that the move of a receiver is drawn larger than it is."""


def calibration_report(
    name: str, records: Sequence[AcousticRecord], array: ReceiverArray, calibration: ArrayCalibration
) -> str:
    """The whole page; `array` as it was drawn."""
    geometry, responses = calibration.geometry, calibration.responses

    def draw() -> dict[str, str]:
        from bluerov_slam.survey.acoustic_solve import SolveOptions, solve_record
        from bluerov_slam.survey.acoustic_solve_report import surface_svg

        options = SolveOptions(geometry.array, geometry.sound_speed_mps)
        return _drawings(array, calibration) | {"surface": surface_svg(solve_record(records[0], options), options)}

    plots = drawn(draw)
    title = f"Array calibrated from {name}"
    learned = [
        (
            each.name,
            f"{each.value:.6g}",
            f"{each.std:.2g}",
            "held" if each.prior_std == 0.0 else f"{each.prior_std:.2g}",
        )
        for each in geometry.learned
    ]
    places = [
        (str(number), *(f"{1e3 * value:.2f}" for value in place), f"{hertz / 1e3:.3f}", f"{100.0 * std:.3f} %")
        for number, (place, hertz, std) in enumerate(
            zip(
                geometry.array.positions_m.tolist(),
                responses.responses.resonance_hz.tolist(),
                responses.tilt_std.tolist(),
                strict=True,
            )
        )
    ]
    fit = f"{geometry.nis / geometry.dof:.2f}" if geometry.dof else "-"
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p class=sub>bluerov-slam {__version__}; {geometry.pulses} pulses used, {len(geometry.excluded)} left out, "
        f"residual {1e6 * geometry.rms_residual_s:.3f} \u00b5s RMS (squared and normalised {fit} for one degree of "
        f"freedom), sound speed {geometry.sound_speed_mps:.2f} m/s.</p>",
        "" if geometry.converged else "<p class='banner bad'>The search did not converge: take no figure from it.</p>",
        "".join(f"<p class=banner>{escape(note)}</p>" for note in calibration.notes),
        "" if plots else NO_PLOTS,
        "<h2>Receivers</h2>",
        table_html(
            ("Receiver", "forward, mm", "right, mm", "down, mm", "resonance, kHz", "known to"), places, range(1, 6)
        ),
        figure_html(
            plots, "receivers", "",
            f"Where the receivers are beside where they were drawn, moves {_RECEIVERS_DRAWN:.0f} times as large.",
        ),
        "<h2>What the data told</h2>",
        table_html(("Figure", "value", "deviation", "before"), learned, range(1, 4)),
        figure_html(
            plots, "observability", "",
            "Singular values in units of noise and prior: what lies below one was not told by these data.",
        ),
        "".join(f"<p>Not told by these data: {escape(each)}</p>" for each in geometry.weak),
        figure_html(plots, "surface", "Correlation surfaces of the first record", "With the array as calibrated."),
    ]  # fmt: skip
    return page_html(title, parts)


def _drawings(array: ReceiverArray, calibration: ArrayCalibration) -> dict[str, str]:
    from matplotlib.figure import Figure

    from bluerov_slam.survey.plot_style import all_as_svg

    geometry = calibration.geometry
    moved = _RECEIVERS_DRAWN * (geometry.array.positions_m - array.positions_m)
    seen = Figure(figsize=(5.0, 4.6), layout="constrained")
    axes = seen.add_subplot()
    _, right, down = array.positions_m.T
    axes.plot(right, down, "o", color="#8c959f", label="as drawn")
    axes.quiver(
        right, down, moved[:, 1], moved[:, 2], angles="xy", scale_units="xy", scale=1.0, color="#0969da", width=0.006
    )
    for number, place in enumerate(array.positions_m):
        axes.annotate(str(number), place[1:], xytext=(5, 5), textcoords="offset points")
    axes.margins(0.3)
    axes.invert_yaxis()
    axes.set(xlabel="right (m)", ylabel="down (m)", aspect="equal")
    axes.legend()
    values = Figure(figsize=(9.0, 3.0), layout="constrained")
    bars = values.add_subplot()
    singular = geometry.singular_values
    bars.bar(np.arange(1, len(singular) + 1), singular, color=np.where(singular < 1.0, "#cf222e", "#0969da").tolist())
    bars.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
    bars.set(xlabel="combination, best told first", ylabel="singular value (1)", yscale="log")
    return all_as_svg({"receivers": seen, "observability": values})
