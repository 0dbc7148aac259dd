"""Rows of the QP: what every constraint yields at a tick, and the function that stacks them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cbf_clf_qp.affine import Array

NO_SLACK = np.inf


@dataclass(frozen=True)
class Rows:
    """Named rows `lower <= A mu - slack <= upper`, k of them, over mu (m,).

    `slack_weight`: the cost w s^2 of violating a row by s; inf makes the rows hard. s is in the row's own units, or
    where the rows are `normalised` in units of mu: s times the norm of the row of A is its violation.
    `rescue` tells a slack of last resort, whose use is published, from one the problem itself has (the paper's d).
    """

    names: tuple[str, ...]
    A: Array
    upper: Array
    lower: Array
    slack_weight: float
    rescue: bool = True
    is_normalised: bool = False

    @classmethod
    def at_most(cls, names: Sequence[str], A: Array, upper: Array, slack_weight: float, rescue: bool = True) -> "Rows":
        """`A mu <= upper`, each row with the same slack weight."""
        return cls(tuple(names), A, upper, np.full(len(names), -np.inf), slack_weight, rescue)

    @classmethod
    def at_least(cls, names: Sequence[str], A: Array, lower: Array, slack_weight: float) -> "Rows":
        """`A mu >= lower`."""
        return cls.at_most(names, -A, -lower, slack_weight)

    @classmethod
    def between(cls, names: Sequence[str], A: Array, lower: Array, upper: Array) -> "Rows":
        """`lower <= A mu <= upper`, hard."""
        return cls(tuple(names), A, upper, lower, NO_SLACK, False)

    def normalised(self) -> "Rows":
        """The same rows with slacks in units of mu."""
        return Rows(self.names, self.A, self.upper, self.lower, self.slack_weight, self.rescue, is_normalised=True)
