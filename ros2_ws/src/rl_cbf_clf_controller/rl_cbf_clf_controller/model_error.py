"""alpha and beta of every quantity from a second model of the robot: what it says less what the nominal model says.

Both give every quantity as an affine function of mu at the same state; their difference is the estimate. The oracle's
second model is the plant's own, the adaptation's the one it has identified.
"""

import numpy as np

from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.context import ModelContext
from rl_cbf_clf_controller.nominal_model import PinnedDynamics
from rl_cbf_clf_controller.uncertainty import INPUTS, Estimates

NOMINAL_OUTPUTS = Affine(np.eye(INPUTS), np.zeros(INPUTS))  # y-ddot = mu


def model_error(context: ModelContext, dynamics: PinnedDynamics) -> Estimates:
    """The estimates that make the nominal quantities those of `dynamics`, at the state of `context`."""
    error = context.quantities.evaluate(dynamics).after(context.precontrol) - context.nominal
    outputs = context.quantities.outputs.second_derivative(dynamics.acceleration).after(context.precontrol)
    return Estimates(error.a, error.b, outputs - NOMINAL_OUTPUTS)
