"""The model of the speed from step to step, by least squares.

    v_k = A v_{k-1} + B_0 gamma_k + B_1 gamma_{k-1} + B_2 gamma_{k-2} + c + noise,

v_k: mean speed of step k less that of its periodic gait, m/s; gamma_k: the slope that it was made for, degrees. Each
plant has a constant c of its own: -c / (B_0 + B_1 + B_2) is the slope on which that plant keeps its gait's speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rabbit_description.state import Array

from rabbit_experiments.speed_model.walks import Steps

NAMES = ("A", "B_0", "B_1", "B_2")
FIRST = 3  # steps of a walk in which the robot is being identified
LEAST_ROWS = 10  # of a plant


class SpeedModelError(ValueError):
    """Too few steps to fit: names how many there are."""


@dataclass(frozen=True)
class SpeedModel:
    """`coefficients` (4,) as in NAMES and half the width of their 95% intervals, from the spread between plants."""

    coefficients: Array
    half_widths: Array
    steps: int
    plants: int


def rows(walks: Sequence[Steps]) -> tuple[Array, Array]:
    """Regressors (n, 4) and speeds (n,) of one plant; the last step of a walk, which may be a fall, is left out."""
    found = []
    for walk in walks:
        v, gamma = walk.speeds[:-1], walk.slopes[:-1]
        found += [(v[k - 1], gamma[k], gamma[k - 1], gamma[k - 2], v[k]) for k in range(FIRST, len(v))]
    table = np.array(found).reshape(-1, len(NAMES) + 1)
    return table[:, :-1], table[:, -1]


def without_mean(plants: Sequence[Sequence[Steps]]) -> list[tuple[Array, Array]]:
    """The rows of each plant that has enough of them, less their mean: its constant is out."""
    tables = [rows(walks) for walks in plants]
    return [(x - x.mean(axis=0), y - y.mean()) for x, y in tables if len(y) >= LEAST_ROWS]


def fitted(plants: Sequence[Sequence[Steps]]) -> SpeedModel:
    """By least squares; raises `SpeedModelError`."""
    tables = without_mean(plants)
    if len(tables) < len(NAMES):
        raise SpeedModelError(f"{len(tables)} plants with {LEAST_ROWS} steps: expected at least {len(NAMES)}")
    inverse = np.linalg.inv(sum(x.T @ x for x, _ in tables))
    coefficients = inverse @ sum(x.T @ y for x, y in tables)
    scores = np.array([x.T @ (y - x @ coefficients) for x, y in tables])
    covariance = inverse @ (scores.T @ scores) @ inverse
    steps = sum(len(y) for _, y in tables)
    return SpeedModel(coefficients, 1.96 * np.sqrt(np.diag(covariance)), steps, len(tables))


def errors(coefficients: Array, plants: Sequence[Sequence[Steps]]) -> tuple[float, float]:
    """Root mean square of the error and of the speeds themselves, m/s, each less the plant's mean."""
    tables = without_mean(plants)
    wrong = np.concatenate([y - x @ coefficients for x, y in tables])
    return float(np.sqrt(np.mean(wrong**2))), float(np.sqrt(np.mean(np.concatenate([y for _, y in tables]) ** 2)))
