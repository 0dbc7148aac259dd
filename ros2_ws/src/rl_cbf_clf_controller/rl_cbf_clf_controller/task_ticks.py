"""The ticks of a control task: what its model says of a state, the estimates, and the input that the QP decides."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates, model_error
from cbf_clf_qp.functions import Array, Values, places_of
from cbf_clf_qp.tick import Tick

from rl_cbf_clf_controller.policy import LearnedPolicy
from rl_cbf_clf_controller.problem import Problem


@dataclass(frozen=True)
class TaskTick:
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


class TaskTicks:
    """The ticks of a system that a `problem` is learned on.

    `tick`: its `reads` have an `observation` (k,), what a policy reads; `limit`: of each component of the input, also
    with exploration; `pairs`: of an episode, those of which the second follows the first.
    """

    def __init__(self, tick: Tick, problem: Problem, limit: float = np.inf) -> None:
        self._tick, self._problem, self._limit = tick, problem, limit
        self._error = model_error(tick.terms)
        self._places = places_of(tick.system.named)
        self.begin()

    def begin(self, policy: LearnedPolicy | None = None, true: Mapping[str, Array | float] | None = None) -> None:
        """Begin an episode with the estimates of a policy, or an oracle's exact ones; without either they are zero.

        The oracle knows the `true` parameters by name; those that are not named are what the model has.
        """
        self._policy, self._true = policy, true
        self.pairs = list[tuple[TaskTick, TaskTick]]()
        self.interrupt()

    def interrupt(self) -> None:
        """The next tick does not follow the last: something was missed, or the state has jumped."""
        self._last: TaskTick | None = None

    def __call__(self, x: Array, p: Array, noise: Array | float = 0.0) -> TaskTick:
        """The tick at a state; `noise` (m,) is added to its mu."""
        seen = self._tick.look(x, p)
        estimates = self._estimates(x, p, seen)
        decided = self._tick.decide(x, p, estimates)
        mu, values = decided.mu + noise, decided.values
        control: Array = values.control_a @ mu + values.control_b
        if np.abs(control).max() > self._limit:
            control = control.clip(-self._limit, self._limit)
            mu = np.linalg.solve(values.control_a, control - values.control_b)
        now = TaskTick(x, p, seen, estimates, decided, mu, control)
        if self._last is not None:
            self.pairs.append((self._last, now))
        self._last = now
        return now

    def _estimates(self, x: Array, p: Array, seen: Values) -> Estimates:
        if self._true is not None:
            true = p.astype(float)
            for name, value in self._true.items():
                true[self._places[name][0]] = np.ravel(value)
            found = self._error(x, p, true)
            return Estimates(found.alpha, found.beta, found.output_error)
        return self._policy.act(seen.observation, self.LgV(seen)) if self._policy else self._tick.no_error()

    def LgV(self, seen: Values) -> Array:
        """The slope (m,) of the CLF, which is V-dot's slope over mu; zeros where there is none."""
        return seen.nominal_a[0] if self._problem.has_clf else np.zeros(self._problem.inputs)
