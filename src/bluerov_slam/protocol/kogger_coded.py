"""Coding 2 of KOGGER_COMPRESSED: a run of samples in a given number of bytes, as true as those allow.

A running mean predicts each sample. What is sent is a symbol for how far the sample lies from it, counted in steps that
grow with the mean (echoes are noisy in proportion to their strength) and that are finer above it than below, so that
peaks keep their height. One number per run, the coarseness, scales all steps; the encoder takes the finest that fits.
Symbols are in unary: near their mean, samples are so common that nothing cleverer saves more than a few per cent.

    u8 coarseness 0..240 | u8 first sample | bits, most significant first: for every further sample `symbol` zeros and
    a one | zeros | the samples whose symbol is 15 as they are, from the last byte backwards

`mean` is in 1/8 of an amplitude, `half` is half a step. docs/protocol.md section 3 has the arithmetic. Any encoder may
choose its symbols freely; this one is the firmware's, bit for bit.
"""

from __future__ import annotations

from array import array
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

MIN_CODE_BYTES = 16
"""In less the header weighs too much: means do it there."""

MAX_COARSENESS = 240
"""At this one no sample is far enough from any mean to be another symbol than 0, so that every run fits."""

ESCAPE = 15
"""This symbol says that the sample is sent as it is."""

_HEADER_BYTES = 2
_HEADER_BITS = 8 * _HEADER_BYTES
_TOP = 255 * 8
_FLOOR = 24 * 8
"""Steps shrink with the mean, but not as if darkness were free of noise."""

_LEVELS = (0, -3, 2, 3, -6, 4, 5, -9, 6, 7, -12, 8, 9, -15, 10)
"""What each symbol adds to the mean, in half steps."""

_USUAL_COARSENESS = 96
_MOST_ATTEMPTS = 8
_GUESSES = 4
_MOST_COARSER = 64
_CACHED_COARSENESSES = 64


def encode(samples: bytes, size: int) -> bytes:
    """At least one sample in exactly `size` bytes, 16 or more; there must be fewer than 8 size - 14 of them."""
    if not 0 < len(samples) < 8 * size - 14 or size < MIN_CODE_BYTES:
        raise ValueError(f"{len(samples)} samples do not fit {size} bytes")
    coarseness, symbols = _finest(samples, 8 * size)
    ends = np.cumsum(np.array(symbols, np.int64) + 1) + (_HEADER_BITS - 1)
    bits = np.zeros(8 * size, np.uint8)
    bits[ends] = 1
    code = bytearray(np.packbits(bits).tobytes())
    code[:_HEADER_BYTES] = coarseness, samples[0]
    escaped = bytes([sample for symbol, sample in zip(symbols, samples[1:], strict=True) if symbol == ESCAPE])
    code[size - len(escaped) :] = escaped[::-1]
    return bytes(code)


def decode(code: bytes, count: int) -> NDArray[np.uint8] | None:
    """The `count` samples of a code, or None if it is none. Never raises for any bytes."""
    if len(code) < MIN_CODE_BYTES or count < 1 or code[0] > MAX_COARSENESS:
        return None
    bits = np.unpackbits(np.frombuffer(code, np.uint8, offset=_HEADER_BYTES))
    ends = np.flatnonzero(bits)[: count - 1]
    if ends.size < count - 1:
        return None
    symbols = ends.copy()
    symbols[1:] -= ends[:-1] + 1
    escapes = np.flatnonzero(symbols >= ESCAPE)
    start, stop = int(ends[-1]) + 1 if count > 1 else 0, bits.size - 8 * escapes.size
    if (escapes.size and symbols.max() > ESCAPE) or start > stop or bits[start:stop].any():
        return None
    means = _means(code, symbols.astype(np.uint8).tobytes(), escapes.tolist())
    samples = np.empty(count, np.uint8)
    samples[0] = code[1]
    # The only sample that leads from one mean to the next.
    samples[1:] = (4 * means[1:] - 3 * means[:-1] + 7) >> 3
    return samples


def _means(code: bytes, symbols: bytes, escapes: list[int]) -> NDArray[np.int32]:
    """The running mean before each symbol and behind the last."""
    table = _transitions(code[0])
    mean = code[1] << 7
    means = [mean]
    at = 0
    for number, escape in enumerate(escapes):
        means += [mean := table[mean | symbol] for symbol in symbols[at:escape]]
        mean = _moved(mean >> 4, code[-1 - number]) << 4
        means.append(mean)
        at = escape + 1
    means += [mean := table[mean | symbol] for symbol in symbols[at:]]
    return np.fromiter(means, np.int32, len(means)) >> 4


