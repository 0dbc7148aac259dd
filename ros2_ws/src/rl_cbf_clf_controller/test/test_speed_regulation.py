"""Speed regulation finds a slope and ignores a push; L1 adaptation, on double integrators in closed form."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import NumpyFunction
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rabbit_description.state import TICK_SECONDS as DT
from rl_cbf_clf_controller.l1_adaptation import ESTIMATE, exponential, into_ball, l1_adaptation, l1_memory
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.speed_regulation import (
    INTEGRAL_MOST,
    MOST,
    PER_SLOPE,
    RETAINED,
    level,
    regulated,
)
from scipy.linalg import expm

MISSING = st.floats(-3, 3)
EITHER = pytest.mark.parametrize(("kind", "most"), [("learned", MOST), ("integral", INTEGRAL_MOST)])


@cache
def functions(kind: str) -> tuple[NumpyFunction, NumpyFunction]:
    """What is kept at first, and after a touchdown."""
    least, most, missing, speed = map(ca.SX.sym, ("least", "most", "missing", "speed"))
    first = level(least, most)
    kept = {name: ca.SX.sym(name, *value.shape) for name, value in first.items()}
    between = {"least": least, "most": most}
    inputs = {**kept, **between, "missing": missing, "v": speed}
    after = regulated(kept, least, most, missing, speed, kind)
    return NumpyFunction.of("level", between, first), NumpyFunction.of("regulated", inputs, after)


class Regulation:
    """Between the slopes `least` and `most`, degrees; `slope` is the present step's."""

    def __init__(self, kind: str, least: float, most: float) -> None:
        self._level, self._regulated = functions(kind)
        self._between = np.array([[least], [most]])
        self.reset()

    def reset(self) -> None:
        self._kept = self._level(*self._between)

    @property
    def slope(self) -> float:
        return float(self._kept.slopes[0])

    def after(self, rate_missing: float, speed_missing: float) -> float:
        kept = (getattr(self._kept, name) for name in ("slopes", "speed", "found", "integral"))
        self._kept = self._regulated(*kept, *self._between, np.array([rate_missing]), np.array([-speed_missing]))
        return self.slope


@EITHER
def test_it_rests_at_the_gait_s_speed(kind: str, most: float) -> None:
    regulation = Regulation(kind, -6.0, 6.0)
    assert [regulation.after(0.0, 0.0) for _ in range(5)] == [0.0] * 5
    tilted = Regulation(kind, 2.0, 6.0)
    assert tilted.after(0.0, 0.0) == 2.0, "the slope nearest to level ground"


@EITHER
@settings(deadline=None)
@given(missing=st.lists(st.tuples(MISSING, MISSING), min_size=1, max_size=30))
def test_the_slope_stays_within_the_library_and_changes_slowly(
    kind: str, most: float, missing: list[tuple[float, float]]
) -> None:
    regulation, before = Regulation(kind, -6.0, 4.0), 0.0
    for rate, speed in missing:
        slope = regulation.after(rate, speed)
        assert -6.0 <= slope <= 4.0
        assert abs(slope - before) <= most + 1e-12
        before = slope


