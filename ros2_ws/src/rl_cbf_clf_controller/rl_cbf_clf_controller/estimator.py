"""What says how wrong the nominal quantities are: a policy, an identified robot, an oracle, an adaptation."""

from abc import ABC, abstractmethod
from copy import copy
from typing import Self

from cbf_clf_qp.estimates import Estimates

from rl_cbf_clf_controller.scene import Scene


class Estimator(ABC):
    """The estimates of all estimators of a controller are added."""

    @abstractmethod
    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        """Alpha and beta of every quantity, to be added to those of the estimators `before`; called once a tick."""

    def another(self) -> Self:
        """One for another robot in the same thread: the same functions, nothing learned. Of one with parts that learn,
        these must be others too."""
        other = copy(self)
        other.reset()
        return other

    def reset(self) -> None:  # noqa: B027  most keep nothing
        """Begin an episode: forget what the last one taught."""
