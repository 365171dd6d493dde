import asyncio

import pytest

from bluerov_slam.errors import CommandError, ConfigError
from bluerov_slam.protocol.kogger import ChartSetup, DatasetMask, FrameType, KoggerId, ResultCode, build_frame
from bluerov_slam.records import Channel
from bluerov_slam.services.command_forwarder import CommandForwarder
from services.fake_sonar import FakeSonar, parse


@pytest.fixture
async def sonar() -> FakeSonar:
    return FakeSonar()


@pytest.fixture
async def forwarder(sonar: FakeSonar) -> CommandForwarder:
    return CommandForwarder({Channel.A: sonar.session}, wall_unix_s=lambda: 1.7e9)


async def test_a_range_change_is_set_and_read_back(sonar, forwarder) -> None:
    outcome = await forwarder.apply(Channel.A, {"range_m": 30.0})
    assert outcome.ok
    assert (outcome.read["range_m"], outcome.read["samples"], outcome.read["resolution_mm"]) == (30.0, 1500, 20)
    assert sonar.settings[KoggerId.CHART_SETUP] == ChartSetup(1500, 20, 0)
    state = forwarder.state()["A"]
    assert state["asked"] == {"range_m": 30.0}
    assert state["read"]["samples"] == 1500
    assert (state["read_at"], state["pending"], state["last_result"]) == (1.7e9, False, "set and read back")


async def test_every_setting_reaches_the_sonar_and_comes_back(forwarder) -> None:
    asked = {
        "samples": 800, "resolution_mm": 25, "first_sample": 10, "period_ms": 150, "frequency_khz": 675, "pulses": 12,
        "boost": False, "sound_speed_mps": 1512.3, "smoothing": 2,
    }  # fmt: skip
    outcome = await forwarder.apply(Channel.A, asked)
    assert outcome.ok, outcome.message
    assert {key: outcome.read[key] for key in asked} == asked


async def test_a_period_shorter_than_the_two_way_time_is_refused_with_the_arithmetic(sonar, forwarder) -> None:
    with pytest.raises(CommandError, match=r"2 x 100 m / 1500 m/s = 133.3 ms.*at least 134 ms.*at most 75.0 m"):
        await forwarder.apply(Channel.A, {"range_m": 100.0})
    assert sonar.sent(FrameType.SETTING) == []
    outcome = await forwarder.apply(Channel.A, {"range_m": 100.0, "period_ms": 134})
    assert outcome.ok
    assert sonar.sent(FrameType.SETTING) == [KoggerId.DATASET, KoggerId.CHART_SETUP]


async def test_a_shorter_period_goes_out_after_the_shorter_range(sonar, forwarder) -> None:
    await forwarder.apply(Channel.A, {"range_m": 10.0, "period_ms": 20})
    assert sonar.sent(FrameType.SETTING) == [KoggerId.CHART_SETUP, KoggerId.DATASET]


async def test_the_other_outputs_of_the_sonar_stay_on(sonar, forwarder) -> None:
    await forwarder.apply(Channel.A, {"period_ms": 200})
    dataset = sonar.settings[KoggerId.DATASET]
    assert (dataset.channel, dataset.mask) == (1, DatasetMask.CHART | DatasetMask.TEMPERATURE)


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ({"range_m": 300}, "range_m 300: expected 0.1 to 200 m"),
        ({"range_m": float("nan")}, "expected a number"),
        ({"range_m": "20"}, "expected a number"),
        ({"samples": 100.5}, "whole number"),
        ({"boost": 2}, "true or false"),
        ({"gain": 3}, "gain: unknown setting"),
        ({}, "nothing asked"),
        ({"range_m": 20, "samples": 100, "resolution_mm": 20}, "give two of the three"),
        ({"range_m": 200, "resolution_mm": 10}, "samples must be"),
    ],
)
async def test_bad_values_are_refused_by_name_and_nothing_is_set(sonar, forwarder, body, text) -> None:
    with pytest.raises(ConfigError, match=text):
        await forwarder.apply(Channel.A, body)
    assert sonar.sent(FrameType.SETTING) == []


async def test_a_slider_burst_becomes_two_commands_of_which_the_last_wins(sonar, forwarder) -> None:
    await forwarder.synchronise(Channel.A)
    sonar.heard.clear()
    first = asyncio.create_task(forwarder.apply(Channel.A, {"range_m": 20.0}))
    while not sonar.heard:
        await asyncio.sleep(0)
    rest = [asyncio.create_task(forwarder.apply(Channel.A, {"range_m": 20.0 + i})) for i in range(1, 11)]
    outcomes = await asyncio.gather(first, *rest)
    assert sonar.sent(FrameType.SETTING).count(KoggerId.CHART_SETUP) <= 2
    assert [outcome.read["range_m"] for outcome in outcomes[1:]] == [30.0] * 10


async def test_only_one_command_is_under_way_per_sonar(sonar, forwarder) -> None:
    under_way = 0
    command = sonar.command

    async def watched(channel, frame):
        nonlocal under_way
        under_way += 1
        assert under_way == 1
        await asyncio.sleep(0)
        result = await command(channel, frame)
        under_way -= 1
        return result

    sonar.command = watched
    await asyncio.gather(
        forwarder.apply(Channel.A, {"range_m": 25.0}),
        forwarder.synchronise(Channel.A),
        forwarder.act(Channel.A, "save_to_flash", confirm=True),
    )


