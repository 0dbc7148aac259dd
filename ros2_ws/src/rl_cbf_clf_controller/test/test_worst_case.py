"""The robust rows bound the true ones for every model within the stated bounds."""

import re

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.tick import rows_of
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rabbit_description import URDF_PATH
from rabbit_description.gait import DEFAULT_GAIT, load_gait
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.oracle import OraclePolicy, TruePlant
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.worst_case import WorstCase

NONE = Estimates.zero(5, 4)
GAIT = load_gait(DEFAULT_GAIT)
CENTER = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
STATES = st.tuples(
    arrays(float, 7, elements=st.floats(-0.3, 0.3)).map(lambda q: CENTER + q),
    arrays(float, 7, elements=st.floats(-3, 3)),
)
INPUTS = arrays(float, 4, elements=st.floats(-500, 500))
UNIT = arrays(float, 4, elements=st.floats(-1, 1)).map(lambda v: v / max(1.0, float(np.linalg.norm(v))))
BOUNDED_ABOVE = np.array([1.0, -1.0, -1.0])  # V-dot from above, B'' from below: the sign that makes more worse
CONE = np.array([[-1.0, 0.0], [-0.6, 1.0], [-0.6, -1.0]])  # C1 and both cone rows, in (F_N, F_T), from above


def make(**changes):
    parameters = load_parameters("ours", controller="robust-cbf-clf-qp", **changes)
    return Controller(parameters, GAIT, ZeroPolicy(parameters.problem))


def tick(controller, state):
    return controller.look(RobotState(0, *state, np.zeros((2, 2)), np.zeros(2, bool), 0, StonePreview(1, 0.35, 0.4)))


def scaled_urdf(scale):
    """The nominal robot with every mass and inertia times `scale`."""
    change = re.compile(r'(value|ixx|iyy|izz)="([^"]+)"')
    return change.sub(lambda match: f'{match[1]}="{float(match[2]) * scale!r}"', URDF_PATH.read_text())


def violations(controller, terms, mu, estimates=None):
    """By how much each row but saturation is exceeded at `mu` without slack; shape (cases, 6)."""
    estimates = estimates or controller.recipe.estimators[-1].estimate(terms, NONE)
    *rows, _ = rows_of(controller.recipe, terms, estimates, terms.precontrol)
    return np.concatenate([block.A @ mu - block.upper for block in rows]).reshape(-1, 6)


@settings(max_examples=60, deadline=None)
@given(state=STATES, mu=INPUTS, where=st.floats(0, 1), low=st.floats(0.3, 1), width=st.floats(0, 3))
def test_rows_of_a_scale_range_imply_the_true_rows_of_every_scale_in_it(state, mu, where, low, width):
    robust = make(robust_scale_min=low, robust_scale_max=low + width)
    terms = tick(robust, state)
    true = OraclePolicy(TruePlant(scaled_urdf(low + where * width))).estimate(terms, NONE)
    parameters = load_parameters("ours", controller="rl-cbf-clf-qp")
    at_truth = violations(Controller(parameters, GAIT, ZeroPolicy(parameters.problem)), terms, mu, true)
    kept = (violations(robust, terms, mu) <= -1e-6).all(axis=0)
    assert (at_truth[0, kept] <= 0).all()


@settings(max_examples=60, deadline=None)
@given(state=STATES, mu=INPUTS, where=st.floats(0, 1))
def test_the_truth_is_no_worse_than_the_worse_corner(state, mu, where):
    """The same in values, where no example is vacuous: every row's expression is at most its larger corner's."""
    low, high = 0.7, 2.5
    robust = make(robust_scale_min=low, robust_scale_max=high)
    terms = tick(robust, state)
    true = OraclePolicy(TruePlant(scaled_urdf(low + where * (high - low)))).estimate(terms, NONE).error(mu)
    corners = np.array([error(mu) for error in WorstCase(robust.parameters).corners(terms)])
    scale = 1e-7 * (1 + np.abs(corners).max())
    assert (BOUNDED_ABOVE * true[:3] <= (BOUNDED_ABOVE * corners[:, :3]).max(axis=0) + scale).all()
    assert (CONE @ true[3:] <= (corners[:, 3:] @ CONE.T).max(axis=0) + scale).all()


@settings(max_examples=30, deadline=None)
@given(state=STATES, mu=INPUTS)
def test_the_corners_are_the_models_at_the_ends(state, mu):
    robust = make(robust_scale_min=0.5, robust_scale_max=3.0)
    terms = tick(robust, state)
    for scale, error in zip((0.5, 3.0), WorstCase(robust.parameters).corners(terms), strict=True):
        true = OraclePolicy(TruePlant(scaled_urdf(scale))).estimate(terms, NONE).error(mu)
        assert error(mu) == pytest.approx(true, rel=1e-6, abs=1e-6 * (1 + np.abs(true).max()))


@settings(max_examples=60, deadline=None)
@given(state=STATES, mu=INPUTS, direction=UNIT, r=st.floats(-1, 1), b=st.floats(-1, 1), b_slope=st.floats(-1, 1))
def test_norm_bounds_hold_for_every_error_within_them(state, mu, direction, r, b, b_slope):
    robust = make(robust_bounds="norm")
    p, terms = robust.parameters, tick(robust, state)
    nominal, LgV = terms.nominal(mu), terms.scene.LgV
    true = np.array(
        [
            LgV @ (p.robust_offset * direction + p.robust_slope * r * mu),
            *(b * p.robust_barrier_offset + b_slope * p.robust_barrier_slope * nominal[1:3]),
        ]
    )
    corners = np.array([error(mu) for error in WorstCase(robust.parameters).corners(terms)])
    scale = 1e-9 * (1 + np.abs(corners).max())
    assert (BOUNDED_ABOVE * true <= (BOUNDED_ABOVE * corners[:, :3]).max(axis=0) + scale).all()
    assert corners[:, 3:] == pytest.approx(0)


@settings(max_examples=30, deadline=None)
@given(state=STATES, mu=INPUTS)
def test_bounds_of_no_width_are_the_nominal_rows(state, mu):
    nothing = {"robust_offset": 0.0, "robust_slope": 0.0, "robust_barrier_offset": 0.0, "robust_barrier_slope": 0.0}
    nominal = load_parameters("ours", controller="cbf-clf-qp")
    plain = Controller(nominal, GAIT, ZeroPolicy(nominal.problem))
    expected = violations(plain, tick(plain, state), mu)
    for bounds in ({"robust_scale_max": 1.0}, {"robust_bounds": "norm", **nothing}):
        robust = make(**bounds)
        found = violations(robust, tick(robust, state), mu)
        assert found == pytest.approx(np.vstack([expected, expected]), rel=1e-6, abs=1e-6)
