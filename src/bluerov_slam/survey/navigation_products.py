"""`bluerov-slam navigate`: a recording in, a folder with its track in every form and a report out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import orjson

from bluerov_slam.errors import RecordingError
from bluerov_slam.pipeline.navigator import NavigatorOptions, SavedNavigation
from bluerov_slam.records import NavState, PositionFix
from bluerov_slam.sinks.mcap_log import McapLog
from bluerov_slam.sinks.whole_output import in_whole
from bluerov_slam.sources.recording_reader import UNKNOWN_CLOCK, Recording, open_recording
from bluerov_slam.survey.navigation_report import duration_words, in_short, report_html
from bluerov_slam.survey.navigation_run import NavigationRun, run_navigation
from bluerov_slam.survey.navigation_summary import summarize
from bluerov_slam.survey.track_files import write_csv, write_geojson, write_gpx, write_water_csv

# States between two flushes of the MCAP file.
_CHUNK_STATES = 500


def navigate(
    source: Path,
    out: Path | None = None,
    *,
    smooth: bool = True,
    baud: int = 115200,
    options: Callable[[Recording], NavigatorOptions] = lambda _recording: NavigatorOptions(),
    state_file: Path | None = None,
    force: bool = False,
) -> list[str]:
    """Write the products of `source` into `out`; what to tell the user. Raises RecordingError naming the cure.

    `options` is asked for the navigator's settings once the recording is open. `state_file` is a navigator's saved
    state, of which the calibrations are taken.
    """
    recording = open_recording(source)
    out = out or _default_folder(source)
    if out.exists() and not force:
        raise RecordingError(f"{out} exists already: choose another name with --out, or add --force to replace it")
    if out.exists() and not _is_ours(out):
        raise RecordingError(f"{out} is no folder of navigation products: choose another name with --out")
    saved = None if state_file is None else _calibration(state_file)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with in_whole(out) as unfinished:
            unfinished.mkdir()
            lines = _make(recording, unfinished, options(recording), smooth, baud, saved)
    except OSError as error:
        raise RecordingError(
            f"cannot write {out}: {error.strerror or error}; choose another place with --out"
        ) from error
    return [f"{out}:", *lines]


def _make(
    recording: Recording,
    folder: Path,
    options: NavigatorOptions,
    smooth: bool,
    baud: int,
    saved: SavedNavigation | None,
) -> list[str]:
    states = _StateFile(folder / "navigation.mcap", recording)
    try:
        run = run_navigation(recording, options=options, saved=saved, smooth=smooth, baud=baud, keep=states.write)
    finally:
        states.close()
    if not run.states:
        raise RecordingError(
            f"{recording.path} holds nothing to navigate by: no attitude, of the IMU or of the autopilot "
            f"(it holds {_records_words(run) or 'nothing at all'})"
        )
    summary = summarize(run, recording, options)
    plots = _plots(run)
    files = ["report.html", "summary.json", "track.csv", "navigation.mcap"]
    write_csv(folder / "track.csv", run.track, run.start_s, recording.utc_offset_s)
    if run.track.has_position.any():
        write_geojson(folder / "track.geojson", run.track, run.fixes, run.start_s, recording.utc_offset_s)
        description = " ".join([*(["Simulated."] if summary["simulated"] else []), *in_short(summary)])
        write_gpx(folder / "track.gpx", run.track, recording.path.name, description, recording.utc_offset_s)
        files += ["track.geojson", "track.gpx"]
    if summary["water"] is not None:
        write_water_csv(folder / "water.csv", summary["water"]["nodes"])
        files.append("water.csv")
    summary["files"] = sorted(files)
    (folder / "report.html").write_text(report_html(run, summary, plots, options), encoding="utf-8")
    data = orjson.dumps(summary, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)
    (folder / "summary.json").write_bytes(data)
    return [*_lines(summary), *(f"  problem: {problem}" for problem in run.problems)]


def _lines(summary: dict[str, Any]) -> list[str]:
    seconds = summary["seconds_by_mode"]
    modes = ", ".join(f"{name.replace('_', ' ')} {duration_words(value)}" for name, value in seconds.items() if value)
    lines = [f"  {sentence}" for sentence in in_short(summary)]
    lines.append(f"  {summary['states']} estimates; {modes}")
    if summary["simulated"]:
        lines.append("  simulated: these are no measurements of a vehicle")
    lines.append(f"  wrote {', '.join(summary['files'])}")
    return lines


def _plots(run: NavigationRun) -> dict[str, str] | None:
    """None where matplotlib is not installed: the vehicle does without it."""
    try:
        from bluerov_slam.survey.navigation_plots import draw
    except ImportError:
        return None
    return draw(run)


class _StateFile:
    """The states of the track, as a recording holds them."""

    def __init__(self, path: Path, recording: Recording) -> None:
        offset_ns = recording.wall_offset_ns or 0
        metadata = {
            "wall_offset_ns": str(offset_ns),
            "imported_from": recording.imported_from or recording.path.name,
            "wall_clock": UNKNOWN_CLOCK if recording.wall_offset_ns is None else "recording",
            "simulated": "true" if recording.simulated else "false",
        }
        self._log = McapLog(path, offset_ns, metadata)
        self._count = 0

    def write(self, record: NavState | PositionFix) -> None:
        """Take one."""
        self._log.write_record(record)
        self._count += 1
        if self._count % _CHUNK_STATES == 0:
            self._log.flush()

    def close(self) -> None:
        """Index and footer."""
        self._log.finish()


def _default_folder(source: Path) -> Path:
    path = source.resolve()
    name = path.name if path.is_dir() else path.stem
    return path.parent / f"{name}_navigation"


def _is_ours(folder: Path) -> bool:
    return folder.is_dir() and (not any(folder.iterdir()) or (folder / "summary.json").exists())


def _calibration(path: Path) -> SavedNavigation:
    """The calibrations of a navigator's saved state; its position belongs to another dive."""
    try:
        document = orjson.loads(path.read_bytes())
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}; give the navigator's saved state") from error
    except orjson.JSONDecodeError as error:
        raise RecordingError(f"{path} is not JSON; give the navigator's saved state") from error
    saved = SavedNavigation.from_json(document.get("navigation", document) if isinstance(document, dict) else None)
    if saved is None:
        raise RecordingError(f"{path} is not the saved state of this version's navigator")
    return SavedNavigation(at_s=float("-inf"), calibration=saved.calibration)


def _records_words(run: NavigationRun) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(run.records.items()))
