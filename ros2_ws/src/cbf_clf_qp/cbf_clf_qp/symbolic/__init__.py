"""CBF-CLF quadratic programmes for any control-affine system, as CasADi expressions. Read `tick.py` first."""

from cbf_clf_qp.symbolic.affine import Affine
from cbf_clf_qp.symbolic.barrier import Barrier
from cbf_clf_qp.symbolic.clf import Clf
from cbf_clf_qp.symbolic.estimates import Estimates
from cbf_clf_qp.symbolic.functions import NumpyFunction
from cbf_clf_qp.symbolic.measure import measure, model_error
from cbf_clf_qp.symbolic.objective import nearest
from cbf_clf_qp.symbolic.rows import HARD
from cbf_clf_qp.symbolic.system import System, mechanical
from cbf_clf_qp.symbolic.tick import Tick

__all__ = ["HARD", "Affine", "Barrier", "Clf", "Estimates", "NumpyFunction", "System", "Tick"]
__all__ += ["measure", "mechanical", "model_error", "nearest"]
