"""Two boards fed alike, and inputs damaged on their way to them: what the comparison of firmwares is made of."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass

import numpy as np

from bluerov_slam.protocol import esp32_messages as messages
from bluerov_slam.protocol.esp32_messages import MessageType
from bluerov_slam.protocol.kogger_bundle import expand
from bluerov_slam.protocol.sensor_frame import unpack_sensors
from bluerov_slam.simulation.board import SENSOR_BAUD, SONAR_BAUD, Board, BoardSettings, BootInfo, Output, Port, Sink

_UNPACK = {
    MessageType.SENSORS: unpack_sensors,
    MessageType.KOGGER_RAW_A: messages.unpack_kogger_raw,
    MessageType.KOGGER_RAW_B: messages.unpack_kogger_raw,
    MessageType.KOGGER_COMPRESSED: expand,
    MessageType.IMU_BURST: messages.unpack_imu_burst,
    MessageType.STATUS: messages.unpack_status,
    MessageType.COMMAND_ACK: messages.unpack_command_ack,
    MessageType.GPS: messages.unpack_gps,
}


def decoded(output: Output | None) -> str:
    """An output in words."""
    if output is None:
        return "nothing"
    where = f"{Sink(output.sink).name} at {output.at_us} us"
    if output.sink != Sink.LINK:
        return f"{where}: {output.data.hex(' ')}"
    frame_type, payload = output.data[2], output.data[5:-1]
    fields = _UNPACK[MessageType(frame_type)](payload) if frame_type in _UNPACK else None
    return f"{where}: {MessageType(frame_type).name} {fields}\n    {output.data.hex(' ')}"


class PairedBoards:
    """A `Board` that is two: the first difference in what they put out, or when, is an AssertionError."""

    def __init__(self, reference: Board, native: Board) -> None:
        self.frames: Counter[MessageType] = Counter()
        self.outputs: Counter[Sink] = Counter()
        self.highest: Counter[str] = Counter()
        """Of every field of STATUS and SENSORS."""
        self.boots = 0
        self._boards = (reference, native)
        self._compared = 0

    def boot(self, info: BootInfo, settings: BoardSettings) -> None:
        self.boots += 1
        for board in self._boards:
            board.boot(info, settings)

    def feed(self, port: int, data: bytes, at_us: int) -> None:
        for board in self._boards:
            board.feed(port, data, at_us)

    def i2c(self, what: int, data: bytes, at_us: int) -> None:
        for board in self._boards:
            board.i2c(what, data, at_us)

    def run(self, until_us: int) -> tuple[int, list[Output]]:
        (reached_us, outputs), (native_reached_us, native_outputs) = (board.run(until_us) for board in self._boards)
        if outputs != native_outputs:
            self._explain(outputs, native_outputs)
        assert reached_us == native_reached_us, f"reference reached {reached_us} us, native {native_reached_us} us"
        self._compared += len(outputs)
        for output in outputs:
            self.outputs[Sink(output.sink)] += 1
            if output.sink == Sink.LINK:
                self._note(MessageType(output.data[2]), output.data[5:-1])
        return reached_us, outputs

    def close(self) -> None:
        for board in self._boards:
            board.close()

    def _note(self, frame_type: MessageType, payload: bytes) -> None:
        self.frames[frame_type] += 1
        if frame_type in (MessageType.STATUS, MessageType.SENSORS):
            fields = _UNPACK[frame_type](payload)
            assert fields is not None
            self.highest |= Counter(asdict(fields))

    def _explain(self, outputs: list[Output], native: list[Output]) -> None:
        length = max(len(outputs), len(native))
        for index in range(length):
            ours = outputs[index] if index < len(outputs) else None
            theirs = native[index] if index < len(native) else None
            if ours != theirs:
                raise AssertionError(
                    f"boot {self.boots}, output {self._compared + index} differs\n"
                    f"  reference: {decoded(ours)}\n  native:    {decoded(theirs)}"
                )


@dataclass(slots=True)
class Damage:
    """What becomes of bytes on one line: per byte the chances of a flipped bit, of being lost, of noise before it."""

    flip: float = 0.0
    lose: float = 0.0
    noise: float = 0.0


class DamagedInputs:
    """A `Board` whose inputs come in pieces of any length and may be damaged on their way."""

    def __init__(self, board: Board, seed: int, largest_piece: int = 64) -> None:
        self.damage: dict[Port, Damage] = {}
        self._board = board
        self._rng = np.random.default_rng(seed)
        self._largest_piece = largest_piece
        self._fed_us = dict.fromkeys(Port, 0)
        self._until_us = 0

    def boot(self, info: BootInfo, settings: BoardSettings) -> None:
        self._fed_us = dict.fromkeys(Port, 0)
        self._until_us = info.boot_us
        self._board.boot(info, settings)

    def feed(self, port: int, data: bytes, at_us: int) -> None:
        data = self._damaged(data, self.damage.get(Port(port)))
        baud = SONAR_BAUD if port in (Port.SONAR_A, Port.SONAR_B) else SENSOR_BAUD
        while data:
            count = int(self._rng.integers(1, self._largest_piece + 1))
            piece, data = data[:count], data[count:]
            self._feed(Port(port), piece, at_us - len(data) * 10_000_000 // baud)

    def flood(self, port: Port, data: bytes) -> None:
        """More bytes at one instant than any line carries."""
        self._feed(port, data, self._until_us)

    def i2c(self, what: int, data: bytes, at_us: int) -> None:
        self._board.i2c(what, data, at_us)

    def run(self, until_us: int) -> tuple[int, list[Output]]:
        self._until_us = until_us
        return self._board.run(until_us)

    def close(self) -> None:
        self._board.close()

    def _feed(self, port: Port, data: bytes, at_us: int) -> None:
        self._fed_us[port] = max(self._fed_us[port], at_us)
        self._board.feed(port, data, self._fed_us[port])

    def _damaged(self, data: bytes, damage: Damage | None) -> bytes:
        if damage is None:
            return data
        out = bytearray()
        for byte, (flip, lose, noise) in zip(data, self._rng.random((len(data), 3)), strict=True):
            if noise < damage.noise:
                out += self._rng.integers(0, 256, int(self._rng.integers(1, 40)), np.uint8).tobytes()
            if flip < damage.flip:
                byte ^= 1 << int(self._rng.integers(8))
            if lose >= damage.lose:
                out.append(byte)
        return bytes(out)
