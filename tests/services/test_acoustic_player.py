"""The acoustic board's datagrams on loopback: whole frames, decoded as the real receiver decodes them."""

import asyncio
import socket
from dataclasses import replace

from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType
from bluerov_slam.services.acoustic_player import AcousticPlayer
from bluerov_slam.simulation.acoustic_board import acoustic_board
from bluerov_slam.simulation.acoustic_plan import AcousticPlan
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.scene import SimulatedScene

SCENARIO = replace(
    SCENARIOS["survey"], mission_start_s=60.0, acoustics=AcousticPlan(errors="none", record_every=2, message_every=0)
)


def _datagrams(listener):
    datagrams = []
    while True:
        try:
            datagrams.append(listener.recv(2048))
        except BlockingIOError:
            return datagrams


async def _play(player, clock, until_s):
    playing = asyncio.create_task(player.run())
    try:
        while clock[0] < until_s:
            clock[0] += 0.5
            sent = player.frames_sent
            await asyncio.sleep(0.03)
            assert not playing.done(), sent
    finally:
        playing.cancel()
        await asyncio.gather(playing, return_exceptions=True)


def test_every_datagram_is_one_whole_frame():
    clock = [0.0]
    said = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        board = acoustic_board(SCENARIO, SimulatedScene(SCENARIO))
        player = AcousticPlayer(board, lambda: clock[0], listener.getsockname(), said.append)
        asyncio.run(_play(player, clock, 6.0))
        datagrams = _datagrams(listener)
    kinds = []
    for datagram in datagrams:
        ((kind, _),) = Esp32FrameDecoder().feed(datagram)
        kinds.append(kind)
    assert len(datagrams) == player.frames_sent
    assert kinds.count(MessageType.ACOUSTIC_TDOA) in (4, 5, 6)
    assert kinds.count(MessageType.ACOUSTIC_RECORD) > 60
    assert said[0].startswith("the virtual acoustic board sends to 127.0.0.1:")


def test_it_goes_on_when_nobody_listens():
    clock = [0.0]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        address = probe.getsockname()
    board = acoustic_board(SCENARIO, SimulatedScene(SCENARIO))
    player = AcousticPlayer(board, lambda: clock[0], address)
    asyncio.run(_play(player, clock, 4.0))
    assert len(board.pulses) >= 3
