"""Online adaptation against models with known errors."""

from dataclasses import replace

import numpy as np
import pytest
from rabbit_description import URDF_PATH
from rabbit_description.gait import load_gait
from rabbit_description.state import RobotState, StonePreview
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.least_squares import MatrixFit, ScalarFit
from rl_cbf_clf_controller.nominal_model import NominalModel
from rl_cbf_clf_controller.oracle import OraclePolicy
from rl_cbf_clf_controller.parameters import ParameterError, load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.residual_adaptation import (
    PINNED,
    Adapted,
    Measured,
    Prediction,
    ResidualAdaptation,
    Tick,
    add,
    is_pinned,
    predict,
)
from rl_cbf_clf_controller.uncertainty import Estimates, Problem

GAIT = load_gait("authors_035")
STANDING = np.array([[0.0, 300.0], [0.0, 0.0]])
TORQUE = np.array([10.0, -20.0, 30.0, 5.0])
NOTHING = Affine(np.zeros((5, 4)), np.zeros(5))
PLANTS = [{"mass_scale": 2.0}, {"mass_scale": 0.5}, {"payload": 48.0}, {"mass_scale": 0.7, "payload": 20.0}]


def plant_urdf(**changes):
    return perturbed_urdf(SimulationParameters(**changes))


def context(state, controller="rl-cbf-clf-qp"):
    parameters = load_parameters("ours", controller=controller, gait="authors_035")
    measured = RobotState(0, *state, np.zeros((2, 2)), np.zeros(2, bool), 0, StonePreview(1, 0.35, 0.40))
    return Controller(parameters, GAIT, ZeroPolicy(parameters.problem)).terms(measured).context


def pinned(urdf, state):
    model = NominalModel(urdf)
    model.update(*state)
    return model.pinned()


def true_values(state, **plant):
    """C, r of the pinned robot: its input matrix is C times the nominal one, r the difference of the drifts."""
    nominal, true = (pinned(urdf, state).acceleration for urdf in (URDF_PATH.read_text(), plant_urdf(**plant)))
    C = true.a[PINNED] @ np.linalg.pinv(nominal.a[PINNED])
    return C, true.b[PINNED] - nominal.b[PINNED]


def test_rls_recovers_a_constant_gain_exactly():
    """Noise-free accelerations of robots of 1/2.5 of the mass and of 2.5 times, in many poses: C = I / s, r = 0."""
    rng = np.random.default_rng(1)
    pose = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
    for scale in (0.4, 2.5):
        fit = MatrixFit(5, prior=1.0, noise=1e-4, walk=0.0)
        urdf, plant = URDF_PATH.read_text(), plant_urdf(mass_scale=scale)
        for _ in range(60):
            state, u = (pose + rng.uniform(-0.3, 0.3, 7), rng.uniform(-3, 3, 7)), rng.normal(0, 40, 4)
            nominal, true = (pinned(each, state).acceleration for each in (urdf, plant))
            fit.update((true(u) - nominal(u))[PINNED], nominal.a[PINNED] @ u)
        assert np.eye(5) + fit.value == pytest.approx(np.eye(5) / scale, abs=1e-6)


def test_rls_keeps_what_is_not_excited():
    fit = MatrixFit(2, prior=1.0, noise=1e-6, walk=0.0)
    for _ in range(5):
        fit.update(np.array([2.0, 4.0]), np.array([2.0, 0.0]))
    assert fit.value == pytest.approx(np.array([[1.0, 0.0], [2.0, 0.0]]), abs=1e-9)


def test_a_scalar_is_found_and_kept_in_its_range():
    found, low, high = (ScalarFit(prior=1.0, noise=1e-6, most=0.8) for _ in range(3))
    regressor = np.array([3.0, -1.0])
    found.update(0.3 * regressor, regressor)
    low.update(-regressor, regressor)
    high.update(2 * regressor, regressor)
    assert (found.value, low.value, high.value) == pytest.approx((0.3, 0.0, 0.8))


