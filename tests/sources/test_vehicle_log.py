from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.errors import RecordingError
from bluerov_slam.sources.vehicle_log import parse_vehicle_log, read_vehicle_log
from real_data import recording

START_US = 1_700_000_000_000_000


def heartbeat(sequence: int) -> bytes:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.seq = sequence
    return bytes(mavlink.MAVLink_heartbeat_message(12, 3, 81, 0, 4, 3).pack(sender))


def logged(sequence: int) -> bytes:
    return (START_US + sequence * 250_000).to_bytes(8, "big") + heartbeat(sequence)


def test_gives_frames_with_their_times() -> None:
    frames = list(parse_vehicle_log(logged(0) + logged(1)))
    assert [frame.data for frame in frames] == [heartbeat(0), heartbeat(1)]
    assert frames[1].time_unix_s - frames[0].time_unix_s == pytest.approx(0.25)


def test_steps_over_damage_and_a_cut_end() -> None:
    content = logged(0) + b"\xfd\x00rubbish" + logged(1) + logged(2)[:-3]
    assert [frame.data for frame in parse_vehicle_log(content)] == [heartbeat(0), heartbeat(1)]


def test_a_file_without_frames_is_named(tmp_path: Path) -> None:
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(bytes(1000))
    with pytest.raises(RecordingError, match=r"empty\.tlog.*no MAVLink frame"):
        read_vehicle_log(empty)
    with pytest.raises(RecordingError, match="No such file"):
        read_vehicle_log(tmp_path / "absent.tlog")


@pytest.mark.data
def test_reads_a_real_ardusub_log() -> None:
    path = recording("bluerov2_ardusub_logs", "surface_ugps_2023-05-04.tlog")
    frames = read_vehicle_log(path)
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True  # the camera manager of that vehicle used another dialect
    names = [message.get_type() for frame in frames[:5000] for message in parser.parse_buffer(frame.data) or []]
    assert len(names) == 5000
    assert {"ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT"} <= set(names)
    times = [frame.time_unix_s for frame in frames]
    assert sorted(times) == times
