"""The chi-square distribution against its tables and against SciPy."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from bluerov_slam.navigation.chi_square import chi_square_cdf, chi_square_quantile


@pytest.mark.parametrize(
    ("probability", "dof", "value"),
    [(0.95, 1, 3.841), (0.95, 2, 5.991), (0.95, 3, 7.815), (0.99, 6, 16.812), (0.025, 100, 74.222), (0.999, 3, 16.266)],
)
def test_the_tables_values(probability, dof, value):
    assert chi_square_quantile(probability, dof) == pytest.approx(value, abs=6e-4)


@given(st.floats(1e-4, 1.0 - 1e-6), st.one_of(st.integers(1, 30), st.integers(100, 20_000)))
def test_agrees_with_scipy(probability, dof):
    value = chi_square_quantile(probability, dof)
    assert value == pytest.approx(chi2.ppf(probability, dof), rel=1e-8)
    assert chi_square_cdf(value, dof) == pytest.approx(probability, abs=1e-10)


def test_nothing_lies_below_zero():
    assert chi_square_cdf(0.0, 3) == chi_square_cdf(-1.0, 3) == 0.0


@pytest.mark.parametrize(("probability", "dof"), [(0.0, 1), (1.0, 1), (float("nan"), 1), (0.5, 0)])
def test_asks_for_a_probability_and_degrees_of_freedom(probability, dof):
    with pytest.raises(ValueError, match="expected"):
        chi_square_quantile(probability, dof)
