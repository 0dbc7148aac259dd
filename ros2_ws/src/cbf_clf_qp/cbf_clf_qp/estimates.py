"""What is known of the model's error: for each quantity, an error that is affine in mu.

    true value = nominal value(mu) + alpha(x) mu + beta(x)        [CLF_estimate], [eq:cbf_der], [eq_const]

A policy learns them, an identified model computes them, an oracle has them; the estimates of several are added.
"""

from dataclasses import dataclass

import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import Array


@dataclass(frozen=True)
class Estimates:
    """`alpha` (n, m) and `beta` (n,) of n quantities over mu (m,), in the quantities' units (alpha: per unit of mu).

    `output_error` (m, m + 1): (Delta_2 | Delta_1), the error Delta_2 mu + Delta_1 of y^(r) = mu; None: not known.
    Raises ValueError for shapes that do not fit together.
    """

    alpha: Array
    beta: Array
    output_error: Array | None = None

    def __post_init__(self) -> None:
        if self.alpha.ndim != 2 or self.beta.ndim != 1 or len(self.alpha) != len(self.beta):
            raise ValueError(f"estimates: alpha {self.alpha.shape}, beta {self.beta.shape}; expected (n, m) and (n,)")

    def __add__(self, other: "Estimates") -> "Estimates":
        """Both errors together; the output error is known if both know it."""
        mine, others = self.output_error, other.output_error
        known = None if mine is None or others is None else mine + others
        return Estimates(self.alpha + other.alpha, self.beta + other.beta, known)

    @classmethod
    def zero(cls, n: int, m: int) -> "Estimates":
        """No error anywhere: the nominal controller."""
        return cls(np.zeros((n, m)), np.zeros(n), np.zeros((m, m + 1)))

    @classmethod
    def from_flat(cls, flat: Array, inputs: int) -> "Estimates":
        """From `flat`; raises ValueError where the vector has another length than (inputs + 1) n."""
        n, rest = divmod(flat.size, inputs + 1)
        if flat.ndim != 1 or rest or n == 0:
            raise ValueError(f"estimates: {flat.shape} values; expected {inputs + 1} values for each quantity")
        return cls(flat[: inputs * n].reshape(n, inputs), flat[inputs * n :])

    @classmethod
    def from_packed(cls, packed: Array, inputs: int) -> "Estimates":
        """From `packed`."""
        start = packed.size - inputs * (inputs + 1)
        rows = cls.from_flat(packed[:start], inputs)
        return cls(rows.alpha, rows.beta, packed[start:].reshape(inputs, inputs + 1))

    @property
    def flat(self) -> Array:
        """The paper's order (alpha_V, alpha_B1, ..., beta_V, beta_B1, ...), shape ((m + 1) n,)."""
        return np.concatenate([self.alpha.ravel(), self.beta])

    @property
    def packed(self) -> Array:
        """`flat`, then the output error row by row, shape ((n + m) (m + 1),); one that is not known is 0."""
        m = self.alpha.shape[1]
        known = np.zeros(m * (m + 1)) if self.output_error is None else self.output_error.ravel()
        return np.concatenate([self.flat, known])

    @property
    def affine(self) -> Affine:
        """The errors (n,), affine in mu."""
        return Affine(self.alpha, self.beta)

    def error(self, mu: Array) -> Array:
        """The errors (n,) at `mu` (m,)."""
        error: Array = self.alpha @ mu + self.beta
        return error
