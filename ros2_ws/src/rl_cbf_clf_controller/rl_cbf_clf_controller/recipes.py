"""The seven controllers: which QP has which quantities, constraints, corners and objective. One table."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.affine import Affine, inverse
from cbf_clf_qp.constraints import Barrier, Clf, ResClf
from cbf_clf_qp.quantity import Constrained, Constraint, Quantity, Rows, Terms, at_most
from cbf_clf_qp.tick import Tick
from rabbit_description.state import TICK_SECONDS

from rl_cbf_clf_controller.contact_force import contact_force, force_rows
from rl_cbf_clf_controller.kinds import Kind, find_kind
from rl_cbf_clf_controller.l1_adaptation import l1_adaptation
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.stone_barriers import stone_barriers
from rl_cbf_clf_controller.uncertainty import IO_RL_CLF_QP, RL_CBF_CLF_QP, RL_CLF_QP
from rl_cbf_clf_controller.walking import Walking
from rl_cbf_clf_controller.worst_case import worst_cases

Parameters = ControllerParameters
CLF_RESCUE_WEIGHT, BARRIER_RESCUE_WEIGHT, FORCE_RESCUE_WEIGHT = 1e6, 1e3, 1e5  # of the rows' slacks of last resort
MU_WEIGHT = 0.01  # of |mu|^2 in `pd_centred`


def flat(w: Walking, p: Parameters) -> list[Constrained]:
    """The CLF's row, hard but for a slack of last resort."""
    return [Clf(w.outputs.y, w.gains["eps"], (p.kp, p.kd), CLF_RESCUE_WEIGHT, rescue=True)]


def stones(w: Walking, p: Parameters) -> list[Constrained]:
    """The CLF relaxed by d, both barriers, the ground's force."""
    g, stone = w.gains, w.stone
    clf = Clf(w.outputs.y, g["eps"], (p.kp, p.kd), g["slack_weight"], in_mu=p.clf_row == "normalised")
    edges = stone.l_min + g["stone_margin"], stone.l_max - g["stone_margin"]
    both = stone_barriers(w.robot.swing, *edges, stone.height, g["R1"], g["R2"])
    poles, weight = (g["barrier_pole_1"], g["barrier_pole_2"]), BARRIER_RESCUE_WEIGHT
    barriers = [Barrier(f"B{i}", B, poles, weight, p.barrier_rows) for i, B in enumerate(both, 1)]
    return [clf, *barriers, contact_force(w.robot.force, w.force, rows_of_force(w, p) if p.force_rows else None)]


def outputs(w: Walking, p: Parameters) -> list[Constrained]:
    """The outputs' accelerations y'', which the input corrects [approach1_input]; no row is theirs."""
    y_ddot, m = w.output_dynamics, w.outputs.y.numel()
    names, itself = tuple(f"y{i + 1}" for i in range(m)), Affine(ca.SX.eye(m), ca.SX.zeros(m))
    return [Quantity(names, y_ddot, lambda value: [], lower=w.eta[m:], slope=itself, outputs=y_ddot)]


def rows_of_force(w: Walking, p: Parameters) -> Callable[[Affine], list[Rows]]:
    """The rows of the forces, with the margin taken off the friction coefficient."""
    least, coeff = w.gains["min_normal_force"], w.gains["friction_coeff"] - w.gains["friction_margin"]
    return partial(force_rows, least=least, coeff=coeff, weight=FORCE_RESCUE_WEIGHT, is_literal=p.cone == "literal")


def res_clf(w: Walking, p: Parameters) -> ResClf:
    """The RES-CLF of the outputs, where no quantity of the controller brings one."""
    return ResClf(w.outputs.y.numel(), w.gains["eps"], (p.kp, p.kd))


def reference_clf(w: Walking, p: Parameters) -> Constraint:
    """The CLF's row on the reference model y'' = mu, which the input is to make true."""

    def rows(terms: Terms) -> list[Rows]:
        clf = res_clf(w, p)
        V_dot = clf.derivative(w.eta)
        upper = -clf.rate * clf.value(w.eta) - V_dot.b
        return [at_most(("CLF",), V_dot.a, upper, CLF_RESCUE_WEIGHT)]

    return rows


def nominal_force(w: Walking, p: Parameters) -> Constraint:
    """The force rows on what the nominal model says, where no force is estimated."""
    build, force = rows_of_force(w, p), contact_force(w.robot.force, w.force, None)
    return lambda terms: build(force.value.after(terms.control))


CLF = Kind(RL_CLF_QP, flat)
RL_CLF = Kind(RL_CLF_QP, flat, learns=True)
L1_CLF = Kind(IO_RL_CLF_QP, outputs, compensation=l1_adaptation)
IO_RL_CLF = Kind(IO_RL_CLF_QP, outputs, learns=True)
CBF_CLF = Kind(RL_CBF_CLF_QP, stones, "stones")
RL_CBF_CLF = Kind(RL_CBF_CLF_QP, stones, "stones", learns=True)
ROBUST_CBF_CLF = Kind(RL_CBF_CLF_QP, stones, "stones", corners=worst_cases)


