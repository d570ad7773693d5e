"""Ridge regression in closed form, for few features and for many (Hoerl and Kennard 1970)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

PENALTIES = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0)
"""Tried by `cross_validated`, relative to the mean of a standardised row's sum of squares."""


@dataclass(frozen=True)
class LinearMap:
    """``y = x @ weights + bias``.

    Attributes:
        weights: (F, T).
        bias: (T,).
    """

    weights: FloatArray
    bias: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        """(M, F) to (M, T)."""
        return np.asarray(x @ self.weights + self.bias)


def fit_ridge(x: FloatArray, y: FloatArray, penalty: float = 1e-2) -> LinearMap:
    """The linear map of least squared error plus ``penalty`` times the squared weights.

    Args:
        x: (M, F) features; they are standardised for the penalty, and a constant one gets no weight.
        y: (M, T) targets.
        penalty: Relative to the mean square of a standardised feature; the bias has none.
    """
    scale = _scale(x)
    middle, mean = x.mean(axis=0), y.mean(axis=0)
    standard = (x - middle) / scale
    gram = standard.T @ standard + penalty * len(x) * np.eye(x.shape[1])
    weights = np.linalg.solve(gram, standard.T @ (y - mean)) / scale[:, None]
    return LinearMap(weights, mean - middle @ weights)


def cross_validated(
    x: FloatArray, y: FloatArray, groups: NDArray[np.int64], penalties: Sequence[float] = PENALTIES
) -> FloatArray:
    """Predictions of each row by a ridge that was fitted without the row's group.

    The penalty is the one of ``penalties`` with the least error over all folds. Solved in the rows, of which
    there may be far fewer than features.

    Args:
        x: (M, F).
        y: (M, T).
        groups: (M,) of each row; rows of a group are never on both sides.
        penalties: See `PENALTIES`.

    Returns:
        (M, T) by the best penalty.
    """
    predictions = np.empty((len(penalties), *y.shape))
    for held in folds(groups):
        predictions[:, held] = _predict(x[~held], y[~held], x[held], penalties)
    errors = np.linalg.norm(predictions - y, axis=2).mean(axis=1)
    best: FloatArray = predictions[int(np.argmin(errors))]
    return best


def folds(groups: NDArray[np.int64], count: int = 5) -> list[NDArray[np.bool_]]:
    """Masks of the rows held out in turn; every group is in one, and there are at most ``count``."""
    _, number = np.unique(groups, return_inverse=True)
    used = min(count, int(number.max()) + 1)
    return [number % used == fold for fold in range(used)]


def _predict(x: FloatArray, y: FloatArray, held: FloatArray, penalties: Sequence[float]) -> FloatArray:
    """(penalties, rows held, T)."""
    middle, scale, mean = x.mean(axis=0), _scale(x), y.mean(axis=0)
    known, asked = (x - middle) / scale, (held - middle) / scale
    kernel, cross = known @ known.T, asked @ known.T
    size = float(np.trace(kernel)) or 1.0
    duals = [
        np.linalg.solve(kernel + penalty * size * np.eye(len(x)) / len(x), y - mean) for penalty in penalties
    ]
    return np.stack([cross @ dual + mean for dual in duals])


def _scale(x: FloatArray) -> FloatArray:
    """Standard deviations; 1 where a feature is constant."""
    deviation = x.std(axis=0)
    return np.where(deviation > 1e-9 * (1.0 + np.abs(x).max(axis=0)), deviation, 1.0)
