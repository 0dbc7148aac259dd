"""From a state's kinematics and dynamics to the scene and the nominal terms of a tick, all affine in mu."""

from functools import lru_cache

import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.ecbf import Barriers
from cbf_clf_qp.io_linearization import precontrol
from cbf_clf_qp.tick import Quantity, Terms, predicted
from cbf_clf_qp.tracing import Traced
from rabbit_description.state import Array, StonePreview

from rl_cbf_clf_controller.kinds import find_kind
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.pinned_robot import Kinematics, PinnedDynamics
from rl_cbf_clf_controller.recipes import make_clf
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.virtual_constraints import Outputs

Sensed = tuple[Array, int, Array]  # the scene's force, tick and torque
Quantities = tuple[Quantity[Scene], ...]


class NominalTerms:
    """What a controller with these parameters and quantities makes of a state."""

    def __init__(self, parameters: ControllerParameters, quantities: Quantities) -> None:
        self._quantities = quantities
        self._derived = traced_terms(parameters, quantities).twin()

    def __call__(
        self,
        state: tuple[Array, Array],
        feet: Kinematics,
        outputs: Outputs,
        dynamics: PinnedDynamics,
        sensed: Sensed,
        stone: StonePreview | None,
        step_length: tuple[float, ...],
    ) -> Terms[Scene]:
        """At `state` = (q_s, dq_s), with the `stone` in sight and the `step_length` that a library chose for it."""
        found = self._derived(state, feet, outputs, dynamics, sensed, stone, step_length)
        observation, LgV, a, b, nominal_a, nominal_b, *of_barriers = found
        barriers = Barriers(*of_barriers) if of_barriers else None
        force, tick, torque = sensed
        scene = Scene(*state, feet, outputs, barriers, force, observation, LgV, tick, torque)
        return Terms(self._quantities, scene, dynamics, Affine(a, b), Affine(nominal_a, nominal_b))


@lru_cache(maxsize=64)
def traced_terms(parameters: ControllerParameters, quantities: Quantities) -> Traced:
    """Observation, LgV, a and b of the pre-control and of the nominal quantities; on stones the barriers."""
    clf, terrain = make_clf(parameters), find_kind(parameters.controller).terrain(parameters)

    def terms(
        state: tuple[Array, Array],
        feet: Kinematics,
        outputs: Outputs,
        dynamics: PinnedDynamics,
        sensed: Sensed,
        stone: StonePreview | None,
        step_length: tuple[float, ...],
    ) -> list[Array]:
        barriers, LgV = terrain.barriers(feet, stone), clf.LgV(outputs.eta)
        z = (feet.hip, [outputs.phase], feet.hip_rate, [outputs.phase_rate])
        observation = np.concatenate([outputs.eta, *z, terrain.observed(stone, step_length)])
        force, tick, torque = sensed
        scene = Scene(*state, feet, outputs, barriers, force, observation, LgV, tick, torque)
        control = precontrol(outputs.second_derivative(dynamics.acceleration))
        nominal = predicted(quantities, scene, dynamics).after(control)
        of_barriers = [barriers.B, barriers.dB, barriers.jacobian, barriers.bias] if barriers else []
        return [observation, LgV, control.a, control.b, nominal.a, nominal.b, *of_barriers]

    return Traced(terms)
