"""The robust number and the result line: what is good, what is named, and what is never a zero."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.errors import BugError, OutOfValidityError
from bluerov_slam.protocol.rig_receiver import (
    TRIES,
    ExchangeOutcome,
    NumberDecoder,
    NumberExchange,
    NumberFault,
    NumberReceiver,
    NumberReply,
    ReceiverResult,
    ReceiverText,
    encode_number,
    encode_reply,
    encode_result,
)

# A line as the logs have them: 1.43 m ahead.
LINE = b"123.45,-6.78,-640.10,123.50,-6.70,-640.00,124.00,-7.00,-641.25,0.52,-1.04,12.00,1426.00,0.00,-652.00"
RESULT = ReceiverResult(
    (123.45, -6.78, -640.10), (123.5, -6.7, -640.0), (124.0, -7.0, -641.25), (0.52, -1.04, 12.0), (1426.0, 0.0, -652.0)
)


@pytest.mark.parametrize(
    ("value_m", "message"),
    [(0.1, b"<0.1000,31>\r\n"), (-0.64838, b"<-0.6484,97>\r\n"), (12.5, b"<12.5000,86>\r\n")],
)
def test_number_is_the_published_text(value_m: float, message: bytes) -> None:
    text = message[1 : message.index(b",")]
    assert int(message[message.index(b",") + 1 : -3]) == sum(text) % 256
    assert encode_number(value_m) == message


@pytest.mark.parametrize("value_m", [math.nan, math.inf, -math.inf, 1000.1, 123_450.0])
def test_what_is_no_place_is_not_sent(value_m: float) -> None:
    with pytest.raises(OutOfValidityError, match="m, expected"):
        encode_number(value_m)


@given(st.lists(st.floats(-1000.0, 1000.0), max_size=5), st.lists(st.integers(1, 20), min_size=1, max_size=20))
def test_numbers_come_back_however_the_stream_is_cut(values: list[float], cuts: list[int]) -> None:
    stream = b"".join(map(encode_number, values))
    decoder = NumberDecoder()
    found: list[float | NumberFault] = []
    at = step = 0
    while at < len(stream):
        size = cuts[step % len(cuts)]
        found += decoder.feed(stream[at : at + size])
        at, step = at + size, step + 1
    assert found == [pytest.approx(value, abs=5.1e-5) for value in values]
    assert decoder.counters.numbers_ok == len(values)
    assert decoder.counters.bytes_skipped == 0


def test_no_change_of_a_single_byte_gives_another_number() -> None:
    message = encode_number(0.1234)
    for at in range(len(message) - 2):
        for byte in range(256):
            damaged = message[:at] + bytes([byte]) + message[at + 1 :]
            for found in NumberDecoder().feed(damaged + encode_number(0.5)):
                assert isinstance(found, NumberFault) or found in (0.1234, 0.5)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (b"<0.1000,32>", NumberFault.CHECKSUM),
        (b"<0.1000>", NumberFault.MALFORMED),
        (b"<,0>", NumberFault.MALFORMED),
        (b"<nan,%d>" % (sum(b"nan") % 256), NumberFault.MALFORMED),
        (b"<.0100 ,%d>" % (sum(b".0100 ") % 256), NumberFault.MALFORMED),
        (b"<5000.0000,%d>" % (sum(b"5000.0000") % 256), NumberFault.MALFORMED),
        (b"<0.1000,3<0.2000,32>", NumberFault.MALFORMED),
        (b"<" + b"1" * 80, NumberFault.TOO_LONG),
    ],
)
def test_bad_text_is_counted_and_named(text: bytes, fault: NumberFault) -> None:
    decoder = NumberDecoder()
    found = decoder.feed(b"garbage" + text + encode_number(0.25))
    assert found[0] == fault
    assert found[-1] == 0.25
    assert decoder.counters.bytes_skipped >= len(b"garbage")
    counters = decoder.counters
    assert counters.checksum_errors + counters.malformed + counters.too_long == len(found) - counters.numbers_ok


def test_receiver_gives_up_with_the_third_bad_message() -> None:
    receiver = NumberReceiver()
    bad = b"<0.1000,32>\r\n"
    assert receiver.feed(bad) == ([], b"0")
    assert receiver.feed(bad) == ([], b"0")
    assert receiver.feed(bad) == ([], b"-1")
    assert receiver.feed(bad) == ([], b"0")
    assert receiver.feed(encode_number(0.1)) == ([0.1], b"1")
    assert receiver.feed(bad) == ([], b"0")
    assert receiver.counters.checksum_errors == 5


def drive(exchange: NumberExchange, answers: list[NumberReply | None]) -> list[bytes]:
    """None is silence."""
    begun = exchange.begin()
    answered = [exchange.timed_out() if answer is None else exchange.replied(answer) for answer in answers]
    return [begun, *answered]


@pytest.mark.parametrize(
    ("answers", "outcome", "tries"),
    [
        ([NumberReply.GOOD], ExchangeOutcome.DELIVERED, 1),
        ([NumberReply.REPEAT, NumberReply.GOOD], ExchangeOutcome.DELIVERED, 2),
        ([None, NumberReply.REPEAT, NumberReply.GOOD], ExchangeOutcome.DELIVERED, 3),
        ([NumberReply.REPEAT] * 3, ExchangeOutcome.CHECKSUM_FAILED, 3),
        ([NumberReply.REPEAT, NumberReply.REPEAT, NumberReply.GIVEN_UP], ExchangeOutcome.CHECKSUM_FAILED, 3),
        ([None, NumberReply.REPEAT, None], ExchangeOutcome.CHECKSUM_FAILED, 3),
        ([None] * 3, ExchangeOutcome.SILENT, 3),
        ([None, None, NumberReply.GIVEN_UP], ExchangeOutcome.CHECKSUM_FAILED, 3),
    ],
)
def test_three_tries_and_how_they_end(answers: list[NumberReply | None], outcome: ExchangeOutcome, tries: int) -> None:
    exchange = NumberExchange(0.1)
    sent = drive(exchange, answers)
    assert exchange.outcome == outcome
    assert sent == [encode_number(0.1)] * tries + [b""] * (len(sent) - tries)
    assert exchange.replied(NumberReply.REPEAT) == b""
    assert exchange.timed_out() == b""
    assert exchange.outcome == outcome


def test_a_number_is_begun_once() -> None:
    exchange = NumberExchange(0.1)
    exchange.begin()
    with pytest.raises(BugError):
        exchange.begin()


def test_sender_and_receiver_agree_over_a_line_that_damages_two_messages() -> None:
    receiver, exchange, text = NumberReceiver(), NumberExchange(-0.5), ReceiverText()
    message, values = exchange.begin(), []
    damage: list[Callable[[bytes], bytes]] = [
        lambda sent: sent.replace(b"5", b"6"),
        lambda sent: sent[:3] + sent[4:],
        lambda sent: sent,
    ]
    for line in damage:
        got, answer = receiver.feed(line(message))
        values += got
        text.feed(answer)
        reply = text.take_reply()
        assert reply is not None
        message = exchange.replied(reply)
    assert (values, exchange.outcome, exchange.tries) == ([-0.5], ExchangeOutcome.DELIVERED, TRIES)


@pytest.mark.parametrize("reply", list(NumberReply))
def test_replies_come_back(reply: NumberReply) -> None:
    text = ReceiverText()
    for byte in encode_reply(reply):
        text.feed(bytes([byte]))
    assert text.take_reply() is reply
    assert text.take_reply() is None


@pytest.mark.parametrize("garbage", [b"2", b"10", b"-", b"1x", b"-10", b"\xff1", b"1,2"])
def test_a_reply_has_no_check_so_nothing_else_may_be_there(garbage: bytes) -> None:
    text = ReceiverText()
    text.feed(garbage)
    assert text.take_reply() is None
    assert text.flush() == garbage
    assert text.counters.malformed == 1


def test_result_line_is_the_published_text() -> None:
    assert encode_result(RESULT) == LINE
    text = ReceiverText()
    text.feed(LINE)
    assert text.take_result() == RESULT


def test_a_line_is_whole_only_with_its_last_digit() -> None:
    text = ReceiverText()
    for at in range(len(LINE)):
        text.feed(LINE[at : at + 1])
        assert (text.take_result() is None) == (at < len(LINE) - 1)
    assert text.counters.results_ok == 1


def test_two_lines_without_anything_between_are_two() -> None:
    other = encode_result(ReceiverResult((1.0, 2.0, 3.0), *((4.0, 5.0, 6.0),) * 4))
    text = ReceiverText()
    text.feed(LINE + b"\r\n" + other)
    assert text.take_result() == RESULT
    second = text.take_result()
    assert second is not None
    assert second.acoustic_mm == (1.0, 2.0, 3.0)


def test_a_value_that_is_no_number_is_nan_and_never_zero() -> None:
    text = ReceiverText()
    text.feed(LINE.replace(b"-6.78", b"-nan").replace(b"124.00", b"inf"))
    result = text.take_result()
    assert result is not None
    assert math.isnan(result.acoustic_mm[1])
    assert math.isnan(result.raw_mm[0])
    assert not result.finite
    assert text.counters.not_finite == 1


@pytest.mark.parametrize(
    "line",
    [
        LINE.replace(b"-6.78", b"-6.7"),
        LINE.replace(b"-6.78,", b""),
        LINE.replace(b"640.10", b"64x.10"),
        LINE[:-1],
        b"\x00\xff" * 40,
    ],
)
def test_a_line_that_is_not_whole_is_no_result(line: bytes) -> None:
    text = ReceiverText()
    text.feed(line)
    assert text.take_result() is None
    text.flush()
    assert (text.counters.results_ok, text.counters.malformed) == (0, 1)
    text.feed(LINE)
    assert text.take_result() == RESULT


def test_garbage_before_a_line_is_counted_and_endless_garbage_is_bounded() -> None:
    text = ReceiverText()
    text.feed(b"\xfe\xfe " + LINE)
    assert text.take_result() == RESULT
    assert text.counters.bytes_skipped == 2
    for _ in range(100):
        text.feed(b"?" * 100)
    assert len(text.flush()) <= 512
