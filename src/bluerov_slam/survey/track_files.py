"""The track as other programs read it: GeoJSON for maps, GPX for chart plotters, CSV for everything else."""

from __future__ import annotations

import csv
import datetime
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import orjson

from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.records import NavMode
from bluerov_slam.survey.navigation_run import Fix
from bluerov_slam.survey.navigation_track import MODES, NavTrack

MAP_PERIOD_S = 1.0
ELLIPSE_PERIOD_S = 30.0
_ELLIPSE_POINTS = 36
# A pause of the track longer than this is no line on a map.
_GAP_S = 10.0
_GPX = "http://www.topografix.com/GPX/1/1"
_OWN = "https://bluerov-slam.invalid/gpx/1"

_CSV_COLUMNS = (
    "utc", "time_s", "mode", "latitude_deg", "longitude_deg", "depth_m", "depth_std_m",
    "error_95_major_m", "error_95_minor_m", "error_95_bearing_deg",
    "north_mps", "east_mps", "down_mps", "speed_std_mps", "roll_deg", "pitch_deg", "heading_deg", "heading_std_deg",
    "altitude_m", "current_north_mps", "current_east_mps", "current_std_mps", "since_fix_s", "distance_m",
    "reset_counter",
)  # fmt: skip


def utc_text(unix_s: float) -> str:
    """ISO 8601 with milliseconds."""
    moment = datetime.datetime.fromtimestamp(unix_s, datetime.UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def write_csv(path: Path, track: NavTrack, start_s: float, utc_offset_s: float | None) -> None:
    """Every row of the track; unknown is empty."""
    at_s = track["at_s"]
    degrees = {
        name: np.degrees(track[f"{name}_rad"]) for name in ("bearing", "roll", "pitch", "heading", "heading_std")
    }
    since_fix = at_s - track["last_fix_s"]
    columns: list[tuple[Any, int]] = [
        (track["latitude_deg"], 8), (track["longitude_deg"], 8), (track["depth_m"], 3), (track["depth_std_m"], 3),
        (track["major_95_m"], 3), (track["minor_95_m"], 3), (degrees["bearing"], 1),
        (track["north_mps"], 4), (track["east_mps"], 4), (track["down_mps"], 4), (track["speed_std_mps"], 4),
        (degrees["roll"], 2), (degrees["pitch"], 2), (degrees["heading"], 2), (degrees["heading_std"], 2),
        (track["altitude_m"], 2), (track["current_north_mps"], 4), (track["current_east_mps"], 4),
        (track["current_std_mps"], 4), (since_fix, 2), (track["distance_m"], 2),
    ]  # fmt: skip
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(_CSV_COLUMNS)
        for row in range(len(track)):
            utc = "" if utc_offset_s is None else utc_text(float(at_s[row]) + utc_offset_s)
            cells = [_cell(float(values[row]), digits) for values, digits in columns]
            head = (utc, _cell(float(at_s[row]) - start_s, 3), track.mode_at(row).value)
            writer.writerow((*head, *cells, int(track["reset_counter"][row])))


def write_water_csv(path: Path, nodes: list[dict[str, Any]]) -> None:
    """The water column, a row for each node of `water_json`."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(nodes[0]))
        writer.writeheader()
        writer.writerows(nodes)


def write_geojson(path: Path, track: NavTrack, fixes: list[Fix], start_s: float, utc_offset_s: float | None) -> None:
    """A line for each stretch of one mode, the 95 % ellipse every half minute, the fixes."""
    features = [*_lines(track, start_s, utc_offset_s), *_ellipses(track, start_s), *_fix_points(fixes, start_s)]
    collection = {"type": "FeatureCollection", "features": features}
    path.write_bytes(orjson.dumps(collection, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE))


def write_gpx(path: Path, track: NavTrack, name: str, description: str, utc_offset_s: float | None) -> None:
    """One track, a segment for each unbroken stretch. Elevation is minus depth; the 95 % error is an extension."""
    ElementTree.register_namespace("", _GPX)
    ElementTree.register_namespace("slam", _OWN)
    root = ElementTree.Element(f"{{{_GPX}}}gpx", {"version": "1.1", "creator": "BlueROV SLAM"})
    element = ElementTree.SubElement(root, f"{{{_GPX}}}trk")
    ElementTree.SubElement(element, f"{{{_GPX}}}name").text = name
    ElementTree.SubElement(element, f"{{{_GPX}}}desc").text = description
    for stretch in _stretches(track, by_mode=False):
        segment = ElementTree.SubElement(element, f"{{{_GPX}}}trkseg")
        for row in stretch:
            position = {"lat": f"{track['latitude_deg'][row]:.8f}", "lon": f"{track['longitude_deg'][row]:.8f}"}
            point = ElementTree.SubElement(segment, f"{{{_GPX}}}trkpt", position)
            if math.isfinite(depth_m := float(track["depth_m"][row])):
                ElementTree.SubElement(point, f"{{{_GPX}}}ele").text = f"{-depth_m:.2f}"
            if utc_offset_s is not None:
                time = utc_text(float(track["at_s"][row]) + utc_offset_s)
                ElementTree.SubElement(point, f"{{{_GPX}}}time").text = time
            extensions = ElementTree.SubElement(point, f"{{{_GPX}}}extensions")
            error = ElementTree.SubElement(extensions, f"{{{_OWN}}}error_95_m")
            error.text = f"{track['major_95_m'][row]:.2f}"
    tree = ElementTree.ElementTree(root)
    ElementTree.indent(tree)
    tree.write(path, encoding="utf-8", xml_declaration=True)


def _stretches(track: NavTrack, by_mode: bool) -> Iterator[list[int]]:
    """Rows with a position, a second apart, cut at pauses and, where wanted, at changes of the mode."""
    stretch: list[int] = []
    for row in np.flatnonzero(track.has_position):
        at_s = track["at_s"][row]
        if stretch:
            before = stretch[-1]
            passed_s = at_s - track["at_s"][before]
            new_mode = track["mode"][row] != track["mode"][before]
            if passed_s > _GAP_S:
                yield stretch
                stretch = []
            elif by_mode and new_mode:
                # The line goes on to where the next one begins.
                yield [*stretch, int(row)]
                stretch = []
            elif passed_s < MAP_PERIOD_S - 1e-3:
                continue
        stretch.append(int(row))
    if stretch:
        yield stretch


def _lines(track: NavTrack, start_s: float, utc_offset_s: float | None) -> Iterator[dict[str, Any]]:
    for stretch in _stretches(track, by_mode=True):
        if len(stretch) < 2:
            continue
        at_s = track["at_s"][stretch]
        mode = MODES[int(track["mode"][stretch[0]])]
        properties: dict[str, Any] = {
            "kind": "track",
            "mode": mode.value,
            "color": "#1a7f37" if mode is NavMode.AIDED else "#bc4c00",
            "from_s": round(float(at_s[0]) - start_s, 2),
            "to_s": round(float(at_s[-1]) - start_s, 2),
            "largest_error_95_m": _json(np.max(track["major_95_m"][stretch]), 2),
            "depth_m": [_json(value, 2) for value in track["depth_m"][stretch]],
            "error_95_m": [_json(value, 2) for value in track["major_95_m"][stretch]],
        }
        if utc_offset_s is not None:
            properties["coordTimes"] = [utc_text(float(value) + utc_offset_s) for value in at_s]
        positions = zip(track["longitude_deg"][stretch], track["latitude_deg"][stretch], strict=True)
        coordinates = [[round(float(lon), 8), round(float(lat), 8)] for lon, lat in positions]
        yield _feature("LineString", coordinates, properties)


def _ellipses(track: NavTrack, start_s: float) -> Iterator[dict[str, Any]]:
    for row in rows_apart(track, ELLIPSE_PERIOD_S):
        frame = LocalFrame(float(track["latitude_deg"][row]), float(track["longitude_deg"][row]))
        north, east = ellipse_outline(track, row)
        outline = [frame.to_geodetic(n, e) for n, e in zip(north.tolist(), east.tolist(), strict=True)]
        ring = [[round(lon, 8), round(lat, 8)] for lat, lon, _ in outline]
        ring.append(ring[0])
        properties = {
            "kind": "error_95",
            "at_s": round(float(track["at_s"][row]) - start_s, 2),
            "major_m": _json(track["major_95_m"][row], 2),
            "minor_m": _json(track["minor_95_m"][row], 2),
        }
        yield _feature("Polygon", [ring], properties)


def _fix_points(fixes: list[Fix], start_s: float) -> Iterator[dict[str, Any]]:
    for fix in fixes:
        properties = {
            "kind": "fix",
            "source": fix.source,
            "at_s": round(fix.at_s - start_s, 2),
            "std_m": fix.std_m,
            "accepted": fix.accepted,
        }
        yield _feature("Point", [fix.longitude_deg, fix.latitude_deg], properties)


def rows_apart(track: NavTrack, period_s: float) -> list[int]:
    """Rows with a position and its error, about `period_s` apart."""
    rows: list[int] = []
    for row in np.flatnonzero(track.has_position & np.isfinite(track["major_95_m"])):
        if not rows or track["at_s"][row] - track["at_s"][rows[-1]] >= period_s:
            rows.append(int(row))
    return rows


def ellipse_outline(track: NavTrack, row: int) -> tuple[Any, Any]:
    """Metres north and east of the position: the 95 % ellipse, counter-clockwise as seen from above."""
    angle = np.linspace(0.0, -2.0 * np.pi, _ELLIPSE_POINTS, endpoint=False)
    along, across = track["major_95_m"][row] * np.cos(angle), track["minor_95_m"][row] * np.sin(angle)
    cosine, sine = math.cos(track["bearing_rad"][row]), math.sin(track["bearing_rad"][row])
    return cosine * along - sine * across, sine * along + cosine * across


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else ""


def _json(value: Any, digits: int) -> float | None:
    number = float(value)
    return round(number, digits) if math.isfinite(number) else None
