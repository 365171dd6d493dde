from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bluerov_slam.protocol.kogger_frame import FrameType, KoggerFrame, KoggerFrameDecoder, KoggerId, build_frame
from bluerov_slam.simulation.kogger_sonar import REBOOT_S, KoggerSonar, SonarSettings

KEY = bytes.fromhex("4A5D6BC9")
# Frames as KoggerApp encodes them (reference document of the protocol, section 4).
SET_1500_X_20_MM = bytes.fromhex("BB55008212 06DC0514000000 8FDD".replace(" ", ""))
SET_PERIOD_100_CHART = bytes.fromhex("BB55008210 09016400000002000000 0253".replace(" ", ""))
SET_FREQUENCY_455 = bytes.fromhex("BB5500821404C701140177 62".replace(" ", ""))
SET_SOUND_SPEED_1520 = bytes.fromhex("BB55008215048031170063E1")
SET_MARK = bytes.fromhex("BB55008221044A5D6BC98246")
SAVE_TO_FLASH = bytes.fromhex("BB55008223044A5D6BC98452")
REBOOT = bytes.fromhex("BB55008224044A5D6BC98558")
GET_VERSION_0 = bytes.fromhex("BB5500832000A3C9")


def ramp(samples: int, resolution_mm: int, first_sample: int) -> NDArray[np.uint8]:
    return (np.arange(samples) % 251).astype(np.uint8)[None, :]


def make_sonar(checksum: str = "mod256", **settings: int) -> KoggerSonar:
    return KoggerSonar(4_001, replace(SonarSettings(), **settings), checksum, ramp)


def parsed(frames: list[bytes]) -> list[KoggerFrame]:
    return KoggerFrameDecoder("mod256").feed(b"".join(frames))


def result_of(sonar: KoggerSonar, command: bytes) -> int | None:
    answers = parsed(sonar.receive(command, 0.0))
    if not answers:
        return None
    assert answers[0].response
    assert answers[0].payload[1:] == command[-2:]
    return answers[0].payload[0]


def setting(frame_id: int, payload: bytes, version: int = 0) -> bytes:
    return build_frame(frame_id, payload, frame_type=FrameType.SETTING, version=version, response=True)


def getting(frame_id: int, payload: bytes = b"", version: int = 0) -> bytes:
    return build_frame(frame_id, payload, frame_type=FrameType.GETTING, version=version, response=True)


def test_a_ping_is_chart_frames_of_two_hundred_samples() -> None:
    frames = make_sonar(samples=1_050).period(0.0, (0, 0, 0), 12.0)
    assert [len(frame) for frame in frames] == [214] * 5 + [64]
    charts = parsed(frames)
    assert [int.from_bytes(chart.payload[:2], "little") for chart in charts] == [0, 200, 400, 600, 800, 1000]
    assert b"".join(chart.payload[6:] for chart in charts) == ramp(1_050, 20, 0).tobytes()


def test_dataset_mask_chooses_the_frames_of_a_period() -> None:
    frames = parsed(make_sonar(samples=200, mask=0x37).period(2.0, (150, -250, 9_000), 12.34))
    assert [frame.frame_id for frame in frames] == [
        KoggerId.TIMESTAMP,
        KoggerId.CHART,
        KoggerId.DISTANCE,
        KoggerId.ATTITUDE,
        KoggerId.TEMPERATURE,
    ]
    assert int.from_bytes(frames[0].payload, "little") == 2_000
    assert frames[4].payload == (1_234).to_bytes(2, "little")


@pytest.mark.parametrize(
    ("command", "changed"),
    [
        (SET_1500_X_20_MM, {"samples": 1_500, "resolution_mm": 20}),
        (SET_PERIOD_100_CHART, {"period_ms": 100, "mask": 2}),
        (SET_FREQUENCY_455, {"frequency_khz": 455, "pulses": 20, "boost": 1}),
        (SET_SOUND_SPEED_1520, {"sound_speed_mmps": 1_520_000}),
        (setting(KoggerId.DSP, b"\x03"), {"smoothing": 3}),
        (setting(0x11, (300).to_bytes(4, "little") + (9_000).to_bytes(4, "little"), 1), {"distance_start_mm": 300}),
        (setting(0x11, b"\x28", 2), {"confidence_percent": 40}),
    ],
)
def test_obeys_settings_and_quotes_their_check_bytes(command: bytes, changed: dict[str, int]) -> None:
    sonar = make_sonar(samples=300, period_ms=500, mask=0)
    assert result_of(sonar, command) == 1
    assert {key: getattr(sonar.settings, key) for key in changed} == changed


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (setting(KoggerId.CHART_SETUP, bytes(6)), 3),
        (setting(KoggerId.CHART_SETUP, bytes(3)), 3),
        (setting(KoggerId.TRANSCEIVER, b"\x01\x00\x0a\x01"), 3),
        (setting(KoggerId.SOUND_SPEED, bytes(4)), 3),
        (setting(KoggerId.MARK, b"\x00\x00\x00\x00"), 7),
        (setting(KoggerId.FLASH, KEY, 5), 5),
        (setting(KoggerId.VERSION, b""), 6),
    ],
)
def test_refuses_what_is_out_of_range_and_changes_nothing(command: bytes, code: int) -> None:
    sonar = make_sonar()
    before = sonar.settings
    assert result_of(sonar, command) == code
    assert sonar.settings == before


