from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bluerov_slam.protocol.kogger_bundle import decimate, hold
from bluerov_slam.protocol.kogger_coded import MIN_CODE_BYTES, decode, encode

LEVELS = (0, -3, 2, 3, -6, 4, 5, -9, 6, 7, -12, 8, 9, -15, 10)


def plainly_decoded(code: bytes, count: int) -> list[int] | None:
    """docs/protocol.md section 3, one bit at a time."""
    coarseness, first = code[:2]
    bits = "".join(f"{byte:08b}" for byte in code[2:])
    symbols = []
    for _ in range(count - 1):
        zeros, one, bits = bits.partition("1")
        if not one or len(zeros) > 15:
            return None
        symbols.append(len(zeros))
    mean, samples = 8 * first, [first]
    for symbol in symbols:
        half = max(1, ((16 + coarseness % 16) * 2 ** (coarseness // 16) * (mean + 192)) >> 13)
        if symbol == 15:
            if len(bits) < 8:
                return None
            sample, bits = int(bits[-8:], 2), bits[:-8]
        else:
            sample = min(max((mean + LEVELS[symbol] * half + 4) >> 3, 0), 255)
        samples.append(sample)
        mean += (8 * sample - mean) >> 2
    return None if coarseness > 240 or "1" in bits else samples


def speckle(count: int, seed: int = 1, level: float = 60.0) -> NDArray[np.uint8]:
    """What a sonar hears of sand: Rayleigh noise whose strength falls with the range."""
    falling = level * np.exp(-np.arange(count) / count)
    noise = np.random.default_rng(seed).rayleigh(0.8, count)
    return np.clip(falling * noise, 0, 255).astype(np.uint8)


def rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def decoded(samples: NDArray[np.uint8], size: int) -> NDArray[np.float64]:
    code = encode(samples.tobytes(), size)
    assert len(code) == size
    result = decode(code, samples.size)
    assert result is not None
    return result.astype(np.float64)


@given(
    st.integers(0, 255),
    st.integers(0, 255),
    st.lists(st.integers(0, 16).filter(lambda symbol: symbol != 14), max_size=120),
    st.binary(max_size=6),
    st.integers(0, 3),
)
@example(240, 255, [15, 13, 12, 15], b"\0\xff", 0)
@example(0, 0, [], b"", 0)
def test_any_symbols_decode_as_the_definition_says(
    coarseness: int, first: int, symbols: list[int], escaped: bytes, missing: int
) -> None:
    text = "".join("0" * symbol + "1" for symbol in symbols)
    size = max(MIN_CODE_BYTES, 2 + -(-len(text) // 8) + len(escaped))
    code = bytes((coarseness, first)) + int(text.ljust(8 * (size - 2), "0"), 2).to_bytes(size - 2)
    code = code[: size - len(escaped)] + escaped
    count = max(1, len(symbols) + 1 - missing)

    result = decode(code, count)

    assert (None if result is None else result.tolist()) == plainly_decoded(code, count)


@given(st.data())
def test_what_fits_comes_back_in_exactly_so_many_bytes(data: st.DataObject) -> None:
    size = data.draw(st.integers(MIN_CODE_BYTES, 60))
    count = data.draw(st.integers(1, 8 * size - 15))
    extremes = st.lists(st.sampled_from((0, 1, 128, 254, 255)), min_size=count, max_size=count).map(bytes)
    samples = data.draw(st.binary(min_size=count, max_size=count) | extremes)

    code = encode(samples, size)
    result = decode(code, count)

    assert len(code) == size
    assert result is not None
    assert result.tolist() == plainly_decoded(code, count)
    assert result[0] == samples[0]


@pytest.mark.parametrize("value", [0, 1, 77, 254, 255])
def test_a_constant_comes_back_as_it_is(value: int) -> None:
    assert decode(encode(bytes([value]) * 105, MIN_CODE_BYTES), 105).tolist() == [value] * 105  # type: ignore[union-attr]


def test_the_longest_run_that_fits_takes_even_the_wildest_samples() -> None:
    samples = bytes((0, 255)) * 56 + b"\0"
    assert len(samples) == 8 * MIN_CODE_BYTES - 15

    assert decode(encode(samples, MIN_CODE_BYTES), len(samples)).tolist() == [0] * 113  # type: ignore[union-attr]


@pytest.mark.parametrize(("count", "size"), [(0, 16), (1, 15), (114, 16), (5000, 100)])
def test_what_cannot_fit_is_refused(count: int, size: int) -> None:
    with pytest.raises(ValueError, match=f"{count} samples do not fit {size} bytes"):
        encode(bytes(count), size)


def test_quiet_runs_lose_almost_nothing() -> None:
    samples = np.random.default_rng(2).integers(100, 103, 400, np.uint8)

    assert np.abs(decoded(samples, 100) - samples).max() <= 1.0


def test_jumps_are_sent_as_they_are() -> None:
    samples = np.array([0] * 40 + [255] + [0] * 40 + [255] * 3 + [0] * 36, np.uint8)

    assert decoded(samples, 60).tolist() == samples.tolist()


@pytest.mark.parametrize("size", [600 // 2, 600 // 3, 600 // 4, 600 // 5])
def test_speckle_comes_back_closer_than_as_held_means(size: int) -> None:
    samples = speckle(600)
    decimation = samples.size // size
    held = hold(np.frombuffer(decimate(samples.tobytes(), decimation), np.uint8), samples.size, decimation)

    assert rms(decoded(samples, size) - samples) < 0.8 * rms(held.astype(np.float64) - samples)


def test_peaks_keep_their_height_within_a_decibel() -> None:
    samples = speckle(600, level=40.0)
    peaks = np.arange(20, 600, 40)
    samples[peaks] = np.random.default_rng(3).integers(100, 256, peaks.size)

    errors_db = 20.0 * np.log10(decoded(samples, 150)[peaks] / samples[peaks])

    assert np.abs(errors_db).max() < 1.0


def test_local_means_stay_true() -> None:
    samples = speckle(600)
    error = decoded(samples, 150) - samples
    averaged = error.reshape(-1, 10).mean(axis=1)

    assert rms(averaged) < 0.5 * rms(error)
    assert abs(float(error.mean())) < 0.15 * rms(error)


def test_more_bytes_bring_more_truth() -> None:
    samples = speckle(600)
    errors = [rms(decoded(samples, size) - samples) for size in (90, 120, 150, 200, 300, 600)]

    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < errors[0] / 8.0


CORRUPTIONS: list[Callable[[bytes], bytes]] = [
    lambda code: bytes((241,)) + code[1:],
    lambda code: code[:-1] + bytes((code[-1] | 1,)),
    lambda code: code[:4] + bytes(2) + code[6:],
    lambda code: code[:-9] + bytes(9),
    lambda code: code[:-1],
    lambda code: code[:15],
    lambda code: b"",
]


@pytest.mark.parametrize("corrupt", CORRUPTIONS)
def test_what_is_no_code_is_none(corrupt: Callable[[bytes], bytes]) -> None:
    samples = speckle(300).tobytes()
    code = encode(samples, 60)
    assert decode(code, 300) is not None

    assert decode(corrupt(code), 300) is None


def test_with_any_byte_changed_it_is_decoded_as_the_definition_says() -> None:
    code = encode(speckle(200).tobytes(), 50)
    outcomes = set()
    for at in range(len(code)):
        for flip in (1, 2, 4, 8, 16, 32, 64, 128, 255):
            changed = code[:at] + bytes((code[at] ^ flip,)) + code[at + 1 :]
            result = decode(changed, 200)
            assert (None if result is None else result.tolist()) == plainly_decoded(changed, 200)
            outcomes.add(result is None)
    assert outcomes == {True, False}


@given(st.binary(max_size=520), st.integers(-2, 5000))
def test_any_bytes_decode_to_so_many_samples_or_to_none(code: bytes, count: int) -> None:
    result = decode(code, count)

    assert result is None or result.size == count
