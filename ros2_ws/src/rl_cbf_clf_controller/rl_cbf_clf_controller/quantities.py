"""The quantities whose model error is learned, as functions of a pinned model: V-dot, B1-ddot, B2-ddot, F_N, F_T.

Nominal and true values come from the same expressions with another model in them, so their difference is the model
error and nothing else. All are affine in the torque u.
"""

from dataclasses import dataclass

import numpy as np

from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.ecbf import Barriers
from rl_cbf_clf_controller.nominal_model import PinnedDynamics
from rl_cbf_clf_controller.virtual_constraints import Outputs


@dataclass(frozen=True)
class QuantityModel:
    """What the quantities are at one state: outputs, V-dot in y-ddot, and barriers (None on flat ground).

    `outputs_only` makes the quantities the output accelerations themselves, as in the first approach.
    """

    outputs: Outputs
    clf_derivative: Affine
    barriers: Barriers | None
    outputs_only: bool = False

    def evaluate(self, dynamics: PinnedDynamics) -> Affine:
        """All quantities (n,), affine in the torque (4,), under `dynamics`."""
        acceleration = self.outputs.second_derivative(dynamics.acceleration)
        if self.outputs_only:
            return acceleration
        clf = self.clf_derivative.after(acceleration)
        if self.barriers is None:
            return clf
        barriers = self.barriers.second_derivative(dynamics.acceleration)
        force = dynamics.normal_tangential
        return Affine(
            np.concatenate([clf.a, barriers.a, force.a]),
            np.concatenate([clf.b, barriers.b, force.b]),
        )
