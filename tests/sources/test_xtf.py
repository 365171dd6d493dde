import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bluerov_slam.errors import ConfigError
from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType
from bluerov_slam.protocol.kogger_bundle import Bundle, Coding, compress_ping, expand
from bluerov_slam.protocol.ping_assembly import ChartChunk
from bluerov_slam.protocol.sensor_frame import unpack_sensors
from bluerov_slam.records import Channel
from bluerov_slam.simulation.place import magnetic_field_ned_nt
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.scene import RecordedScene, RecordedSurvey
from bluerov_slam.simulation.sonar import PORT, STARBOARD
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from bluerov_slam.sources.xtf import read_sides, read_xtf
from real_data import recording


@pytest.fixture(scope="module")
def wreck_path() -> Path:
    return recording("sss_iver2_wreck", "scotsman-iver2.xtf")


@pytest.fixture(scope="module")
def wreck(wreck_path: Path) -> RecordedSurvey:
    return read_xtf(wreck_path)


@pytest.mark.data
def test_reads_every_ping_with_its_navigation(wreck: RecordedSurvey) -> None:
    assert wreck.port.shape == wreck.starboard.shape == (461, 1024)
    assert wreck.slant_range_m == pytest.approx(29.98, abs=0.01)
    assert wreck.duration_s == pytest.approx(52.3, abs=0.2)
    assert (wreck.origin_latitude_deg, wreck.origin_longitude_deg) == pytest.approx((48.4454, -68.8279), abs=1e-3)
    assert np.hypot(wreck.north_m[-1], wreck.east_m[-1]) == pytest.approx(55.0, abs=3.0)
    assert np.all(np.diff(wreck.time_s) > 0.0)


@pytest.mark.data
def test_the_first_ping_without_navigation_takes_its_neighbours(wreck: RecordedSurvey) -> None:
    assert wreck.depth_m[0] == wreck.depth_m[1] > 13.0
    assert np.degrees(wreck.yaw_rad[0]) == pytest.approx(np.degrees(wreck.yaw_rad[1]))
    assert (wreck.north_m[0], wreck.east_m[0]) == (0.0, 0.0)


@pytest.mark.data
def test_both_sides_run_from_near_to_far(wreck: RecordedSurvey) -> None:
    """The water column, some 9 m of it, is dark on the near side of both."""
    for side in (wreck.port, wreck.starboard):
        near, far = side[40:80, 60:250].mean(), side[40:80, 500:].mean()
        assert near < 0.25 * far


@pytest.mark.data
def test_reads_the_recorders_own_amplitudes_too(wreck: RecordedSurvey, wreck_path: Path) -> None:
    range_m, port, starboard = read_sides(wreck_path)

    assert range_m == wreck.slant_range_m
    for side, played in ((port, wreck.port), (starboard, wreck.starboard)):
        assert side.max() == 32_767.0
        assert np.array_equal(np.minimum(side // 128, 255), played)


@pytest.mark.data
@pytest.mark.parametrize("exponent", [1.0, 0.5], ids=["linear", "square root"])
def test_coded_pings_are_closer_to_the_recording_than_means_of_as_many_bytes(wreck_path: Path, exponent: float) -> None:
    _, *sides = read_sides(wreck_path)
    errors: dict[Coding, list[float]] = {Coding.MEAN: [], Coding.CODED: []}
    for ping in (side[number] for side in sides for number in (240, 300, 360, 420)):
        samples = np.rint(255.0 * (ping / 32_767.0) ** exponent).astype(np.uint8).tobytes()
        chunks = [ChartChunk(at, 29, 0, samples[at : at + 200]) for at in range(0, len(samples), 200)]
        for coding, squares in errors.items():
            payloads = compress_ping(Channel.A, chunks, ping_number=0, t_us=0, coding=coding)
            assert list(map(len, payloads)) == [180, 136]
            bundles = [bundle for payload in payloads if isinstance(bundle := expand(payload), Bundle)]
            came = b"".join(chunk.samples for bundle in bundles for chunk in bundle.chunks)
            difference = np.frombuffer(came, np.uint8).astype(float) - np.frombuffer(samples, np.uint8)
            squares.append(float(np.mean(difference**2)))

    assert np.sqrt(np.mean(errors[Coding.CODED])) < 0.7 * np.sqrt(np.mean(errors[Coding.MEAN]))


@pytest.mark.data
def test_the_sonars_send_the_recording_and_the_sensors_its_navigation(wreck: RecordedSurvey) -> None:
    scenario = replace(SCENARIOS["survey"], resolution_mm=30, ping_period_ms=113, decimation=1, mission_start_s=30.0)
    scene = RecordedScene(wreck)
    frames = Esp32FrameDecoder().feed(VirtualEsp32(scenario, 921_600, scene).advance(0.6))
    bundles = [b for kind, p in frames if kind == MessageType.KOGGER_COMPRESSED and isinstance(b := expand(p), Bundle)]
    sent = [b"".join(c.samples for c in b.chunks) for b in bundles if b.channel is Channel.A]
    expected = scene.ping(STARBOARD, 30.02, 1000, 0.030, 0).tobytes()
    assert b"".join(sent).startswith(expected)
    assert expected != scene.ping(PORT, 30.02, 1000, 0.030, 0).tobytes()
    *_, fields = (f for kind, p in frames if kind == MessageType.SENSORS and (f := unpack_sensors(p)))
    truth = scene.state(30.5)
    assert fields.depth_cm / 100 == pytest.approx(truth.depth_m, abs=0.05)
    field = magnetic_field_ned_nt(scene.origin_latitude_deg, scene.origin_longitude_deg, scenario.utc_start_unix_s)
    magnetic_rad = truth.yaw_rad - np.arctan2(field[1], field[0])  # a compass knows no other north
    assert fields.yaw_cdeg / 100 == pytest.approx(np.degrees(magnetic_rad), abs=0.5)


@pytest.mark.data
def test_the_recording_starts_again_at_its_end(wreck: RecordedSurvey) -> None:
    scene = RecordedScene(wreck)
    early = scene.ping(PORT, 1.0, 1000, 0.03, 0)
    assert np.array_equal(scene.ping(PORT, 1.0 + wreck.duration_s, 1000, 0.03, 0), early)
    assert not np.array_equal(scene.ping(PORT, 2.0, 1000, 0.03, 0), early)


@pytest.mark.data
def test_a_cut_recording_is_refused_by_name(wreck_path: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.xtf"
    cut.write_bytes(wreck_path.read_bytes()[:100_000])
    with pytest.raises(ConfigError, match=r"cut\.xtf: cut off or damaged at byte"):
        read_xtf(cut)


@pytest.mark.parametrize("content", [b"", b"not a recording" * 200, bytes((123,)) + bytes(1023)])
def test_what_is_no_recording_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "wrong.xtf"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"wrong\.xtf"):
        read_xtf(path)


def test_an_absent_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        read_xtf(tmp_path / "absent.xtf")


def test_without_pyxtf_the_message_names_the_cure(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pyxtf", None)
    with pytest.raises(ConfigError, match=r"pip install 'bluerov-slam\[xtf\]'"):
        read_xtf(tmp_path / "any.xtf")
