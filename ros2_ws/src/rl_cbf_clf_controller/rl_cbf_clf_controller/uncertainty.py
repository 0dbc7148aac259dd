"""What is learned: for each constrained quantity, the error of the nominal model, affine in mu.

    true value = nominal value(mu) + alpha(x) mu + beta(x)        [CLF_estimate], [eq:cbf_der], [eq_const]

Quantities: `V` (V-dot, 1/s), `B1`, `B2` (second derivatives of the barriers, m/s^2), `C1` (normal force F_N of the
stance foot, N), `C2` (its tangential force F_T, N). The rows of the unilateral and the friction constraint are built
from F_N and F_T; see docs/differences_from_paper.md.

In the first approach the quantities are the outputs' accelerations `y1` to `y4` (rad/s^2), and alpha, beta are not an
estimate but an input: u = u~(mu) + (LgLfh)^-1 (alpha mu + beta) [approach1_input].
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from rabbit_description.state import Array

from rl_cbf_clf_controller.affine import Affine

INPUTS = 4  # mu has one component for each output
STEP_LENGTH = "step_length"  # m, what a gait library steps at; seen after l_min
STATE_OBSERVATION = (
    *(f"y{i}" for i in range(1, 5)),  # rad
    *(f"dy{i}" for i in range(1, 5)),  # rad/s
    *("hip_x", "hip_z", "phase"),  # m, m (from the stance foot), 1
    *("hip_dx", "hip_dz", "dphase"),  # m/s, m/s, 1/s
)


class Problem(StrEnum):
    """A learning problem of the paper, by the name of the controller that uses it."""

    IO_RL_CLF_QP = "io-rl-clf-qp"
    RL_CLF_QP = "rl-clf-qp"
    RL_CBF_CLF_QP = "rl-cbf-clf-qp"

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the n learned quantities, in the order of every array over them."""
        return _QUANTITIES[self]

    @property
    def observation(self) -> tuple[str, ...]:
        """Names of the observation's components: 14 of the state, and `l_min` on stones."""
        return (*STATE_OBSERVATION, "l_min") if self is Problem.RL_CBF_CLF_QP else STATE_OBSERVATION

    @property
    def observations(self) -> tuple[tuple[str, ...], ...]:
        """All that a policy may read: without `l_min`, with it, and with a gait library's step length after it."""
        whole = self.observation
        if whole == STATE_OBSERVATION:
            return (whole,)
        return STATE_OBSERVATION, whole, (*whole, STEP_LENGTH)

    @property
    def has_clf(self) -> bool:
        """V is among the quantities, so its row may take the structured form."""
        return "V" in self.quantities


NO_OUTPUT_ERROR = Affine(np.zeros((INPUTS, INPUTS)), np.zeros(INPUTS))
_QUANTITIES = {
    Problem.IO_RL_CLF_QP: ("y1", "y2", "y3", "y4"),
    Problem.RL_CLF_QP: ("V",),
    Problem.RL_CBF_CLF_QP: ("V", "B1", "B2", "C1", "C2"),
}


@dataclass(frozen=True)
class Estimates:
    """`alpha` (n, 4) and `beta` (n,) of the n quantities, in the quantities' units (per unit of mu, rad/s^2).

    `output_error`: Delta_2 mu + Delta_1 (4), rad/s^2, the error of y'' = mu; None where the estimates do not tell it.
    """

    alpha: Array
    beta: Array
    output_error: Affine | None = None

    def __post_init__(self) -> None:
        if self.alpha.shape != (len(self.beta), INPUTS) or self.beta.ndim != 1:
            raise ValueError(f"estimates: alpha {self.alpha.shape}, beta {self.beta.shape}; expected (n, 4) and (n,)")

    def __add__(self, other: "Estimates") -> "Estimates":
        """Both errors together; the output error is told if both tell it."""
        told = self.output_error and other.output_error and self.output_error + other.output_error
        return Estimates(self.alpha + other.alpha, self.beta + other.beta, told)

    @classmethod
    def zero(cls, problem: Problem) -> "Estimates":
        """No error anywhere: the nominal controller."""
        n = len(problem.quantities)
        return cls(np.zeros((n, INPUTS)), np.zeros(n), NO_OUTPUT_ERROR)

    @classmethod
    def from_flat(cls, flat: Array) -> "Estimates":
        """From the paper's vector of 5n values: all alphas, then all betas (25 for V, B1, B2, C1, C2)."""
        n, rest = divmod(flat.size, INPUTS + 1)
        if flat.ndim != 1 or rest or n == 0:
            raise ValueError(f"estimates: a vector of shape {flat.shape}; expected 5 values for each quantity")
        return cls(flat[: INPUTS * n].reshape(n, INPUTS), flat[INPUTS * n :])

    @classmethod
    def from_packed(cls, packed: Array) -> "Estimates":
        """From `packed`."""
        rows, output = packed[: -INPUTS * (INPUTS + 1)], packed[-INPUTS * (INPUTS + 1) :].reshape(INPUTS, INPUTS + 1)
        part = cls.from_flat(rows)
        return cls(part.alpha, part.beta, Affine(output[:, :INPUTS], output[:, INPUTS]))

    @property
    def packed(self) -> Array:
        """`flat`, then [Delta_2 | Delta_1] row by row, shape (5n + 20,); an output error that is not told is 0."""
        output = self.output_error or NO_OUTPUT_ERROR
        return np.concatenate([self.flat, np.column_stack([output.a, output.b]).ravel()])

    @property
    def flat(self) -> Array:
        """The paper's order (alpha_V, alpha_B1, ..., alpha_C2, beta_V, ..., beta_C2), shape (5n,)."""
        return np.concatenate([self.alpha.ravel(), self.beta])

    def error(self, mu: Array) -> Array:
        """Estimated error of each quantity at `mu` (4,), shape (n,)."""
        error: Array = self.alpha @ mu + self.beta
        return error
