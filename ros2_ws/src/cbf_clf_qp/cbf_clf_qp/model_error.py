"""alpha and beta of every quantity from a second model of the system: what it says less what the nominal model says.

Both give every quantity as an affine function of mu at the same state; their difference is the estimate. The oracle's
second model is the plant's own, that of an adaptation the one it has identified.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.tick import Quantity, Terms
from cbf_clf_qp.tracing import Traced


class ModelError:
    """By how much a second model differs, tick after tick."""

    def __init__(self) -> None:
        self._quantities: tuple[Quantity[Any], ...] | None = None

    def __call__(self, terms: Terms[Any], dynamics: Any) -> Estimates:
        """The estimates that make the nominal quantities those of `dynamics`, at the state of `terms`."""
        if self._quantities is not terms.quantities:
            self._quantities, self._error = terms.quantities, traced_error(terms.quantities).twin()
        estimates: Estimates = self._error(terms.scene, terms.precontrol, terms.nominal, dynamics)[0]
        return estimates


@lru_cache(maxsize=64)
def traced_error(quantities: tuple[Quantity[Any], ...]) -> Traced:
    """The estimates, with the outputs' error."""

    def error(scene: Any, precontrol: Affine, nominal: Affine, dynamics: Any) -> list[Estimates]:
        return [error_under(dynamics, Terms(quantities, scene, None, precontrol, nominal))]

    return Traced(error, quantities)


def error_under(dynamics: Any, terms: Terms[Any]) -> Estimates:
    """The estimates that make the nominal quantities of `terms` those of `dynamics`."""
    quantity = terms.under(dynamics) - terms.nominal
    outputs = terms.scene.outputs.second_derivative(dynamics.acceleration).after(terms.precontrol)
    return Estimates(quantity.a, quantity.b, Affine(outputs.a - np.eye(len(outputs.b)), outputs.b))