def make_tick(w: Walking, p: Parameters, further: Sequence[Constrained] = ()) -> Tick:
    """The tick of the controller that the parameters name; `further` quantities have rows and no estimates."""
    kind = find_kind(p.controller)
    quantities = kind.quantities(w, p)
    constraints = [unestimated(quantity) for quantity in further]
    if kind.problem.corrects_input:
        constraints.insert(0, reference_clf(w, p))
    if p.flat_force_rows and kind.terrain != "stones":
        constraints.append(nominal_force(w, p))
    return Tick(
        w.system,
        quantities,
        control=w.output_dynamics.inverse(),
        limit=w.gains["torque_limit"],
        constraints=constraints,
        objective=None if p.objective == "paper" else pd_objective(w, p, kind.problem.corrects_input),
        corners=kind.corners(w, p) if kind.corners else None,
        corrects_input=kind.problem.corrects_input,
        reads=reads(w, p, barriers_of([*quantities, *further])),
        solver=p.qp_solver,
    )


def barriers_of(quantities: Sequence[Constrained]) -> dict[str, ca.SX]:
    """The quantities that are barriers, by name."""
    return {barrier.name: barrier.B for barrier in quantities if isinstance(barrier, Barrier)}


def unestimated(further: Constrained) -> Constraint:
    """The rows of a quantity under the nominal model."""

    def rows(terms: Terms) -> list[Rows]:
        quantity = further.on(terms.system)
        return quantity.rows(quantity.value.after(terms.control))

    return rows


def pd_objective(w: Walking, p: Parameters, corrects_input: bool) -> Any:
    """`pd_centred`. Where the input is corrected, y'' = mu, as it makes it."""

    def objective(terms: Terms) -> Affine:
        m = terms.inputs
        error = Affine(ca.SX.zeros(m, m), ca.SX.zeros(m)) if corrects_input else terms.output_error
        change = Affine(terms.control.a, terms.control.b - w.held)
        # a change since the last tick is as small as the tick is short, and shall cost the same in the same time
        weights = MU_WEIGHT, TICK_SECONDS / p.tick_seconds * w.gains["torque_change_weight"]
        return pd_centred(w.eta[:m], w.eta[m:], w.gains["eps"], error, change, weights)

    return objective


def pd_centred(
    y: ca.SX,
    dy: ca.SX,
    eps: ca.SX | float,
    output_error: Affine,
    change: Affine,
    weights: tuple[ca.SX | float, ca.SX | float],
) -> Affine:
    """min |E mu + Delta - v_PD|^2 + w_1 |mu|^2 + w_2 |change(mu)|^2: outputs y (m,), rates dy, follow a PD law.

    y'' = E mu + Delta is the present estimate of the output dynamics: E = I + Delta_2, Delta = Delta_1 [delta_IO2]. The
    PD law is that of the CLF's Riccati equation (Q = I):  v_PD = -y / eps^2 - sqrt(3) dy / eps. mu' mu asks for the
    smallest mu, whatever it does to the outputs: where the model is wrong and eta near 0, the smallest mu lets the
    error Delta_1 drive the outputs away until the CLF row holds them, and the torque jumps from tick to tick.

    `change` C mu + c is that of the torque since the last tick. Where motors are slow, a torque that jumps comes late.

    The value is root mu - center, with root upper triangular: root' root = E'E + w_1 I + w_2 C'C,
    root' center = E' (v_PD - Delta) - w_2 C'c.
    """
    identity, (of_mu, of_change) = ca.SX.eye(y.numel()), weights
    E, wanted = identity + output_error.a, -y / eps**2 - np.sqrt(3) * dy / eps
    root = ca.chol(E.T @ E + of_mu * identity + of_change * change.a.T @ change.a)
    pull = E.T @ (output_error.b - wanted) + of_change * change.a.T @ change.b
    return Affine(root, inverse(root).T @ pull)


def reads(w: Walking, p: Parameters, barriers: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """What estimators, recorders and the page read of a state besides what the quantities show."""
    clf, y_ddot, B = res_clf(w, p), w.output_dynamics, barriers.values()
    return {
        "barriers": ca.vertcat(ca.SX(0, 1), *B),
        "barrier_rates": ca.vertcat(ca.SX(0, 1), *map(w.robot.rate, B)),
        "eta": w.eta,
        "V": clf.value(w.eta),
        "LgV": clf.derivative(w.eta).a.T,
        "phase": w.outputs.phase,
        "observation": w.observation,
        "swing": w.robot.swing,
        "stone": ca.vertcat(w.stone.l_min, w.stone.l_max, w.stone.height),
        "outputs_a": y_ddot.a,
        "outputs_b": y_ddot.b,
    }
