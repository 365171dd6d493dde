import json
from pathlib import Path

import pytest

from bluerov_slam.errors import CommandError
from bluerov_slam.protocol.kogger import (
    BootAction,
    ChartSetup,
    CommandDecision,
    Dataset,
    DatasetMask,
    DistanceConfidence,
    DistanceSetup,
    Dsp,
    FirmwareInfo,
    FlashAction,
    FrameType,
    KoggerFrame,
    KoggerFrameDecoder,
    KoggerId,
    ResultCode,
    SonarSetting,
    SoundSpeed,
    Transceiver,
    UniqueId,
    VersionInfo,
    answers,
    boot_frame,
    build_frame,
    check_period,
    classify_command,
    classify_udp_command,
    flash_frame,
    get_frame,
    mark_frame,
    parse_result,
    parse_setting,
    parse_version,
    result_frame,
    two_way_time_s,
    uart_address_frame,
    uart_baud_frame,
    uart_default_address_frame,
    uart_get_frame,
    version_content_frame,
    version_get_frame,
)

REFERENCE = json.loads((Path(__file__).parents[1] / "vectors" / "kogger_vectors.json").read_text())
COMMANDS = [(entry["what"], entry["hex"]) for entry in REFERENCE["commands"]["frames"]]

ALL = DatasetMask.CHART | DatasetMask.TIMESTAMP | DatasetMask.TEMPERATURE | DatasetMask.ATTITUDE
# In the order of the reference file.
BUILT = [
    ChartSetup(1000, 20).set_frame(),
    ChartSetup(1500, 20).set_frame(),
    ChartSetup(15_000, 10).set_frame(),
    ChartSetup.get_frame(),
    Dataset(1, 100).set_frame(),
    Dataset(1, 100, ALL).set_frame(),
    Dataset(1, 0, DatasetMask(0)).set_frame(),
    Dataset(0, 0, DatasetMask(0)).set_frame(),
    Dataset.get_frame(),
    DistanceSetup(500, 50_000).set_frame(),
    DistanceConfidence(14).set_frame(),
    DistanceSetup.get_frame(),
    DistanceConfidence.get_frame(),
    Dsp(1).set_frame(),
    Dsp.get_frame(),
    Transceiver(455, 20, boost=True).set_frame(),
    Transceiver(455, 20, boost=False).set_frame(),
    Transceiver.get_frame(),
    SoundSpeed(1500.0).set_frame(),
    SoundSpeed(1520.0).set_frame(),
    SoundSpeed.get_frame(),
    version_get_frame(0),
    version_get_frame(1),
    version_get_frame(2),
    version_get_frame(0, route=3),
    version_get_frame(1, route=3),
    version_get_frame(2, route=3),
    mark_frame(),
    get_frame(KoggerId.MARK),
    uart_baud_frame(1, 921_600),
    uart_address_frame(1, 2),
    uart_default_address_frame(2),
    uart_get_frame(0),
    uart_get_frame(1),
    uart_get_frame(2),
    flash_frame(FlashAction.SAVE),
    flash_frame(FlashAction.RESTORE),
    flash_frame(FlashAction.ERASE),
    boot_frame(BootAction.REBOOT),
    boot_frame(BootAction.RUN_FIRMWARE),
    get_frame(KoggerId.CHART),
    get_frame(KoggerId.DISTANCE),
    get_frame(KoggerId.TIMESTAMP),
    get_frame(KoggerId.TEMPERATURE),
    get_frame(KoggerId.ATTITUDE),
]
SETTINGS: list[SonarSetting] = [
    ChartSetup(1234, 15, 67),
    Dataset(2, 250, DatasetMask.CHART | DatasetMask.TEMPERATURE),
    Transceiver(675, 10, boost=True),
    SoundSpeed(1482.125),
    Dsp(3),
    DistanceSetup(300, 42_000),
    DistanceConfidence(55),
]


def decoded(data: bytes) -> KoggerFrame:
    (frame,) = KoggerFrameDecoder("mod256").feed(data)
    return frame


def test_there_is_a_builder_for_each_of_the_45_reference_commands() -> None:
    assert len(BUILT) == len(COMMANDS) == 45


@pytest.mark.parametrize(
    ("built", "expected"),
    list(zip(BUILT, [hex_ for _, hex_ in COMMANDS], strict=True)),
    ids=[what for what, _ in COMMANDS],
)
def test_command_is_byte_exact(built: bytes, expected: str) -> None:
    assert built.hex() == expected


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda setting: type(setting).__name__)
def test_setting_is_read_back_from_the_sonars_answer(setting: SonarSetting) -> None:
    answer = decoded(setting.content_frame(route=2, mark=True))

    assert (answer.route, answer.mark, answer.frame_type) == (2, True, FrameType.CONTENT)
    assert type(setting).parse(answer) == setting
    assert parse_setting(answer) == setting
    assert parse_setting(decoded(setting.set_frame())) == setting


