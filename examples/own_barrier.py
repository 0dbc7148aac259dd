"""A barrier of your own in the walking controller, without an edit to it: the swing foot stays below a ceiling.

    B = ceiling - h_f >= 0,   B-ddot = -h_f-ddot,   row: B-ddot + K_b (B, B-dot) >= 0

A `Constraint` is anything with `rows(terms, control)`; `terms` has the tick's scene, nominal dynamics and precontrol.
"""

import argparse

import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.ecbf import Barriers, ecbf_bound, ecbf_gains
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.tick import Terms
from rabbit_description.gait import load_gait
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.scene import Scene


class Ceiling:
    """The swing foot stays below `height`, m from the stance foot."""

    def __init__(self, height: float, pole: float = 40.0) -> None:
        self._height = height
        self._K_b = ecbf_gains((pole, pole))

    def rows(self, terms: Terms[Scene], control: Affine) -> list[Rows]:
        """One row of the QP, affine in mu."""
        feet = terms.scene.feet
        barrier = Barriers(
            B=np.array([self._height - feet.swing[1]]),
            dB=-feet.swing_rate[1:],
            jacobian=-feet.swing_jacobian[1:],
            bias=-feet.swing_bias[1:],
        )
        ddB = barrier.second_derivative(terms.dynamics.acceleration).after(control)
        return [Rows.at_least(("ceiling",), ddB.a, ecbf_bound(barrier, self._K_b) - ddB.b, 1e6).normalised()]


def highest_step(ceiling: float | None, steps: int, seed: int = 1) -> float:
    """Walk on flat ground and return the swing foot's greatest height, m."""
    parameters = load_parameters("ours", controller="clf-qp")
    gait = load_gait(parameters.gait)
    own = [] if ceiling is None else [Ceiling(ceiling)]
    controller = Controller(parameters, gait, ZeroPolicy(parameters.problem), constraints=own)
    simulation = Simulation(SimulationParameters(terrain="flat", stones=steps), gait)
    state, highest = simulation.reset(seed), 0.0
    controller.reset(seed)
    while state.running:
        highest = max(highest, controller.look(state).scene.feet.swing[1])
        state = simulation.step(controller.step(state).torque)
    simulation.close()
    return highest


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--steps", type=int, default=10)
    steps = arguments.parse_args().steps
    free = highest_step(None, steps)
    low = free - 0.01
    print(f"without: {free:.4f} m; with a ceiling at {low:.4f} m: {highest_step(low, steps):.4f} m")
