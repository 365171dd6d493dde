"""`bluerov-slam isbl solve`: records of an array from a file, solved."""

from __future__ import annotations

import json
from pathlib import Path

import click
import numpy as np

from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.time_differences.estimate import METHODS, Method
from bluerov_slam.cli.evaluation_options import report_option, write_report
from bluerov_slam.errors import ArrayGeometryError, ConfigError, RecordingError
from bluerov_slam.sinks.whole_output import in_whole
from bluerov_slam.sources.acoustic_records import read_acoustic_records
from bluerov_slam.survey.acoustic_solve import (
    AXES,
    SolvedRecord,
    SolveOptions,
    remarks_of,
    solve_record,
    solved_json,
)

DEFAULT_STD_M = 0.05


class ValueWithStd(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """VALUE or VALUE,STD in metres."""

    name = "M[,STD]"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        parts = str(value).split(",")
        try:
            numbers = [float(part) for part in parts]
        except ValueError:
            numbers = []
        if len(numbers) not in (1, 2) or not np.isfinite(numbers).all() or (len(numbers) == 2 and numbers[1] <= 0.0):
            self.fail(f"{value!r}: expected metres, or metres and their standard deviation above 0", param, ctx)
        return numbers[0], numbers[1] if len(numbers) == 2 else DEFAULT_STD_M


def make_array(fifth: bool, arm_m: float, places: tuple[str, ...], thesis_skew: bool) -> ReceiverArray:
    """The array of the options. Raises ConfigError."""
    try:
        if places:
            rows = [[float(part) for part in place.split(",")] for place in places]
            return ReceiverArray(np.array(rows), name="given places")
        skew = [THESIS_RANK_SKEW_S if receiver in (1, 3) else 0.0 for receiver in range(4 + fifth)]
        return ReceiverArray.cross(arm_m, fifth, skew if thesis_skew else ())
    except (ValueError, ArrayGeometryError) as error:
        raise ConfigError(f"--receiver: {error}") from error


@click.command("solve")
@click.argument("record", type=click.Path(path_type=Path))
@click.option(
    "--sound-speed", "sound_speed_mps", default=1500.0, show_default=True, type=click.FloatRange(300.0, 1700.0)
)
@click.option("--arm", "arm_m", default=0.25, show_default=True, type=click.FloatRange(0.01, 10.0), help="Of the X, m.")
@click.option("--fifth", is_flag=True, help="A fifth receiver in the middle of the X.")
@click.option("--receiver", "places", multiple=True, help="FORWARD,RIGHT,DOWN in m of one receiver; repeat for all.")
@click.option("--thesis-skew", is_flag=True, help="Receivers 1 and 3 are sampled 0.42 us late, as the thesis's are.")
@click.option("--depth", type=ValueWithStd(), help="How far the source lies below the array, m, and how sure that is.")
@click.option(
    "--axis", type=click.Choice(tuple(AXES)), default="down", show_default=True, help="What --depth is along."
)
@click.option("--range", "range_", type=ValueWithStd(), help="Range of the source, m, from a synchronised clock.")
@click.option(
    "--method", type=click.Choice([each for each in METHODS if each != "matched"]), default="joint", show_default=True
)
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write every number there.")
@report_option
@click.option("--force", is_flag=True, help="Replace files that exist.")
def command(
    record: Path,
    sound_speed_mps: float,
    arm_m: float,
    fifth: bool,
    places: tuple[str, ...],
    thesis_skew: bool,
    depth: tuple[float, float] | None,
    axis: str,
    range_: tuple[float, float] | None,
    method: Method,
    json_file: Path | None,
    report_file: Path | None,
    force: bool,
) -> None:
    """Delays, direction and, with --depth or --range, the position of the source in RECORD.

    RECORD is a WAV file with a channel for each receiver, an NPZ file, or a recorded dive. All is in the array's frame:
    forward along its normal, right, down.
    """
    array = make_array(fifth, arm_m, places, thesis_skew)
    for output in (json_file, report_file):
        if output is not None and output.exists() and not force:
            raise ConfigError(f"{output} exists; give another name, or --force to replace it")
    options = SolveOptions(array, sound_speed_mps, method, depth, axis, range_)
    solved = [solve_record(each, options) for each in read_acoustic_records(record)]
    for number, each in enumerate(solved):
        click.echo(_line(number, each))
    try:
        if json_file is not None:
            _write_json(json_file, record, solved, options)
    except OSError as error:
        raise RecordingError(f"cannot write {error.filename}: {error.strerror}") from error

    def report() -> str:
        try:
            from bluerov_slam.survey.acoustic_solve_report import solve_report
        except ImportError as error:
            raise ConfigError("--report needs matplotlib: install the extra 'survey'") from error
        return solve_report(record.name, solved, options)

    write_report(report_file, report)


def _line(number: int, solved: SolvedRecord) -> str:
    content = solved_json(solved)
    parts = [f"record {content['record_id'] or number}:"]
    if content["direction"] is not None:
        direction = content["direction"]
        parts.append(
            f"azimuth {direction['azimuth_deg']:.2f} deg, elevation {direction['elevation_deg']:.2f} deg "
            f"(1 sigma {direction['std_deg']:.3f} deg)"
        )
    if content["position"] is not None:
        forward, right, down = content["position"]["forward_right_down_m"]
        parts.append(f"at {forward:.3f}, {right:.3f}, {down:.3f} m (range {content['position']['range_m']:.3f} m)")
    if content["message"] is not None and content["message"]["bytes"] is not None:
        parts.append(f"message {content['message']['bytes']}")
    if solved.differences is not None:
        parts += remarks_of(solved.differences)
    if solved.reason:
        parts.append(solved.reason)
    return " ".join([parts[0], "; ".join(parts[1:])])


def _write_json(path: Path, record: Path, solved: list[SolvedRecord], options: SolveOptions) -> None:
    content = {
        "file": record.name,
        "array": {"name": options.array.name, "positions_m": options.array.positions_m.tolist()},
        "sound_speed_mps": options.sound_speed_mps,
        "method": options.method,
        "records": [solved_json(each) for each in solved],
    }
    with in_whole(path) as unfinished:
        unfinished.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
