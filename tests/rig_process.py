"""The native rig firmware as a process, spoken to through its pseudo terminal."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import time
import tty
from typing import TYPE_CHECKING

from bluerov_slam.protocol.rig_link import (
    ANSWER_WAIT_S,
    POLL_S,
    CommandExchange,
    CommandOutcome,
    RigAck,
    RigFrameDecoder,
    RigImu,
    RigMode,
    RigRecord,
    RigState,
    encode_where,
    unpack,
)
from firmware_build import built

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

PATIENCE_S = 10.0
SLOWNESS = 10
"""This machine is shared: an answer may take so much longer than on a rig's own."""


class RigProcess:
    """`brov-rig` and the computer's side of its link."""

    def __init__(self, *options: str) -> None:
        command = [built("brov-rig"), "--link", "auto", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert self.process.stdout is not None
        self._fd = os.open(self.process.stdout.readline().strip(), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._fd)
        self._sequence = 0
        self.decoder = RigFrameDecoder()
        self.unasked: list[RigRecord] = []

    def __enter__(self) -> RigProcess:
        """Nothing more: it already runs."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it."""
        self.process.kill()
        self.process.wait(PATIENCE_S)
        os.close(self._fd)

    def press(self) -> None:
        """Push the button."""
        self.process.send_signal(signal.SIGUSR1)

    def change_supply(self) -> None:
        """Cut the servo boards' supply, or bring it back."""
        self.process.send_signal(signal.SIGUSR2)

    def sequence(self) -> int:
        """A new one."""
        self._sequence = self._sequence % 255 + 1
        return self._sequence

    def write(self, data: bytes) -> None:
        """Raw bytes to the rig."""
        assert os.write(self._fd, data) == len(data)

    def ask(self, frame: bytes) -> RigAck | RigState | RigImu:
        """Send a command, three times if need be, and return its answer."""
        exchange = CommandExchange(frame)
        self.write(exchange.begin())
        while exchange.outcome is None:
            deadline = time.monotonic() + SLOWNESS * ANSWER_WAIT_S
            while exchange.outcome is None and time.monotonic() < deadline:
                for record in self.read(0.05):
                    if not exchange.heard(record):
                        self.unasked.append(record)
            if exchange.outcome is None:
                self.write(exchange.timed_out())
        assert exchange.outcome is CommandOutcome.ANSWERED
        assert exchange.answer is not None
        return exchange.answer

    def where(self) -> RigState:
        """Where the rig is now."""
        answer = self.ask(encode_where(self.sequence()))
        assert isinstance(answer, RigState)
        return answer

    def wait_for(self, wanted: Callable[[RigState], bool], poll_s: float = POLL_S) -> RigState:
        """Ask WHERE until the answer is as wanted."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            state = self.where()
            if wanted(state):
                return state
            time.sleep(poll_s)
        raise AssertionError(f"the rig stays in {RigMode(state.mode).name}: {state}")

    def start(self) -> RigState:
        """Wait until it is at home, and press."""
        self.wait_for(lambda state: state.mode == RigMode.WAITING)
        self.press()
        return self.wait_for(lambda state: state.mode == RigMode.READY)

    def read(self, wait_s: float) -> list[RigRecord]:
        """What comes within this time, as soon as something does."""
        if not select.select([self._fd], [], [], wait_s)[0]:
            return []
        records = [unpack(kind, body) for kind, body in self.decoder.feed(os.read(self._fd, 4096))]
        assert None not in records
        return [record for record in records if record is not None]
