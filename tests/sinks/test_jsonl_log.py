import errno
import json
import os

import pytest

from bluerov_slam.records import PositionFix
from bluerov_slam.sinks import append_file
from bluerov_slam.sinks.jsonl_log import JsonlLog, SensorLines
from recording_samples import WALL_AT_START_NS, FakeClocks, ctd_sample, feed, nav_state, recorder, sensor_sample


def test_a_line_waits_for_the_water_computed_from_its_sample():
    lines = SensorLines(0)
    assert lines.feed(sensor_sample(1.0)) == []
    (line,) = lines.feed(ctd_sample(1.0))
    assert json.loads(line)["ctd"]["s"] == 35.2
    assert lines.flush() == []


def test_a_sample_without_its_water_is_written_all_the_same():
    lines = SensorLines(0)
    lines.feed(sensor_sample(1.0))
    (line,) = lines.feed(sensor_sample(1.5))
    assert json.loads(line)["t_mono"] == 1.0
    assert lines.feed(ctd_sample(9.9)) == []
    (last,) = lines.flush()
    assert json.loads(last)["t_mono"] == 1.5
    assert json.loads(last)["ctd"]["s"] is None


def test_a_line_is_one_line_with_the_wall_time_of_the_session():
    lines = SensorLines(1_700_000_000_000_000_000)
    lines.feed(sensor_sample(2.0))
    (line,) = lines.flush()
    assert line.count(b"\n") == 1
    assert line.endswith(b"\n")
    assert json.loads(line)["t_unix"] == pytest.approx(1_700_000_002.0)


def test_an_unknown_wall_clock_is_null():
    lines = SensorLines(None)
    lines.feed(sensor_sample(2.0))
    assert json.loads(lines.flush()[0])["t_unix"] is None


def test_lines_the_disk_refuses_are_kept_whole_until_it_takes_them(tmp_path, monkeypatch):
    log = JsonlLog(tmp_path / "log.jsonl")
    log.write([b'{"n": 1}\n'])
    log.flush()

    def half(descriptor: int, data: memoryview) -> int:
        real(descriptor, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    real = os.write
    monkeypatch.setattr(append_file.os, "write", half)
    log.write([b'{"n": 2}\n'])
    with pytest.raises(OSError, match="No space"):
        log.flush()
    assert (tmp_path / "log.jsonl").read_bytes() == b'{"n": 1}\n', "never half a line"
    monkeypatch.setattr(append_file.os, "write", real)
    log.write([b'{"n": 3}\n'])
    log.close()
    assert (tmp_path / "log.jsonl").read_bytes() == b'{"n": 1}\n{"n": 2}\n{"n": 3}\n'


def test_an_existing_log_is_never_written_over(tmp_path):
    path = tmp_path / "log.jsonl"
    path.write_bytes(b"old\n")
    with pytest.raises(FileExistsError):
        JsonlLog(path)
    assert path.read_bytes() == b"old\n"


def test_estimates_and_positions_have_lines_of_their_own(tmp_path):
    clock = FakeClocks()
    target = recorder(tmp_path, clock, simulated=True)
    feed(target, clock, 0.1)
    fix = PositionFix(clock.now_s, clock.now_s, "acoustics", 48.1, -4.5, (1.0, 0.0, 4.0), 3.0)
    target.observe(fix)
    for step in range(40):
        target.observe(nav_state(clock.now_s + step * 0.05))
    target.finish()
    lines = [json.loads(line) for line in next(tmp_path.glob("session_*/*.jsonl")).read_bytes().splitlines()]
    typed = [line for line in lines if "type" in line]
    assert typed[0] == {
        "type": "position_fix", "source": "acoustics", "latitude_deg": 48.1, "longitude_deg": -4.5,
        "covariance_ne_m2": [1.0, 0.0, 4.0], "depth_m": 3.0, "t_mono": clock.now_s,
        "t_unix": pytest.approx(clock.now_s + WALL_AT_START_NS * 1e-9),
    }  # fmt: skip
    states = typed[1:]
    assert {line["type"] for line in states} == {"navigation"}
    assert [round(line["t_mono"] - clock.now_s, 2) for line in states] == [0.0, 1.0]
    north_m = states[0]["position"]["north_m"]
    assert states[0]["position"]["latitude_deg"] == pytest.approx(48.1 + north_m / 111_200.0, abs=1e-6)
    assert states[0]["simulated"] is True
    assert len(lines) - len(typed) == 1
