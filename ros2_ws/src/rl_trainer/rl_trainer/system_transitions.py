"""Transitions of any system under a `cbf_clf_qp` recipe; RABBIT's, from its messages, are in `transitions.py`.

tick = SystemTick(terms, decided, mu, observation)               every tick, mu as executed
trainer.take(transition(problem, number, tick, next_tick, seconds))
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from cbf_clf_qp.affine import Array
from cbf_clf_qp.problem import Problem
from cbf_clf_qp.tick import Decided, Terms, measured

from rl_trainer.transitions import Doubt, Transition


@dataclass(frozen=True)
class SystemTick:
    """A tick: the model's terms, what was decided, `mu` (m,) as executed, with any exploration, `observation` (k,)."""

    terms: Terms[Any]
    decided: Decided
    mu: Array
    observation: Array

    @property
    def control(self) -> Array:
        """The input u (m,) of this tick."""
        return self.decided.control(self.mu)

    def LgV(self, problem: Problem) -> Array:
        """Of the CLF, (m,), which is V-dot's slope over mu; zeros where there is none."""
        return self.terms.nominal.a[0] if problem.has_clf else np.zeros(problem.inputs)


def transition(
    problem: Problem, number: int, before: SystemTick, after: SystemTick, seconds: float, failed: bool = False
) -> Transition:
    """The transition of tick `number`, between two ticks that are `seconds` apart under the input of the first.

    A measured value is a mean over the tick, so the nominal one is the mean of both ends under the held input; that of
    V has the start's slope at both, as its measurement has.
    """
    held = after.terms.precontrol.inverse()(before.control)
    nominal = (before.terms.nominal(before.mu) + after.terms.nominal(held)) / 2
    if problem.has_clf:
        nominal[0] = before.terms.nominal((before.mu + held) / 2)[0]
    quantities = before.terms.quantities
    return Transition(
        problem=problem,
        tick=number,
        step_index=0,
        observation=before.observation,
        LgV=before.LgV(problem),
        mu=before.mu,
        mu_qp=before.decided.mu,
        alpha=before.decided.estimates.alpha,
        beta=before.decided.estimates.beta,
        nominal=nominal,
        measured=measured(quantities, before.terms.scene, after.terms.scene, seconds),
        next_observation=after.observation,
        next_LgV=after.LgV(problem),
        next_mu=after.mu,
        failed=failed,
        doubt=Doubt.NONE,
    )
