"""Logistic regression: from the features of a touchdown to the probability of a miss.

    p = 1 / (1 + exp(-score)),    score = w' z + b

z are the features less their mean over their spread, clipped. (w, b) maximise the likelihood less RIDGE w'w / 2. The
bias has no ridge, so the mean of p over the steps that it is fitted on is their rate of misses.
"""

from pathlib import Path
from typing import Self

import numpy as np
from pydantic import ValidationError, model_validator
from rabbit_description.bounded_file import FileError, read_bytes
from rabbit_description.state import Array
from rabbit_description.validation import Checked, one_line
from scipy.optimize import minimize
from scipy.special import expit

from rabbit_misses.touchdowns import FEATURES

MOST_BYTES = 1_000_000  # of a file
RIDGE = 10.0
CLIP = 4.0  # spreads from the mean
LEAST_MISSES = 12  # that a fit takes


class MissModelError(ValueError):
    """A file that is no model of the probability of a miss, or too little to fit one: names what is wrong."""


class MissProbability(Checked):
    """A fitted model: mean, spread and weight of each feature, and the bias."""

    features: tuple[str, ...]
    mean: tuple[float, ...]
    spread: tuple[float, ...]
    weights: tuple[float, ...]
    bias: float
    fitted_on: str

    @model_validator(mode="after")
    def _parts_fit_together(self) -> Self:
        if self.features != FEATURES:
            raise ValueError(f"features = {self.features}: expected {FEATURES}")
        for name in ("mean", "spread", "weights"):
            if len(getattr(self, name)) != len(FEATURES) or not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} = {getattr(self, name)}: expected {len(FEATURES)} finite numbers")
        if min(self.spread) <= 0:
            raise ValueError(f"spread = {self.spread}: expected positive numbers")
        if not np.isfinite(self.bias):
            raise ValueError(f"bias = {self.bias}: expected a finite number")
        return self

    @classmethod
    def fitted(cls, rows: Array, missed: Array, fitted_on: str) -> Self:
        """Fits it to `rows` (n, 17) of touchdowns and to whether each step `missed` (n,).

        Raises:
            MissModelError: fewer misses than LEAST_MISSES.
        """
        if missed.sum() < LEAST_MISSES:
            raise MissModelError(f"{int(missed.sum())} misses: expected at least {LEAST_MISSES} to fit")
        mean, spread = rows.mean(axis=0), rows.std(axis=0)
        spread = np.where(spread > 0, spread, 1.0)
        z = _standardised(rows, mean, spread)

        def loss(x: Array) -> tuple[float, Array]:
            score = z @ x[:-1] + x[-1]
            wrong = expit(score) - missed
            value = np.sum(np.logaddexp(0.0, score) - missed * score) + RIDGE * x[:-1] @ x[:-1] / 2
            return float(value), np.append(z.T @ wrong + RIDGE * x[:-1], wrong.sum())

        *weights, bias = minimize(loss, np.zeros(rows.shape[1] + 1), jac=True, method="L-BFGS-B").x.tolist()
        numbers = {"mean": mean.tolist(), "spread": spread.tolist(), "weights": weights, "bias": bias}
        return cls.model_validate({"features": FEATURES, "fitted_on": fitted_on, **numbers})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file; raises `MissModelError`."""
        try:
            return cls.model_validate_json(read_bytes(path, MOST_BYTES))
        except (FileError, ValidationError) as error:
            raise MissModelError(f"{path}: {one_line(error)}") from error

    @classmethod
    def shipped(cls) -> Self:
        """That of `--parameters best`, see studies/docs/misses.md."""
        return cls.load(Path(__file__).with_name("best.json"))

    def at(self, rows: Array) -> Array:
        """The probability of a miss (n,) for features (n, 17)."""
        z = _standardised(rows, np.array(self.mean), np.array(self.spread))
        return expit(z @ np.array(self.weights) + self.bias)


def _standardised(rows: Array, mean: Array, spread: Array) -> Array:
    return np.clip((rows - mean) / spread, -CLIP, CLIP)