async def test_a_lost_answer_is_asked_for_again(sonar, forwarder) -> None:
    await forwarder.synchronise(Channel.A)
    sonar.heard.clear()
    sonar.answers_lost = 2
    outcome = await forwarder.apply(Channel.A, {"smoothing": 1})
    assert outcome.ok
    assert sonar.sent(FrameType.SETTING) == [KoggerId.DSP] * 3


async def test_a_sonar_that_gives_no_result_is_judged_by_what_it_reads(sonar, forwarder) -> None:
    sonar.gives_results = False
    assert (await forwarder.apply(Channel.A, {"smoothing": 1})).ok
    sonar.stubborn = True
    outcome = await forwarder.apply(Channel.A, {"smoothing": 3})
    assert not outcome.ok
    assert outcome.message == "smoothing: asked 3, the sonar reads 1"


async def test_a_refusal_of_the_sonar_is_explained(sonar, forwarder) -> None:
    sonar.result = ResultCode.PAYLOAD
    outcome = await forwarder.apply(Channel.A, {"smoothing": 1})
    assert not outcome.ok
    assert "it refuses these values" in outcome.message
    assert "the sonar reads 0" in outcome.message


async def test_a_result_for_another_command_is_not_taken_for_ours(sonar, forwarder) -> None:
    stray = build_frame(KoggerId.DSP, b"\x03\x00\x00", response=True)
    sonar.before_answer = lambda: sonar.session.take(parse(stray)[0])
    assert (await forwarder.apply(Channel.A, {"smoothing": 1})).ok


@pytest.mark.parametrize(
    ("results", "text"),
    [
        (["no_link"], "no link to the ESP32"),
        (["rejected"], "firmware may be too old"),
        (["timeout"] * 3, "did not reach sonar A"),
        (["busy"] * 3, "busy"),
    ],
)
async def test_a_command_that_does_not_get_through_says_why(sonar, forwarder, results, text) -> None:
    sonar.link_results = results
    with pytest.raises(CommandError, match=text):
        await forwarder.apply(Channel.A, {"samples": 500, "resolution_mm": 20})
    assert text in forwarder.state()["A"]["last_result"]


async def test_a_busy_link_is_tried_again(sonar, forwarder) -> None:
    sonar.link_results = ["busy", "busy"]
    assert (await forwarder.apply(Channel.A, {"smoothing": 1})).ok


async def test_a_silent_sonar_is_named_with_what_to_check(sonar, forwarder) -> None:
    sonar.answers_lost = 1000
    with pytest.raises(CommandError, match="sonar A does not answer: check its 12 V"):
        await forwarder.apply(Channel.A, {"smoothing": 1})


async def test_link_up_marks_the_sonar_and_reads_everything(sonar, forwarder) -> None:
    await forwarder.synchronise(Channel.A)
    assert sonar.heard[0].frame_id == KoggerId.MARK
    state = forwarder.state()["A"]
    assert None not in state["read"].values()
    assert state["device"] == {"name": "SSS-A", "board": "Side-Enhanced", "firmware": "0.87", "serial": "4711"}


async def test_a_restart_of_the_sonar_forgets_what_it_said(sonar, forwarder) -> None:
    await forwarder.synchronise(Channel.A)
    assert sonar.session.heard(mark=False)
    assert set(forwarder.state()["A"]["read"].values()) == {None}


@pytest.mark.parametrize("action", ["save_to_flash", "reboot"])
async def test_flash_and_reboot_need_confirmation(sonar, forwarder, action) -> None:
    with pytest.raises(ConfigError, match="confirm"):
        await forwarder.act(Channel.A, action, confirm=False)
    assert sonar.heard == []
    assert (await forwarder.act(Channel.A, action, confirm=True)).ok
    assert sonar.sent(FrameType.SETTING) == [KoggerId.FLASH if action == "save_to_flash" else KoggerId.BOOT]


async def test_an_unknown_action_lists_the_known_ones(forwarder) -> None:
    with pytest.raises(ConfigError, match="save_to_flash, reboot, stop, refresh"):
        await forwarder.act(Channel.A, "erase", confirm=True)


async def test_refreshing_goes_round_slowly_and_skips_what_the_sonar_does_not_know(sonar) -> None:
    pauses = 0

    async def sleep(seconds: float) -> None:
        nonlocal pauses
        pauses += 1
        if pauses > 60:
            await asyncio.Event().wait()

    forwarder = CommandForwarder({Channel.A: sonar.session}, sleep=sleep)
    sonar.session.heard(mark=True)
    task = asyncio.create_task(forwarder.keep_fresh(Channel.A, lambda: True))
    while pauses <= 60:
        await asyncio.sleep(0.001)
    task.cancel()
    asked = [(frame.frame_id, frame.version) for frame in sonar.heard if frame.frame_type == FrameType.GETTING]
    assert asked.count((KoggerId.DISTANCE_SETUP, 1)) == 1
    assert asked.count((KoggerId.TRANSCEIVER, 0)) >= 5
    assert len(sonar.heard) <= pauses + 12
