"""Transitions of any system under a `cbf_clf_qp` tick; RABBIT's, from its messages, are in `transitions.py`.

ticks = SystemTicks(tick, problem)
now = ticks.decide(x, p, estimates, observation, noise)           every tick; now.control is the input
trainer.take(ticks.transition(number, before, now, seconds))
"""

from dataclasses import dataclass

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates, measure
from cbf_clf_qp.functions import Array, Values
from cbf_clf_qp.tick import Tick
from rl_cbf_clf_controller.problem import Problem

from rl_trainer.transitions import Doubt, Transition


@dataclass(frozen=True)
class SystemTick:
    """A tick at a state `x` with the parameters `p`: what the model says (`seen`), the estimates, what was decided.

    `mu` (m,) as executed, with any exploration; `observation` (k,): what a policy reads.
    """

    x: Array
    p: Array
    seen: Values
    estimates: Estimates
    decided: Decided
    mu: Array
    observation: Array

    @property
    def control(self) -> Array:
        """The input u (m,) of this tick."""
        control: Array = self.decided.values.control_a @ self.mu + self.decided.values.control_b
        return control

    def nominal(self, mu: Array) -> Array:
        """The quantities (n,) by the model."""
        nominal: Array = self.seen.nominal_a @ mu + self.seen.nominal_b
        return nominal


class SystemTicks:
    """The ticks of a system that a `problem` is learned on, and the transitions between them."""

    def __init__(self, tick: Tick, problem: Problem) -> None:
        self._tick, self._problem, self._measure = tick, problem, measure(tick.terms)

    def decide(
        self, x: Array, p: Array, estimates: Estimates, observation: Array, noise: Array | float = 0.0
    ) -> SystemTick:
        """The tick; `noise` (m,) is added to its mu."""
        decided = self._tick.decide(x, p, estimates)
        return SystemTick(x, p, self._tick.look(x, p), estimates, decided, decided.mu + noise, observation)

    def LgV(self, x: Array, p: Array) -> Array:
        """Of the CLF, (m,), which is V-dot's slope over mu; zeros where there is none."""
        return self._LgV(self._tick.look(x, p))

    def _LgV(self, seen: Values) -> Array:
        return seen.nominal_a[0] if self._problem.has_clf else np.zeros(self._problem.inputs)

    def transition(
        self, number: int, before: SystemTick, after: SystemTick, seconds: float, failed: bool = False
    ) -> Transition:
        """The transition of tick `number`, between two ticks that are `seconds` apart under the input of the first.

        A measured value is a mean over the tick, so the nominal one is the mean of both ends under the held input; that
        of V has the start's slope at both, as its measurement has.
        """
        held = np.linalg.solve(after.seen.control_a, before.control - after.seen.control_b)
        nominal = (before.nominal(before.mu) + after.nominal(held)) / 2
        if self._problem.has_clf:
            nominal[0] = before.nominal((before.mu + held) / 2)[0]
        return Transition(
            problem=self._problem,
            tick=number,
            step_index=0,
            observation=before.observation,
            LgV=self._LgV(before.seen),
            mu=before.mu,
            mu_qp=before.decided.mu,
            alpha=before.estimates.alpha,
            beta=before.estimates.beta,
            nominal=nominal,
            measured=self._measure(before.x, before.p, after.x, after.p, np.array([seconds])).measured,
            next_observation=after.observation,
            next_LgV=self._LgV(after.seen),
            next_mu=after.mu,
            failed=failed,
            doubt=Doubt.NONE,
        )
