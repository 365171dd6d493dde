import asyncio
import fcntl
import os
import sys
import termios
import time
import tty

import pytest

from bluerov_slam.pipeline.health import PortState
from bluerov_slam.sources import serial_port
from bluerov_slam.sources.port_search import find_candidates
from bluerov_slam.sources.serial_port import OpenFailure, SerialPort, SerialState, open_port
from patience import PATIENCE_S


class Board:
    """A pseudo-terminal that stands for the ESP32's port; unplugging removes its names and closes it."""

    def __init__(self):
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.node = os.ttyname(slave)
        self.links = []
        os.close(slave)

    def say(self, data):
        os.write(self.master, data)

    def hear(self):
        return os.read(self.master, 4096)

    def unplug(self):
        """The kernel gives the number away at once: a name left behind would lead to the port of another test."""
        if self.master is not None:
            for link in self.links:
                if link.is_symlink() and os.readlink(link) == self.node:
                    link.unlink()
            os.close(self.master)
            self.master = None


@pytest.fixture
def board():
    board = Board()
    yield board
    board.unplug()


@pytest.fixture
def devices(tmp_path):
    (tmp_path / "serial" / "by-id").mkdir(parents=True)
    (tmp_path / "serial" / "by-path").mkdir()
    return tmp_path


def plug(devices, board, by_id="usb-Silicon_Labs_CP2102_0001-if00-port0", node="ttyUSB0"):
    names = [devices / node]
    if by_id:
        names.append(devices / "serial" / "by-id" / by_id)
    for link in names:
        link.unlink(missing_ok=True)
        link.symlink_to(board.node)
        board.links.append(link)


class Reader:
    """Starts a port and lets a test wait for bytes and states."""

    def __init__(self, port, missing=0):
        self.port, self.missing, self.data, self.news = port, missing, bytearray(), asyncio.Event()
        port.start(self.take, self.news.set)

    def take(self, data, arrived_s):
        self.data += data
        self.arrived_s = arrived_s
        self.news.set()
        return self.missing

    async def until(self, condition):
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                self.news.clear()
                await self.news.wait()


def waiting_bytes(port):
    """What the port could read now."""
    count = bytearray(4)
    fcntl.ioctl(port._descriptor, termios.FIONREAD, count)
    return int.from_bytes(count, sys.byteorder)


async def soon(_seconds):
    await asyncio.sleep(0.001)


@pytest.fixture
async def start(devices):
    started = []

    def _start(port, missing=0, baud=115200, **options):
        serial = SerialPort(str(port), baud, device_folder=devices, sleep=soon, **options)
        started.append(serial)
        return Reader(serial, missing)

    yield _start
    for serial in started:
        await serial.stop()


async def test_auto_finds_the_port_by_its_stable_name_and_reads_it(devices, board, start):
    plug(devices, board)
    reader = start("auto")
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    board.say(b"\xaa\x55 hello \x00\xff\x11\x13\r\n")
    await reader.until(lambda: len(reader.data) == 15)
    assert bytes(reader.data) == b"\xaa\x55 hello \x00\xff\x11\x13\r\n"
    facts = reader.port.facts()
    assert facts.state is PortState.CONNECTED
    assert facts.port == board.node
    assert facts.by_id.endswith("usb-Silicon_Labs_CP2102_0001-if00-port0")


async def test_what_is_sent_arrives_unaltered(devices, board, start):
    plug(devices, board)
    reader = start("auto")
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    assert reader.port.send(b"\xaa\x55\x0a\x0d\x03\x04")
    assert board.hear() == b"\xaa\x55\x0a\x0d\x03\x04"


async def test_sending_without_a_link_or_beyond_the_buffer_is_refused_not_waited_for(devices, board, start):
    reader = start("auto")
    assert not reader.port.send(b"x")
    plug(devices, board)
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    assert not all(reader.port.send(bytes(2000)) for _ in range(100))


async def test_a_port_absent_at_start_is_named_and_opened_when_it_appears(devices, board, start):
    reader = start(devices / "ttyUSB7")
    await reader.until(lambda: reader.port.state is SerialState.ABSENT)
    facts = reader.port.facts()
    assert facts.state is PortState.ABSENT
    assert facts.waiting_for == str(devices / "ttyUSB7")
    plug(devices, board, node="ttyUSB7")
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)


async def test_recovers_by_itself_when_replugged_under_another_node(devices, start):
    first, second = Board(), Board()
    plug(devices, first, node="ttyUSB0")
    reader = start("auto")
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    first.unplug()
    await reader.until(lambda: reader.port.state is not SerialState.CONNECTED)
    plug(devices, second, node="ttyUSB1")
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    second.say(b"back")
    await reader.until(lambda: bytes(reader.data) == b"back")
    assert reader.port.reconnects == 1
    assert reader.port.facts().port == second.node
    second.unplug()


async def test_a_stale_link_is_absent_and_says_where_it_points(devices, start):
    link = devices / "esp32"
    link.symlink_to(devices / "gone")
    reader = start(link)
    await reader.until(lambda: reader.port.state is SerialState.ABSENT)
    assert f"{link}, which points to {devices / 'gone'} does not exist" in reader.port.facts().detail


async def test_a_port_held_by_another_program_is_busy_until_released(devices, board, start):
    plug(devices, board)
    holder = os.open(board.node, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    reader = start("auto")
    await reader.until(lambda: reader.port.state is SerialState.BUSY)
    facts = reader.port.facts()
    assert facts.state is PortState.BUSY
    assert facts.waiting_for == "the ESP32's USB serial port"
    assert facts.detail.startswith("another program holds ")
    os.close(holder)
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)


