"""The condition of a RES-CLF as a quantity: V-dot, its error estimated, and the row V-dot + (clf_rate / eps) V <= 0."""

from typing import Any

import numpy as np

from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.rows import Rows


class Clf:
    """V-dot (1), affine in the input. The scene's `outputs` have `eta` and their `second_derivative`.

    Args:
        clf: of the outputs.
        slack_weight: p, of the row's slack; `is_rescue`: that slack is one of last resort, not the paper's d.
        is_normalised: the row is divided by its norm, so that its slack is in units of mu.
    """

    names = ("V",)

    def __init__(self, clf: ResClf, slack_weight: float, is_rescue: bool = False, is_normalised: bool = True) -> None:
        self._clf, self._slack_weight = clf, slack_weight
        self._is_rescue, self._is_normalised = is_rescue, is_normalised

    def predict(self, scene: Any, dynamics: Any) -> Affine:
        """V-dot under `dynamics`."""
        return self._clf.derivative(scene.outputs.eta).after(scene.outputs.second_derivative(dynamics.acceleration))

    def measure(self, before: Any, after: Any, seconds: float) -> Array:
        """V-dot = LfV + LgV y^(r): the gradient of V is known, y^(r) the difference of the highest derivatives in eta.

        The difference of V itself would be off by the tick times |G y^(r)|^2 in the metric P.
        """
        slope = self._clf.derivative(before.outputs.eta)
        m = slope.a.shape[1]
        return slope((after.outputs.eta[-m:] - before.outputs.eta[-m:]) / seconds)

    def rows(self, scene: Any, value: Affine) -> list[Rows]:
        """The row if V-dot is `value`, affine in mu."""
        upper = np.array([self._clf.bound(scene.outputs.eta)]) - value.b
        row = Rows.at_most(("CLF",), value.a, upper, self._slack_weight, rescue=self._is_rescue)
        return [row.normalised() if self._is_normalised else row]
