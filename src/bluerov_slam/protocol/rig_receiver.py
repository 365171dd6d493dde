"""The text link between the ground-truth rig and the thesis's acoustic receiver: the robust number and the result line.

The rig tells the receiver where its array will be as `<1.2345,48>` CR LF: metres with four decimals, and the sum of the
value's character codes modulo 256. The receiver answers `1` (good), `0` (once more) or `-1` (given up, after the
third). Later it sends fifteen values, "%.2f", without anything behind them. No clock: who waits calls `flush` or
`timed_out`. Layout and what is done about bad text: docs/rig-link.md. Source: thesis section 2.5.3.
Check: 0.1 -> `<0.1000,31>`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum

from bluerov_slam.errors import BugError, OutOfValidityError

TRIES = 3
"""How often a message is sent before its point is given up."""
REPLY_WAIT_S = 2.0
"""The published time after which the other side counts as silent."""
NUMBER_LIMIT_M = 1000.0
"""Beyond it a number is no place of the rig's, and millimetres were given for metres."""
_MAX_NUMBER_BYTES = 64
_MAX_RESULT_BYTES = 512

_START, _END = b"<", b">"
_NUMBER = re.compile(rb"<([^<>,]*),([0-9]{1,3})>")
_VALUE_TEXT = re.compile(r"-?[0-9]{1,9}\.[0-9]{4}")
_FIELD = rb"-?(?:[0-9]{1,9}\.[0-9]{2}|nan|inf)"
_RESULT = re.compile(rb"(?<![0-9.\-])" + _FIELD + rb"(?:," + _FIELD + rb"){14}")
_REPLY = re.compile(rb"-1|1|0")
VALUES = 15


class NumberReply(IntEnum):
    """What the receiver answers to a number."""

    GOOD = 1
    REPEAT = 0
    GIVEN_UP = -1


class NumberFault(StrEnum):
    """What was wrong with a number message."""

    CHECKSUM = "the checksum does not fit the value"
    MALFORMED = "no number message"
    TOO_LONG = "a start without an end"


def checksum(text: bytes) -> int:
    """Sum of the character codes modulo 256."""
    return sum(text) & 0xFF


def encode_number(value_m: float) -> bytes:
    """The whole message. Raises OutOfValidityError for what is no place in metres (NaN is not sent as anything)."""
    if not math.isfinite(value_m) or abs(value_m) > NUMBER_LIMIT_M:
        raise OutOfValidityError(
            f"number for the receiver: {value_m} m, expected -{NUMBER_LIMIT_M:g}..{NUMBER_LIMIT_M:g}"
        )
    text = f"{value_m:.4f}".encode("ascii")
    return _START + text + b",%d" % checksum(text) + _END + b"\r\n"


@dataclass(frozen=True, slots=True)
class NumberCounters:
    """What a `NumberDecoder` saw."""

    numbers_ok: int = 0
    checksum_errors: int = 0
    malformed: int = 0
    too_long: int = 0
    bytes_skipped: int = 0


class NumberDecoder:
    """Number messages out of a byte stream cut anywhere: the receiver's side."""

    def __init__(self) -> None:
        self._pending = b""
        self.counters = NumberCounters()

    def feed(self, data: bytes) -> list[float | NumberFault]:
        """Take the next bytes; returns the values (m) and faults that they completed, in order."""
        self._pending += data
        found: list[float | NumberFault] = []
        while self._pending:
            start = self._pending.find(_START)
            self._skip(len(self._pending) if start < 0 else start)
            end = self._pending.find(_END, 0, _MAX_NUMBER_BYTES)
            if end < 0:
                if len(self._pending) >= _MAX_NUMBER_BYTES:
                    found.append(self._fault(NumberFault.TOO_LONG))
                    self._skip(1)
                    continue
                break
            # A start inside means that the end of the message before was lost.
            last_start = self._pending.rfind(_START, 0, end)
            if last_start > 0:
                found.append(self._fault(NumberFault.MALFORMED))
                self._skip(last_start)
                continue
            found.append(self._judge(self._pending[: end + 1]))
            self._pending = self._pending[end + 1 :]
        return found

    def _judge(self, message: bytes) -> float | NumberFault:
        match = _NUMBER.fullmatch(message)
        if match is None:
            return self._fault(NumberFault.MALFORMED)
        if int(match[2]) != checksum(match[1]):
            return self._fault(NumberFault.CHECKSUM)
        # A text that is no number may have a right sum all the same: two errors may cancel.
        text = match[1].decode("latin-1")
        if _VALUE_TEXT.fullmatch(text) is None or abs(float(text)) > NUMBER_LIMIT_M:
            return self._fault(NumberFault.MALFORMED)
        self.counters = replace(self.counters, numbers_ok=self.counters.numbers_ok + 1)
        return float(text)

    def _fault(self, fault: NumberFault) -> NumberFault:
        name = {
            NumberFault.CHECKSUM: "checksum_errors",
            NumberFault.MALFORMED: "malformed",
            NumberFault.TOO_LONG: "too_long",
        }
        counter = name[fault]
        self.counters = replace(self.counters, **{counter: getattr(self.counters, counter) + 1})
        return fault

    def _skip(self, count: int) -> None:
        skipped = self._pending[:count].strip(b"\r\n")  # the line's end between two messages is no garbage
        self._pending = self._pending[count:]
        if skipped:
            self.counters = replace(self.counters, bytes_skipped=self.counters.bytes_skipped + len(skipped))


