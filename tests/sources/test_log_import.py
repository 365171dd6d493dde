import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.sources.imported_log import ImportReport, PositionWatch
from bluerov_slam.sources.log_import import read_log
from log_samples import DataflashLog, TelemetryLog
from real_data import recording


@pytest.mark.parametrize("name", ["dive.tlog", "dive.bin", "no_ending"])
def test_the_content_tells_what_a_log_is_not_its_name(tmp_path, name):
    telemetry = TelemetryLog()
    telemetry.heartbeat(0.0)
    telemetry.attitude(0.1)
    path = tmp_path / name
    path.write_bytes(telemetry.content)
    assert read_log(path).kind == "MAVLink telemetry log"
    dataflash = DataflashLog()
    dataflash.add("ATT", 1.0, 0.0, 1.0, 0.0, -2.0, 0.0, 270.0, 0.0, 0.0)
    path.write_bytes(dataflash.content)
    assert read_log(path).kind == "dataflash log of the autopilot"
    path.write_text("Timestamp,roll,pitch,heading\n2022-08-15 09:00:00,1,2,3\n")
    assert read_log(path).kind == "QGroundControl CSV log"


@pytest.mark.parametrize(
    ("name", "content", "cure"),
    [
        ("empty.tlog", b"", "is empty: copy it"),
        ("picture.png", b"\x89PNG\r\n" + bytes(500), "give an ArduSub .tlog or .BIN"),
        ("log.txt", b"FMT, 128, 89, FMT, BBnNZ, Type,Length\n", "download the .BIN instead"),
        ("nmea.txt", b"$GPRMC,120000,A,4800.0,N\n", "only of the boat"),
        ("broken.BIN", b"\x00" * 300, "beginning is damaged"),
        ("link_000.mcap", b"\x89MCAP0\r\n" + bytes(50), "a recording already"),
        ("dive.zip", b"PK\x03\x04" + bytes(50), "a recording already"),
    ],
)
def test_what_is_no_log_is_refused_with_its_cure(tmp_path, name, content, cure):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=cure):
        read_log(path)


def test_missing_files_and_wrong_folders_are_refused_with_their_cure(tmp_path):
    with pytest.raises(RecordingError, match="No such file"):
        read_log(tmp_path / "absent.tlog")
    with pytest.raises(RecordingError, match=r"holds no file \*_g2_acoustic\.csv"):
        read_log(tmp_path)
    (tmp_path / "link_000.mcap").write_bytes(b"x")
    with pytest.raises(RecordingError, match="a recording already"):
        read_log(tmp_path)


def test_a_report_counts_and_says_a_note_once():
    report = ImportReport()
    report.read["attitudes"] += 3
    report.left_out["positions"] += 2
    report.note("frozen")
    report.note("frozen")
    assert [line.split() for line in report.lines()] == [
        ["read", "3", "attitudes"],
        ["left", "out", "2", "positions"],
        ["note:", "frozen"],
    ]


def test_a_position_that_moves_again_is_news():
    watch = PositionWatch()
    assert watch.objection(48.1, -4.5) is None
    assert "repeat" in (watch.objection(48.1, -4.5) or "")
    assert watch.objection(48.2, -4.5) is None
    assert watch.objection(float("nan"), 1.0) == "without numbers"
    assert not watch.is_frozen


@pytest.mark.data
def test_a_real_nmea_log_is_refused_with_its_cure():
    with pytest.raises(RecordingError, match="only of the boat"):
        read_log(recording("bluerov2_ardusub_logs", "ugps_nmea_2023-09-01.txt"))