@pytest.mark.parametrize("kind", [type(setting) for setting in SETTINGS])
def test_short_answers_and_result_frames_carry_no_setting(kind: type[SonarSetting]) -> None:
    short = build_frame(kind.frame_id, bytes(kind.layout.size - 1), version=kind.version)
    result = build_frame(kind.frame_id, bytes(kind.layout.size), version=kind.version, response=True)
    question = kind.get_frame()

    assert [kind.parse(decoded(frame)) for frame in (short, result, question)] == [None] * 3


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        (ChartSetup(0, 20), "sample count 0, allowed 1..15000"),
        (ChartSetup(1000, 9), "resolution 9 mm, allowed 10..1000 mm"),
        (ChartSetup(1000, 20, -1), "first sample -1, allowed 0..65535"),
        (ChartSetup(15_000, 20), "15000 samples x 20 mm = 300 m, allowed up to 200 m"),
        (Dataset(3, 100), "output slot 3, allowed 0..2"),
        (Dataset(1, -5), "period -5 ms, allowed 0..3.6e+06 ms"),
        (Dataset(1, 100, DatasetMask(0x100)), "data set mask 256, allowed 0..255"),
        (Transceiver(39, 10, boost=True), "frequency 39 kHz, allowed 40..6000 kHz"),
        (Transceiver(455, 256, boost=True), "pulse count 256, allowed 0..255"),
        (SoundSpeed(1.5), "sound speed 1.5 m/s, allowed 300..6000 m/s"),
        (SoundSpeed(float("nan")), "sound speed nan m/s, allowed 300..6000 m/s"),
        (Dsp(5), "smoothing 5, allowed 0..4"),
        (DistanceSetup(5000, 5000), "end of the bottom search 5000 mm, allowed 5001..200000 mm"),
        (DistanceConfidence(101), "confidence 101 %, allowed 0..100 %"),
    ],
    ids=lambda value: repr(value) if isinstance(value, SonarSetting) else "",
)
def test_values_no_sonar_takes_are_refused_with_value_and_range(setting: SonarSetting, text: str) -> None:
    with pytest.raises(CommandError) as caught:
        setting.set_frame()
    assert str(caught.value) == text


