"""A child process ends when its parent does, however that ends (Linux: prctl(2), PR_SET_PDEATHSIG)."""

from __future__ import annotations

import ctypes
import signal
from typing import Final

_PR_SET_PDEATHSIG: Final = 1


def end_with_parent(signal_number: signal.Signals = signal.SIGTERM) -> None:
    """To be called in the child: a parent that is killed must not leave it behind with its ports and its memory."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal_number)
