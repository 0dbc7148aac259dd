"""How well a policy explains transitions it was not trained on: by this, weights are published or kept back.

    e_i = rms(correction_i - target_i) / rms(target_i)      0: exact, 1: no better than the zero policy

Measured errors only, in units of `error_unit`. In the first approach the target at mu is not known for another policy
than the one that walked; but the executed v is the right input for the measured y'', so it is asked at mu = y''.
"""

from collections.abc import Sequence

import numpy as np
from rabbit_description.state import Array
from rl_cbf_clf_controller.policy import LearnedPolicy

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit
from rl_trainer.transitions import Doubt, Transition


def estimation_error(policy: LearnedPolicy, transitions: Sequence[Transition], parameters: TrainingParameters) -> Array:
    """Normalised error of each quantity, (n,), over the transitions beyond doubt; NaN where there are none."""
    wrong, size = [], []
    for transition in transitions:
        if transition.doubt & ~Doubt.SATURATED:
            continue
        unit = error_unit(transition.LgV, parameters)
        mu = transition.measured if transition.problem.corrects_input else transition.mu
        estimates = policy.act(transition.observation, transition.LgV)
        wrong.append((estimates.error(mu) - transition.target) / unit)
        size.append(transition.target / unit)
    if not wrong:
        return np.full(parameters.n, np.nan)
    ratio: Array = np.sqrt(np.square(wrong).sum(axis=0) / np.square(size).sum(axis=0))
    return ratio
