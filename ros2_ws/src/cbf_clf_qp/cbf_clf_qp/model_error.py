"""alpha and beta of every quantity from a second model of the system: what it says less what the nominal model says.

Both give every quantity as an affine function of mu at the same state; their difference is the estimate. The oracle's
second model is the plant's own, that of an adaptation the one it has identified.
"""

from typing import Any

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.tick import Terms


def model_error(terms: Terms[Any], dynamics: Any) -> Estimates:
    """The estimates that make the nominal quantities those of `dynamics`, at the state of `terms`."""
    error = terms.under(dynamics) - terms.nominal
    outputs = terms.scene.outputs.second_derivative(dynamics.acceleration).after(terms.precontrol)
    return Estimates(error.a, error.b, outputs - Affine.identity(len(outputs.b)))
