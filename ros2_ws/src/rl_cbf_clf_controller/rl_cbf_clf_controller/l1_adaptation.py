"""L1 adaptation of the CLF-QP (Nguyen and Sreenath, ACC 2015): the model's error in y-ddot, estimated and cancelled.

    plant       y'' = mu + model_error,   model_error = Delta_1 + Delta_2 mu = slope |mu| + offset     [delta_IO2]
    input       mu = mu_1 + mu_2,   mu_1 of the CLF-QP on the reference model y'' = mu_1,   mu_2 = -C(s) estimate
    predictor   predicted' = F predicted + G (mu + estimate + K error),   error = predicted - eta
    adaptation  estimate = slope |mu| + offset,   s = G' P_eps error
                slope' = gain Proj(-|mu| s),   offset' = gain Proj(-s)
    filter      C(s) = cutoff / (s + cutoff),   C(0) = 1

K is the CLF's own feedback, so V(error) falls by the CLF condition but for model_error - estimate, which the adaptation
takes out of V-dot. Proj keeps |slope| and |offset| in their bounds.

Sampled: over the tick that ended, torque held, the predictor's rate minus the measured one is, apart from the error's
own dynamics, the constant

    defect = F mean(eta) + G mean(mu) - (eta - eta_last) / dt = -G model_error for a constant model error,

and the error and the estimate obey linear differential equations. `exact` solves them over a sub-step, `euler` takes
one forward step. `piecewise` is the other usual law, without a gain: the estimate is the constant that explains the
error which the tick left behind, and the predictor starts anew at what was measured. The filter is sampled exactly in
all.
"""

import casadi as ca
import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.constraints import ResClf
from cbf_clf_qp.functions import Layout, NumpyFunction, is_finite, row_by_row, row_major
from rabbit_description.state import JOINTS

from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.step import symbols

STATES = 4  # rows of the state: the predictor's error in y and y-dot, the estimate, the filtered estimate
DY, ESTIMATE, FILTERED = range(1, STATES)
DOUBLINGS = 50  # of a time so short that a polynomial gives the exponential


def l1_memory(m: int = JOINTS) -> Layout:
    """What a tick leaves to the next one, of m outputs: all zero at first. `belief`: the nominal y-ddot."""
    return Layout({"slope": m, "offset": m, "state": STATES * m, "last_eta": 2 * m, "belief": m * (m + 1)})


def l1_adaptation(p: ControllerParameters, m: int = JOINTS) -> NumpyFunction:
    """`compensation` (m,), a part of beta, and the row `adaptive`, see `l1_memory`, of what is seen and estimated.

    With a policy's input [approach1_input] it believes in y-ddot = (I + alpha)^-1 (a u + b - beta), and mu_2 adds
    (I + alpha) mu_2 to beta. `torque` (m,), of the last tick, is not finite where the step is new: there eta has
    jumped, the predictor starts at it, and the estimate stays.
    """
    layout = l1_memory(m)
    s = symbols({"eps": 1, "eta": 2 * m, "torque": m, "adaptive": layout.size, "beta": m})
    s |= {"outputs_a": ca.SX.sym("outputs_a", m, m), "outputs_b": ca.SX.sym("outputs_b", m)}
    s["alpha"], was = ca.SX.sym("alpha", m, m), layout.parts(s["adaptive"])
    whole, clf = ca.SX.eye(m) + s["alpha"], ResClf(m, s["eps"], (p.kp, p.kd))
    belief = Affine(ca.solve(whole, s["outputs_a"]), ca.solve(whole, s["outputs_b"] - s["beta"]))
    last = row_by_row(was["belief"], m + 1)
    mu = (Affine(last[:, :m], last[:, m])(s["torque"]) + belief(s["torque"])) / 2  # a held torque is no held mu
    rate = clf.F @ (was["last_eta"] + s["eta"]) / 2 + clf.G @ mu
    defect = row_by_row(rate - (s["eta"] - was["last_eta"]) / p.tick_seconds, m)
    state = row_by_row(was["state"], m)
    adapted = adapt(p, clf, (was["slope"], was["offset"], state), defect, ca.norm_2(mu))
    goes_on, anew = is_finite(s["torque"]), ca.vertcat(ca.SX.zeros(ESTIMATE, m), state[ESTIMATE:, :])
    before = was["slope"], was["offset"], anew
    slope, offset, state = (ca.if_else(goes_on, *pair) for pair in zip(adapted, before, strict=True))
    left = {"slope": slope, "offset": offset, "state": row_major(state), "last_eta": s["eta"]}
    left["belief"] = row_major(ca.horzcat(belief.a, belief.b))
    outputs = {"adaptive": layout.joined(left), "compensation": -whole @ state[FILTERED, :].T}
    return NumpyFunction.of("l1_adaptation", s, outputs)


