"""The thesis's receiver behind a pseudo terminal, as far as the rig's computer sees it."""

import contextlib
import os
import threading
import time
import tty
from pathlib import Path

from bluerov_slam.protocol.rig_receiver import NumberReceiver, ReceiverResult, encode_result

PLACE = (110.0, 1.0, -648.0)


class ReceiverThread(threading.Thread):
    """Replies and results of a receiver on a pty; `fail(n, kind)` spoils its n-th answer."""

    def __init__(self):
        super().__init__(daemon=True)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = Path(os.ttyname(self._slave))
        self.attitude_deg = (0.0, 0.0, 0.0)
        self.told = []
        self.deaf = False
        self.damaged = set()
        self.refusals = 0
        self.on_told = lambda: None
        self._ended = False

    def run(self):
        numbers = NumberReceiver()
        while not self._ended:
            try:
                data = os.read(self._master, 256)
            except OSError:
                return
            if self.deaf:
                continue
            if self.refusals:
                self.refusals -= 1
                os.write(self._master, b"0")
                continue
            values, answer = numbers.feed(data)
            os.write(self._master, answer)
            if values:
                self.told += values
                self.on_told()
                time.sleep(0.35)  # the reply must have ended by silence
                line = encode_result(ReceiverResult(PLACE, PLACE, PLACE, self.attitude_deg, (1426.0, 0.0, -694.0)))
                with contextlib.suppress(OSError):  # the test may have ended meanwhile
                    os.write(self._master, b"12.0,xy" if len(self.told) in self.damaged else line)

    def end(self):
        self._ended = True
        os.close(self._slave)
        os.close(self._master)
