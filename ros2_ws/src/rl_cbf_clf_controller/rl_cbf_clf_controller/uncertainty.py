"""What is learned: for each constrained quantity, the error of the nominal model, affine in mu.

    true value = nominal value(mu) + alpha(x) mu + beta(x)        [CLF_estimate], [eq:cbf_der], [eq_const]

Quantities: `V` (V-dot, 1/s), `B1`, `B2` (second derivatives of the barriers, m/s^2), `C1` (normal force F_N of the
stance foot, N), `C2` (its tangential force F_T, N). The rows of the unilateral and the friction constraint are built
from F_N and F_T; see docs/differences_from_paper.md.

In the first approach the quantities are the outputs' accelerations `y1` to `y4` (rad/s^2), and alpha, beta are not an
estimate but an input: u = u~(mu) + (LgLfh)^-1 (alpha mu + beta) [approach1_input].
"""

from enum import StrEnum

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


_QUANTITIES = {
    Problem.IO_RL_CLF_QP: ("y1", "y2", "y3", "y4"),
    Problem.RL_CLF_QP: ("V",),
    Problem.RL_CBF_CLF_QP: ("V", "B1", "B2", "C1", "C2"),
}