@pytest.mark.parametrize("plant", PLANTS)
def test_with_the_true_values_the_rows_are_the_oracles(state, plant):
    here = context(state)
    C, r = true_values(state, **plant)
    if plant == {"mass_scale": 2.0}:
        known = C @ here.dynamics.acceleration.a[PINNED]  # C is I / 2 on what torques can do
        assert known == pytest.approx(here.dynamics.acceleration.a[PINNED] / 2)
        assert r == pytest.approx(0, abs=1e-9)
    estimates = add(here, Estimates.zero(Problem.RL_CBF_CLF_QP), Adapted(C, r, np.zeros(2)))
    oracle = OraclePolicy(plant_urdf(**plant)).estimate(here)
    rows = slice(0, 3)  # V, B1, B2
    assert estimates.alpha[rows] == pytest.approx(oracle.alpha[rows], rel=1e-6, abs=1e-6)
    assert estimates.beta[rows] == pytest.approx(oracle.beta[rows], rel=1e-6, abs=1e-5)
    assert estimates.output_error.a == pytest.approx(oracle.output_error.a, abs=1e-7)
    assert estimates.output_error.b == pytest.approx(oracle.output_error.b, abs=1e-6)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_an_exact_policy_predicts_a_scaled_robot(state, scale):
    """So nothing is left to adapt."""
    here, true = context(state), pinned(plant_urdf(mass_scale=scale), state)
    predicted = predict(here, OraclePolicy(plant_urdf(mass_scale=scale)).estimate(here))
    assert predicted.acceleration(TORQUE) == pytest.approx(true.acceleration(TORQUE)[PINNED], rel=1e-6, abs=1e-5)
    assert predicted.force(TORQUE) == pytest.approx(true.force(TORQUE)[::-1], rel=1e-6, abs=1e-5)


def test_an_exact_policy_predicts_the_outputs_of_any_robot(state):
    here, urdf = context(state), plant_urdf(payload=48.0)
    predicted = predict(here, OraclePolicy(urdf).estimate(here)).acceleration(TORQUE)
    left = predicted - pinned(urdf, state).acceleration(TORQUE)[PINNED]
    assert here.quantities.outputs.jacobian[:, PINNED] @ left == pytest.approx(0, abs=1e-5)
    assert np.abs(left).max() > 0.1  # the fifth component, which is left to adapt


def test_what_an_exact_policy_leaves_completes_the_rows(state):
    here, urdf = context(state), plant_urdf(payload=48.0)
    oracle, true = OraclePolicy(urdf).estimate(here), pinned(urdf, state).acceleration
    predicted, A = predict(here, oracle).acceleration, here.dynamics.acceleration.a[PINNED]
    D = (true.a[PINNED] - predicted.a) @ np.linalg.pinv(A)
    left = Adapted(np.eye(5) + D, true.b[PINNED] - predicted.b, np.zeros(2))
    estimates = add(here, oracle, left)
    assert estimates.alpha == pytest.approx(oracle.alpha, rel=1e-6, abs=1e-6)
    assert estimates.beta == pytest.approx(oracle.beta, rel=1e-6, abs=1e-5)


def test_on_flat_ground_an_exact_policy_predicts_a_scaled_robot(state):
    here, true = context(state, "rl-clf-qp"), pinned(plant_urdf(mass_scale=2.0), state)
    predicted = predict(here, OraclePolicy(plant_urdf(mass_scale=2.0)).estimate(here))
    assert predicted.acceleration(TORQUE) == pytest.approx(true.acceleration(TORQUE)[PINNED], abs=1e-6)


def walk_on_the_spot(adaptation, gain, lag, drift, ticks=300):
    """Torques at random on a robot at rest in one pose, whose gain, lag, drift and force error are given."""
    rng = np.random.default_rng(3)
    nominal = Prediction(
        Affine(rng.normal(0, 3, (5, 4)), rng.normal(0, 30, 5)),
        Affine(rng.normal(0, 1, (2, 4)), np.array([300.0, 0.0])),
        np.zeros((5, 4)),
    )
    nominal = replace(nominal, input_matrix=nominal.acceleration.a)
    before = rng.normal(0, 30, 4)
    for number in range(ticks):
        u = rng.normal(0, 30, 4)
        mean = u + lag * (before - u)
        rate = nominal.acceleration.b + drift + gain @ nominal.acceleration.a @ mean
        normal, tangential = nominal.force(mean) + (50.0, -20.0)
        measured = Measured(number, u, np.array([[tangential, normal], [0.0, 0.0]]))
        adaptation.learn(nominal, rate, measured, before)
        before = u
    return nominal