@pytest.mark.parametrize(("range_m", "expected_ms"), [(20, 26.7), (30, 40.0), (50, 66.7), (100, 133.3)])
def test_two_way_time(range_m: int, expected_ms: float) -> None:
    chart = ChartSetup(range_m * 1000 // 50, 50)

    assert two_way_time_s(chart, 1500.0) * 1000 == pytest.approx(expected_ms, abs=0.05)


def test_period_below_the_two_way_time_is_refused_with_the_arithmetic() -> None:
    chart = ChartSetup(900, 20, first_sample=100)

    check_period(27, chart)
    check_period(0, chart)
    with pytest.raises(CommandError) as caught:
        check_period(20, chart)
    assert str(caught.value) == (
        "period 20 ms is shorter than the two-way time 2 x 20 m / 1500 m/s = 26.7 ms;"
        " choose at least 27 ms, or a range of at most 15.0 m"
    )


VERSIONS = [
    VersionInfo(board=17, hardware_minor=3, boot_version=(1, 7), serial_number=123_456, part_number="NSSS-455"),
    UniqueId(bytes(range(12))),
    FirmwareInfo(in_boot_loader=False, board=8, hardware_minor=2, boot_version=(1, 2), firmware_version=(3, 14)),
]


@pytest.mark.parametrize("info", VERSIONS, ids=lambda info: type(info).__name__)
def test_version_round_trip(info: VersionInfo | UniqueId | FirmwareInfo) -> None:
    frame = decoded(version_content_frame(info, route=1, mark=True))

    assert (frame.route, frame.mark) == (1, True)
    assert parse_version(frame) == info


def test_version_fields_lie_where_the_specification_has_them() -> None:
    payload = bytearray(34)
    payload[0], payload[1] = 4, 129
    payload[12], payload[13] = 5, 6
    payload[14:18] = (77).to_bytes(4, "little")
    payload[18:22] = b"DSS1"

    info = parse_version(decoded(build_frame(KoggerId.VERSION, bytes(payload))))

    assert info == VersionInfo(129, 4, (6, 5), 77, "DSS1")
    assert isinstance(info, VersionInfo)
    assert info.board_name == "PULSEblue DSS"


def test_unknown_board_and_short_or_foreign_version_frames() -> None:
    assert VersionInfo(200, 0, (0, 0), 0, "").board_name == "board 200"
    assert parse_version(decoded(build_frame(KoggerId.VERSION, bytes(33)))) is None
    assert parse_version(decoded(build_frame(KoggerId.VERSION, bytes(34), version=3))) is None
    assert parse_version(decoded(version_get_frame(0))) is None


def test_result_is_matched_by_id_version_route_and_the_commands_check_bytes() -> None:
    command = decoded(ChartSetup(1000, 20).set_frame(route=2))
    result = decoded(result_frame(command, ResultCode.OK, mark=True))
    parsed = parse_result(result)

    assert parsed is not None
    assert (parsed.code, parsed.meaning, parsed.check.hex()) == (1, "ok", command.check.hex())
    assert answers(result, command)
    assert not answers(result, decoded(ChartSetup(1000, 20).set_frame(route=1)))
    assert not answers(result, decoded(ChartSetup(1001, 20).set_frame(route=2)))
    assert not answers(result, decoded(Dsp(1).set_frame(route=2)))
    assert not answers(decoded(ChartSetup(1000, 20).content_frame(route=2)), command)


def test_reference_result_frame_answers_the_reference_command() -> None:
    (vector,) = (v for v in REFERENCE["vectors"] if v["name"] == "mode_bits")
    result = parse_result(decoded(bytes.fromhex(vector["datagrams"][0])))

    assert result is not None
    assert (result.code, result.check.hex()) == (ResultCode.OK, "991b")


def test_unknown_result_code_keeps_its_number() -> None:
    result = parse_result(decoded(build_frame(KoggerId.DSP, b"\x2a\x01\x02", response=True)))

    assert result is not None
    assert result.meaning == "code 42"


def decisions(names: dict[str, CommandDecision], frames: list[bytes]) -> None:
    """The reference commands' expected decisions; whatever is not named is allowed."""
    for (what, _), data in zip(COMMANDS, frames, strict=True):
        rule = classify_command(decoded(data))
        assert rule.decision is names.get(what, CommandDecision.ALLOW), what
        assert bool(rule.reason) is (rule.decision is not CommandDecision.ALLOW)


def test_reference_commands_are_classified_by_section_4() -> None:
    decisions(
        {
            "flash save v0": CommandDecision.CONFIRM,
            "flash restore v1": CommandDecision.CONFIRM,
            "boot reboot v0": CommandDecision.CONFIRM,
            "uart set baud 921600": CommandDecision.REFUSE,
            "uart set addr 2 (v1)": CommandDecision.REFUSE,
            "uart set defaddr 2 (v2)": CommandDecision.REFUSE,
            "flash erase v2": CommandDecision.REFUSE,
            "boot runfw v1": CommandDecision.REFUSE,
        },
        [bytes.fromhex(hex_) for _, hex_ in COMMANDS],
    )


@pytest.mark.parametrize("frame_id", range(256))
def test_every_getting_is_allowed_and_only_listed_settings_are(frame_id: int) -> None:
    allowed_ids = {0x10, 0x11, 0x12, 0x13, 0x14, 0x15, 0x20, 0x21}
    for version in range(8):
        getting = decoded(build_frame(frame_id, frame_type=FrameType.GETTING, version=version))
        setting = decoded(build_frame(frame_id, frame_type=FrameType.SETTING, version=version))
        assert classify_command(getting).decision is CommandDecision.ALLOW
        allowed = classify_command(setting).decision is CommandDecision.ALLOW
        assert allowed is (frame_id in allowed_ids)


@pytest.mark.parametrize("frame_type", [FrameType.RESERVED, FrameType.CONTENT])
def test_content_never_goes_down(frame_type: FrameType) -> None:
    frame = decoded(build_frame(KoggerId.CHART_SETUP, bytes(6), frame_type=frame_type))

    assert classify_command(frame).decision is CommandDecision.REFUSE


@pytest.mark.parametrize("settings_allowed", [False, True])
def test_from_the_network_only_questions_mark_and_version_pass_and_settings_need_the_switch(
    settings_allowed: bool,
) -> None:
    def passes(data: bytes) -> bool:
        rule = classify_udp_command(decoded(data), settings_allowed=settings_allowed)
        assert rule.decision is not CommandDecision.CONFIRM
        return rule.decision is CommandDecision.ALLOW

    for (what, hex_), _ in zip(COMMANDS, BUILT, strict=True):
        is_get = " get" in what
        is_setting = what.startswith(("chart_setup", "dataset", "dist_setup", "dsp", "transc", "snd_speed"))
        expected = is_get or what == "mark set" or (is_setting and settings_allowed)
        assert passes(bytes.fromhex(hex_)) is expected, what
    assert passes(build_frame(KoggerId.VERSION, frame_type=FrameType.SETTING))
