"""Learning on any system under a `cbf_clf_qp` tick; RABBIT's transitions, from its messages, are in `transitions.py`.

ticks = SystemTicks(Tick(..., reads={"observation": ...}), problem, seconds=0.01)

def walk(policy, plan):                            an episode
    ticks.begin(policy)
    for ...:
        now = ticks(x, p, noise)                   every tick; now.control is the input
    return ticks.transitions

policy = learn(TrainingParameters(problem=problem, seed=1, episodes=12), walk)
"""

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
from cbf_clf_qp.estimates import measure
from cbf_clf_qp.functions import Array, NumpyFunction
from cbf_clf_qp.tick import Tick
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.task_ticks import TaskTick, TaskTicks

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit
from rl_trainer.training import EpisodePlan, Trainer
from rl_trainer.transitions import Doubt, Transition

__all__ = ["EpisodePlan", "LearnedPolicy", "Problem", "SystemTicks", "TrainingParameters", "Transition"]
__all__ += ["learn"]


class SystemTicks(TaskTicks):
    """Ticks `seconds` apart, and what is learned of: their `transitions`."""

    def __init__(self, tick: Tick, problem: Problem, seconds: float, limit: float = np.inf) -> None:
        super().__init__(tick, problem, limit)
        self._seconds = np.array([seconds])

    def begin(self, policy: LearnedPolicy | None = None, true: Mapping[str, Array | float] | None = None) -> None:
        """See `TaskTicks`."""
        super().begin(policy, true)
        self._transitions = list[Transition]()

    @cached_property
    def _measure(self) -> NumpyFunction:
        return measure(self._tick.terms)

    @property
    def transitions(self) -> list[Transition]:
        """Those of the episode so far; raises ValueError, see `measure`, where a quantity cannot be measured."""
        new = self.pairs[len(self._transitions) :]
        self._transitions += [self._transition(len(self._transitions) + i, *pair) for i, pair in enumerate(new)]
        return self._transitions

    def _transition(self, number: int, before: TaskTick, after: TaskTick) -> Transition:
        """A measured value is a mean over the tick, so the nominal one is the mean of both ends under the held input;
        that of V has the start's slope at both, as its measurement has."""
        held = np.linalg.solve(after.seen.control_a, before.control - after.seen.control_b)
        nominal = (before.nominal(before.mu) + after.nominal(held)) / 2
        if self._problem.has_clf:
            nominal[0] = before.nominal((before.mu + held) / 2)[0]
        return Transition(
            problem=self._problem,
            tick=number,
            step_index=0,
            observation=before.seen.observation,
            LgV=self.LgV(before.seen),
            mu=before.mu,
            mu_qp=before.decided.mu,
            alpha=before.estimates.alpha,
            beta=before.estimates.beta,
            nominal=nominal,
            measured=self._measure(before.x, before.p, after.x, after.p, self._seconds).measured,
            next_observation=after.seen.observation,
            next_LgV=self.LgV(after.seen),
            next_mu=after.mu,
            failed=False,
            doubt=Doubt.NONE,
        )


def learn(
    parameters: TrainingParameters,
    ticks: SystemTicks,
    walk: Callable[[LearnedPolicy, EpisodePlan], object],
    say: Callable[[str], object] = print,
) -> LearnedPolicy:
    """The policy after all episodes: each is a `walk` through the `ticks` under a policy; `say` hears how wrong it was.

    The error is the mean square root over the episode and the quantities, in units of `reward.error_unit`.
    """
    trainer = Trainer(parameters)
    while trainer.episode < parameters.episodes:
        plan = trainer.begin_episode()
        walk(plan.policy, plan)
        for transition in ticks.transitions:
            trainer.take(transition)
        wrong = [each.error / error_unit(each.LgV, parameters) for each in ticks.transitions]
        mean = np.sqrt(np.mean(np.square(wrong)))
        say(f"seed {parameters.seed}, episode {plan.episode + 1}: {len(wrong)} ticks, error {mean:.2f}")
        trainer.learn_episode()
    return ActorPolicy(trainer.policy_file())
