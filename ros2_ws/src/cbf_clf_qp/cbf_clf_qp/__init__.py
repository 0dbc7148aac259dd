"""CBF-CLF quadratic programmes for any control-affine system, as CasADi expressions. Read `tick.py` first."""

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.barrier import Barrier
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import NumpyFunction
from cbf_clf_qp.measurement import measure, model_error
from cbf_clf_qp.objective import nearest
from cbf_clf_qp.rows import HARD
from cbf_clf_qp.system import System, mechanical
from cbf_clf_qp.tick import Tick

__all__ = ["HARD", "Affine", "Barrier", "Clf", "Estimates", "NumpyFunction", "System", "Tick"]
__all__ += ["measure", "mechanical", "model_error", "nearest"]