async def test_a_second_user_of_the_same_port_finds_it_busy(devices, board, start):
    plug(devices, board)
    reader = start("auto")
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    with pytest.raises(OpenFailure) as caught:
        open_port(devices / "ttyUSB0", 115200)
    assert caught.value.state is SerialState.BUSY


async def test_no_permission_is_named_as_such(devices, board, start, monkeypatch):
    plug(devices, board)

    def denied(*_args):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(serial_port.os, "open", denied)
    reader = start("auto")
    await reader.until(lambda: reader.port.state is SerialState.PERMISSION_DENIED)
    assert reader.port.facts().state is PortState.DENIED


async def test_a_plain_file_is_no_port(devices, start):
    (devices / "file").write_text("x")
    reader = start(devices / "file")
    await reader.until(lambda: reader.port.state is SerialState.FAILED)
    assert "is no serial port" in reader.port.facts().detail


async def test_a_silent_port_is_called_silent_until_it_speaks(devices, board, start):
    plug(devices, board)
    reader = start(devices / "ttyUSB0", silent_after_s=0.02)
    await reader.until(lambda: reader.port.state is SerialState.SILENT)
    assert reader.port.facts().waiting_for == "data from the ESP32"
    board.say(b"x")
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)


async def test_auto_passes_over_a_port_that_speaks_no_known_language(devices, start):
    stranger, esp32 = Board(), Board()
    plug(devices, stranger, by_id="usb-1a86_USB_Serial-if00", node="ttyUSB0")
    plug(devices, esp32, by_id="usb-Zzz_thing-if00", node="ttyUSB1")
    reader = start("auto", silent_after_s=0.02)
    frames = 0

    def understood():
        return bytes(reader.data).count(b"\xaa\x55")

    reader.port.frames_understood = understood
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    assert reader.port.facts().port == stranger.node
    stranger.say(b"$GPGGA,,,\r\n")
    await reader.until(lambda: reader.port.facts().port == esp32.node)
    esp32.say(b"\xaa\x55")
    await reader.until(lambda: understood() > frames)
    stranger.unplug()
    esp32.unplug()


async def test_reading_pauses_for_the_missing_bytes_of_a_frame_and_wakes_once(devices, board, start):
    plug(devices, board)
    reader = start("auto", missing=100)
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    board.say(b"1")
    await reader.until(lambda: reader.data == b"1")
    first_s = reader.arrived_s
    for _ in range(20):
        board.say(b"2")
    while waiting_bytes(reader.port) < 20:  # the kernel takes its time to carry them over
        time.sleep(0.001)
    await reader.until(lambda: len(reader.data) > 1)
    assert bytes(reader.data) == b"1" + b"2" * 20
    assert reader.arrived_s - first_s >= 100 * 10 / 115200 * 0.9
    assert reader.port.wakeups == 2


async def test_stopping_releases_the_port(devices, board):
    plug(devices, board)
    port = SerialPort("auto", 921600, device_folder=devices, sleep=soon)
    reader = Reader(port)
    await reader.until(lambda: port.state is SerialState.CONNECTED)
    await port.stop()
    os.close(open_port(devices / "ttyUSB0", 921600))


def test_candidates_come_with_the_likeliest_first_and_never_the_autopilot(devices):
    boards = [Board() for _ in range(5)]
    names = [
        "usb-ArduPilot_Pixhawk1-if00",
        "usb-FTDI_FT232R-if00",
        "usb-Silicon_Labs_CP2102-if00",
        "usb-Other-if00",
        None,
    ]
    for number, (board, name) in enumerate(zip(boards, names, strict=True)):
        plug(devices, board, by_id=name, node=f"ttyUSB{number}")
    found = [candidate.path.name for candidate in find_candidates("auto", devices)]
    assert found == ["usb-Silicon_Labs_CP2102-if00", "usb-FTDI_FT232R-if00", "usb-Other-if00", "ttyUSB4"]
    for board in boards:
        board.unplug()


def test_a_named_port_knows_its_stable_name_and_is_found_by_it_again(devices):
    board = Board()
    plug(devices, board, by_id="usb-CP2102", node="ttyUSB0")
    [candidate] = find_candidates(str(devices / "ttyUSB0"), devices)
    assert candidate.by_id == devices / "serial" / "by-id" / "usb-CP2102"
    (devices / "ttyUSB0").unlink()
    again = find_candidates(str(devices / "ttyUSB0"), devices, last_good=candidate.by_id)
    assert [str(c.node) for c in again] == [str(devices / "ttyUSB0"), board.node]
    board.unplug()


def test_by_path_and_acm_are_searched_after_the_stable_names(devices):
    boards = [Board(), Board(), Board()]
    (devices / "serial" / "by-path" / "platform-usb-0:1.3").symlink_to(boards[0].node)
    plug(devices, boards[1], by_id=None, node="ttyACM0")
    plug(devices, boards[2], by_id=None, node="ttyAMA0")
    found = [candidate.path.name for candidate in find_candidates("auto", devices)]
    assert found == ["platform-usb-0:1.3", "ttyACM0", "ttyAMA0"]
    for board in boards:
        board.unplug()


async def test_another_port_can_be_chosen_while_it_runs(devices, start):
    first, second = Board(), Board()
    plug(devices, first, by_id=None, node="ttyUSB0")
    plug(devices, second, by_id=None, node="ttyUSB1")
    reader = start(devices / "ttyUSB0")
    await reader.until(lambda: reader.port.state is SerialState.CONNECTED)
    reader.port.aim(str(devices / "ttyUSB1"), 921600)
    await reader.until(lambda: reader.port.facts().port == second.node)
    second.say(b"here")
    await reader.until(lambda: bytes(reader.data) == b"here")
    assert reader.port.facts().baud == 921600
    first.unplug()
    second.unplug()
