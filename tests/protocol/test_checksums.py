import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.protocol.checksums import kogger_mod255, kogger_mod256, kogger_mod256_rows, xor8

# The vendor's own program gives the mod-256 values; the mod-255 ones are the textbook Fletcher-16 of the same bytes.
KOGGER_PAIRS = [
    ("00832000", "a3c9", "a3ca"),
    ("00030100", "040b", "040b"),
    ("0001010400000000", "0621", "0621"),
    ("00010104f9000000", "ff05", "0009"),
    ("ff", "ffff", "0000"),
    ("ffffffff", "fcf6", "0000"),
    ("008221044a5d6bc9", "8246", "844e"),
    ("00821206e80314000000", "991b", "9a26"),
]


@pytest.mark.parametrize(("data", "mod256", "mod255"), KOGGER_PAIRS)
def test_kogger_sums_match_published_pairs(data: str, mod256: str, mod255: str) -> None:
    assert kogger_mod256(bytes.fromhex(data)).hex() == mod256
    assert kogger_mod255(bytes.fromhex(data)).hex() == mod255


def slow_sums(data: bytes, modulus: int) -> bytes:
    first = second = 0
    for byte in data:
        first = (first + byte) % modulus
        second = (second + first) % modulus
    return bytes((first, second))


@given(st.binary(max_size=600))
def test_fast_sums_equal_the_definition(data: bytes) -> None:
    expected_xor = 0
    for byte in data:
        expected_xor ^= byte
    assert xor8(data) == expected_xor
    assert kogger_mod256(data) == slow_sums(data, 256)
    assert kogger_mod255(data) == slow_sums(data, 255)


@pytest.mark.parametrize("count", [0, 1, 39, 40, 41, 255, 256, 257, 4096])
def test_sums_agree_on_both_sides_of_every_length_threshold(count: int) -> None:
    data = bytes((31 * k + 7) & 0xFF for k in range(count))
    expected_xor = 0
    for byte in data:
        expected_xor ^= byte
    assert xor8(data) == expected_xor
    assert kogger_mod256(data) == slow_sums(data, 256)
    assert kogger_mod255(data) == slow_sums(data, 255)


@pytest.mark.parametrize("wrap", [bytes, bytearray, memoryview])
def test_any_bytes_like_object_is_accepted(wrap: type) -> None:
    data = bytes(range(100))
    assert xor8(wrap(data)) == xor8(data)
    assert kogger_mod256(wrap(data)) == kogger_mod256(data)
    assert kogger_mod255(wrap(data)) == kogger_mod255(data)


def test_rows_give_the_sums_of_each_row() -> None:
    rows = np.random.default_rng(1).integers(0, 256, (7, 210), dtype=np.uint8)
    sums = kogger_mod256_rows(rows)
    assert [row.tobytes() for row in sums] == [kogger_mod256(row.tobytes()) for row in rows]
