"""Which controller has which adaptation."""

from cbf_clf_qp.res_clf import ResClf

from rl_cbf_clf_controller.adaptation import Adaptation, IdentifiedRobot, NoAdaptation
from rl_cbf_clf_controller.l1_adaptation import L1Adaptation
from rl_cbf_clf_controller.parameters import ControllerParameters


def make_adaptation(parameters: ControllerParameters, clf: ResClf, urdf: str | None = None) -> Adaptation:
    """L1's of the controller that has it; else by `adaptation`, of a robot whose nominal model is `urdf`."""
    p = parameters
    if p.controller == "l1-clf-qp":
        bounds = (p.l1_slope_bound, p.l1_offset_bound)
        return L1Adaptation(clf, p.l1_law, p.l1_gain, p.l1_cutoff, bounds, p.l1_substeps)
    return NoAdaptation() if p.adaptation == "none" else IdentifiedRobot(urdf)