def test_ignores_unknown_ids_and_bad_checks_in_silence() -> None:
    sonar = make_sonar()
    assert sonar.receive(setting(0x66, b"\x01"), 0.0) == []
    assert sonar.receive(getting(0x66), 0.0) == []
    assert sonar.receive(SET_1500_X_20_MM[:-1] + b"\x00", 0.0) == []
    assert sonar.settings.samples == 1_000


@pytest.mark.parametrize(
    ("request_frame", "payload"),
    [
        (getting(KoggerId.CHART_SETUP), bytes.fromhex("E80314000000")),
        (getting(KoggerId.DATASET, b"\x01"), bytes.fromhex("016400000002000000")),
        (getting(KoggerId.DATASET, b"\x02"), bytes.fromhex("020000000000000000")),
        (getting(KoggerId.TRANSCEIVER), bytes.fromhex("A3020A01")),
        (getting(KoggerId.SOUND_SPEED), bytes.fromhex("60E31600")),
        (getting(KoggerId.DSP), b"\x01"),
        (getting(0x11, version=1), bytes.fromhex("F401000050C30000")),
        (getting(0x11, version=2), b"\x0e"),
    ],
)
def test_reads_back_settings(request_frame: bytes, payload: bytes) -> None:
    (answer,) = parsed(make_sonar().receive(request_frame, 0.0))
    assert (answer.frame_type, answer.response, answer.payload) == (FrameType.CONTENT, False, payload)


@pytest.mark.parametrize(("version", "size"), [(0, 34), (1, 12), (2, 9)])
def test_three_versions_of_version(version: int, size: int) -> None:
    (answer,) = parsed(make_sonar().receive(getting(KoggerId.VERSION, version=version), 0.0))
    assert (answer.version, len(answer.payload)) == (version, size)


def test_version_zero_says_side_enhanced_and_simulated() -> None:
    (answer,) = parsed(make_sonar().receive(GET_VERSION_0, 0.0))
    assert answer.payload[1] == 8
    assert int.from_bytes(answer.payload[14:18], "little") == 4_001
    assert answer.payload[18:].rstrip(b"\0") == b"SIMULATED"


def test_mark_is_in_every_frame_until_a_reboot() -> None:
    sonar = make_sonar()
    assert not any(frame.mark for frame in parsed(sonar.period(0.0, (0, 0, 0), 0.0)))
    assert result_of(sonar, SET_MARK) == 1
    assert all(frame.mark for frame in parsed(sonar.period(0.0, (0, 0, 0), 0.0)))
    sonar.receive(REBOOT, 10.0)
    assert not sonar.alive(10.0 + REBOOT_S / 2)
    assert sonar.alive(10.0 + REBOOT_S)
    assert not sonar.marked


def test_settings_survive_a_reboot_only_when_saved() -> None:
    sonar = make_sonar()
    sonar.receive(SET_SOUND_SPEED_1520, 0.0)
    sonar.receive(SAVE_TO_FLASH, 0.0)
    sonar.receive(SET_1500_X_20_MM, 0.0)
    sonar.receive(REBOOT, 1.0)
    assert (sonar.settings.sound_speed_mmps, sonar.settings.samples) == (1_520_000, 1_000)


def test_a_polled_chart_is_sent_once() -> None:
    charts = parsed(make_sonar(period_ms=0).receive(getting(KoggerId.CHART), 0.0))
    assert sum(len(chart.payload) - 6 for chart in charts) == 1_000


def test_the_period_is_never_shorter_than_the_two_way_time() -> None:
    assert make_sonar(period_ms=100).settings.period_s == pytest.approx(0.1)
    assert make_sonar(period_ms=20, samples=5_000).settings.period_s == pytest.approx(0.14)
    assert make_sonar(period_ms=0).settings.period_s is None


def test_a_mod_255_sonar_speaks_mod_255() -> None:
    frames = make_sonar("mod255").period(0.0, (0, 0, 0), 0.0)
    assert parsed(frames) == []
    assert len(KoggerFrameDecoder("mod255").feed(b"".join(frames))) == 5