class NumberReceiver:
    """The receiver's side with its three tries: values in, replies out."""

    def __init__(self) -> None:
        self._decoder = NumberDecoder()
        self._failures = 0

    @property
    def counters(self) -> NumberCounters:
        """What came in so far."""
        return self._decoder.counters

    def feed(self, data: bytes) -> tuple[list[float], bytes]:
        """Take the next bytes; returns the good values (m) and what to answer."""
        values: list[float] = []
        answer = b""
        for found in self._decoder.feed(data):
            if isinstance(found, NumberFault):
                self._failures += 1
                reply = NumberReply.GIVEN_UP if self._failures >= TRIES else NumberReply.REPEAT
            else:
                values.append(found)
                reply = NumberReply.GOOD
            if reply is not NumberReply.REPEAT:
                self._failures = 0
            answer += encode_reply(reply)
        return values, answer


def encode_reply(reply: NumberReply) -> bytes:
    """The receiver's answer to a number."""
    return b"%d" % reply


class ExchangeOutcome(StrEnum):
    """How a number or a command ended."""

    DELIVERED = "delivered"
    CHECKSUM_FAILED = "three tries failed their check"
    SILENT = "no answer to three tries"


class NumberExchange:
    """One number on its way: three tries, whatever spoils them. A point whose number failed is missing, never 0."""

    def __init__(self, value_m: float) -> None:
        self._message = encode_number(value_m)
        self._silences = 0
        self.tries = 0
        self.outcome: ExchangeOutcome | None = None
        """None while it is still under way."""

    def begin(self) -> bytes:
        """What to send first."""
        if self.tries:
            raise BugError("this number is already on its way")
        self.tries = 1
        return self._message

    def replied(self, reply: NumberReply) -> bytes:
        """The receiver answered; returns what to send now (nothing when it is over)."""
        if self.outcome is not None:
            return b""
        if reply is NumberReply.GOOD:
            self.outcome = ExchangeOutcome.DELIVERED
            return b""
        if reply is NumberReply.GIVEN_UP:
            self.outcome = ExchangeOutcome.CHECKSUM_FAILED
            return b""
        return self._once_more()

    def timed_out(self) -> bytes:
        """Nothing came for `REPLY_WAIT_S`; returns what to send now."""
        if self.outcome is not None:
            return b""
        self._silences += 1
        return self._once_more()

    def _once_more(self) -> bytes:
        if self.tries < TRIES:
            self.tries += 1
            return self._message
        self.outcome = ExchangeOutcome.SILENT if self._silences == TRIES else ExchangeOutcome.CHECKSUM_FAILED
        return b""


Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ReceiverResult:
    """The fifteen values in the order of the line; test frame, mm and degrees; NaN where it said nan."""

    acoustic_mm: Triple
    combined_mm: Triple
    raw_mm: Triple
    attitude_deg: Triple
    """Roll, pitch, yaw."""
    transmitter_mm: Triple

    @property
    def finite(self) -> bool:
        """Whether every value is a number."""
        return all(math.isfinite(value) for value in self.values)

    @property
    def values(self) -> tuple[float, ...]:
        """All fifteen in the order of the line."""
        return self.acoustic_mm + self.combined_mm + self.raw_mm + self.attitude_deg + self.transmitter_mm


def encode_result(result: ReceiverResult) -> bytes:
    """The receiver's line; like the original without anything behind it."""
    return ",".join(f"{value:.2f}" for value in result.values).encode("ascii")


@dataclass(frozen=True, slots=True)
class ReceiverCounters:
    """What a `ReceiverText` saw. `not_finite` results are among `results_ok`: their other values are good."""

    replies_ok: int = 0
    results_ok: int = 0
    not_finite: int = 0
    malformed: int = 0
    bytes_skipped: int = 0


class ReceiverText:
    """What the receiver sends, cut anywhere. Neither kind of text has an end: who waits takes what it waits for.

    A reply has no check. Only a text that is nothing but one counts as one, after the silence that ends it.
    """

    def __init__(self) -> None:
        self._pending = b""
        self.counters = ReceiverCounters()

    def feed(self, data: bytes) -> None:
        """Take the next bytes."""
        self._pending += data
        excess = len(self._pending) - _MAX_RESULT_BYTES
        if excess > 0:
            self._count(malformed=1)
            self._drop(excess)

    def take_reply(self) -> NumberReply | None:
        """The answer to a number, when all that has come is one; call it once the line is quiet."""
        match = _REPLY.fullmatch(self._pending.strip())
        if match is None:
            return None
        self._pending = b""
        self._count(replies_ok=1)
        return NumberReply(int(match[0]))

    def take_result(self) -> ReceiverResult | None:
        """The oldest whole line of fifteen values."""
        match = _RESULT.search(self._pending)
        if match is None:
            return None
        before, self._pending = self._pending[: match.start()].strip(), self._pending[match.end() :]
        if before:
            self._count(malformed=1, bytes_skipped=len(before))
        numbers = [float(field) for field in match[0].split(b",")]
        values = [value if math.isfinite(value) else math.nan for value in numbers]
        result = ReceiverResult(*((values[i], values[i + 1], values[i + 2]) for i in range(0, VALUES, 3)))
        self._count(results_ok=1, not_finite=0 if result.finite else 1)
        return result

    def flush(self) -> bytes:
        """The wait is over: what is left is no message. Returns it, for the log."""
        rest, self._pending = self._pending.strip(), b""
        if rest:
            self._count(malformed=1, bytes_skipped=len(rest))
        return rest

    def _drop(self, count: int) -> None:
        self._pending = self._pending[count:]
        self._count(bytes_skipped=count)

    def _count(self, **more: int) -> None:
        changed = {name: getattr(self.counters, name) + count for name, count in more.items()}
        self.counters = replace(self.counters, **changed)
