import asyncio
import os
import termios
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from pathlib import Path

import pytest

from bluerov_slam.errors import LinkError
from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType, encode_time_sync, unpack_status
from bluerov_slam.services.simulator import BURST_S, BY_ID_NAME, LONGEST_BACKLOG_S, PacedOutput, Simulator
from bluerov_slam.simulation.faults import parse_fault
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from patience import PATIENCE_S

SCENARIO = replace(SCENARIOS["survey"], mission_start_s=60.0)


def make_board(*faults: str, baud: int = 115_200) -> VirtualEsp32:
    return VirtualEsp32(replace(SCENARIO, faults=tuple(parse_fault(fault) for fault in faults)), baud)


class Reader:
    """A raw, non-blocking reader of the port, at a baud rate that no program would choose unless told."""

    def __init__(self, path: Path, speed: int | None = None) -> None:
        self.descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        if speed is not None:
            settings = termios.tcgetattr(self.descriptor)
            settings[4] = settings[5] = speed
            termios.tcsetattr(self.descriptor, termios.TCSANOW, settings)

    def read(self) -> bytes:
        with suppress(BlockingIOError):
            return os.read(self.descriptor, 1 << 16)
        return b""

    def close(self) -> None:
        os.close(self.descriptor)


@asynccontextmanager
async def running(simulator: Simulator) -> AsyncIterator[Simulator]:
    task = asyncio.create_task(simulator.run())
    try:
        await asyncio.wait_for(simulator.ready.wait(), PATIENCE_S)
        yield simulator
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


async def until(condition: Callable[[], bool]) -> None:
    """Let the simulator's own rounds go by until something holds."""
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.005)


async def test_a_reader_of_the_link_gets_frames_and_can_answer(tmp_path: Path) -> None:
    async with running(Simulator(make_board(), tmp_path / "esp32")) as simulator:
        reader = Reader(tmp_path / "esp32", termios.B115200)
        decoder = Esp32FrameDecoder()
        frames: list[tuple[int, bytes]] = []

        def heard(frame_type: MessageType) -> list[bytes]:
            frames.extend(decoder.feed(reader.read()))
            return [payload for got, payload in frames if got == frame_type]

        await until(lambda: len(heard(MessageType.SENSORS)) >= 1)
        os.write(reader.descriptor, encode_time_sync(1, 4_711))
        await until(
            lambda: any(s.echoed_host_us == 4_711 for p in heard(MessageType.STATUS) if (s := unpack_status(p)))
        )
        assert simulator.counters.bytes_received > 0
        await until(lambda: len(heard(MessageType.KOGGER_COMPRESSED)) > 4)
        reader.close()
    assert not (tmp_path / "esp32").is_symlink()


async def test_a_reader_at_another_baud_rate_gets_no_frame(tmp_path: Path) -> None:
    async with running(Simulator(make_board(), tmp_path / "esp32")) as simulator:
        reader = Reader(tmp_path / "esp32", termios.B921600)
        decoder = Esp32FrameDecoder()
        received = 0

        def enough() -> bool:
            nonlocal received
            data = reader.read()
            received += len(data)
            decoder.feed(data)
            return received > 2_000

        await until(lambda: simulator.board.now_s > 0.3)
        reader.read()
        await until(enough)
        assert decoder.counters.frames_ok == 0
        reader.close()


async def test_what_nobody_listens_to_is_gone(tmp_path: Path) -> None:
    async with running(Simulator(make_board(), tmp_path / "esp32")) as simulator:
        await until(lambda: simulator.counters.bytes_unheard > 1_000)
        assert simulator.counters.bytes_written == 0


async def test_a_reader_that_does_not_read_loses_bytes_and_blocks_nobody(tmp_path: Path) -> None:
    board = VirtualEsp32(replace(SCENARIOS["high_resolution"], mission_start_s=60.0), 921_600)
    async with running(Simulator(board, tmp_path / "esp32")) as simulator:
        reader = Reader(tmp_path / "esp32")
        await until(lambda: simulator.counters.bytes_dropped > 0)
        reader.close()


async def test_unplug_hangs_up_and_replug_has_another_node_behind_the_same_name(tmp_path: Path) -> None:
    said: list[str] = []
    board = make_board("kind=unplug at=0.3 duration=1.5")
    device_folder = tmp_path / "dev"
    async with running(Simulator(board, device_folder=device_folder, on_event=said.append)) as simulator:
        by_id = device_folder / "serial" / "by-id" / BY_ID_NAME
        before = by_id.resolve()
        assert (device_folder / "ttyUSB0").resolve() == before
        reader = Reader(by_id)

        def hung_up() -> bool:
            try:
                return os.read(reader.descriptor, 1 << 16) == b""
            except BlockingIOError:
                return False
            except OSError:
                return True

        await until(lambda: not by_id.is_symlink())
        assert not (device_folder / "ttyUSB0").is_symlink()
        await until(hung_up)
        reader.close()
        await until(lambda: simulator.path is not None)
        assert by_id.resolve() != before
        assert (device_folder / "ttyUSB1").resolve() == by_id.resolve()
        second = Reader(by_id)
        # Whoever opens a port late misses the boot text: any byte shows that the new node is alive.
        await until(lambda: len(second.read()) > 0)
        second.close()
    assert [text.split()[:2] for text in said] == [["serial", "port"]] * 3


async def test_replug_can_rename_the_link(tmp_path: Path) -> None:
    async with running(
        Simulator(make_board("kind=unplug at=0.1 duration=1 rename=1"), tmp_path / "esp32")
    ) as simulator:
        await until(lambda: (tmp_path / "esp32-2").exists())
        assert simulator.path == tmp_path / "esp32-2"
        assert not (tmp_path / "esp32").is_symlink()


async def test_never_replaces_a_file_by_its_link(tmp_path: Path) -> None:
    precious = tmp_path / "esp32"
    precious.write_text("data")
    with pytest.raises(LinkError, match="no symbolic link"):
        await Simulator(make_board(), precious).run()
    assert precious.read_text() == "data"


async def test_replaces_a_stale_link(tmp_path: Path) -> None:
    link = tmp_path / "esp32"
    link.symlink_to(tmp_path / "gone")
    async with running(Simulator(make_board(), link)):
        assert link.resolve().exists()


def test_output_is_paced_after_a_stall() -> None:
    output = PacedOutput()
    output.add(bytes(10_000))
    assert len(output.take(1.0, 11_520.0)) == int(BURST_S * 11_520.0)
    assert len(output.take(0.01, 11_520.0)) in (115, 116)
    assert len(output) == 10_000 - int(BURST_S * 11_520.0) - 115


def test_a_long_stall_holds_virtual_time_back_on_a_full_line(tmp_path: Path) -> None:
    simulator = Simulator(VirtualEsp32(SCENARIOS["saturated"]), tmp_path / "esp32")
    simulator.tick(0.01)
    simulator.tick(5.0)
    assert simulator.board.now_s == pytest.approx(LONGEST_BACKLOG_S, abs=0.02)
    assert simulator.counters.stalls == 1
