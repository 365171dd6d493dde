"""The bits of a frame that carries a message.

    1 1 1 1 0 0 | 8 bits message counter     the 14 bits of every frame: positioning sees no difference
    13 bits sync word                        Barker's sequence: pins the start, which 1 1 1 1 0 0 alone cannot
    300 bits                                 16 bytes and CRC-16, coded (`coding`)

327 bits are 0.16 s at 0.495 ms each; the next frame starts a second after this one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.message.coding import coded_bits, encode
from bluerov_slam.acoustics.message.report import PAYLOAD_BYTES
from bluerov_slam.acoustics.pulse_train import COUNTER_BITS, FRAME_BITS, HEADER_BITS, frame_bits

SYNC_BITS = (1, 1, 1, 1, 1, 0, 0, 1, 1, 0, 1, 0, 1)
BODY_START = FRAME_BITS + len(SYNC_BITS)
MESSAGE_FRAME_BITS = BODY_START + coded_bits(PAYLOAD_BYTES)

KNOWN_PLACES: NDArray[np.intp] = np.array([*range(len(HEADER_BITS)), *range(FRAME_BITS, BODY_START)])
KNOWN_BITS: NDArray[np.int8] = np.array(HEADER_BITS + SYNC_BITS, np.int8)
COUNTER_PLACES: NDArray[np.intp] = np.arange(len(HEADER_BITS), len(HEADER_BITS) + COUNTER_BITS)


def message_frame_bits(counter: int, payload: bytes) -> tuple[int, ...]:
    """All 327 bits of a frame; raises ValueError for another length than 16 bytes or a counter beyond 0 to 255."""
    if len(payload) != PAYLOAD_BYTES:
        raise ValueError(f"a message has {PAYLOAD_BYTES} bytes, not {len(payload)}")
    return frame_bits(counter) + SYNC_BITS + tuple(int(bit) for bit in encode(payload))
