"""The paper's reward [SectionRL], term by term:

    R = -sum_i (error_i / S_i)^2 - l_e        i over the learned quantities, S_i the unit of an error

1 / S_i^2 are the paper's weights. S_V may grow with |LgV| + 1 (`relative_clf`): docs/differences_from_paper.md.
"""

from dataclasses import dataclass

import numpy as np
from rabbit_description.state import Array

from rl_trainer.parameters import TrainingParameters
from rl_trainer.transitions import Transition


@dataclass(frozen=True)
class RewardTerms:
    """Terms, each zero or less: `estimation` by quantity (n,), 0 where not measured, and `failure`."""

    estimation: Array
    failure: float

    @property
    def total(self) -> float:
        """R of this tick."""
        return float(self.estimation.sum()) + self.failure

    def named(self, quantities: tuple[str, ...]) -> dict[str, float]:
        """For logs and messages."""
        return {**dict(zip(quantities, self.estimation.tolist(), strict=True)), "failure": self.failure}


def reward_terms(transition: Transition, parameters: TrainingParameters) -> RewardTerms:
    """Each term of R for one transition."""
    scaled = np.nan_to_num(transition.error / error_unit(transition.LgV, parameters))
    return RewardTerms(-(scaled * scaled), 0.0 - parameters.failure_penalty * transition.failed)


def error_unit(LgV: Array, parameters: TrainingParameters) -> Array:
    """S_i for LgV of shape (..., p): shape (..., n)."""
    unit: Array = np.broadcast_to(parameters.scales[2], (*LgV.shape[:-1], parameters.n)).copy()
    if parameters.relative_clf and parameters.problem.has_clf:
        unit[..., 0] *= np.linalg.norm(LgV, axis=-1) + 1
    return unit
