"""`bluerov-slam isbl calibrate-array`: an array from records of its own pulses."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.calibration.geometry import GeometryPriors, in_words
from bluerov_slam.cli.evaluation_options import report_option, write_report
from bluerov_slam.cli.isbl_solve import make_array
from bluerov_slam.errors import ConfigError, RecordingError
from bluerov_slam.sinks.whole_output import in_whole
from bluerov_slam.sources.acoustic_records import read_acoustic_records
from bluerov_slam.survey.acoustic_calibrate import calibrate_array, calibration_json


@click.command("calibrate-array", short_help="Learn an array's geometry from records.")
@click.argument("record", type=click.Path(path_type=Path))
@click.option(
    "--places", type=click.Path(path_type=Path), help="CSV: forward,right,down in m of the source for each record."
)
@click.option(
    "--sound-speed", "sound_speed_mps", default=1500.0, show_default=True, type=click.FloatRange(300.0, 1700.0)
)
@click.option("--arm", "arm_m", default=0.25, show_default=True, type=click.FloatRange(0.01, 10.0), help="Of the X, m.")
@click.option("--fifth", is_flag=True, help="A fifth receiver in the middle of the X.")
@click.option("--receiver", "receivers", multiple=True, help="FORWARD,RIGHT,DOWN in m of one receiver; repeat for all.")
@click.option("--thesis-skew", is_flag=True, help="Receivers 1 and 3 are sampled 0.42 us late, as the thesis's are.")
@click.option("--position-std", "position_mm", default=2.0, show_default=True, type=click.FloatRange(0.0), help="mm.")
@click.option("--sound-std", "sound_percent", default=1.0, show_default=True, type=click.FloatRange(0.0), help="%.")
@click.option("--mounting-std", "mounting_deg", default=3.0, show_default=True, type=click.FloatRange(0.0), help="deg.")
@click.option("--offset-std", "offset_us", default=0.0, show_default=True, type=click.FloatRange(0.0), help="us.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write the calibration there.")
@report_option
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def command(
    record: Path,
    places: Path | None,
    sound_speed_mps: float,
    arm_m: float,
    fifth: bool,
    receivers: tuple[str, ...],
    thesis_skew: bool,
    position_mm: float,
    sound_percent: float,
    mounting_deg: float,
    offset_us: float,
    json_file: Path | None,
    report_file: Path | None,
    force: bool,
) -> None:
    """Receivers' resonances, positions, sound speed and mounting from the pulses in RECORD.

    With --places the source's place is known for every record; without, the array is calibrated by what its own delays
    have in common, which never tells its mounting and hardly its size. What the data cannot tell is said and keeps its
    prior. A standard deviation of 0 holds a group as it is.
    """
    for output in (json_file, report_file):
        if output is not None and output.exists() and not force:
            raise ConfigError(f"{output} exists; give another name, or --force to replace it")
    array = make_array(fifth, arm_m, receivers, thesis_skew)
    priors = GeometryPriors(
        1e-3 * position_mm, 0.01 * sound_percent, (math.radians(mounting_deg),) * 3, 1e-6 * offset_us
    )
    known = None if places is None else read_places(places)
    records = read_acoustic_records(record)
    calibration = calibrate_array(records, array, sound_speed_mps, known, priors)
    for note in calibration.notes:
        click.echo(note)
    resonances = calibration.responses.responses.resonance_hz
    click.echo("Resonances: " + ", ".join(f"{each / 1e3:.3f} kHz" for each in resonances))
    click.echo(in_words(calibration.geometry))
    click.echo(f"Sound speed {calibration.geometry.sound_speed_mps:.2f} m/s")
    if json_file is not None:
        with in_whole(json_file) as unfinished:
            unfinished.write_text(json.dumps(calibration_json(calibration), indent=1) + "\n", encoding="utf-8")

    def report() -> str:
        from bluerov_slam.survey.acoustic_calibrate_report import calibration_report

        return calibration_report(record.name, records, array, calibration)

    write_report(report_file, report)


def read_places(path: Path) -> NDArray[np.float64]:
    """Rows of three numbers; a first row of words is a heading. Raises RecordingError."""
    try:
        rows = [row for row in csv.reader(path.read_text(encoding="utf-8").splitlines()) if row]
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"cannot read {path}: {error}") from error
    places = []
    for number, row in enumerate(rows):
        try:
            values = [float(part) for part in row]
        except ValueError:
            if number == 0:
                continue
            raise RecordingError(f"{path}, row {number + 1}: '{','.join(row)}' is not three numbers") from None
        if len(values) != 3 or not np.isfinite(values).all():
            raise RecordingError(f"{path}, row {number + 1}: '{','.join(row)}' is not three numbers")
        places.append(values)
    if not places:
        raise RecordingError(f"{path} holds no place")
    return np.array(places)
