"""A learner of your own in the training loop, without an edit to it: 15 lines and no critic.

    minimise  sum |alpha mu + beta - measured error|  by RMSprop on the actor itself

A learner derives from `rl_trainer.learner.Learner`; it has the actor that walks, `acting`, and an `update`.
"""

import argparse

import torch
from rabbit_description.gait import load_gait
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import Policy
from rl_trainer.actor import Actor
from rl_trainer.learner import Learner
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Batch
from rl_trainer.session import train
from rl_trainer.training import Trainer


class AbsoluteErrors(Learner):
    """Fits the actor to the measured errors of all quantities at once."""

    def __init__(self, parameters: TrainingParameters) -> None:
        self.acting = Actor(parameters)
        self._optimizer = torch.optim.RMSprop(self.acting.parameters(), lr=3e-4)

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One step; `batch.target` is the measured error in `batch.unit`s."""
        alpha, beta = self.acting(batch.observation, batch.LgV)
        estimate = torch.einsum("bij,bj->bi", alpha, batch.mu) + beta
        loss = (estimate / batch.unit - batch.target).abs().sum(1).mean()
        self._optimizer.param_groups[0]["lr"] = 3e-4 * rate
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        return {"absolute error": loss.item()}


def learn(episodes: int, steps: int, scale: float = 2.0) -> list[float]:
    """Train on the heavy robot on flat ground; the mean loss of each episode that learned."""
    chosen = load_parameters("ours", controller="rl-clf-qp")
    gait = load_gait(chosen.gait)
    parameters = TrainingParameters(problem="rl-clf-qp", episodes=episodes, seed=1)
    simulation = Simulation(SimulationParameters(terrain="flat", stones=steps, mass_scale=scale), gait)

    def make_controller(policy: Policy, sigma: float) -> Controller:
        return Controller(chosen.model_copy(update={"sigma": sigma}), gait, policy)

    trainer = Trainer(parameters, learner=AbsoluteErrors(parameters))
    reports = list(train(trainer, simulation, make_controller))
    simulation.close()
    return [report.losses["absolute error"] for report in reports if report.losses]


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--episodes", type=int, default=8)
    arguments.add_argument("--steps", type=int, default=10)
    options = arguments.parse_args()
    for episode, loss in enumerate(learn(options.episodes, options.steps), 1):
        print(f"episode {episode} with learning: mean error {loss:.4f}")
