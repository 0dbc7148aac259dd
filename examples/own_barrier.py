"""A barrier of your own in the walking controller, without an edit to it: the swing foot stays below a ceiling.

B = ceiling - h_f >= 0;  its derivatives, and the row B-ddot + K_b (B, B-dot) >= 0, follow from that
"""

import argparse

from cbf_clf_qp.barrier import Barrier
from rabbit_description.gait import load_gait
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.walking import Walking

POLES = (40.0, 40.0)  # 1/s


def ceiling(height: float, walking: Walking) -> Barrier:
    """The swing foot stays below `height`, m from the stance foot."""
    return Barrier("ceiling", height - walking.robot.swing[1], POLES)


def highest_step(limit: float | None, steps: int, seed: int = 1) -> float:
    """Walk on flat ground and return the swing foot's greatest height, m."""
    parameters = load_parameters("ours", controller="clf-qp")
    gait = load_gait(parameters.gait)
    own = (lambda walking: []) if limit is None else (lambda walking: [ceiling(limit, walking)])
    controller = Controller(parameters, gait, ZeroPolicy(parameters.problem), further=own)
    simulation = Simulation(SimulationParameters(terrain="flat", stones=steps), gait)
    state, highest = simulation.reset(seed), 0.0
    controller.reset(seed)
    while state.running:
        highest = max(highest, controller.look(state).seen.swing[1])
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
