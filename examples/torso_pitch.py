"""A learned barrier of your own, in this one file: the torso leans forward by at most 0.345 rad.

B = LIMIT - pitch >= 0,   row: B-ddot + K_b (B, B-dot) >= 0,   B-ddot = nominal(mu) + alpha mu + beta, learned

pip install -e examples                                    the controller gets its name: see pyproject.toml
rabbit train --problem pitch-rl-clf-qp --out DIR
rabbit walk --controller pitch-rl-clf-qp --terrain flat --policy DIR/policy.safetensors --mass-scale 2
python examples/torso_pitch.py DIR/policy.safetensors      how far the torso leans, nominal and learned
"""

import sys
from dataclasses import replace
from typing import Any

from cbf_clf_qp import Barrier, Clf
from rl_cbf_clf_controller.kinds import Kind
from rl_cbf_clf_controller.recipes import BARRIER_RESCUE_WEIGHT
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_cbf_clf_controller.walking import Walking

NAME, PITCH, LIMIT, POLES = "pitch-rl-clf-qp", 2, 0.345, (40.0, 40.0)  # -; its place in q; rad; 1/s


def quantities(w: Walking, parameters: Any) -> tuple[Clf, Barrier]:
    """The CLF relaxed by d, and the barrier."""
    clf = Clf(w.outputs.y, w.gains["eps"], (parameters.kp, parameters.kd), w.gains["slack_weight"])
    return clf, Barrier("pitch", LIMIT - w.robot.q[PITCH], POLES, BARRIER_RESCUE_WEIGHT)


SCALES: Any = {"alpha_scale": (1.5, 1.0), "beta_scale": (250, 60), "error_scale": (15, 10)}
PROBLEM = replace(RL_CLF_QP, name=NAME, quantities=("V", "pitch"), **SCALES)
CONTROLLER = Kind(PROBLEM, quantities, learns=True)

if __name__ == "__main__":
    from rabbit_experiments.assembly import Assembly
    from rabbit_sim.parameters import SimulationParameters
    from rl_cbf_clf_controller.parameters import load_parameters
    from rl_trainer.rollout import rollout

    heavy = SimulationParameters(terrain="flat", stones=20, mass_scale=2)
    tuning = load_parameters("ours", controller=NAME)
    for policy, seed in ((policy, seed) for policy in ("zero", *sys.argv[1:]) for seed in range(901, 906)):
        walk: list[Any] = []
        end = rollout(*Assembly(heavy, tuning, policy).build(), seed, walk.append)
        lean = max(tick.state.q[PITCH] for tick in walk)
        print(f"{policy}, seed {seed}: {end.touchdowns} steps, lean up to {lean:.4f} rad, limit {LIMIT}")
