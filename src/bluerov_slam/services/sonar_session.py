"""The dialogue with one sonar: one request at a time, matched with its answer, retried, remembered."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from bluerov_slam.errors import CommandError
from bluerov_slam.protocol.kogger import (
    FrameType,
    KoggerFrame,
    KoggerFrameDecoder,
    KoggerId,
    ResultCode,
    get_frame,
    parse_result,
)
from bluerov_slam.records import Channel
from bluerov_slam.services.viewer_link_client import CommandResult

logger = logging.getLogger(__name__)

ANSWER_TIMEOUT_S = 0.5
RETRIES = 2
BUSY_PAUSE_S = 0.05
# A sonar that sent nothing for so long is reported as silent; its remembered answers are no longer given out.
ALIVE_S = 5.0
ASK_QUEUE = 16
# KoggerApp asks for VERSION several times a second for ever; the sonar hears it once.
ASK_INTERVAL_S = 1.0
CHART_POLL_INTERVAL_S = 0.1
UNANSWERED_PAUSE_S = 15.0
# More kinds of questions than KoggerApp has; the rest is somebody trying them all.
KINDS_OF_ASKS = 32
MAXIMUM_ASK_PAYLOAD = 16
RESULT_MEANINGS: dict[int, str] = {
    ResultCode.NONE: "no result",
    ResultCode.OK: "done",
    ResultCode.CHECKSUM: "the command was damaged on its way (checksum)",
    ResultCode.PAYLOAD: "it refuses these values (payload)",
    ResultCode.ID: "it does not know this command (id)",
    ResultCode.VERSION: "it does not know this version of the command",
    ResultCode.TYPE: "it does not take this kind of command (type)",
    ResultCode.KEY: "the confirm key was wrong",
    ResultCode.RUNTIME: "it failed while carrying it out",
}
# Values that change by themselves are never answered from memory.
STREAMED_IDS = frozenset(range(KoggerId.TIMESTAMP, KoggerId.DATASET))
AnswerKey = tuple[int, int, int]


class UnansweredError(CommandError):
    """The command got as far as the ESP32; the sonar said nothing."""


class SonarLink(Protocol):
    """The way down: what `ViewerLinkClient` offers."""

    async def command(self, channel: Channel, frame: bytes) -> CommandResult: ...


@dataclass(frozen=True, slots=True)
class Answer:
    """The latest content frame of a kind, and when it came."""

    frame: KoggerFrame
    at_s: float


@dataclass(slots=True)
class _Awaited:
    """The request under way and the future its answer completes."""

    request: KoggerFrame
    done: asyncio.Future[KoggerFrame]

    def matches(self, frame: KoggerFrame) -> bool:
        if frame.frame_id != self.request.frame_id or frame.version != self.request.version:
            return False
        result = parse_result(frame)
        if result is not None:
            return result.check == self.request.check
        return not frame.response and self.request.frame_type == FrameType.GETTING


class SonarSession:
    """Requests to one sonar, strictly one outstanding. Times are of the clock `now_s`."""

    def __init__(
        self,
        channel: Channel,
        link: SonarLink,
        now_s: Callable[[], float] = time.monotonic,
        answer_timeout_s: float = ANSWER_TIMEOUT_S,
    ) -> None:
        self.channel = channel
        self.marked: bool | None = None
        self.restarts = 0
        self.retries = 0
        self.asks_dropped = 0
        self._link = link
        self._now_s = now_s
        self._answer_timeout_s = answer_timeout_s
        self._lock = asyncio.Lock()
        self._awaited: _Awaited | None = None
        self._answers: dict[AnswerKey, Answer] = {}
        self._heard_s: float | None = None
        self._asks: asyncio.Queue[KoggerFrame] = asyncio.Queue(ASK_QUEUE)
        self._ask_again_s: dict[tuple[int, int, bytes], float] = {}

    @property
    def alive(self) -> bool:
        """Anything heard from the sonar lately, charts included."""
        return self._heard_s is not None and self._now_s() - self._heard_s <= ALIVE_S

    @property
    def busy(self) -> bool:
        """A request is under way."""
        return self._lock.locked()

    def heard(self, mark: bool) -> bool:
        """Sonar data arrived; True when its MARK says that the sonar restarted since it was marked."""
        self._heard_s = self._now_s()
        restarted = self.marked is True and not mark
        self.restarts += restarted
        if restarted:
            self._answers.clear()
        self.marked = mark
        return restarted

    def take(self, frame: KoggerFrame) -> None:
        """An answer, a result or any other frame but a chart came from the sonar."""
        if frame.frame_type != FrameType.CONTENT:
            return
        self._heard_s = self._now_s()
        if not frame.response and frame.frame_id not in STREAMED_IDS:
            self._answers[_answer_key(frame)] = Answer(frame, self._now_s())
        awaited = self._awaited
        if awaited is not None and not awaited.done.done() and awaited.matches(frame):
            awaited.done.set_result(frame)

    def answers(self, frame_id: int, version: int = 0) -> list[Answer]:
        """What the sonar last said about this: one answer, or one per output slot for DATASET."""
        return [answer for key, answer in self._answers.items() if key[:2] == (frame_id, version)]

    def forget(self, frame_id: int) -> None:
        """The remembered answers of this kind are out of date."""
        for key in [key for key in self._answers if key[0] == frame_id]:
            del self._answers[key]

    async def set(self, frame: bytes) -> int | None:
        """Send a SETTING; returns the sonar's result code, None when it got the command but gave no result.

        Raises CommandError when the command did not get through.
        """
        try:
            result = parse_result(await self._request(parse_one(frame)))
        except UnansweredError:
            return None
        return result.code if result else None

    async def get(
        self, frame_id: int, version: int = 0, payload: bytes = b"", attempts: int = 1 + RETRIES
    ) -> KoggerFrame:
        """Send a GETTING; returns the content. Raises CommandError when refused or unanswered."""
        request = parse_one(get_frame(frame_id, version=version, payload=payload))
        answer = await self._request(request, attempts)
        result = parse_result(answer)
        if result is not None:
            raise CommandError(f"sonar {self.channel} does not tell {frame_id:#04x}: {result_meaning(result.code)}")
        return answer

    def ask_soon(self, frame_id: int, version: int, payload: bytes) -> None:
        """Queue a GETTING for `run`, unless the same was asked a moment ago or too many wait."""
        now_s = self._now_s()
        key = (frame_id, version, payload)
        if now_s < self._ask_again_s.get(key, now_s) or len(payload) > MAXIMUM_ASK_PAYLOAD:
            return
        self._ask_again_s = {known: at_s for known, at_s in self._ask_again_s.items() if at_s > now_s}
        if self._asks.full() or len(self._ask_again_s) >= KINDS_OF_ASKS:
            self.asks_dropped += 1
            return
        self._ask_again_s[key] = now_s + (CHART_POLL_INTERVAL_S if frame_id in STREAMED_IDS else ASK_INTERVAL_S)
        self._asks.put_nowait(parse_one(get_frame(frame_id, version=version, payload=payload)))

    async def run(self) -> None:
        """Carry out what `ask_soon` queued, one after the other; until cancelled."""
        while True:
            request = await self._asks.get()
            try:
                if request.frame_id in STREAMED_IDS:
                    # Its answer comes with the data; nothing to wait for.
                    await self._link.command(self.channel, request.raw)
                else:
                    await self._request(request, attempts=1)
            except CommandError as error:
                # KoggerApp asks every sonar for things that only other products know, again and again.
                key = (request.frame_id, request.version, request.payload)
                self._ask_again_s[key] = self._now_s() + UNANSWERED_PAUSE_S
                logger.debug("sonar %s: %s", self.channel, error)

    async def _request(self, request: KoggerFrame, attempts: int = 1 + RETRIES) -> KoggerFrame:
        async with self._lock:
            awaited = _Awaited(request, asyncio.get_running_loop().create_future())
            self._awaited = awaited
            problem = CommandError("")
            try:
                for attempt in range(attempts):
                    self.retries += attempt > 0
                    problem = await self._attempt(awaited)
                    if awaited.done.done():
                        return awaited.done.result()
            finally:
                self._awaited = None
        raise problem

    async def _attempt(self, awaited: _Awaited) -> CommandError:
        """Send once and wait; returns what went wrong if no answer came. Raises CommandError where a retry is vain."""
        outcome = await self._link.command(self.channel, awaited.request.raw)
        if outcome.result == "no_link":
            raise CommandError(outcome.message or "no link to the ESP32: plug it in, or look at the extension's page")
        if outcome.result in ("rejected", "unknown"):
            raise CommandError(
                f"the ESP32 refused the command ({outcome.message or outcome.result}): its firmware may be too old"
            )
        if outcome.result == "busy":
            await asyncio.sleep(BUSY_PAUSE_S)
            return CommandError(f"the ESP32 is busy with another command for sonar {self.channel}: try again")
        if outcome.result != "ok":
            # Old firmware acknowledges nothing; the sonar may have answered all the same.
            await asyncio.sleep(0)
            return CommandError(
                f"the command did not reach sonar {self.channel} ({outcome.message or outcome.result}): "
                "old firmware relays no commands, then flash the present one; else look at the link's errors"
            )
        await asyncio.wait([awaited.done], timeout=self._answer_timeout_s)
        return UnansweredError(
            f"sonar {self.channel} does not answer: check its 12 V, its cable (to its RX) and its baud rate"
        )


def parse_one(frame: bytes) -> KoggerFrame:
    """The one whole, valid frame in `frame`. Raises CommandError for anything else."""
    frames = KoggerFrameDecoder("mod256").feed(frame)
    if len(frames) != 1 or frames[0].raw != frame:
        raise CommandError("not one whole valid Kogger frame")
    return frames[0]


def result_meaning(code: int) -> str:
    """A sonar's result code in words."""
    return RESULT_MEANINGS.get(code, f"result code {code}")


def _answer_key(frame: KoggerFrame) -> AnswerKey:
    slot = frame.payload[0] if frame.frame_id == KoggerId.DATASET and frame.payload else 0
    return frame.frame_id, frame.version, slot
