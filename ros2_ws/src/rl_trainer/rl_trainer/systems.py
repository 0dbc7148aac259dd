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
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates, measure, model_error
from cbf_clf_qp.functions import Array, NumpyFunction, Values, places_of
from cbf_clf_qp.tick import Tick
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy
from rl_cbf_clf_controller.problem import Problem

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit
from rl_trainer.training import EpisodePlan, Trainer
from rl_trainer.transitions import Doubt, Transition

__all__ = ["EpisodePlan", "LearnedPolicy", "Problem", "SystemTick", "SystemTicks", "TrainingParameters", "Transition"]
__all__ += ["learn"]


@dataclass(frozen=True)
class SystemTick:
    """A tick at a state `x` with the parameters `p`: what the model says (`seen`), the estimates, what was decided.

    `mu` (m,) as executed, with any exploration; `control` (m,): the input that it is.
    """

    x: Array
    p: Array
    seen: Values
    estimates: Estimates
    decided: Decided
    mu: Array
    control: Array

    def nominal(self, mu: Array) -> Array:
        """The quantities (n,) by the model."""
        nominal: Array = self.seen.nominal_a @ mu + self.seen.nominal_b
        return nominal


class SystemTicks:
    """The ticks of a system that a `problem` is learned on, `seconds` apart; what is learned of are its `transitions`.

    `tick`: its `reads` have an `observation` (k,), what a policy reads; `limit`: of each component of the input, also
    with exploration.
    """

    def __init__(self, tick: Tick, problem: Problem, seconds: float, limit: float = np.inf) -> None:
        self._tick, self._problem, self._seconds, self._limit = tick, problem, np.array([seconds]), limit
        self._error = model_error(tick.terms)
        self._places = places_of(tick.system.named)
        self.begin()

    def begin(self, policy: LearnedPolicy | None = None, true: Mapping[str, Array | float] | None = None) -> None:
        """Begin an episode with the estimates of a policy, or an oracle's exact ones; without either they are zero.

        The oracle knows the `true` parameters by name; those that are not named are what the model has.
        """
        self._policy, self._true = policy, true
        self._pairs, self._transitions = list[tuple[SystemTick, SystemTick]](), list[Transition]()
        self.interrupt()

    def interrupt(self) -> None:
        """The next tick does not follow the last: something was missed, or the state has jumped."""
        self._last: SystemTick | None = None

    def __call__(self, x: Array, p: Array, noise: Array | float = 0.0) -> SystemTick:
        """The tick at a state; `noise` (m,) is added to its mu."""
        seen = self._tick.look(x, p)
        estimates = self._estimates(x, p, seen)
        decided = self._tick.decide(x, p, estimates)
        mu, values = decided.mu + noise, decided.values
        control: Array = values.control_a @ mu + values.control_b
        if np.abs(control).max() > self._limit:
            control = control.clip(-self._limit, self._limit)
            mu = np.linalg.solve(values.control_a, control - values.control_b)
        now = SystemTick(x, p, seen, estimates, decided, mu, control)
        if self._last is not None:
            self._pairs.append((self._last, now))
        self._last = now
        return now

    @cached_property
    def _measure(self) -> NumpyFunction:
        return measure(self._tick.terms)

    @property
    def transitions(self) -> list[Transition]:
        """Those of the episode so far; raises ValueError, see `measure`, where a quantity cannot be measured."""
        new = self._pairs[len(self._transitions) :]
        self._transitions += [self._transition(len(self._transitions) + i, *pair) for i, pair in enumerate(new)]
        return self._transitions

    def _estimates(self, x: Array, p: Array, seen: Values) -> Estimates:
        if self._true is not None:
            true = p.astype(float)
            for name, value in self._true.items():
                true[self._places[name][0]] = np.ravel(value)
            found = self._error(x, p, true)
            return Estimates(found.alpha, found.beta, found.output_error)
        return self._policy.act(seen.observation, self._LgV(seen)) if self._policy else self._tick.no_error()

    def _LgV(self, seen: Values) -> Array:
        """Of the CLF, (m,), which is V-dot's slope over mu; zeros where there is none."""
        return seen.nominal_a[0] if self._problem.has_clf else np.zeros(self._problem.inputs)

    def _transition(self, number: int, before: SystemTick, after: SystemTick) -> Transition:
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
            LgV=self._LgV(before.seen),
            mu=before.mu,
            mu_qp=before.decided.mu,
            alpha=before.estimates.alpha,
            beta=before.estimates.beta,
            nominal=nominal,
            measured=self._measure(before.x, before.p, after.x, after.p, self._seconds).measured,
            next_observation=after.seen.observation,
            next_LgV=self._LgV(after.seen),
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
