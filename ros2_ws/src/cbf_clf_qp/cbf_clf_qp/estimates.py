"""What is known of the model's error: for each quantity, an error that is affine in mu.

    true value = nominal value(mu) + alpha(x) mu + beta(x)        [CLF_estimate], [eq:cbf_der], [eq_const]

A policy learns them, an identified model computes them, an oracle has them; the estimates of several are added.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from cbf_clf_qp.affine import Affine, Array


@dataclass(frozen=True)
class Estimates:
    """`alpha` (n, m) and `beta` (n,) of n quantities over mu (m,), in the quantities' units (alpha: per unit of mu).

    `output_error`: Delta_2 mu + Delta_1 (m,), the error of y^(r) = mu; None where the estimates do not give it.
    `corners`: further errors (n,), affine in mu; every row is to hold at each of them.

    Raises:
        ValueError: shapes that do not fit together.
    """

    alpha: Array
    beta: Array
    output_error: Affine | None = None
    corners: tuple[Affine, ...] = ()

    def __post_init__(self) -> None:
        if self.alpha.ndim != 2 or self.beta.ndim != 1 or len(self.alpha) != len(self.beta):
            raise ValueError(f"estimates: alpha {self.alpha.shape}, beta {self.beta.shape}; expected (n, m) and (n,)")

    def __add__(self, other: "Estimates") -> "Estimates":
        """Both errors together; the output error is known if both know it. Of the two at most one has corners."""
        known = self.output_error and other.output_error and self.output_error + other.output_error
        return Estimates(self.alpha + other.alpha, self.beta + other.beta, known, self.corners or other.corners)

    @classmethod
    @cache
    def zero(cls, n: int, m: int) -> "Estimates":
        """No error anywhere: the nominal controller. All who ask share the arrays, which are read-only."""
        error = Affine.zero(m, m)
        zero = cls(np.zeros((n, m)), np.zeros(n), error)
        for array in (zero.alpha, zero.beta, error.a, error.b):
            array.flags.writeable = False
        return zero

    @classmethod
    def from_flat(cls, flat: Array, inputs: int) -> "Estimates":
        """From the paper's vector of (inputs + 1) n values: all alphas, then all betas.

        Raises:
            ValueError: a vector of another length.
        """
        n, rest = divmod(flat.size, inputs + 1)
        if flat.ndim != 1 or rest or n == 0:
            raise ValueError(
                f"estimates: a vector of shape {flat.shape}; expected {inputs + 1} values for each quantity"
            )
        return cls(flat[: inputs * n].reshape(n, inputs), flat[inputs * n :])

    @classmethod
    def from_packed(cls, packed: Array, inputs: int) -> "Estimates":
        """From `packed`."""
        of_outputs = inputs * (inputs + 1)
        part = cls.from_flat(packed[:-of_outputs], inputs)
        output = packed[-of_outputs:].reshape(inputs, inputs + 1)
        return cls(part.alpha, part.beta, Affine(output[:, :inputs], output[:, inputs]))

    @property
    def packed(self) -> Array:
        """`flat`, then [Delta_2 | Delta_1] row by row, shape ((n + m) (m + 1),); an output error not known is 0."""
        m = self.alpha.shape[1]
        output = self.output_error or Affine.zero(m, m)
        return np.concatenate([self.flat, np.column_stack([output.a, output.b]).ravel()])

    @property
    def flat(self) -> Array:
        """The paper's order (alpha_V, alpha_B1, ..., beta_V, beta_B1, ...), shape ((m + 1) n,)."""
        return np.concatenate([self.alpha.ravel(), self.beta])

    @property
    def affine(self) -> Affine:
        """The errors (n,), affine in mu."""
        return Affine(self.alpha, self.beta)

    def at(self, terms: Any) -> "Estimates":
        """These, whatever the `terms` of a tick: they have been worked out, see `tick.Pending`."""
        return self

    def error(self, mu: Array) -> Array:
        """Estimated error of each quantity at `mu` (m,), shape (n,)."""
        error: Array = self.alpha @ mu + self.beta
        return error
