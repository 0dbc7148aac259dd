"""Exact alpha and beta from the plant's own parameters: for tests and upper bounds, never for training.

A second model carries the plant's perturbed parameters (`cbf_clf_qp.model_error`). In the first approach alpha and beta
are the input that makes y-ddot = mu: I + alpha = LgLfh_nominal LgLfh_true^-1, beta = LgLfh_nominal (u_true* -
u_nominal*).
"""

import numpy as np
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.io_linearization import precontrol
from cbf_clf_qp.model_error import ModelError
from cbf_clf_qp.tick import Terms

from rl_cbf_clf_controller.generated_model import make_model
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import Scene


class OraclePolicy(Policy):
    """The plant's true errors; `urdf`, `motor_gain` and `joint_damping` are the plant's."""

    version = "oracle"
    adaptation = "none"  # it leaves nothing to find

    def __init__(self, urdf: str, motor_gain: float = 1.0, joint_damping: float = 0.0, io: bool = False) -> None:
        self._model = make_model(urdf, motor_gain, joint_damping)
        self._io = io
        self._error = ModelError()

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        """Exact estimates at this tick."""
        self._model.update(terms.scene.q_s, terms.scene.dq_s)
        dynamics = self._model.pinned()
        if self._io:
            true_control = precontrol(terms.scene.outputs.second_derivative(dynamics.acceleration))
            error = terms.precontrol.inverse().after(true_control)
            return Estimates(error.a - np.eye(len(error.b)), error.b)
        return self._error(terms, dynamics)
