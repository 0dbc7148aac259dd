"""L1 adaptation on double integrators y'' = mu + model error, whose motion under a held mu has a closed form."""

import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rabbit_description.state import TICK_SECONDS as DT
from rl_cbf_clf_controller.l1_adaptation import L1Adaptation, into_ball
from rl_cbf_clf_controller.parameters import ControllerParameters

BELIEF = Affine(np.eye(4), np.zeros(4))  # the torque is mu
ERROR = np.array([30.0, -20.0, 5.0, 40.0])
MU = np.array([1.0, -0.5, 0.0, 2.0])
NEW_STEP = np.full(4, np.nan)
LAWS = [("piecewise", 1.0, 1), ("exact", 100.0, 1), ("exact", 1e5, 1), ("exact", 100.0, 10), ("euler", 100.0, 10)]
VECTORS = arrays(float, 4, elements=st.floats(-1e3, 1e3))


def make(law="piecewise", gain=1.0, substeps=1, cutoff=50.0, bounds=(100.0, 1000.0)):
    slope, offset = bounds
    values = {"law": law, "gain": gain, "cutoff": cutoff, "substeps": substeps, "slope_bound": slope}
    values |= {"offset_bound": offset}
    return L1Adaptation(ControllerParameters.model_construct(**{f"l1_{name}": value for name, value in values.items()}))


def move(eta, acceleration):
    """A tick of y'' = `acceleration`."""
    y, dy = eta[:4], eta[4:]
    return np.concatenate([y + DT * dy + DT**2 / 2 * acceleration, dy + DT * acceleration])


def drive(l1, ticks, error=ERROR, mu=MU, eta=None):
    """Compensations of `ticks` ticks under a held `mu`, open loop."""
    eta = np.zeros(8) if eta is None else eta
    compensations = [l1.compensation(eta, BELIEF, NEW_STEP)]
    for _ in range(ticks):
        eta = move(eta, mu + error)
        compensations.append(l1.compensation(eta, BELIEF, mu))
    return np.array(compensations)


@pytest.mark.parametrize(("law", "gain", "substeps"), LAWS)
def test_a_constant_error_is_found_and_its_compensation_has_gain_one(law, gain, substeps):
    l1 = make(law, gain, substeps)
    compensation = drive(l1, 400)[-1]
    assert l1.model_error == pytest.approx(ERROR, rel=1e-6)
    assert compensation == pytest.approx(-ERROR, rel=1e-6)


@pytest.mark.parametrize(("law", "gain", "substeps"), LAWS)
def test_nothing_is_compensated_when_the_model_is_exact(law, gain, substeps):
    start = np.random.default_rng(0).standard_normal(8)
    assert drive(make(law, gain, substeps), 50, error=np.zeros(4), eta=start) == pytest.approx(0, abs=1e-6)


def test_the_piecewise_law_knows_after_one_tick_and_the_filter_answers_a_step():
    compensations = drive(make(cutoff=30.0), 20)
    n = np.arange(21)[:, None]
    assert compensations == pytest.approx(-(1 - np.exp(-30.0 * DT * n)) * ERROR)


def test_exact_is_the_limit_of_euler():
    exact, fine, coarse = (drive(make(*law), 15) for law in (("exact",), ("euler", 1.0, 4000), ("euler", 1.0, 400)))
    far, near = np.abs(coarse - exact).max(), np.abs(fine - exact).max()
    assert near < 0.01 * np.abs(exact).max()
    assert near == pytest.approx(far / 10, rel=0.1)  # of first order


def test_an_error_that_grows_with_mu_is_cancelled_in_closed_loop():
    """y'' = (1 + Delta_2) mu + Delta_1 becomes the reference model's mu_1, as C(0) = 1."""
    l1, eta, mu_1 = make(), np.zeros(8), MU
    mu = mu_1 + l1.compensation(eta, BELIEF, NEW_STEP)
    for _ in range(200):
        acceleration = 0.5 * mu + ERROR
        eta = move(eta, acceleration)
        mu = mu_1 + l1.compensation(eta, BELIEF, mu)
    assert acceleration == pytest.approx(mu_1, abs=1e-6)


def test_a_jump_at_a_new_step_is_no_error():
    l1 = make("exact", 100.0)
    before = drive(l1, 400)[-1]
    jumped = np.full(8, 3.0)
    assert l1.compensation(jumped, BELIEF, NEW_STEP) == pytest.approx(before)
    assert l1.compensation(move(jumped, MU + ERROR), BELIEF, MU) == pytest.approx(-ERROR, rel=0.05)


@settings(max_examples=50, deadline=None)
@given(
    law=st.sampled_from(["piecewise", "exact", "euler"]),
    gain=st.floats(1e-3, 1e6),
    ticks=st.lists(st.tuples(VECTORS, VECTORS), min_size=1, max_size=20),
)
def test_the_projection_never_leaves_its_set(law, gain, ticks):
    l1, eta = make(law, gain, bounds=(0.5, 50.0)), np.zeros(8)
    l1.compensation(eta, BELIEF, NEW_STEP)
    for mu, error in ticks:
        eta = move(eta, mu + error)
        l1.compensation(eta, BELIEF, mu)
        assert np.linalg.norm(l1.slope) <= 0.5 * (1 + 1e-12)
        assert np.linalg.norm(l1.offset) <= 50.0 * (1 + 1e-12)


@settings(deadline=None)
@given(value=VECTORS, other=VECTORS)
def test_the_projection_is_the_nearest_point(value, other):
    """The variational inequality (value - P)' (inside - P) <= 0 for every point inside."""
    nearest, inside = into_ball(value, 10.0), into_ball(other, 10.0)
    assert (value - nearest) @ (inside - nearest) <= 1e-6
    assert into_ball(nearest, 10.0) == pytest.approx(nearest)
