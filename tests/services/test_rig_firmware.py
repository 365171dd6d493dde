"""The native rig firmware through its link: its angles, and what is said of a build that is none."""

import json
import os
import shutil

import numpy as np
import pytest

from bluerov_slam.errors import LinkError
from bluerov_slam.rig.dimensions import FO_SHIP_PLATFORM
from bluerov_slam.rig.platform import servo_angles_rad
from bluerov_slam.services.rig_firmware import firmware_angles_rad, instruction_counts, running
from firmware_build import built

POINTS = np.zeros((4, 4, 6))
POINTS[1, :, 2] = 7.0
POINTS[2, 0] = [3.0, -2.0, 5.0, 0.1, -0.1, 0.05]
POINTS[3, 1, 5] = 0.5  # beyond the axis limit


def test_the_angles_are_those_of_python_and_what_is_refused_is_unknown():
    angles = firmware_angles_rad(POINTS, built("brov-rig").parent)
    np.testing.assert_allclose(angles[:3], servo_angles_rad(POINTS[:3], FO_SHIP_PLATFORM), atol=np.radians(0.01))
    assert np.isnan(angles[3]).all()


def test_the_program_ends_with_its_use(monkeypatch):
    ended = []
    monkeypatch.setattr("bluerov_slam.services.rig_firmware._end", lambda process: ended.append(process))
    with running(built("brov-rig")) as rig:
        assert rig.where().presses == 1
    (process,) = ended
    assert process.poll() is None
    process.terminate()
    assert process.wait(10.0) == 0


def build_in(folder, program):
    build = folder / "build"
    build.mkdir()
    shutil.copy(program, build / "brov-rig")
    return build


def test_a_build_older_than_its_source_is_not_measured(tmp_path):
    build = build_in(tmp_path, built("brov-rig"))
    (tmp_path / "lib").mkdir()
    source = tmp_path / "lib" / "kinematics.cpp"
    source.write_text("")
    os.utime(build / "brov-rig", (1.0, 1.0))
    with pytest.raises(LinkError, match="older than the firmware's source; `make firmware`"):
        firmware_angles_rad(POINTS, build)


def test_what_is_no_firmware_is_said(tmp_path):
    with pytest.raises(LinkError, match=r"there is no .*brov-rig; `make firmware`"):
        firmware_angles_rad(POINTS, tmp_path)
    build = build_in(tmp_path, "/bin/true")
    with pytest.raises(LinkError, match="names no pseudo terminal"):
        firmware_angles_rad(POINTS, build)
    (build / "brov-rig").write_bytes(b"no program")
    with pytest.raises(LinkError, match="cannot be started"):
        firmware_angles_rad(POINTS, build)


def test_counts_come_from_the_report_and_a_damaged_one_gives_none(tmp_path):
    with pytest.raises(LinkError, match=r"there is no .*report.json; firmware/xtensa/try_all"):
        instruction_counts(tmp_path)
    report = tmp_path / "report.json"
    report.write_text(json.dumps({"rows": [{"id": "ik_six_legs_mean", "value": 22039, "unit": "instructions"}]}))
    assert instruction_counts(tmp_path) == {"ik_six_legs_mean": 22039.0}
    for damaged in ("{", "[]", '{"rows": [{"id": "ik"}]}', '{"rows": 3}', '{"rows": [{"id": "a", "value": null}]}'):
        report.write_text(damaged)
        with pytest.raises(LinkError, match="does not read"):
            instruction_counts(tmp_path)
    report.write_text('{"rows": [{"id": "ram_board", "value": 1}]}')
    with pytest.raises(LinkError, match="no counts of the inverse kinematics"):
        instruction_counts(tmp_path)
