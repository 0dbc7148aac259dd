"""The paper's reward [SectionRL], term by term:

    R = -sum_i (error_i / S_i)^2 - l_e        i over the learned quantities, S_i the unit of an error

1 / S_i^2 are the paper's weights. S_V may grow with |LgV| + 1 (`relative_clf`): docs/differences_from_paper.md.
"""

import numpy as np
from rabbit_description.state import Array

from rl_trainer.parameters import TrainingParameters
from rl_trainer.transitions import Transition


def reward_terms(transition: Transition, parameters: TrainingParameters) -> tuple[Array, float]:
    """The terms of R, zero or less: by quantity (n,), 0 where not measured; and the failure's."""
    scaled = np.nan_to_num(transition.error / error_unit(transition.LgV, parameters))
    return -(scaled * scaled), 0.0 - parameters.failure_penalty * transition.failed


def reward(transition: Transition, parameters: TrainingParameters) -> float:
    """R of one transition."""
    terms, failure = reward_terms(transition, parameters)
    return float(terms.sum()) + failure


def error_unit(LgV: Array, parameters: TrainingParameters) -> Array:
    """S_i for LgV of shape (..., p): shape (..., n)."""
    unit: Array = np.broadcast_to(parameters.scales[2], (*LgV.shape[:-1], parameters.n)).copy()
    if parameters.relative_clf and parameters.problem.has_clf:
        unit[..., 0] *= np.linalg.norm(LgV, axis=-1) + 1
    return unit
