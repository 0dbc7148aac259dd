"""The outputs along a path as numbers: of what the controller has as expressions (`virtual_constraints.py`)."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import NumpyFunction, packed
from cbf_clf_qp.system import System
from rabbit_description.gait import Gait
from rabbit_description.state import Array
from rl_cbf_clf_controller.virtual_constraints import (
    RABBIT_ANGLES,
    Angles,
    OutputExpressions,
    StepPath,
    desired,
    path_row,
    path_scale,
)


@dataclass(frozen=True)
class Outputs:
    """`eta` = (y, dy) (2 m,), `jacobian` (m, n) and `bias` (m,) of y-ddot, `phase` and `phase_rate` (1/s)."""

    eta: Array
    jacobian: Array
    bias: Array
    phase: float
    phase_rate: float

    @property
    def y(self) -> Array:
        """The outputs (m,), rad."""
        return self.eta[: len(self.bias)]

    @property
    def dy(self) -> Array:
        """Their rates (m,), rad/s."""
        return self.eta[len(self.bias) :]

    def second_derivative(self, acceleration: Affine) -> Affine:
        """y-ddot (m), affine in whatever `acceleration` (n) is affine in."""
        return Affine(self.jacobian, self.bias).after(acceleration)


class VirtualConstraints:
    """The outputs of a path as numbers. One object serves one thread.

    `row` holds the numbers of the path. `scale` (2,) turns a phase angle into a phase: `phase_scale` of
    `OutputExpressions`. `functions` are the `output_functions` of these angles; several paths can share them.
    """

    def __init__(
        self, path: StepPath | Gait, angles: Angles = RABBIT_ANGLES, functions: tuple[NumpyFunction, ...] | None = None
    ) -> None:
        self._outputs, self._phase, self._desired = functions or output_functions(angles)
        self.row, self.scale = path_row(path), path_scale(path)

    def desired(self, phase: float) -> tuple[Array, Array, Array]:
        """The controlled angles (m,) at a phase, rad, and two derivatives in the phase."""
        orders = self._desired(np.array([phase]), self.row)
        return orders.desired_0, orders.desired_1, orders.desired_2

    def phase(self, q_s: Array) -> float:
        """The phase of the step, at `q_s` (n,)."""
        return float(self._phase(q_s, self.scale).phase[0])

    def evaluate(self, q_s: Array, dq_s: Array) -> Outputs:
        """Outputs at `q_s`, `dq_s` (n,), stance/swing order."""
        values = self._outputs(q_s, dq_s, self.scale, self.row)
        return Outputs(values.eta, values.jacobian, values.bias, float(values.phase[0]), float(values.phase_rate[0]))


def output_functions(angles: Angles) -> tuple[NumpyFunction, ...]:
    """`Outputs` of (q, dq, scale, row of a path); the phase of (q, scale); what is desired, of (phase, row)."""
    n = angles.controlled.shape[1]
    q, dq, ddq = ca.SX.sym("q", n), ca.SX.sym("dq", n), ca.SX.sym("ddq", n)
    outputs = OutputExpressions(q, dq, angles)
    free = System(ca.vertcat(q, dq), ddq, ca.vertcat(dq, ddq), outputs.parameters, outputs.rates)
    y, dy, ddy = free.derivatives("outputs", outputs.y, 2)
    acceleration = free.affine(ddy)
    free_of_path = {"eta": ca.vertcat(y, dy), "jacobian": acceleration.a, "bias": acceleration.b}
    free_of_path |= {"phase": outputs.phase, "phase_rate": outputs.phase_rate}
    scale, phase, path = outputs.parameters["phase_scale"], ca.SX.sym("phase"), packed(outputs.path)
    orders = {f"desired_{k}": order for k, order in enumerate(desired(phase, outputs.path))}
    along = dict(zip(free_of_path, outputs.along_path([*free_of_path.values()]), strict=True))
    return (
        NumpyFunction.of("outputs", {"q": q, "dq": dq, "scale": scale, "path": path}, along),
        NumpyFunction.of("phase", {"q": q, "scale": scale}, {"phase": outputs.phase}),
        NumpyFunction.of("desired", {"phase": phase, "path": path}, orders),
    )
