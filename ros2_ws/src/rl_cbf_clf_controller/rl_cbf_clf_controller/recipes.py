"""The seven controllers: which QP has which quantities, estimators, constraints and objective. One table."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.objective import Objective, pd_centred, pd_input
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.saturation import Saturation
from cbf_clf_qp.tick import Constraint, Recipe, Terms, least_mu

from rl_cbf_clf_controller.contact_force import ContactForce, NominalForce
from rl_cbf_clf_controller.kinds import Estimators, Kind, Quantities, find_kind
from rl_cbf_clf_controller.l1_adaptation import L1Adaptation
from rl_cbf_clf_controller.output_acceleration import OutputAcceleration, ReferenceClf
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.scene import ControllerError, Scene
from rl_cbf_clf_controller.stone_barriers import StoneBarriers
from rl_cbf_clf_controller.terrain import SteppingStones
from rl_cbf_clf_controller.uncertainty import IO_RL_CLF_QP, RL_CBF_CLF_QP, RL_CLF_QP
from rl_cbf_clf_controller.worst_case import WorstCase

Parameters = ControllerParameters


def flat(p: Parameters, clf: ResClf) -> Quantities:
    """The CLF's row, hard but for a slack of last resort."""
    return (hard_clf(p, clf),)


def stones(p: Parameters, clf: ResClf) -> Quantities:
    """The CLF relaxed by d, both barriers, the ground's force."""
    soft_clf = Clf(clf, p.slack_weight, is_normalised=p.clf_row == "normalised")
    poles = (p.barrier_pole_1, p.barrier_pole_2)
    return soft_clf, StoneBarriers(poles, p.barrier_rescue_weight, p.barrier_rows), contact_force(p, p.force_rows)


def outputs(p: Parameters, clf: ResClf) -> Quantities:
    """The outputs' accelerations, which the input corrects."""
    return (OutputAcceleration(),)


def l1(p: Parameters, clf: ResClf) -> Estimators:
    """The L1 adaptation, whose input cancels the error of the outputs' accelerations."""
    bounds = (p.l1_slope_bound, p.l1_offset_bound)
    return (L1Adaptation(clf, p.l1_law, p.l1_gain, p.l1_cutoff, bounds, p.l1_substeps),)


def worst_case(p: Parameters, clf: ResClf) -> Estimators:
    """The corners of what the model error may be."""
    return (WorstCase(p),)


CLF = Kind(RL_CLF_QP, flat)
RL_CLF = Kind(RL_CLF_QP, flat, learns=True)
L1_CLF = Kind(IO_RL_CLF_QP, outputs, estimators=l1)
IO_RL_CLF = Kind(IO_RL_CLF_QP, outputs, learns=True)
CBF_CLF = Kind(RL_CBF_CLF_QP, stones, SteppingStones)
RL_CBF_CLF = Kind(RL_CBF_CLF_QP, stones, SteppingStones, learns=True)
ROBUST_CBF_CLF = Kind(RL_CBF_CLF_QP, stones, SteppingStones, estimators=worst_case)


def make_recipe(p: Parameters, estimators: Estimators, constraints: Sequence[Constraint] = ()) -> Recipe[Scene]:
    """The recipe of the controller that the parameters name.

    `estimators`, `constraints`: further ones. The first estimator is the policy.
    """
    fixed = _fixed_part(p)
    return replace(
        fixed,
        constraints=(*fixed.constraints, *constraints),
        estimators=(*estimators, *find_kind(p.controller).estimators(p, make_clf(p))),
    )


@lru_cache(maxsize=64)
def _fixed_part(p: ControllerParameters) -> Recipe[Scene]:
    """What keeps nothing from tick to tick; the same objects for the same parameters, so that a trace serves all."""
    kind, clf = find_kind(p.controller), make_clf(p)
    reference = [ReferenceClf(clf, hard_clf(p, clf))] if p.problem.corrects_input else []
    forces = [NominalForce(contact_force(p))] if p.flat_force_rows and kind.terrain is not SteppingStones else []
    return Recipe(
        quantities=kind.quantities(p, clf),
        constraints=(*reference, *forces, Saturation(p.torque_limit)),
        corrects_input=p.problem.corrects_input,
        objective=least_mu if p.objective == "paper" else pd_objective(p, p.problem.corrects_input),
    )


@lru_cache(maxsize=64)
def make_clf(p: ControllerParameters) -> ResClf:
    """Of RABBIT's four outputs; it keeps nothing from tick to tick, so one serves all who ask."""
    return ResClf(4, p.eps, (p.kp, p.kd))


def hard_clf(p: Parameters, clf: ResClf) -> Clf:
    """Of the flat-ground controllers."""
    return Clf(clf, p.clf_rescue_weight, is_rescue=True)


def contact_force(p: Parameters, has_rows: bool = True) -> ContactForce:
    """With the margin taken off the friction coefficient."""
    coeff = p.friction_coeff - p.friction_margin
    return ContactForce(p.min_normal_force, coeff, p.force_rescue_weight, p.cone == "literal", has_rows)


def pd_objective(p: Parameters, corrects_input: bool) -> Callable[[Terms[Scene], Estimates], Objective]:
    """`pd_centred`. Where the input is corrected, y'' = mu, as it makes it."""

    def objective(terms: Terms[Scene], estimates: Estimates) -> Objective:
        m = len(terms.precontrol.b)
        error = Affine.zero(m, m) if corrects_input else estimates.output_error
        if error is None:
            raise ControllerError("objective pd_centred: expected a structured policy, which gives the output error")
        return pd_centred(pd_input(terms.scene.outputs.y, terms.scene.outputs.dy, p.eps), error, p.mu_weight)

    return objective
