"""A recorded dive in place of the serial link: the same bytes, with the same arrival times, at any speed."""

from __future__ import annotations

import asyncio
import itertools
import logging
import time
from collections.abc import Callable, Iterator
from typing import Any

from bluerov_slam.errors import RecordingError
from bluerov_slam.pipeline.acoustic_frames import AcousticInput
from bluerov_slam.pipeline.health import LinkFacts, PortState
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.records import AcousticBytes, Channel, LinkBytes, Record
from bluerov_slam.sources.recording_reader import Received, Recording

_log = logging.getLogger(__name__)

# Blocks and records read from disk at a time, in a worker thread.
_BATCH = 256
# Shorter waits than this are not worth a timer.
_SHORTEST_WAIT_S = 0.002
# Without a pace, the event loop gets its turn after this many blocks.
_TURN = 16
# Who cannot keep up with a replay is given this much time, again and again.
_BREATH_S = 0.005


def decoder_for(recording: Recording) -> LinkDecoder:
    """A decoder set as the one that ran when the dive was recorded."""
    settings = dict(recording.decoder_settings)
    expected = settings.get("expected_samples")
    if expected:
        settings["expected_samples"] = {Channel(name): int(count) for name, count in expected.items()}
    known = {key: value for key, value in settings.items() if key in _DECODER_SETTINGS and value is not None}
    return LinkDecoder(**known)


def decode(recording: Recording, baud: int = 115200) -> Iterator[Record]:
    """Every record of a dive: decoded afresh from its raw bytes, and those that came beside the link."""
    decoder, boards = decoder_for(recording), AcousticInput()
    for received in recording.received(baud):
        if isinstance(received, LinkBytes):
            yield from decoder.feed(received.data, received.arrived_s)
        elif isinstance(received, AcousticBytes):
            yield from boards.feed(received.data, received.source, received.arrived_s)
        else:
            yield received
    yield from decoder.finish()
    yield from boards.finish()


class ReplaySource:
    """Stands where the serial port stands. `speed` times real time, None = as fast as it can be taken.

    `on_vehicle` gets what came beside the link: the vehicle's own messages, positions given to us, acoustic datagrams.
    """

    kind = "replay"

    def __init__(self, recording: Recording, speed: float | None = 1.0, baud: int = 115200) -> None:
        if speed is not None and not 0.0 < speed <= 1000.0:
            raise RecordingError(f"speed {speed:g}, expected above 0 and up to 1000, or max")
        first = next(recording.received(baud), None)
        if first is None:
            raise RecordingError(f"{recording.path} holds no link bytes: nothing was recorded into it")
        recording.problems.clear()
        self.recording = recording
        self.speed = speed
        self.baud = baud
        self._state = PortState.ABSENT
        self._detail = "not started"
        self._task: asyncio.Task[None] | None = None
        self._position_s = first.arrived_s
        self._origin: tuple[float, float] | None = None
        self.finished = asyncio.Event()
        self.on_vehicle: Callable[[Record], None] = lambda _record: None
        self.is_too_fast: Callable[[], bool] = lambda: False

    def now_s(self) -> float:
        """The recording's own clock: where the replay stands, going on in real time once it has ended."""
        if self._origin is None:
            return self._position_s
        host_s, recorded_s = self._origin
        running = self._state is PortState.CONNECTED
        if running and self.speed is None:
            return self._position_s
        rate = self.speed if running and self.speed is not None else 1.0
        return max(self._position_s, recorded_s + (time.monotonic() - host_s) * rate)

    def start(self, on_data: Callable[[bytes, float], Any], on_change: Callable[[], None]) -> None:
        """Begin to deliver blocks to `on_data`; `on_change` is called when the state changes."""
        self._task = asyncio.get_running_loop().create_task(self._run(on_data, on_change), name="replay")

    async def stop(self) -> None:
        """End early."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None

    def send(self, frame: bytes) -> bool:
        """A recording takes no commands."""
        return False

    def facts(self) -> LinkFacts:
        """For the status page."""
        return LinkFacts(
            state=self._state, kind=self.kind, port=str(self.recording.path), baud=self.baud, detail=self._detail
        )

    async def _run(self, on_data: Callable[[bytes, float], Any], on_change: Callable[[], None]) -> None:
        received = self.recording.received(self.baud)
        try:
            batch = await asyncio.to_thread(_take, received)
            self._origin = (time.monotonic(), self._position_s)
            self._change(PortState.CONNECTED, f"replay of {self.recording.path}", on_change)
            while batch:
                following = asyncio.create_task(asyncio.to_thread(_take, received))
                try:
                    await self._deliver(batch, on_data)
                finally:
                    batch = await following
            detail = "; ".join(["the recording has ended", *self.recording.problems])
        except (OSError, RecordingError) as error:
            _log.error("replay ended: %s", error)
            detail = f"replay ended: {error}"
        self._origin = (time.monotonic(), self._position_s)
        self._change(PortState.FINISHED, detail, on_change)
        self.finished.set()

    async def _deliver(self, batch: list[Received], on_data: Callable[[bytes, float], Any]) -> None:
        for number, received in enumerate(batch):
            await self._wait_for(received.arrived_s)
            if number % _TURN == 0:
                await asyncio.sleep(0)
                while self.is_too_fast():  # noqa: ASYNC110  nobody would set an event: it is a look at a queue
                    await asyncio.sleep(_BREATH_S)
            self._position_s = max(self._position_s, received.arrived_s)
            if isinstance(received, LinkBytes):
                on_data(received.data, received.arrived_s)
            else:
                self.on_vehicle(received)

    async def _wait_for(self, arrived_s: float) -> None:
        if self.speed is None:
            return
        wait_s = (arrived_s - self.now_s()) / self.speed
        if wait_s > _SHORTEST_WAIT_S:
            await asyncio.sleep(wait_s)

    def _change(self, state: PortState, detail: str, on_change: Callable[[], None]) -> None:
        self._state, self._detail = state, detail
        on_change()


_DECODER_SETTINGS = frozenset({"kogger_checksum", "surface_pressure_pa", "expected_samples"})


def _take(received: Iterator[Received]) -> list[Received]:
    return list(itertools.islice(received, _BATCH))
