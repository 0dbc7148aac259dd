"""DDPG of the paper's 25 estimates beside `best`, over the plants of the training, many robots at once in MuJoCo.

python -B studies/rabbit_rivals/ddpg_over_plants.py --ticks 10000000 --seed 1 --out DIR

Three quarters of the robots walk under the newest policy, the others under zero estimates. Every fourth tick of a robot
becomes a transition, put together as in `rl_trainer.transitions`. Of all 64 ticks walked there is an update.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from cbf_clf_qp.estimates import Estimates
from rabbit_description.gait import load_gaits
from rabbit_experiments.assembly import make_simulation
from rabbit_experiments.provenance import commit
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Outcome
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchOutput, estimates_of, identified
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ActorPolicy, ZeroPolicy
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit
from rl_trainer.training import Provenance, Trainer
from rl_trainer.transitions import CONTACT_FORCE, FAR_POSITION, FAR_VELOCITY, SETTLED

from rabbit_rivals.plants import draw_plant

EVERY, PERIOD, UPDATE_EVERY, STEPS, AGAIN = 4, 160, 64, 10, 0.6
FIRST = 200_000  # ticks under zero estimates


def error(e: Estimates, v: Any) -> Any:
    return np.einsum("nij,nj->ni", e.alpha, v) + e.beta


def y_ddot(e: Estimates, v: Any) -> Any:
    return v + np.einsum("nij,nj->ni", e.output_error[:, :, :-1], v) + e.output_error[:, :, -1]


class Robots:
    """Robots under one policy; keeps what the last tick decided."""

    def __init__(self, n: int, seed: int, plant: Any, parameters: Any, training: TrainingParameters) -> None:
        self.rng, self.plant, self.training = np.random.default_rng(seed), plant, training
        self.gait, self.zero = load_gaits(parameters.gait), ZeroPolicy(parameters.problem)
        self.controller = BatchController(Controller(parameters, self.gait, self.zero), [self.zero] * n)
        self.parameters, self.n, self.time = parameters, n, 0
        seeds = self.rng.integers(2**32, size=n).tolist()
        self.batch = BatchSimulation([make_simulation(plant(s), self.gait) for s in seeds])
        self.batch.reset(seeds)
        for i, s in enumerate(seeds):
            self.controller.reset(i, s)
        self.last: BatchOutput | None = None
        self.fresh = np.ones(n, dtype=bool)  # began an episode since the last output
        self.walked = self.ended = 0

    def tick(self) -> dict[str, Any] | None:
        """A tick of all; the transitions that it ends."""
        states = self.batch.states
        output = self.controller.step(states)
        columns = self.transitions(self.last, output, states) if self.last else None
        self.last, self.fresh[:] = output, False
        torque = output.torque.copy()
        faults = {*output.faults, *output.errors}
        torque[[*faults]] = 0
        states = self.batch.step(torque)
        over = ~states.running
        over[[*faults]] = True
        for i in over.nonzero()[0].tolist():
            self.next_episode(i, i in faults)
        self.time += 1
        return columns

    def next_episode(self, i: int, fault: bool) -> None:
        simulation, seed = self.batch.simulations[i], int(self.rng.integers(2**32))
        walked = simulation.outcome is Outcome.WALKED and not fault
        self.walked, self.ended = self.walked + walked, self.ended + 1
        if walked or self.rng.random() >= AGAIN:
            simulation.close()
            simulation = make_simulation(self.plant(seed), self.gait)
        self.batch.restart(i, simulation, seed)
        self.controller.reset(i, seed)
        self.fresh[i] = True

    def transitions(self, last: BatchOutput, new: BatchOutput, states: Any) -> dict[str, Any]:
        """The columns of a replay of every fourth robot whose tick was beyond doubt."""
        one, p, at = last._one, self.training, last._one.output_places.arrays
        a, b = ({name: o.report[:, place] for name, place in at.items()} for o in (last, new))
        for columns, o in ((a, last), (b, new)):
            columns |= {name: o.report[:, one.places[name]] for name in ("mu", "mu_qp")}
        s, t = last.scene, new.scene
        y, dy = np.abs(s.seen.eta[:, :4]).max(axis=1), np.abs(s.seen.eta[:, 4:]).max(axis=1)
        rows, normal = np.arange(self.n), states.foot_force[:, :, 1]
        phase, following = s.seen.phase.ravel(), t.seen.phase.ravel()
        good = ~self.fresh & (s.step_index == t.step_index) & (s.step_index > 0) & np.isfinite(b["measured"]).all(axis=1)
        good &= last.report[:, one.places["saturated"]][:, 0] == 0
        good &= ~((phase < 0) != (following < 0)) & ~((phase < 1) != (following < 1))
        good &= s.step_time >= SETTLED - p.tick_seconds / 2
        good &= (normal[rows, s.stance] >= CONTACT_FORCE) & (normal[rows, 1 - s.stance] < CONTACT_FORCE)
        good &= (y <= FAR_POSITION) & (dy <= FAR_VELOCITY) & np.isfinite(b["mu_held"]).all(axis=1)
        good &= (rows + self.time) % EVERY == 0
        k, m = good.nonzero()[0], len(p.observation)
        before, after = identified(one, last.report)[0], identified(one, new.report)[0]
        mu, held = a["mu"], b["mu_held"]
        A = a["nominal_a"].reshape(self.n, -1, 4), b["nominal_a"].reshape(self.n, -1, 4)
        start = np.einsum("nij,nj->ni", A[0], mu) + a["nominal_b"] + error(before, mu)
        end = np.einsum("nij,nj->ni", A[1], held) + b["nominal_b"] + error(after, held)
        mean = (start + end) / 2
        mean[:, 0] = a["nominal_b"][:, 0] + np.sum(a["LgV"] * (y_ddot(before, mu) + y_ddot(after, held)), axis=1) / 2
        learned = estimates_of(one, last._learned)
        unit = error_unit(a["LgV"], p)
        target = (b["measured"] - mean) / unit
        reward = -((error(Estimates(learned.alpha, learned.beta, None), mu) / unit - target) ** 2)
        none = np.zeros(len(k))
        return {
            "observation": a["observation"][k, :m], "LgV": a["LgV"][k], "mu": mu[k], "mu_qp": a["mu_qp"][k],
            "unit": unit[k], "alpha": learned.alpha[k], "beta": learned.beta[k], "target": target[k],
            "reward": reward[k], "penalty": none, "failed": none,
            "next_observation": b["observation"][k, :m], "next_LgV": b["LgV"][k], "next_mu": b["mu"][k],
        }  # fmt: skip


def keep(replay: Any, columns: dict[str, Any], capacity: int) -> None:
    n = len(columns["unit"])
    rows = (replay.added + np.arange(n)) % capacity
    for name, value in columns.items():
        value = torch.as_tensor(value, dtype=torch.float32)
        if name not in replay.columns:
            replay.columns[name] = torch.zeros(capacity, *value.shape[1:])
        replay.columns[name][rows] = value
    replay.added += n


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--ticks", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--robots", type=int, default=128)
    parser.add_argument("--plant", default="")
    parser.add_argument("--out", type=Path, required=True)
    o = parser.parse_args()
    o.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    training = TrainingParameters(
        seed=o.seed, alpha_scale=(0.15, 0.1, 0.1, 0.4, 0.4), beta_scale=(25, 6, 6, 80, 20), observe_step_length=True,
        batch=256, capacity=400_000, rate_half_life=600_000.0, sigma=4.0, actor_rate=6e-4, critic_rate=1e-3, polyak=5e-4,
    )  # fmt: skip
    parameters = load_parameters("best", "stones", qp_solver="daqp", controller="rl-cbf-clf-qp")
    trainer = Trainer(training, Provenance({"plant": "mujoco"}, commit(), f"ddpg_over_plants.py --ticks {o.ticks} --seed {o.seed}"))
    trainer._adaptation = "identification"
    changes = json.loads(o.plant) if o.plant else None

    def plant(seed: int) -> SimulationParameters:
        if changes is None:
            return draw_plant("stones", np.random.default_rng([seed, 1]), STEPS)
        return SimulationParameters(plant="mujoco", stones=STEPS, **changes)

    groups = [Robots(n, 1000 * o.seed + j, plant, parameters, training) for j, n in enumerate((3 * o.robots // 4, o.robots // 4))]
    rng, ticks, began = np.random.default_rng(o.seed), 0, time.perf_counter()
    log = (o.out / "curve.csv").open("a")
    print("ticks,seconds,kept,walked,ended,walked_zero,ended_zero,reward,reward_zero,critic", file=log, flush=True)
    owed, shown, saved = 0.0, 0, 0
    while ticks < o.ticks:
        for group in groups:
            group.controller.set_parameters(parameters.model_copy(update={"sigma": float(rng.choice([0, 2.0, 4.0, 8.0]))}))
            group.walked = group.ended = 0
        if ticks >= FIRST:
            groups[0].controller.policies[:] = [ActorPolicy(trainer.policy_file())] * groups[0].n
        rewards: list[Any] = [[], []]
        for _ in range(PERIOD):
            for j, group in enumerate(groups):
                columns = group.tick()
                if columns and len(columns["unit"]):
                    keep(trainer.replay, columns, training.capacity)
                    rewards[j].append(columns["reward"].sum(axis=1))
            ticks += o.robots
        losses = trainer.learn(PERIOD * o.robots // UPDATE_EVERY)
        trainer.episode += 1
        means = [float(np.mean(np.concatenate(r))) if r else 0.0 for r in rewards]
        a, z = groups
        print(ticks, round(time.perf_counter() - began), trainer.replay.added, a.walked, a.ended, z.walked, z.ended,
              *(f"{x:.4g}" for x in (*means, losses.get("critic", 0))), sep=",", file=log, flush=True)  # fmt: skip
        if ticks // 1_000_000 > saved:
            saved = ticks // 1_000_000
            trainer.policy_file().write(o.out / f"policy-{saved}M.safetensors")
    trainer.policy_file().write(o.out / "policy.safetensors")


if __name__ == "__main__":
    main()
