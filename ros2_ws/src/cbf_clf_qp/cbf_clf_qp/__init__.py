"""CBF-CLF quadratic programmes for any control-affine system, as CasADi expressions. Read `tick.py` first."""

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.constraints import Barrier, Clf
from cbf_clf_qp.estimates import Estimates, measure, model_error
from cbf_clf_qp.functions import NumpyFunction
from cbf_clf_qp.qp import nearest
from cbf_clf_qp.quantity import HARD, Constrained, Quantity, Rows, Terms, at_least, at_most
from cbf_clf_qp.system import DegreeError, System, mechanical
from cbf_clf_qp.tick import Tick

__all__ = ["HARD", "Affine", "Barrier", "Clf", "Constrained", "Decided", "DegreeError", "Estimates", "NumpyFunction"]
__all__ += ["Quantity", "Rows", "System", "Terms", "Tick", "at_least", "at_most", "measure"]
__all__ += ["mechanical", "model_error", "nearest"]
