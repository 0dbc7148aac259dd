"""Rows of the QP, as expressions: what every constraint yields at a tick."""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

HARD = float("inf")  # weight of a row without slack
Number = ca.SX | float


@dataclass(frozen=True)
class Rows:
    """Named rows `lower <= A mu - slack <= upper`, k of them, over mu (m,).

    `slack_weight`: the cost w s^2 of violating a row by s, positive; HARD: no slack. `in_mu`: s is in units of mu, that
    is s times the norm of the row of A is its violation; else in the row's own.
    `rescue` separates a slack of last resort, whose use is published, from one that the problem has (the paper's d).
    """

    names: tuple[str, ...]
    A: ca.SX
    lower: ca.SX
    upper: ca.SX
    slack_weight: Number = HARD
    rescue: bool = True
    in_mu: bool = True

    @property
    def is_hard(self) -> bool:
        return isinstance(self.slack_weight, float) and self.slack_weight == HARD


def at_most(
    names: Sequence[str], A: ca.SX, upper: ca.SX, slack_weight: Number, rescue: bool = True, in_mu: bool = True
) -> Rows:
    """`A mu <= upper`, each row with a slack of its own."""
    return Rows(tuple(names), A, ca.SX(-ca.inf * ca.DM.ones(len(names))), upper, slack_weight, rescue, in_mu)


def at_least(names: Sequence[str], A: ca.SX, lower: ca.SX, slack_weight: Number, rescue: bool = True) -> Rows:
    """`A mu >= lower`, each row with a slack of its own."""
    return at_most(names, -A, -lower, slack_weight, rescue)
