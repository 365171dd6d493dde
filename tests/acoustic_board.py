"""An acoustic receiver board of tests: true delays of a transmitter somewhere, as the frames it would send."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.protocol.acoustic_messages import (
    MessageFields,
    pack_message,
    pack_record_chunk,
    pack_tdoa,
    record_chunks,
    tdoa_fields,
)
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import AcousticRecord

LOUD = (300.0, 280.0, 310.0, 290.0)


@dataclass(slots=True)
class AcousticBoard:
    """Its clock starts anywhere; delays have the noise of a good receiver."""

    array: ReceiverArray = field(default_factory=ReceiverArray.cross)
    sound_speed_mps: float = 1500.0
    noise_s: float = 0.2e-6
    t_us: int = 4_294_000_000
    seed: int = 5
    _rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)

    def pulse(
        self,
        source_m: Sequence[float],
        std: Sequence[float] = LOUD,
        after_s: float = 1.0,
        frame_bits: int | None = 0x3C05,
    ) -> bytes:
        """The 0x08 frame of a pulse from a source in the array's frame."""
        self.t_us = (self.t_us + round(after_s * 1e6)) % 2**32
        arrivals = self.array.arrival_s(source_m, self.sound_speed_mps)
        arrivals = arrivals + self._rng.normal(0.0, self.noise_s, len(arrivals))
        delays = (arrivals[0] - arrivals)[1:]
        fields = tdoa_fields(self.t_us, 0, delays, np.array(std, float), frame_bits)
        return encode_frame(MessageType.ACOUSTIC_TDOA, pack_tdoa(fields))

    def record(self, samples: np.ndarray, rate_hz: float, record_id: int) -> list[bytes]:
        """The 0x09 frames of a record of the newest pulse."""
        record = AcousticRecord(0.0, 0.0, record_id, rate_hz, samples.astype(np.int16), 12, 0)
        return [
            encode_frame(MessageType.ACOUSTIC_RECORD, pack_record_chunk(chunk))
            for chunk in record_chunks(record, self.t_us)
        ]

    def message(self, said: bytes, corrected_errors: int = 0) -> bytes:
        """The 0x0A frame."""
        return encode_frame(
            MessageType.ACOUSTIC_MESSAGE, pack_message(MessageFields(self.t_us, corrected_errors, said))
        )


@contextlib.contextmanager
def sender(port: int) -> Iterator[socket.socket]:
    """A UDP socket that sends to a port of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        udp.connect(("127.0.0.1", port))
        yield udp


@contextlib.asynccontextmanager
async def pinging(port: int, frames: Iterator[bytes], every_s: float = 0.05) -> AsyncIterator[None]:
    """Send one datagram after the other in the background."""

    async def run() -> None:
        for data in frames:
            udp.send(data)
            await asyncio.sleep(every_s)

    with sender(port) as udp:
        task = asyncio.create_task(run())
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
