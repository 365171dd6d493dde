"""The message cells against what the modulation can do."""

from __future__ import annotations

import pytest

from bluerov_slam.acoustics.message.theory import bit_error_rate, coded_bit_error_bound, energy_to_noise
from bluerov_slam.evaluation.acoustic_cases import AcousticJob
from bluerov_slam.evaluation.acoustic_message import CASES, message_cell, rows, run


def test_theory_has_textbook_values() -> None:
    # Coherent on-off keying: 1e-5 needs E/N0 of 15.6 dB of the pulse, twice the mean energy's 12.6 dB.
    assert bit_error_rate(10.0**1.56) == pytest.approx(1e-5, rel=0.1)
    assert bit_error_rate(0.0) == 0.5
    assert coded_bit_error_bound(10.0**0.9) < 1e-3 * bit_error_rate(10.0**0.9)
    assert energy_to_noise(0.0, 421.0, 4) == pytest.approx(842.0)


def test_bits_before_correction_are_near_theory() -> None:
    cell = message_cell(-17.0, 25, seed=5)

    share = cell.bits_wrong / (25 * 327)
    assert cell.lost == 0
    # Theory knows amplitude, phase and timing; estimating them at this level costs under 1 dB.
    assert cell.bit_error_rate_in_theory < share < bit_error_rate(10.0 ** ((cell.energy_to_noise_db - 1.0) / 10.0))


def test_rows_judge_where_positioning_works() -> None:
    (case,) = CASES
    found = {cell: [run(AcousticJob("I9", cell, 1, 2), {})] for cell in ("0", "-22")}

    made = {row.id: row for row in rows(found)}

    assert made["I9.0.lost"].must is not None
    assert made["I9.0.lost"].interval.value == 0.0
    assert made["I9.-22.lost"].must is None
    assert made["I9.0.theory"].interval.value < 1e-6
    assert set(found) < set(case.cells)
