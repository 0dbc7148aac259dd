"""The oracle against the closed form of a uniformly scaled robot, and its estimates against the true dynamics."""

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from rabbit_description import URDF_PATH
from rabbit_description.gait import load_gait
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.nominal_model import NominalModel
from rl_cbf_clf_controller.oracle import OraclePolicy, TruePlant
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints

NONE = Estimates.zero(5, 4)
GAIT = load_gait("authors_035")
SCALE = 2.0


def scaled_urdf(scale):
    """The nominal robot with every mass and inertia times `scale`."""
    import re

    def times(match):
        return f'{match[1]}="{float(match[2]) * scale}"'

    return re.sub(r'(value|ixx|iyy|izz)="([^"]+)"', times, URDF_PATH.read_text())


def tick(state, controller="cbf-clf-qp"):
    q, dq = state
    parameters = load_parameters("ours", controller=controller, gait="authors_035")
    built = Controller(parameters, GAIT, ZeroPolicy(parameters.problem))
    measured = RobotState(0, q, dq, np.zeros((2, 2)), np.zeros(2, bool), 0, StonePreview(1, 0.35, 0.40))
    return built.look(measured)


def test_closed_form_under_uniform_scale(state):
    terms = tick(state)
    oracle = OraclePolicy(TruePlant(scaled_urdf(SCALE))).estimate(terms, NONE)
    model = NominalModel()
    model.update(*state)
    dynamics = model.pinned()
    outputs = VirtualConstraints(GAIT).evaluate(*state).second_derivative(dynamics.acceleration)
    shrink, LgV = 1 / SCALE - 1, terms.scene.LgV
    barrier = terms.scene.barriers.second_derivative(dynamics.acceleration)
    alpha = np.vstack([shrink * LgV, shrink * barrier.a @ terms.precontrol.a, np.zeros((2, 4))])
    force = (SCALE - 1) * dynamics.force.b[::-1]
    beta = np.concatenate([[-shrink * LgV @ outputs.b], shrink * barrier.a @ terms.precontrol.b, force])
    assert oracle.alpha == pytest.approx(alpha, rel=1e-7, abs=1e-7)
    assert oracle.beta == pytest.approx(beta, rel=1e-7, abs=1e-6)


def test_first_approach_makes_the_true_output_acceleration_mu(state):
    terms = tick(state, "io-rl-clf-qp")
    heavy = TruePlant(scaled_urdf(SCALE), motor_gain=0.85, joint_damping=1.0)
    oracle = OraclePolicy(heavy, io=True).estimate(terms, NONE)
    plant = NominalModel(scaled_urdf(SCALE), motor_gain=0.85, joint_damping=1.0)
    plant.update(*state)
    mu = np.array([10.0, -20.0, 30.0, 5.0])
    u = terms.precontrol(mu + oracle.alpha @ mu + oracle.beta)
    acceleration = plant.pinned().acceleration(u)
    assert terms.scene.outputs.jacobian @ acceleration + terms.scene.outputs.bias == pytest.approx(mu, abs=1e-7)


def test_it_knows_each_motor_dry_friction_and_the_slope(state):
    q, dq = state[0], np.where(np.arange(7) < 3, state[1], [0, 0, 0, 0.9, -0.8, 0.7, -0.6])
    terms = tick((q, dq), "io-rl-clf-qp")
    gains, rise = np.array([0.8, 1.0, 1.1, 0.9]), np.radians(3)
    known = TruePlant(URDF_PATH.read_text(), motor_gains=tuple(gains), coulomb=5.0, slope=3.0)
    oracle = OraclePolicy(known, io=True).estimate(terms, NONE)
    plant = NominalModel()
    plant.model.gravity.linear = 9.81 * np.array([-np.sin(rise), 0, -np.cos(rise)])
    plant.update(q, dq)
    mu = np.array([10.0, -20.0, 30.0, 5.0])
    u = terms.precontrol(mu + oracle.alpha @ mu + oracle.beta)
    acceleration = plant.pinned().acceleration(gains * u - 5.0 * np.sign(dq[3:]))
    assert terms.scene.outputs.jacobian @ acceleration + terms.scene.outputs.bias == pytest.approx(mu, abs=1e-7)


def test_no_error_when_the_plant_is_nominal(state):
    oracle = OraclePolicy(TruePlant(URDF_PATH.read_text())).estimate(tick(state), NONE)
    assert oracle.alpha == pytest.approx(0, abs=1e-9)
    assert oracle.beta == pytest.approx(0, abs=1e-9)
