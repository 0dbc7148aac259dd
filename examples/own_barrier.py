"""A barrier of your own in the walking controller, without an edit to it: the swing foot stays below a ceiling.

B = ceiling - h_f >= 0;  its derivatives, and the row B-ddot + K_b (B, B-dot) >= 0, follow from that
"""

import sys

from cbf_clf_qp import Barrier
from rabbit_experiments.assembly import Assembly
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters
from rl_trainer.rollout import rollout


def highest_step(ceiling: float | None, steps: int, seed: int = 1) -> float:
    """Walk on flat ground and return the swing foot's greatest height over the stance foot, m."""
    flat, parameters = SimulationParameters(terrain="flat", stones=steps), load_parameters("ours", controller="clf-qp")
    simulation, controller = Assembly(flat, parameters, "zero").build(
        further=lambda w: [Barrier("ceiling", ceiling - w.robot.swing[1], poles=(40.0, 40.0))] if ceiling else []
    )
    heights = list[float]()
    rollout(simulation, controller, seed, lambda tick: heights.append(controller.scene.seen.swing[1]))
    simulation.close()
    return max(heights)


if __name__ == "__main__":
    steps = int(sys.argv[1]) if sys.argv[1:] else 10
    free = highest_step(None, steps)
    print(f"without: {free:.4f} m; with a ceiling 1 cm below: {highest_step(free - 0.01, steps):.4f} m")
