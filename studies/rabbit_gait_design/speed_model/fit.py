"""The model of the speed from step to step, by instrumental variables.

    v_k = A v_{k-1} + B_0 gamma_k + B_1 gamma_{k-1} + B_2 gamma_{k-2} + c + noise,

v_k: mean speed of step k less that of its periodic gait, m/s; gamma_k: the slope that it was made for, degrees. Each
plant has a constant c of its own: -c / (B_0 + B_1 + B_2) is the slope on which that plant keeps its gait's speed.

A speed is not what it seems: where a foot lands a little early, a step is short and seems slow. Such an error is in v_k
and, a step later, in v_{k-1}; least squares then find an A that is too small. Earlier slopes were changed at random,
moved v_{k-1}, and know nothing of its error. So v_{k-1} is first predicted from them (two-stage least squares, with
gamma_k to gamma_{k-4} as instruments).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from rabbit_description.state import Array

from rabbit_gait_design.speed_model.walks import Steps

NAMES = ("A", "B_0", "B_1", "B_2")
INSTRUMENTS = 5  # slopes, the present one and those before
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


class Rows(NamedTuple):
    """The rows of a plant's steps: regressors (n, 4), speeds (n,), instruments (n, 5)."""

    x: Array
    y: Array
    z: Array


def rows(walks: Sequence[Steps]) -> Rows:
    """The rows of one plant from the sixth step on, but for the last step of a walk, which may be a fall."""
    x, y, z = [], [], []
    for walk in walks:
        v, gamma = walk.speeds[:-1], walk.slopes[:-1]
        for k in range(INSTRUMENTS, len(v)):
            instruments = [gamma[k - back] for back in range(INSTRUMENTS)]
            x.append([v[k - 1], *instruments[: len(NAMES) - 1]])
            y.append(v[k])
            z.append(instruments)
    return Rows(np.array(x).reshape(-1, len(NAMES)), np.array(y), np.array(z).reshape(-1, INSTRUMENTS))


def without_mean(plants: Sequence[Sequence[Steps]]) -> list[Rows]:
    """The rows of each plant that has enough of them, less their mean: its constant is out."""
    tables = [rows(walks) for walks in plants]
    return [Rows(*(values - values.mean(axis=0) for values in table)) for table in tables if len(table.y) >= LEAST_ROWS]


def fitted(plants: Sequence[Sequence[Steps]]) -> SpeedModel:
    """Fits it by two-stage least squares; raises `SpeedModelError`."""
    tables = without_mean(plants)
    if len(tables) < len(NAMES):
        raise SpeedModelError(f"{len(tables)} plants with {LEAST_ROWS} steps: expected at least {len(NAMES)}")
    x, y, z = (np.concatenate(columns) for columns in zip(*tables, strict=True))
    first_stage = np.linalg.lstsq(z, x, rcond=None)[0]
    inverse = np.linalg.inv((z @ first_stage).T @ (z @ first_stage))
    coefficients = inverse @ (z @ first_stage).T @ y
    scores = np.array([(table.z @ first_stage).T @ (table.y - table.x @ coefficients) for table in tables])
    covariance = inverse @ (scores.T @ scores) @ inverse
    return SpeedModel(coefficients, 1.96 * np.sqrt(np.diag(covariance)), len(y), len(tables))


def errors(coefficients: Array, plants: Sequence[Sequence[Steps]]) -> tuple[float, float]:
    """Root mean square of the error and of the speeds themselves, m/s, each less the plant's mean."""
    tables = without_mean(plants)
    wrong = np.concatenate([y - x @ coefficients for x, y, _ in tables])
    return float(np.sqrt(np.mean(wrong**2))), float(np.sqrt(np.mean(np.concatenate([y for _, y, _ in tables]) ** 2)))
