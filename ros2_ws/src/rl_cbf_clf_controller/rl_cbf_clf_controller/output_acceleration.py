"""The outputs' accelerations y'' as quantities, for the first approach: learned, and no row's [approach1_input]."""

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.tick import Terms
from rabbit_description.state import Array

from rl_cbf_clf_controller.pinned_robot import PinnedDynamics
from rl_cbf_clf_controller.scene import Scene


class OutputAcceleration:
    """y'' (4), rad/s^2."""

    names = ("y1", "y2", "y3", "y4")

    def predict(self, scene: Scene, dynamics: PinnedDynamics) -> Affine:
        """y'', affine in the torque."""
        return scene.outputs.second_derivative(dynamics.acceleration)

    def measure(self, before: Scene, after: Scene, seconds: float) -> Array:
        """The difference of the outputs' rates."""
        return (after.outputs.dy - before.outputs.dy) / seconds

    def rows(self, scene: Scene, value: Affine) -> list[Rows]:
        """None."""
        return []


class ReferenceClf:
    """The CLF's row on the reference model y'' = mu, which the input is to make true."""

    def __init__(self, clf: ResClf, quantity: Clf) -> None:
        self._clf, self._quantity = clf, quantity

    def rows(self, terms: Terms[Scene], control: Affine) -> list[Rows]:
        """The row."""
        return self._quantity.rows(terms.scene, self._clf.derivative(terms.scene.outputs.eta))
