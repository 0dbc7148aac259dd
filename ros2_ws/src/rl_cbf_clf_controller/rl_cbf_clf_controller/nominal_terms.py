"""From a state's kinematics and dynamics to the scene and the nominal terms of a tick, all affine in mu."""

from functools import lru_cache
from typing import Any

import numpy as np
from cbf_clf_qp import tracing
from cbf_clf_qp.io_linearization import precontrol
from cbf_clf_qp.tick import Quantity, Terms, predicted
from cbf_clf_qp.tracing import Traced
from rabbit_description.state import Array, StonePreview

from rl_cbf_clf_controller.generated.traces import compiled_trace
from rl_cbf_clf_controller.kinds import find_kind
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.pinned_robot import PinnedRobot
from rl_cbf_clf_controller.recipes import make_clf
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.step_outputs import OutputPath

Quantities = tuple[Quantity[Scene], ...]

tracing.compiled = compiled_trace
tracing.TRUSTED.update(("rl_cbf_clf_controller", "rabbit_description"))


class NominalTerms:
    """What a controller with these parameters and quantities makes of a state."""

    def __init__(self, parameters: ControllerParameters, quantities: Quantities) -> None:
        self._quantities = quantities
        self._derived = traced_terms(parameters, quantities).twin()

    def __call__(self, *of_state: Any) -> Terms[Scene]:
        """At a state, of which all is given that `terms` below asks for."""
        return Terms(self._quantities, *self._derived(*of_state))


@lru_cache(maxsize=64)
def traced_terms(parameters: ControllerParameters, quantities: Quantities) -> Traced:
    """Scene, dynamics, pre-control, nominal quantities."""
    clf, terrain = make_clf(parameters), find_kind(parameters.controller).terrain(parameters)

    def terms(
        q_s: Array,
        dq_s: Array,
        robot: PinnedRobot,
        path: OutputPath,
        force: Array,
        tick: int,
        torque: Array,
        stance: int,
        stone: StonePreview | None,
        step_length: tuple[float, ...],
    ) -> list[Any]:
        """`force` to `stance` are the scene's; the `step_length` is what a library chose for the `stone`."""
        (feet, dynamics), outputs = robot.at(q_s, dq_s), path.at(q_s, dq_s)
        barriers, LgV = terrain.barriers(feet, stone), clf.LgV(outputs.eta)
        z = (feet.hip, [outputs.phase], feet.hip_rate, [outputs.phase_rate])
        observation = np.concatenate([outputs.eta, *z, terrain.observed(stone, step_length)])
        scene = Scene(q_s, dq_s, feet, outputs, barriers, force, observation, LgV, tick, torque, stance)
        control = precontrol(outputs.second_derivative(dynamics.acceleration))
        return [scene, dynamics, control, predicted(quantities, scene, dynamics).after(control)]

    return Traced(terms, quantities)
