import asyncio
import csv
from pathlib import Path

import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.records import Event
from bluerov_slam.services.conversion import convert
from bluerov_slam.services.log_import import import_log
from bluerov_slam.sources.log_import import read_log
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.sources.replay import ReplaySource, decode
from log_samples import START_UNIX_S, DataflashLog, TelemetryLog
from real_data import recording

LOGS = (
    ("bluerov2_ardusub_logs", "surface_ugps_2023-05-04.tlog"),
    ("bluerov2_ardusub_logs", "static_ekf3.BIN"),
    ("bluerov2_ugps_dive", "qgc_2022-08-15_09-56-00.csv"),
    ("bluerov2_ugps_dive", "2024-12-05_22-12-34_g2_acoustic.csv"),
)


def plain(record: object) -> object:
    """NaN is not equal to itself."""
    return repr(record)


@pytest.fixture
def telemetry(tmp_path: Path) -> Path:
    log = TelemetryLog()
    log.heartbeat(0.0)
    for step in range(100):
        log.attitude(step * 0.1)
        log.pressure(step * 0.1, 1013.0 + step)
        log.gps_input(step * 0.1, 48.1 + step * 1e-6, -4.5)
    path = tmp_path / "dive.tlog"
    path.write_bytes(log.content)
    return path


def test_an_imported_log_is_a_session_that_gives_the_same_records(telemetry, tmp_path):
    result = import_log(telemetry, tmp_path / "sessions")
    assert result.folder.name == "session_20231114_221320"
    recorded = open_recording(result.folder)
    assert recorded.imported_from == "dive.tlog"
    assert recorded.utc_offset_s == pytest.approx(START_UNIX_S)
    assert recorded.session["closed"]
    assert recorded.session["title"] == "dive.tlog"
    assert recorded.session["duration_s"] == pytest.approx(9.9)
    assert [plain(r) for r in decode(recorded)] == [plain(r) for r in read_log(telemetry).records]
    assert not recorded.problems
    assert any("100  positions (GPS_INPUT)" in line for line in result.lines)


def test_a_log_without_a_date_has_none_in_its_session(tmp_path):
    log = DataflashLog()
    log.add("ATT", 1.0, 0.0, 1.0, 0.0, -2.0, 0.0, 270.0, 0.0, 0.0)
    path = tmp_path / "1.BIN"
    path.write_bytes(log.content)
    recorded = open_recording(import_log(path, tmp_path).folder)
    assert recorded.utc_offset_s is None


def test_an_imported_session_converts_to_tables(telemetry, tmp_path):
    folder = import_log(telemetry, tmp_path / "sessions").folder
    (said,) = convert(folder, "csv", tmp_path / "tables")
    assert "positions.csv with 100 rows" in said
    rows = list(csv.DictReader((tmp_path / "tables" / "positions.csv").open()))
    assert rows[1]["source"] == "gps_input"
    assert float(rows[1]["latitude_deg"]) == pytest.approx(48.100001)
    assert rows[1]["east_variance_m2"] == ""
    assert rows[1]["utc"].startswith("2023-11-14T22:13:20.1")
    with pytest.raises(RecordingError, match="holds no sonar data"):
        convert(folder, "xtf", tmp_path / "dive.xtf")


async def test_an_imported_session_replays(telemetry, tmp_path):
    recorded = open_recording(import_log(telemetry, tmp_path / "sessions").folder)
    source, told = ReplaySource(recorded, None), []
    source.on_vehicle = told.append
    source.start(lambda _data, _at_s: None, lambda: None)
    await asyncio.wait_for(source.finished.wait(), 60)
    await source.stop()
    assert [plain(record) for record in told] == [plain(record) for record in read_log(telemetry).records]


def test_a_place_that_cannot_be_written_is_named_with_its_cure(telemetry):
    with pytest.raises(RecordingError, match=r"give another folder with --out"):
        import_log(telemetry, Path("/proc/nowhere"))


@pytest.mark.data
@pytest.mark.parametrize("parts", LOGS, ids=lambda parts: parts[-1])
def test_real_logs_come_back_as_they_were_read(parts, tmp_path):
    path = recording(*parts)
    result = import_log(path, tmp_path)
    expected = [r for r in read_log(path).records if not isinstance(r, Event)]
    assert [plain(r) for r in decode(open_recording(result.folder))] == [plain(r) for r in expected]
