"""The navigation worker: a process of its own, so that no estimate can delay the link, the log or a page.

`python -m bluerov_slam.services.navigation_worker PARENT_PID` reads `Setup`, then one `Work` after the other from its
standard input and answers each with `Done` on its standard output. It ends when its input does, and when its parent
does, however that came.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import resource
import signal
import sys
from typing import Final

from bluerov_slam.services.parent_death import end_with_parent

# The link, the log and the pages come first.
NICENESS: Final = 5
# Some ten times what it needs: a leak ends here, in a restart, and not in the vehicle's memory.
MEMORY_LIMIT_BYTES: Final = 1_000_000_000

_log = logging.getLogger(__name__)


def main(parent_pid: int) -> None:
    """Serve until the input ends."""
    _be_a_quiet_child(parent_pid)
    # The answers' pipe is ours alone: whatever prints goes to the log.
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    requests = os.fdopen(os.dup(0), "rb", buffering=0)

    # Only now: what is imported here takes a second on a Raspberry Pi and counts against no request.
    from bluerov_slam.services.navigation_engine import NavigationEngine
    from bluerov_slam.services.navigation_messages import Done, pack, read_message

    setup = read_message(requests.read)
    if setup is None:
        return
    engine = NavigationEngine(setup)
    gc.collect()
    gc.freeze()
    _write(answers, pack(Done(resumed=engine.resumed, calibrations=engine.calibrations())))
    while (work := read_message(requests.read)) is not None:
        _write(answers, pack(engine.run(work)))
    engine.close()


def _be_a_quiet_child(parent_pid: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent ends us in order
    end_with_parent(signal.SIGKILL)
    if os.getppid() != parent_pid:  # it ended before we could ask to be told
        sys.exit(0)
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_LIMIT_BYTES, MEMORY_LIMIT_BYTES))
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")


def _write(file: object, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[file.write(view) :]  # type: ignore[attr-defined]  # raw file: may take less


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        main(int(sys.argv[1]))