@lru_cache(maxsize=_CACHED_COARSENESSES)
def _transitions(coarseness: int) -> array[int]:
    """At 16 x mean + symbol: 16 x the next mean. A look-up takes a fifth of the time of the arithmetic."""
    mean = np.arange(_TOP + 1)[:, None]
    half = np.maximum(1, _scale(coarseness) * (mean + _FLOOR) >> 13)
    samples = np.clip((mean + np.array((*_LEVELS, 0)) * half + 4) >> 3, 0, 255)
    return array("H", ((mean + ((8 * samples - mean) >> 2)) << 4).astype(np.uint16).tobytes())


def _scale(coarseness: int) -> int:
    """Sixteen to the octave."""
    return (16 + coarseness % 16) << (coarseness // 16)


def _moved(mean: int, sample: int) -> int:
    return mean + ((8 * sample - mean) >> 2)


def _finest(samples: bytes, most_bits: int) -> tuple[int, list[int]]:
    """The least coarseness of which so many bits are enough, as far as a few attempts tell, and its symbols."""
    least_bits = _HEADER_BITS + len(samples) - 1
    too_fine, fitting = -1, MAX_COARSENESS + 1
    best: list[int] | None = None
    coarseness = _USUAL_COARSENESS
    for attempt in range(1, _MOST_ATTEMPTS + 1):
        symbols = _symbols(samples, coarseness)
        bits = least_bits + sum(symbols) + 8 * symbols.count(ESCAPE)
        if bits <= most_bits:
            fitting, best = coarseness, symbols
        else:
            too_fine = coarseness
        by = _coarser_by(bits - least_bits, most_bits - least_bits)
        if by == 0 or fitting - too_fine == 1:
            break
        coarseness += by
        if attempt >= _GUESSES:
            coarseness = (too_fine + fitting) // 2
        if attempt == _MOST_ATTEMPTS - 1 and best is None:
            coarseness = MAX_COARSENESS  # the last attempt must fit
        coarseness = min(max(coarseness, too_fine + 1), fitting - 1)
    assert best is not None
    return fitting, best


def _coarser_by(excess: int, room: int) -> int:
    """How much coarser the steps must be for `excess` bits to become `room`; 0 if they hardly can be finer. A guess."""
    by = 0
    excess, room = 256 * excess, 256 * room
    if excess > room:
        while by < _MOST_COARSER and excess > room:
            excess -= excess >> 4
            by += 1
        return by
    while by > -_MOST_COARSER and excess + (excess >> 4) <= room:
        excess += excess >> 4
        by -= 1
    return by


def _symbols(samples: bytes, coarseness: int) -> list[int]:
    """The symbols of all samples but the first."""
    scale = _scale(coarseness)
    mean = 8 * samples[0]
    owed = 0
    symbols: list[int] = []
    add = symbols.append
    for sample in samples[1:]:
        half = scale * (mean + _FLOOR) >> 13 or 1
        away = deviation = 8 * sample - mean
        if away < 2 * half:
            # Part of what earlier samples lost: local means stay true, and peaks are left alone.
            deviation += owed >> 3
        if -15 * half < 8 * deviation < 10 * half and 3 * half <= mean <= _TOP - 2 * half:
            add(0)  # by far the most
            error = (mean + 4 & ~7) - mean
        else:
            symbol = _symbol(min(max(deviation, -mean), _TOP - mean), mean, half)
            add(symbol)
            decoded = min(max(mean + _LEVELS[symbol] * half + 4 >> 3, 0), 255) if symbol < ESCAPE else sample
            error = 8 * decoded - mean
        owed += away - error - (owed >> 2)
        mean += error >> 2
    return symbols


def _symbol(deviation: int, mean: int, half: int) -> int:
    """The symbol for a deviation that stays inside the scale; a level is taken from 5/8 of the way to it."""
    if deviation >= 0:  # levels 2, 3, 4... half steps up
        level = max(1, (8 * deviation - 5 * half) // (8 * half)) if 8 * deviation >= 10 * half else 0
        reached = (level + 1) * half if level else 0
        room = _TOP - mean
        if reached < room < (level + 2) * half:
            level += _takes_edge(deviation, reached, room, 0 if level else half)
        return min(level + (level + 1 >> 1), ESCAPE)
    level = (8 * -deviation + 9 * half) // (24 * half)  # levels 3, 6, 9... half steps down
    reached = 3 * level * half
    if reached < mean < reached + 3 * half:
        level += _takes_edge(-deviation, reached, mean, 0 if level else half)
    return min(3 * level - 2, ESCAPE) if level else 0


def _takes_edge(deviation: int, reached: int, edge: int, half: int) -> bool:
    """Whether the next level, which the end of the scale cuts short, is the better one, and not just noise there."""
    return deviation >= max(reached + (5 * (edge - reached) >> 3), half >> 2)
