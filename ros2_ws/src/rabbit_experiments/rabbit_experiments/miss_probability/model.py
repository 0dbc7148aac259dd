"""Logistic regression, calibrated: from the features of a touchdown to the probability of a miss.

The score is w' z + b, z the features less their mean over their spread, clipped; (w, b) maximise the likelihood less
RIDGE w'w / 2. Scores of steps that the fit has not seen (five folds, each of whole walks) are sorted into bins of
equally many misses, so that the bins are fine where misses are frequent; a bin's probability is (misses + 1/2) /
(steps + 1), made to increase with the score, and linear in the score between the bins' means. So p is a frequency that
was counted, and never 0.
"""

from pathlib import Path
from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from rabbit_description.state import Array
from scipy.optimize import isotonic_regression, minimize
from scipy.special import expit

from rabbit_experiments.miss_probability.touchdowns import FEATURES

RIDGE = 10.0
CLIP = 4.0  # spreads from the mean
FOLDS = 5
BINS = 12


class ModelError(ValueError):
    """A file that is no model of the probability of a miss, or too little to fit one: names what is wrong."""


class MissProbability(BaseModel):
    """A fitted model; `scores` and `probabilities` are the ends of its calibration's lines, increasing."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    features: tuple[str, ...]
    mean: tuple[float, ...]
    spread: tuple[float, ...]
    weights: tuple[float, ...]
    bias: float
    scores: tuple[float, ...]
    probabilities: tuple[float, ...]
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
        if not (len(self.scores) == len(self.probabilities) >= 2 and np.all(np.diff(self.scores) > 0)):
            raise ValueError(f"scores = {self.scores}: expected two or more, increasing, with a probability each")
        if not (
            np.all(np.diff(self.probabilities) >= 0) and 0 < min(self.probabilities) <= max(self.probabilities) < 1
        ):
            raise ValueError(f"probabilities = {self.probabilities}: expected increasing ones between 0 and 1")
        return self

    @classmethod
    def fitted(cls, rows: Array, missed: Array, walks: Array, fitted_on: str) -> Self:
        """Of `rows` (n, 17) of touchdowns, whether each step `missed` (n,), and the number of its walk (n,).

        Raises:
            ModelError: fewer than BINS misses, or walks than FOLDS.
        """
        if missed.sum() < BINS or len(np.unique(walks)) < FOLDS:
            seen = f"{int(missed.sum())} misses in {len(np.unique(walks))} walks"
            raise ModelError(f"{seen}: expected at least {BINS} misses and {FOLDS} walks to fit")
        scores = np.empty(len(rows))
        for fold in range(FOLDS):
            held = walks % FOLDS == fold
            scores[held] = _score(rows[held], *_fit(rows[~held], missed[~held]))
        knots, probabilities = calibrated(scores, missed)
        mean, spread, weights, bias = _fit(rows, missed)
        return cls(
            features=FEATURES,
            mean=tuple(mean.tolist()),
            spread=tuple(spread.tolist()),
            weights=tuple(weights.tolist()),
            bias=bias,
            scores=tuple(knots.tolist()),
            probabilities=tuple(probabilities.tolist()),
            fitted_on=fitted_on,
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file; raises `ModelError`."""
        try:
            return cls.model_validate_json(path.read_bytes())
        except (OSError, ValidationError) as error:
            raise ModelError(f"{path}: {' '.join(str(error).split())}") from error

    @classmethod
    def shipped(cls) -> Self:
        """That of `--parameters best`, see docs/misses.md."""
        return cls.load(Path(__file__).with_name("best.json"))

    def at(self, rows: Array) -> Array:
        """The probability of a miss (n,) for features (n, 17)."""
        score = _score(rows, np.array(self.mean), np.array(self.spread), np.array(self.weights), self.bias)
        return np.interp(score, self.scores, self.probabilities)


def calibrated(scores: Array, missed: Array) -> tuple[Array, Array]:
    """Mean scores of bins of equally many misses, increasing, and the probabilities that they stand for."""
    order = np.argsort(scores, kind="stable")
    counted = np.cumsum(missed[order])
    ends = np.searchsorted(counted, counted[-1] * np.arange(1, BINS) / BINS)
    bins = [each for each in np.split(order, ends) if len(each)]
    means = np.array([scores[each].mean() for each in bins])
    rates = np.array([(missed[each].sum() + 0.5) / (len(each) + 1) for each in bins])
    weights = np.array([len(each) for each in bins], dtype=float)
    keep = np.concatenate([[True], np.diff(means) > 0])
    return means[keep], np.asarray(isotonic_regression(rates, weights=weights).x)[keep]


def _score(rows: Array, mean: Array, spread: Array, weights: Array, bias: float) -> Array:
    return np.clip((rows - mean) / spread, -CLIP, CLIP) @ weights + bias


def _fit(rows: Array, missed: Array) -> tuple[Array, Array, Array, float]:
    """Mean and spread (17,) of the features, weights (17,), bias."""
    mean, spread = rows.mean(axis=0), rows.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    z = np.clip((rows - mean) / spread, -CLIP, CLIP)

    def loss(x: Array) -> tuple[float, Array]:
        score = z @ x[:-1] + x[-1]
        wrong = expit(score) - missed
        value = np.sum(np.logaddexp(0.0, score) - missed * score) + RIDGE * x[:-1] @ x[:-1] / 2
        return float(value), np.append(z.T @ wrong + RIDGE * x[:-1], wrong.sum())

    found = minimize(loss, np.zeros(rows.shape[1] + 1), jac=True, method="L-BFGS-B").x
    return mean, spread, found[:-1], float(found[-1])
