"""What tests of the rig's commands share: a run that shows its errors, and a rig with its receiver."""

import contextlib
import os
from pathlib import Path

from click.testing import CliRunner

from bluerov_slam.services import rig as service
from receiver_thread import ReceiverThread
from rig_process import RigProcess


def run_command(command, arguments):
    """The result of a command, which may have exited; any other exception is the test's."""
    result = CliRunner().invoke(command, [str(each) for each in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


@contextlib.contextmanager
def rig_and_receiver(monkeypatch):
    """The firmware's process, its receiver, and the path of the rig's port. The process still has its own end."""
    monkeypatch.setattr(service, "REPLY_WAIT_S", 1.0)
    receiver = ReceiverThread()
    receiver.start()
    with RigProcess() as process:
        process.start()
        yield process, receiver, Path(os.ttyname(process._fd))
    receiver.end()
