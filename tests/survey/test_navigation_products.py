import csv
import json
import math
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.records import NavMode
from bluerov_slam.services.log_import import import_log
from bluerov_slam.sinks.mcap_recovery import scan_mcap
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.survey import navigation_products
from bluerov_slam.survey.navigation_products import navigate
from log_samples import TelemetryLog
from navigated_dive import record_short_dive
from real_data import recording

GPX = "{http://www.topografix.com/GPX/1/1}"


@pytest.fixture(scope="module")
def dive(tmp_path_factory):
    """A simulated dive, recorded and navigated."""
    folder = tmp_path_factory.mktemp("dive")
    session, simulated = record_short_dive(folder)
    out = folder / "out"
    lines = navigate(session, out)
    return session, simulated, out, lines


def table(out: Path) -> list[dict[str, str]]:
    with (out / "track.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def summary(out: Path) -> dict:
    return json.loads((out / "summary.json").read_text())


def test_the_track_is_near_the_truth_and_says_how_near(dive):
    _, simulated, out, _ = dive
    frame = LocalFrame(*simulated.truth.origin_deg)
    within, errors = [], []
    for row in table(out):
        if not row["latitude_deg"]:
            continue
        north_m, east_m, _ = frame.to_ned_m(float(row["latitude_deg"]), float(row["longitude_deg"]))
        truth = simulated.truth.at(float(row["time_s"])).position_ned_m
        error_m = math.hypot(north_m - truth[0], east_m - truth[1])
        errors.append(error_m)
        within.append(error_m <= float(row["error_95_major_m"]))
    assert len(errors) > 500
    assert max(errors) < 15.0
    assert np.mean(within) > 0.9


def test_depth_and_heading_are_those_of_the_truth(dive):
    _, simulated, out, _ = dive
    rows = [row for row in table(out) if row["depth_m"] and row["heading_deg"]][100:]
    assert len(rows) > 400
    for row in rows[::20]:
        truth = simulated.truth.at(float(row["time_s"]))
        assert float(row["depth_m"]) == pytest.approx(truth.position_ned_m[2], abs=0.4)
        turn = math.radians(float(row["heading_deg"])) - truth.heading_rad
        assert abs(math.degrees(math.remainder(turn, math.tau))) < 15.0


def test_every_form_holds_the_same_track(dive):
    session, _, out, lines = dive
    rows = [row for row in table(out) if row["latitude_deg"]]
    last = (float(rows[-1]["latitude_deg"]), float(rows[-1]["longitude_deg"]))
    points = ElementTree.parse(out / "track.gpx").getroot().findall(f".//{GPX}trkpt")
    assert (float(points[-1].get("lat", "")), float(points[-1].get("lon", ""))) == pytest.approx(last, abs=2e-5)
    assert 0.5 < len(points) / float(rows[-1]["time_s"]) < 2.0
    assert points[0].find(f"{GPX}time") is not None
    collection = json.loads((out / "track.geojson").read_text())
    kinds = [feature["properties"]["kind"] for feature in collection["features"]]
    assert {"track", "error_95", "fix"} <= set(kinds)
    tracks = [feature for feature in collection["features"] if feature["properties"]["kind"] == "track"]
    assert {track["properties"]["mode"] for track in tracks} == {"aided", "dead_reckoning"}
    assert tracks[-1]["geometry"]["coordinates"][-1] == pytest.approx([last[1], last[0]], abs=2e-5)
    for track in tracks:
        assert len(track["properties"]["coordTimes"]) == len(track["geometry"]["coordinates"])
    states = list(open_recording(out / "navigation.mcap").navigation())
    assert len(states) == len(table(out))
    lasted_s = float(rows[-1]["time_s"]) - float(table(out)[0]["time_s"])
    assert states[-1].measured_s - states[0].measured_s == pytest.approx(lasted_s, abs=1e-3)
    assert session.name in lines[0] or str(out) in lines[0]


def test_the_water_of_the_dive_is_told(dive):
    _, _, out, _ = dive
    water = summary(out)["water"]
    with (out / "water.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["depth_m"]) for row in rows] == [node["depth_m"] for node in water["nodes"]]
    assert water["shallowest_m"] == 0.0
    assert water["deepest_m"] == pytest.approx(3.0, abs=0.5)
    assert water["nodes"][0]["sound_speed_mps"] == pytest.approx(water["mean_sound_speed_mps"], abs=1.0)
    text, _ = read_report(out)
    assert "By the vehicle's own CTD, from 0.0 m to" in text
    assert "water.csv" in summary(out)["files"]


def test_smoothing_makes_what_came_before_a_fix_no_worse(dive, tmp_path):
    session, simulated, out, _ = dive
    navigate(session, tmp_path / "live", smooth=False)
    assert summary(tmp_path / "live")["smoothed"] is False
    frame = LocalFrame(*simulated.truth.origin_deg)

    def rms(folder: Path) -> float:
        squares = []
        for row in table(folder):
            if row["latitude_deg"] and row["mode"] == "aided":
                place = frame.to_ned_m(float(row["latitude_deg"]), float(row["longitude_deg"]))
                truth = simulated.truth.at(float(row["time_s"])).position_ned_m
                squares.append((place[0] - truth[0]) ** 2 + (place[1] - truth[1]) ** 2)
        return math.sqrt(np.mean(squares))

    assert rms(out) < rms(tmp_path / "live") + 0.1
    both = summary(out)["error_95_m"]
    assert both["smoothed"]["median"] <= both["live"]["median"]


class Outline(HTMLParser):
    """Text and what a page would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.text, self.fetched, self.tags = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "xlink:href") and not str(value).startswith("#"):
                self.fetched.append(value)

    def handle_data(self, data):
        self.text.append(data)


def read_report(out: Path) -> tuple[str, Outline]:
    html = (out / "report.html").read_text()
    outline = Outline()
    outline.feed(html)
    return re.sub(r"\s+", " ", " ".join(outline.text)), outline


def test_the_report_needs_nothing_else_and_says_that_it_is_simulated(dive):
    text, outline = read_report(dive[2])
    assert "Simulated: the sensors of this dive were made by a program" in text
    assert outline.tags.count("svg") == 9
    assert outline.fetched == []
    for words in ("dead reckoned", "95 % probability", "Thruster model", "Every setting of the navigator", "numpy"):
        assert words in text
    assert any("simulated" in line for line in dive[3])


def test_the_summary_counts_what_happened(dive):
    content = summary(dive[2])
    assert content["simulated"] is True
    assert content["duration_s"] == pytest.approx(140.0, abs=1.0)
    modes = content["seconds_by_mode"]
    assert modes["aided"] > 40.0
    assert modes["dead_reckoning"] > 40.0
    assert sum(modes.values()) == pytest.approx(content["duration_s"], abs=3.0)
    assert content["longest_dead_reckoning_s"] <= modes["dead_reckoning"] + 1.0
    gps = next(sensor for sensor in content["sensors"] if sensor["id"] == "gps")
    assert content["fixes"]["gps"]["accepted"] == gps["accepted"] > 20
    assert gps["nis_ratio"] > 0.0
    assert content["files"] == sorted(path.name for path in dive[2].iterdir())


def test_the_same_recording_gives_the_same_track(dive, tmp_path):
    navigate(dive[0], tmp_path / "again")
    assert (tmp_path / "again" / "track.csv").read_bytes() == (dive[2] / "track.csv").read_bytes()


def test_what_exists_is_not_overwritten_without_being_asked(dive, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(dive[2], out)
    before = (out / "summary.json").stat().st_mtime_ns
    with pytest.raises(RecordingError, match="add --force"):
        navigate(dive[0], out)
    assert (out / "summary.json").stat().st_mtime_ns == before
    navigate(dive[0], out, force=True, smooth=False)
    assert summary(out)["smoothed"] is False
    holiday = tmp_path / "holiday"
    holiday.mkdir()
    (holiday / "photo.jpg").write_bytes(b"x")
    with pytest.raises(RecordingError, match="no folder of navigation products"):
        navigate(dive[0], holiday, force=True)
    assert (holiday / "photo.jpg").exists()


def test_a_place_that_cannot_be_written_is_named_with_its_cure(dive):
    with pytest.raises(RecordingError, match=r"choose another place with --out"):
        navigate(dive[0], Path("/proc/nowhere/out"))


def test_a_recording_cut_in_the_middle_is_navigated_as_far_as_it_goes(dive, tmp_path):
    session = tmp_path / dive[0].name
    shutil.copytree(dive[0], session)
    file = session / "link_000.mcap"
    chunks = scan_mcap(file).chunks
    middle = chunks[len(chunks) // 2]
    file.write_bytes(file.read_bytes()[: middle.chunk_start_offset + 10])
    lines = navigate(session, tmp_path / "out", smooth=False)
    assert any("was cut short" in line for line in lines)
    assert "was cut short" in read_report(tmp_path / "out")[0]
    assert 50.0 < summary(tmp_path / "out")["duration_s"] < 90.0


def test_without_matplotlib_everything_but_the_plots_is_made(dive, tmp_path, monkeypatch):
    monkeypatch.setattr(navigation_products, "_plots", lambda _run: None)
    navigate(dive[0], tmp_path / "out", smooth=False)
    text, outline = read_report(tmp_path / "out")
    assert 'pip install "bluerov-slam[survey]"' in text
    assert "svg" not in outline.tags


def imported(log: TelemetryLog, folder: Path) -> Path:
    path = folder / "log.tlog"
    path.write_bytes(log.content)
    return import_log(path, folder).folder


def test_a_dive_without_a_fix_has_attitude_and_depth_but_no_track(tmp_path):
    log = TelemetryLog()
    for step in range(200):
        log.attitude(step * 0.1)
        log.pressure(step * 0.1, 1013.0 + 0.5 * max(0, step - 100) + 0.1 * (step % 3))
    out = tmp_path / "out"
    lines = navigate(imported(log, tmp_path), out)
    assert any("no GPS fix and no position from outside" in line for line in lines)
    assert not (out / "track.gpx").exists()
    assert not (out / "track.geojson").exists()
    content = summary(out)
    assert content["origin"] is None
    assert content["end"] is None
    assert content["depth_m"]["greatest"] == pytest.approx(0.5, abs=0.15)
    text, outline = read_report(out)
    assert "There is no track" in text
    assert outline.tags.count("svg") >= 3
    assert {row["mode"] for row in table(out)} == {NavMode.ATTITUDE.value}


def test_only_attitudes_make_a_report(tmp_path):
    log = TelemetryLog()
    for step in range(50):
        log.attitude(step * 0.1)
    navigate(imported(log, tmp_path), tmp_path / "out")
    content = summary(tmp_path / "out")
    assert content["depth_m"] == {"least": None, "greatest": None}
    assert "unknown" in read_report(tmp_path / "out")[0]


def test_a_recording_without_an_attitude_is_refused_with_what_it_holds(tmp_path):
    log = TelemetryLog()
    log.heartbeat(0.0)
    log.pressure(0.1, 1013.0)
    session = imported(log, tmp_path)
    with pytest.raises(RecordingError, match=r"no attitude.*1 VehicleDepth"):
        navigate(session, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.glob("out*"))


@pytest.mark.data
@pytest.mark.parametrize(
    ("parts", "positions"),
    [
        pytest.param(("bluerov2_ardusub_logs", "bench_2023-04-18_11-03-34.tlog"), 0, marks=pytest.mark.long),
        (("bluerov2_ardusub_logs", "surface_ugps_2023-05-04.tlog"), 1),
        (("bluerov2_ardusub_logs", "static_ekf3.BIN"), 0),
        (("bluerov2_ugps_dive", "qgc_2022-08-15_09-56-00.csv"), 1536),
        (("bluerov2_ugps_dive", "2024-12-05_22-12-34_g2_acoustic.csv"), 1723),
        pytest.param(("bluerov2_ugps_dive", "qgc_2022-08-15_11-57-51.csv"), 1627, marks=pytest.mark.long),
    ],
    ids=lambda value: value[-1] if isinstance(value, tuple) else "",
)
def test_real_dives_are_navigated(parts, positions, tmp_path):
    session = import_log(recording(*parts), tmp_path).folder
    out = tmp_path / "out"
    navigate(session, out)
    content = summary(out)
    assert content["simulated"] is False
    assert sum(sum(count.values()) for count in content["fixes"].values()) == positions
    assert content["states"] > 200
    headings = [float(row["heading_deg"]) for row in table(out) if row["heading_deg"]]
    # Acoustic positions alone tell no heading, and none is made up.
    assert bool(headings) is not parts[-1].endswith("_acoustic.csv")
    assert all(0.0 <= heading < 360.0 for heading in headings)
    if positions > 1:
        assert content["seconds_by_mode"]["aided"] > 0.8 * content["duration_s"]
        # Every fix of these dives lies within 130 m of the first; a track that leaves them has run away.
        frame = LocalFrame(content["origin"]["latitude_deg"], content["origin"]["longitude_deg"])
        places = [
            frame.to_ned_m(float(row["latitude_deg"]), float(row["longitude_deg"]))
            for row in table(out)
            if row["latitude_deg"] and row["mode"] == "aided"
        ]
        assert max(math.hypot(place[0], place[1]) for place in places) < 150.0
