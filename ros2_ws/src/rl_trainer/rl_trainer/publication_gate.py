"""Which weights are published while the robot walks: those that are no worse than the ones in force.

    e_i = rms(correction_i - target_i) / rms(target_i)      0: exact, 1: no better than the zero policy
    e   = mean of e_i over the quantities, on the newest held-out ticks

One walking step in five is held out: its transitions are measured by and never learned from. Whole steps, because the
ticks of one step resemble each other.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rabbit_description.state import Array
from rl_cbf_clf_controller.policy import LearnedPolicy, ZeroPolicy

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit
from rl_trainer.transitions import Doubt, Transition

EVERY = 5  # walking steps, of which one is held out
NEWEST = 200  # held-out ticks kept, five steps
LEAST = 30  # on fewer nothing is decided


def estimation_error(policy: LearnedPolicy, transitions: Sequence[Transition], parameters: TrainingParameters) -> Array:
    """e_i of each quantity, (n,), over the transitions beyond doubt; NaN where there are none.

    Measured errors only, in units of `error_unit`. In the first approach the target at mu is not known for another
    policy than the one that walked; but the executed v is the right input for the measured y'', so it is asked at
    mu = y''.
    """
    wrong, size = [], []
    for transition in transitions:
        if transition.doubt & ~Doubt.SATURATED:
            continue
        unit = error_unit(transition.LgV, parameters)
        mu = transition.measured if transition.problem.corrects_input else transition.mu
        estimates = policy.act(transition.observation, transition.LgV)
        wrong.append((estimates.error(mu) - transition.target) / unit)
        size.append(transition.target / unit)
    if not wrong:
        return np.full(parameters.n, np.nan)
    ratio: Array = np.sqrt(np.square(wrong).sum(axis=0) / np.square(size).sum(axis=0))
    return ratio


@dataclass(frozen=True)
class Verdict:
    """A policy's error e and that of the one in force, both on the same `ticks` held-out ticks."""

    version: str
    error: float
    version_in_force: str
    error_in_force: float
    ticks: int

    @property
    def passes(self) -> bool:
        """Whether to publish it."""
        return self.error <= self.error_in_force

    def __str__(self) -> str:
        """As it is logged."""
        word = "published" if self.passes else "kept back"
        other = f"{self.version_in_force}, in force, has {self.error_in_force:.4f}"
        return f"policy {self.version} {word}: error {self.error:.4f} on {self.ticks} held-out ticks, {other}"


class PublicationGate:
    """Holds out transitions, knows the policy in force, and judges others. `held_out`: it judges by, oldest first."""

    def __init__(self, parameters: TrainingParameters) -> None:
        self.in_force: LearnedPolicy = ZeroPolicy(parameters.problem)
        self.held_out: deque[Transition] = deque(maxlen=NEWEST)
        self._parameters = parameters
        self._steps = 0
        self._newest = (-1, -1)  # step index and tick

    def holds_out(self, transition: Transition) -> bool:
        """Take a transition for measuring, if it is of a step for that; False: it is for learning."""
        index, tick = self._newest
        self._steps += transition.step_index != index or transition.tick <= tick
        self._newest = transition.step_index, transition.tick
        if self._steps % EVERY or transition.doubt & ~Doubt.SATURATED:
            return False
        self.held_out.append(transition)
        return True

    def judge(self, policy: LearnedPolicy) -> Verdict | None:
        """The policy against the one in force; None while too few ticks are held out."""
        if len(self.held_out) < LEAST:
            return None
        both = policy, self.in_force
        error, in_force = (float(estimation_error(each, self.held_out, self._parameters).mean()) for each in both)
        return Verdict(policy.version, error, self.in_force.version, in_force, len(self.held_out))
