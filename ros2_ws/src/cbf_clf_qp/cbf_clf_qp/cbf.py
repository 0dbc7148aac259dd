"""Control barrier functions of relative degree 1 as a quantity: B-dot, and the row that keeps B >= 0.

    B-dot + rate B >= 0

Those of relative degree 2 are in `ecbf.py`.
"""

from typing import Any

from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.rows import Rows


class Cbf:
    """Barriers as a quantity, B-dot. A barrier of your own is a subclass with `names`, `value` and `derivative`.

    Args:
        rate: 1/s; B may fall no faster than rate B.
        rescue_weight: of the slack of last resort on each row.

    Raises:
        ValueError: the rate is not positive.
    """

    names: tuple[str, ...]

    def __init__(self, rate: float, rescue_weight: float) -> None:
        if not rate > 0:
            raise ValueError(f"rate = {rate}: expected a positive rate in 1/s")
        self._rate, self._rescue_weight = rate, rescue_weight

    def value(self, scene: Any) -> Array:
        """B (n,) at a state."""
        raise NotImplementedError

    def derivative(self, scene: Any, acceleration: Affine) -> Affine:
        """B-dot (n), affine in whatever `acceleration` is affine in."""
        raise NotImplementedError

    def predict(self, scene: Any, dynamics: Any) -> Affine:
        """B-dot (n), affine in the input, under `dynamics`, which have the `acceleration` of the coordinates."""
        return self.derivative(scene, dynamics.acceleration)

    def measure(self, before: Any, after: Any, seconds: float) -> Array:
        """B-dot (n): the difference of the barriers."""
        difference: Array = (self.value(after) - self.value(before)) / seconds
        return difference

    def rows(self, scene: Any, value: Affine) -> list[Rows]:
        """A row for each barrier if B-dot is `value`, affine in mu."""
        lower = -self._rate * self.value(scene) - value.b
        return [Rows.at_least(self.names, value.a, lower, self._rescue_weight).normalised()]