def adapt(p: ControllerParameters, clf: ResClf, before: tuple[ca.SX, ...], defect: ca.SX, size: ca.SX) -> list[ca.SX]:
    """Slope (m,), offset (m,) and state (4, m) after a tick; `size`: |mu|, `defect` (2, m)."""
    slope, offset, state = before
    if p.l1_law == "piecewise":
        offset, decay = into_ball(-defect[1, :].T, p.l1_offset_bound), np.exp(-p.l1_cutoff * p.tick_seconds)
        filtered = decay * state[FILTERED, :] + (1 - decay) * offset.T
        return [slope, offset, ca.vertcat(state[:ESTIMATE, :], offset.T, filtered)]
    step = sub_step(p, clf, size)
    for _ in range(p.l1_substeps):
        estimate = slope * size + offset
        state = step @ ca.vertcat(state[:ESTIMATE, :], estimate.T, state[FILTERED, :], defect)
        share = (state[ESTIMATE, :].T - estimate) / (1 + size**2)
        slope = into_ball(slope + size * share, p.l1_slope_bound)  # as their rates share the change
        offset = into_ball(offset + share, p.l1_offset_bound)
    return [slope, offset, ca.vertcat(state[:ESTIMATE, :], (slope * size + offset).T, state[FILTERED, :])]


def sub_step(p: ControllerParameters, clf: ResClf, size: ca.SX) -> ca.SX:
    """(4, 6): the state after a sub-step; d/dt (state, defect) is linear in them, the same for every output."""
    m, seconds = clf.G.shape[1], p.tick_seconds / p.l1_substeps
    rates = ca.SX.zeros(STATES + 2, STATES + 2)
    rates[:2, :2], rates[:2, STATES:] = (clf.F + clf.G @ clf.K)[::m, ::m], ca.SX.eye(2)
    rates[DY, ESTIMATE] = 1.0
    rates[ESTIMATE, :2] = -p.l1_gain * (1 + size**2) * (clf.G.T @ clf.P)[0, ::m]
    rates[FILTERED, ESTIMATE], rates[FILTERED, FILTERED] = p.l1_cutoff, -p.l1_cutoff
    if p.l1_law == "exact":
        return exponential(rates * seconds)[:STATES, :]
    step = ca.SX.eye(STATES + 2) + rates * seconds
    decay = np.exp(-p.l1_cutoff * seconds)  # the filter is no part of what Euler may spoil
    step[FILTERED, FILTERED], step[FILTERED, ESTIMATE] = decay, 1 - decay
    return step[:STATES, :]


def exponential(matrix: ca.SX) -> ca.SX:
    """e^A: the Taylor polynomial of e^(A/2^k) - I, doubled k times, which loses nothing of a small A."""
    part = matrix / 2.0**DOUBLINGS
    change = part @ (ca.SX.eye(matrix.shape[0]) + part / 2)
    for _ in range(DOUBLINGS):
        change = 2 * change + change @ change
    return ca.SX.eye(matrix.shape[0]) + change


def into_ball(value: ca.SX, radius: float) -> ca.SX:
    """The point of the ball of `radius` about 0 that is nearest to `value` (m,)."""
    size = ca.norm_2(value)
    return ca.if_else(size <= radius, value, value * (radius / size))
