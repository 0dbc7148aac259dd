"""Which weights are published while the robot walks: those that are no worse than the ones in force.

    e = mean over the quantities of `held_out_error.estimation_error` on the newest held-out ticks

One walking step in five is held out: its transitions are measured by and never learned from. Whole steps, because the
ticks of one step resemble each other.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from rl_cbf_clf_controller.policy import LearnedPolicy, ZeroPolicy

from rl_trainer.held_out_error import estimation_error
from rl_trainer.parameters import TrainingParameters
from rl_trainer.transitions import Doubt, Transition

EVERY = 5  # walking steps, of which one is held out
NEWEST = 200  # held-out ticks kept, five steps
LEAST = 30  # on fewer nothing is decided


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
    """Holds out transitions, knows the policy in force, and judges others."""

    def __init__(self, parameters: TrainingParameters) -> None:
        self.in_force: LearnedPolicy = ZeroPolicy(parameters.problem)
        self._parameters = parameters
        self._held_out: deque[Transition] = deque(maxlen=NEWEST)
        self._steps = 0
        self._newest = (-1, -1)  # step index and tick

    def holds_out(self, transition: Transition) -> bool:
        """Take a transition for measuring, if it is of a step for that; False: it is for learning."""
        index, tick = self._newest
        self._steps += transition.step_index != index or transition.tick <= tick
        self._newest = transition.step_index, transition.tick
        if self._steps % EVERY or transition.doubt & ~Doubt.SATURATED:
            return False
        self._held_out.append(transition)
        return True

    @property
    def held_out(self) -> list[Transition]:
        """What it measures by, oldest first."""
        return list(self._held_out)

    def restore(self, held_out: Iterable[Transition]) -> None:
        """Measure by these again, after a checkpoint."""
        self._held_out.extend(held_out)

    def judge(self, policy: LearnedPolicy) -> Verdict | None:
        """The policy against the one in force; None while too few ticks are held out."""
        if len(self._held_out) < LEAST:
            return None
        errors = (self._error(policy), self._error(self.in_force))
        return Verdict(policy.version, errors[0], self.in_force.version, errors[1], len(self._held_out))

    def _error(self, policy: LearnedPolicy) -> float:
        return float(estimation_error(policy, self._held_out, self._parameters).mean())
