from pathlib import Path

import orjson
import pytest
from click.testing import CliRunner

from bluerov_slam.cli.main import cli
from bluerov_slam.config import InvalidSettingsError
from bluerov_slam.errors import RecordingError
from bluerov_slam.sources.recording_reader import open_recording
from log_samples import TelemetryLog
from recording_samples import FakeClocks, feed, recorder


@pytest.fixture
def log(tmp_path: Path) -> Path:
    made = TelemetryLog()
    for step in range(100):
        made.attitude(step * 0.1)
        made.gps_input(step * 0.1, 48.1 + step * 1e-6, -4.5)
    path = tmp_path / "dive.tlog"
    path.write_bytes(made.content)
    return path


def run(*arguments: object) -> str:
    result = CliRunner().invoke(cli, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_a_log_is_imported_beside_itself_and_navigated_beside_that(log):
    output = run("import", log)
    assert "100  positions (GPS_INPUT)" in output
    (session,) = log.parent.glob("session_*")
    assert "report.html" in run("navigate", session)
    products = log.parent / f"{session.name}_navigation"
    assert (products / "track.gpx").exists()
    with pytest.raises(RecordingError, match="exists already"):
        run("navigate", session)


def test_several_logs_become_several_sessions(log, tmp_path):
    second = tmp_path / "second.tlog"
    second.write_bytes(log.read_bytes())
    run("import", log, second, "--out", tmp_path / "dives")
    assert len(list((tmp_path / "dives").glob("session_*"))) == 2


def test_the_settings_of_the_recording_hold_unless_a_flag_says_otherwise(log, tmp_path):
    run("import", log, "--out", tmp_path / "dives")
    (session,) = (tmp_path / "dives").glob("session_*")
    run("navigate", session, "--out", tmp_path / "out", "--set", "navigation.origin=48.2, -4.6")
    summary = orjson.loads((tmp_path / "out" / "summary.json").read_bytes())
    assert summary["origin"] == {"latitude_deg": 48.2, "longitude_deg": -4.6}
    with pytest.raises(InvalidSettingsError, match=r"navigation\.orgin"):
        run("navigate", session, "--out", tmp_path / "other", "--set", "navigation.orgin=1")


def test_a_recording_keeps_the_navigators_settings(tmp_path):
    clock = FakeClocks()
    settings = {"navigation.origin": "48.2, -4.6", "navigation.of_another_version": 1}
    target = recorder(tmp_path, clock, navigation_settings=lambda: settings)
    feed(target, clock, 0.2)
    target.finish()
    assert open_recording(next(tmp_path.glob("session_*"))).navigation_settings == settings


def test_only_the_calibrations_of_a_saved_state_are_taken(log, tmp_path):
    run("import", log, "--out", tmp_path / "dives")
    (session,) = (tmp_path / "dives").glob("session_*")
    state = tmp_path / "navigation.json"
    saved = {"at_s": 5.0, "version": 1, "origin_deg": [10.0, 20.0], "position_known": True, "calibration": {}}
    state.write_bytes(orjson.dumps({"version": 1, "boot_id": None, "navigation": saved}))
    run("navigate", session, "--out", tmp_path / "out", "--state", state)
    summary = orjson.loads((tmp_path / "out" / "summary.json").read_bytes())
    assert summary["origin"]["latitude_deg"] == pytest.approx(48.1, abs=1e-3)
    state.write_text("{}")
    with pytest.raises(RecordingError, match="not the saved state"):
        run("navigate", session, "--out", tmp_path / "third", "--state", state)
    with pytest.raises(RecordingError, match="No such file"):
        run("navigate", session, "--out", tmp_path / "third", "--state", tmp_path / "absent.json")