def test_an_exact_model_leaves_nothing_to_learn():
    adaptation = ResidualAdaptation()
    walk_on_the_spot(adaptation, np.eye(5), 0.0, np.zeros(5))
    assert adaptation.adapted.effectiveness == pytest.approx(np.eye(5), abs=1e-12)
    assert adaptation.adapted.acceleration_residual == pytest.approx(0, abs=1e-9)


def test_a_lagging_motor_is_not_taken_for_another_robot():
    adaptation = ResidualAdaptation()
    nominal = walk_on_the_spot(adaptation, np.eye(5), 0.37, np.zeros(5))
    pushed = nominal.acceleration.a @ TORQUE
    assert adaptation.adapted.effectiveness @ pushed == pytest.approx(pushed, rel=0.02, abs=2.0)


def test_gain_drift_and_force_are_found():
    adaptation, gain = ResidualAdaptation(), np.diag([0.5, 0.5, 0.5, 0.4, 0.6])
    drift = np.array([5.0, -5.0, 10.0, 0.0, 2.0])
    nominal = walk_on_the_spot(adaptation, gain, 0.2, drift, ticks=1500)
    adapted, A = adaptation.adapted, nominal.acceleration.a
    assert adapted.effectiveness @ A @ TORQUE == pytest.approx(gain @ A @ TORQUE, rel=0.03, abs=3.0)
    assert adapted.force_residual == pytest.approx([50.0, -20.0], abs=10.0)


def test_only_pinned_ticks_count():
    last = Tick(6, np.zeros(5), TORQUE, Prediction(NOTHING, NOTHING, np.zeros((5, 4))))
    good = Measured(7, TORQUE, STANDING)
    assert is_pinned(last, good)
    bad = [
        replace(good, tick=8),  # a tick is missing
        replace(good, torque=np.full(4, np.nan)),  # the legs have swapped
        replace(good, force=np.zeros((2, 2))),  # flight
        replace(good, force=np.array([[0.0, 300.0], [0.0, 40.0]])),  # the swing foot touches
    ]
    assert not any(is_pinned(last, each) for each in bad)


def test_after_a_bounce_it_waits_again(state):
    """The fourth and the tenth tick on the ground in a row are the first to teach; a bounce in the sixth."""
    adaptation, here = ResidualAdaptation(), context(state)
    learned = []
    for tick in range(12):
        force = np.zeros((2, 2)) if tick == 6 else STANDING
        before = adaptation.adapted
        adaptation.estimate(here, Estimates.zero(Problem.RL_CBF_CLF_QP), Measured(tick, TORQUE, force))
        learned.append(adaptation.adapted is not before)
    assert [tick for tick in range(12) if learned[tick]] == [3, 4, 5, 9, 10, 11]


def test_an_episode_begins_with_nothing_learned():
    adaptation = ResidualAdaptation()
    walk_on_the_spot(adaptation, 0.5 * np.eye(5), 0.2, np.zeros(5), ticks=20)
    adaptation.reset()
    assert adaptation.adapted.effectiveness == pytest.approx(np.eye(5), abs=0)
    assert not adaptation.adapted.acceleration_residual.any()
    assert not adaptation.adapted.force_residual.any()


@pytest.mark.parametrize("controller", ["io-rl-clf-qp", "l1-clf-qp"])
def test_a_controller_that_estimates_no_rows_has_nothing_to_adapt(controller):
    with pytest.raises(ParameterError, match="estimates no rows"):
        load_parameters("ours", controller=controller, adaptation="recursive_least_squares")
