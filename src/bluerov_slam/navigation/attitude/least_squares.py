"""Small robust least squares: Levenberg and Marquardt's method with Huber weights, for a handful of unknowns."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_HUBER = 1.345
_MAD_TO_STD = 1.4826


class Fit(NamedTuple):
    """`information`: J^T W J at the solution, for unit noise. `scale`: robust one sigma of the residuals."""

    parameters: NDArray[np.float64]
    residuals: NDArray[np.float64]
    weights: NDArray[np.float64]
    information: NDArray[np.float64]
    scale: float
    converged: bool


def fit(
    residuals_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    start: NDArray[np.float64],
    steps: NDArray[np.float64],
    prior_information: NDArray[np.float64] | None = None,
    iterations: int = 60,
) -> Fit:
    """Minimises Huber's loss of the residuals (n,) plus (p - start)^T prior (p - start).

    `steps`: sizes of the central differences, one per unknown; also what counts as having converged (a thousandth).
    """
    parameters = start.astype(np.float64)
    prior = np.zeros((len(start), len(start))) if prior_information is None else prior_information
    damping = 1e-6
    residuals = residuals_of(parameters)
    scale, weights = _weights(residuals)
    information = prior
    converged = False
    for _ in range(iterations):
        jacobian = np.stack(
            [(residuals_of(parameters + d) - residuals_of(parameters - d)) / (2.0 * d.sum()) for d in np.diag(steps)],
            axis=1,
        )
        information = jacobian.T @ (weights[:, None] * jacobian) + prior * scale**2
        gradient = jacobian.T @ (weights * residuals) + prior @ (parameters - start) * scale**2
        cost = _cost(residuals, weights, parameters - start, prior * scale**2)
        while damping < 1e8:
            try:
                change = -np.linalg.solve(information + damping * np.diag(np.diag(information) + 1e-300), gradient)
            except np.linalg.LinAlgError:
                damping *= 10.0
                continue
            tried = residuals_of(parameters + change)
            if np.isfinite(tried).all() and (
                _cost(tried, weights, parameters + change - start, prior * scale**2) <= cost * (1.0 + 1e-12)
            ):
                break
            damping *= 10.0
        else:
            break
        parameters, residuals = parameters + change, tried
        damping = max(1e-9, damping * 0.1)
        scale, weights = _weights(residuals)
        if bool((np.abs(change) <= 1e-3 * steps).all()):
            converged = True
            break
    return Fit(parameters, residuals, weights, information, scale, converged)


def _weights(residuals: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    scale = max(_MAD_TO_STD * float(np.median(np.abs(residuals))), 1e-12)
    return scale, np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(residuals), 1e-300))


def _cost(
    residuals: NDArray[np.float64], weights: NDArray[np.float64], off: NDArray[np.float64], prior: NDArray[np.float64]
) -> float:
    return float((weights * residuals**2).sum() + off @ prior @ off)
