"""The code against its known properties."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from bluerov_slam.acoustics.message.coding import coded_bits, decode, encode

_PAYLOAD = bytes(range(40, 56))


def _ratios(bits: np.ndarray, noise: float, seed: int) -> np.ndarray:
    return 2.0 * bits - 1.0 + noise * np.random.default_rng(seed).standard_normal(len(bits))


def test_length_and_balance() -> None:
    assert len(encode(_PAYLOAD)) == coded_bits(16) == 300
    zeros = encode(bytes(16))
    assert 0.4 < zeros.mean() < 0.6  # whitened: no long silence
    longest = max(len(list(run)) for bit, run in itertools.groupby(zeros) if bit == 0)
    assert longest <= 12


def test_free_distance_is_ten() -> None:
    base = encode(_PAYLOAD).astype(int)
    distances = []
    for index in range(128):
        changed = bytearray(_PAYLOAD)
        changed[index // 8] ^= 128 >> index % 8
        distances.append(int(np.abs(encode(bytes(changed)) - base).sum()))
    # One changed bit also changes the CRC, so its code word differs in two separate places, each by 10 or more.
    assert min(distances) >= 20


def test_twelve_scattered_weak_errors_are_corrected() -> None:
    word = encode(_PAYLOAD)
    for seed in range(20):
        places = np.random.default_rng(seed).choice(len(word), 12, replace=False)
        ratios = 2.0 * word - 1.0
        ratios[places] *= -0.5

        payload, corrected, again = decode(ratios)

        assert payload == _PAYLOAD
        assert corrected == 12
        assert (again == word).all()


def test_burst_of_fifteen_lost_bits_is_corrected() -> None:
    word = encode(_PAYLOAD)
    for start in range(0, 285, 5):
        ratios = 2.0 * word - 1.0
        ratios[start : start + 15] = 0.0
        assert decode(ratios)[0] == _PAYLOAD


def test_noise_beyond_the_code_is_noticed() -> None:
    passed = [decode(_ratios(np.full(300, 0.5), 1.0, seed))[0] for seed in range(200)]
    assert passed.count(None) >= 199  # a CRC of 16 bits lets one in 65536 through


def test_decodes_at_the_signal_to_noise_ratio_published_for_this_code() -> None:
    # Eb/N0 of 4 dB: bit error rate near 4e-5 (the code's published curve), so nearly every packet comes through.
    noise = float(np.sqrt(0.5 / (0.5 * 10.0**0.4)))
    word = encode(_PAYLOAD)
    lost = sum(decode(_ratios(word, noise, seed))[0] != _PAYLOAD for seed in range(200))
    assert lost <= 2


@pytest.mark.parametrize("count", [0, 44, 59, 299, 301])
def test_impossible_length_is_refused(count: int) -> None:
    with pytest.raises(ValueError, match="no payload"):
        decode(np.zeros(count))