@pytest.mark.parametrize("true_slope", [-4.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("gain", [0.7, 1.0, 1.5])
def test_the_rule_without_a_model_settles_at_the_true_slope_too(true_slope: float, gain: float) -> None:
    """The rate's Poincaré map, linear: it falls back to the gait's by the eigenvalue 0.72, and a step for a slope that
    is one degree too steep adds 0.07 rad/s (of `slopes`' zero dynamics; also 0.7 and 1.5 times as much)."""
    regulation, missing = Regulation("integral", -6.0, 6.0), 0.0
    for _ in range(60):
        slope = regulation.after(missing, 0.5 * missing)  # step length times rate over phase: m/s for rad/s
        missing = 0.72 * missing - 0.07 * gain * (slope - true_slope)
    assert slope == pytest.approx(true_slope, abs=0.02)
    assert missing == pytest.approx(0.0, abs=0.01)


class LinearWalk:
    """Speeds that follow the regulation's own model on ground of a slope, with coefficients `gain` times as large."""

    def __init__(self, true_slope: float, gain: float = 1.0) -> None:
        self.regulation, self.true_slope, self.gain = Regulation("learned", -6.0, 6.0), true_slope, gain
        self.speed, self.slopes = 0.0, [0.0] * len(PER_SLOPE)

    def step(self, push: float = 0.0, per_speed: float = 0.0) -> float:
        """The slope of the next step, after one in which a push adds to the speed; the rate's part is `per_speed`."""
        self.slopes = [self.regulation.slope, *self.slopes][: len(PER_SLOPE)]
        effect = np.dot(PER_SLOPE, np.array(self.slopes) - self.true_slope)
        self.speed = RETAINED * self.speed + self.gain * effect + push
        return self.regulation.after(-per_speed * self.speed, -self.speed)


@pytest.mark.parametrize("true_slope", [-4.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("gain", [0.7, 1.0, 1.5])
def test_on_a_linear_walk_it_settles_at_the_true_slope(true_slope: float, gain: float) -> None:
    walk = LinearWalk(true_slope, gain)
    slopes = [walk.step(per_speed=2.0) for _ in range(80)]
    assert slopes[-1] == pytest.approx(true_slope, abs=0.05)
    assert walk.speed == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("true_slope", [-3.0, 0.0, 2.0])
@pytest.mark.parametrize("push", [-0.3, 0.3])
def test_a_push_is_not_taken_for_a_slope(true_slope: float, push: float) -> None:
    """One every third step, forward and backward in turn: the median of six leaves two of them out."""
    walk = LinearWalk(true_slope)
    for _ in range(20):
        walk.step()
    assert walk.regulation.slope == pytest.approx(true_slope, abs=1e-3)
    for step in range(30):
        slope = walk.step(push * (-1) ** (step // 3) if step % 3 == 0 else 0.0)
        assert slope == pytest.approx(true_slope, abs=1e-3)


BELIEF = Affine(np.eye(4), np.zeros(4))  # the torque is mu
ERROR = np.array([30.0, -20.0, 5.0, 40.0])
MU = np.array([1.0, -0.5, 0.0, 2.0])
NEW_STEP = np.full(4, np.nan)
LAWS = [("piecewise", 1.0, 1), ("exact", 100.0, 1), ("exact", 1e5, 1), ("exact", 100.0, 10), ("euler", 100.0, 10)]
VECTORS = arrays(float, 4, elements=st.floats(-1e3, 1e3))


@cache
def l1_function(law, gain, substeps, cutoff, bounds):
    slope, offset = bounds
    values = {"law": law, "gain": gain, "cutoff": cutoff, "substeps": substeps, "slope_bound": slope}
    values |= {"offset_bound": offset}
    parameters = {f"l1_{name}": value for name, value in values.items()}
    return l1_adaptation(ControllerParameters.model_construct(**parameters))


class Adaptation:
    """The adaptation of four outputs, tick by tick, with its memory."""

    def __init__(self, law="piecewise", gain=1.0, substeps=1, cutoff=50.0, bounds=(100.0, 1000.0)):
        self.function = l1_function(law, gain, substeps, cutoff, bounds)
        self.memory = l1_memory().values(np.zeros(l1_memory().size))

    def compensation(self, eta, belief, torque):
        given = {"eps": ControllerParameters.model_construct().eps, "eta": eta, "torque": torque, "beta": np.zeros(4)}
        given |= {"adaptive": self.memory.row, "outputs_a": belief.a, "outputs_b": belief.b, "alpha": np.zeros((4, 4))}
        found = self.function(*(np.atleast_1d(given[name]) for name in self.function.function.name_in()))
        self.memory.row[:] = found.adaptive
        return found.compensation

    @property
    def model_error(self):
        return self.memory.state.reshape(-1, 4)[ESTIMATE]


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
def test_a_constant_error_is_found_and_its_compensation_has_gain_one_and_none_where_there_is_none(law, gain, substeps):
    l1 = Adaptation(law, gain, substeps)
    compensation = drive(l1, 400)[-1]
    assert l1.model_error == pytest.approx(ERROR, rel=1e-6)
    assert compensation == pytest.approx(-ERROR, rel=1e-6)
    start = np.random.default_rng(0).standard_normal(8)
    assert drive(Adaptation(law, gain, substeps), 50, error=np.zeros(4), eta=start) == pytest.approx(0, abs=1e-6)


def test_the_piecewise_law_knows_after_one_tick_and_the_filter_answers_a_step():
    compensations = drive(Adaptation(cutoff=30.0), 20)
    n = np.arange(21)[:, None]
    assert compensations == pytest.approx(-(1 - np.exp(-30.0 * DT * n)) * ERROR)


def test_exact_is_the_limit_of_euler():
    exact, fine, coarse = (drive(Adaptation(*law), 15) for law in (("exact",), ("euler", 1.0, 400), ("euler", 1.0, 40)))
    far, near = np.abs(coarse - exact).max(), np.abs(fine - exact).max()
    assert near < 0.01 * np.abs(exact).max()
    assert near == pytest.approx(far / 10, rel=0.1)  # of first order


def test_an_error_that_grows_with_mu_is_cancelled_in_closed_loop():
    """y'' = (1 + Delta_2) mu + Delta_1 becomes the reference model's mu_1, as C(0) = 1."""
    l1, eta, mu_1 = Adaptation(), np.zeros(8), MU
    mu = mu_1 + l1.compensation(eta, BELIEF, NEW_STEP)
    for _ in range(200):
        acceleration = 0.5 * mu + ERROR
        eta = move(eta, acceleration)
        mu = mu_1 + l1.compensation(eta, BELIEF, mu)
    assert acceleration == pytest.approx(mu_1, abs=1e-6)


def test_a_jump_at_a_new_step_is_no_error():
    l1 = Adaptation("exact", 100.0)
    before = drive(l1, 400)[-1]
    jumped = np.full(8, 3.0)
    assert l1.compensation(jumped, BELIEF, NEW_STEP) == pytest.approx(before)
    assert l1.compensation(move(jumped, MU + ERROR), BELIEF, MU) == pytest.approx(-ERROR, rel=0.05)


@settings(max_examples=50, deadline=None)
@given(
    law=st.sampled_from(["piecewise", "exact", "euler"]),
    gain=st.sampled_from([1e-3, 1.0, 1e3, 1e6]),
    ticks=st.lists(st.tuples(VECTORS, VECTORS), min_size=1, max_size=20),
)
def test_the_projection_never_leaves_its_set(law, gain, ticks):
    l1, eta = Adaptation(law, gain, bounds=(0.5, 50.0)), np.zeros(8)
    l1.compensation(eta, BELIEF, NEW_STEP)
    for mu, error in ticks:
        eta = move(eta, mu + error)
        l1.compensation(eta, BELIEF, mu)
        assert np.linalg.norm(l1.memory.slope) <= 0.5 * (1 + 1e-12)
        assert np.linalg.norm(l1.memory.offset) <= 50.0 * (1 + 1e-12)


@settings(deadline=None)
@given(value=VECTORS, other=VECTORS)
def test_the_projection_is_the_nearest_point(value, other):
    """The variational inequality (value - P)' (inside - P) <= 0 for every point inside."""
    nearest, inside = (ca.DM(into_ball(ca.DM(point), 10.0)).full().ravel() for point in (value, other))
    assert (value - nearest) @ (inside - nearest) <= 1e-6
    assert ca.DM(into_ball(ca.DM(nearest), 10.0)).full().ravel() == pytest.approx(nearest)


@settings(deadline=None)
@given(matrix=arrays(float, (4, 4), elements=st.floats(-5, 5)), small=st.sampled_from([1e-12, 1e-3, 1.0]))
def test_the_exponential_is_scipys_and_keeps_what_is_small(matrix, small):
    found = ca.DM(exponential(ca.DM(matrix * small))).full()
    expected = expm(matrix * small)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12 * np.abs(expected).max())
