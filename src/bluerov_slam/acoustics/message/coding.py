"""Forward error correction of the message: CRC-16, whitening, a convolutional code, interleaving.

The code is the rate 1/2, constraint length 7 one with generators 171 and 133 (octal), free distance 10 (Odenwalder
1970; CCSDS 131.0-B), decoded by Viterbi's algorithm on soft values. Six zero bits end the trellis in a known state.
"""

from __future__ import annotations

import binascii

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BitArray = NDArray[np.int8]

CRC_BYTES = 2
_MEMORY = 6
_STATES = 1 << _MEMORY
_GENERATORS = (0o171, 0o133)
_INTERLEAVER_ROWS = 15
_CRC_START = 0xFFFF

# Information bits in error, summed over all paths of each Hamming distance: the terms of the union bound.
DISTANCE_WEIGHTS = ((10, 36), (12, 211), (14, 1404), (16, 11633), (18, 77433))


def coded_bits(payload_bytes: int) -> int:
    """How many bits a payload of this length becomes."""
    return 2 * (8 * (payload_bytes + CRC_BYTES) + _MEMORY)


def encode(payload: bytes) -> BitArray:
    """The bits to send for these bytes."""
    protected = payload + binascii.crc_hqx(payload, _CRC_START).to_bytes(CRC_BYTES, "big")
    bits = np.unpackbits(np.frombuffer(protected, np.uint8)) ^ _whitening(8 * len(protected))
    interleaved: BitArray = _convolve(bits)[_interleaving(2 * (len(bits) + _MEMORY))]
    return interleaved


def decode(log_likelihood: FloatArray) -> tuple[bytes | None, int, BitArray]:
    """Payload, corrected bits and the most likely code word from one log-likelihood ratio per sent bit.

    A ratio is ln p(1) / p(0), in any scale. The payload is None where the CRC does not agree. Raises ValueError for a
    length that no payload has.
    """
    if len(log_likelihood) < coded_bits(1) or len(log_likelihood) % 16 != coded_bits(1) % 16:
        raise ValueError(f"{len(log_likelihood)} coded bits: no payload has this length")
    order = _interleaving(len(log_likelihood))
    soft = np.empty(len(log_likelihood))
    soft[order] = log_likelihood
    bits = _viterbi(soft)
    word = _convolve(bits)[order]
    corrected = int(np.count_nonzero((log_likelihood > 0.0) != (word > 0)))
    protected = np.packbits(bits ^ _whitening(len(bits))).tobytes()
    payload, crc = protected[:-CRC_BYTES], protected[-CRC_BYTES:]
    intact = binascii.crc_hqx(payload, _CRC_START) == int.from_bytes(crc, "big")
    return (payload if intact else None), corrected, word


def _convolve(bits: NDArray[np.uint8]) -> BitArray:
    ended = np.concatenate([bits, np.zeros(_MEMORY, np.uint8)])
    taps = [[generator >> (_MEMORY - delay) & 1 for delay in range(_MEMORY + 1)] for generator in _GENERATORS]
    coded = [np.convolve(ended, tap)[: len(ended)] % 2 for tap in taps]
    return np.stack(coded, axis=1).reshape(-1).astype(np.int8)


def _trellis() -> tuple[NDArray[np.intp], FloatArray]:
    """Per state reached: the two states it may come from, and the two code bits (+-1) on each way."""
    states = np.arange(_STATES)
    before = np.stack([(states << 1) & (_STATES - 1), ((states << 1) & (_STATES - 1)) | 1], axis=1)
    register = (states[:, None] >> (_MEMORY - 1) << _MEMORY) | before  # newest bit on top
    signs = np.empty((_STATES, 2, 2))
    for output, generator in enumerate(_GENERATORS):
        parity = np.zeros_like(register)
        for shift in range(_MEMORY + 1):
            parity ^= (register & generator) >> shift & 1
        signs[:, :, output] = 2.0 * parity - 1.0
    return before, signs


_BEFORE, _SIGNS = _trellis()


def _viterbi(soft: FloatArray) -> NDArray[np.uint8]:
    """Most likely information bits (without the tail) of the code word with these log-likelihood ratios."""
    steps = len(soft) // 2
    gains = soft.reshape(steps, 1, 2)[:, :, None, :] * _SIGNS  # (steps, states, 2, 2)
    branch = gains.sum(axis=3)
    metric = np.full(_STATES, -np.inf)
    metric[0] = 0.0
    choices = np.empty((steps, _STATES), np.int8)
    for step in range(steps):
        candidates = metric[_BEFORE] + branch[step]
        choices[step] = candidates[:, 1] > candidates[:, 0]
        metric = candidates.max(axis=1)
    state = 0
    bits = np.empty(steps, np.uint8)
    for step in range(steps - 1, -1, -1):
        bits[step] = state >> (_MEMORY - 1)
        state = int(_BEFORE[state, choices[step, state]])
    return bits[:-_MEMORY]


def _whitening(count: int) -> NDArray[np.uint8]:
    """Sequence of the register x^7 + x^4 + 1 from all ones: a message of zeros shall not be silence."""
    register, sequence = 0x7F, np.empty(count, np.uint8)
    for index in range(count):
        bit = (register >> 6 ^ register >> 3) & 1
        register = (register << 1 | bit) & 0x7F
        sequence[index] = bit
    return sequence


def _interleaving(count: int) -> NDArray[np.intp]:
    """Which code bit is sent at each place: neighbours are sent `count / 15` places apart."""
    places = np.arange(-(-count // _INTERLEAVER_ROWS) * _INTERLEAVER_ROWS).reshape(-1, _INTERLEAVER_ROWS).T.reshape(-1)
    return places[places < count]
