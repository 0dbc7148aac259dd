"""The oracle against the closed form of a uniformly scaled robot, and its estimates against the true dynamics."""

from dataclasses import replace

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from rabbit_description import URDF_PATH
from rabbit_description.gait import load_gait
from rabbit_description.planar_urdf import scaled
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.oracle import OraclePolicy, TruePlant
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints

PinocchioModel = pytest.importorskip("rabbit_gait_design.pinocchio_model", reason="no studies").PinocchioModel
NONE = Estimates.zero(5, 4)
GAIT = load_gait("authors_035")
SCALE = 2.0
URDF = URDF_PATH.read_text()


def tick(state, controller="cbf-clf-qp"):
    q, dq = state
    parameters = load_parameters("ours", controller=controller, gait="authors_035")
    built = Controller(parameters, GAIT, ZeroPolicy(parameters.problem))
    measured = RobotState(0, q, dq, np.zeros((2, 2)), np.zeros(2, bool), 0, StonePreview(1, 0.35, 0.40))
    return built.look(measured)


def test_closed_form_under_uniform_scale(state):
    """At a given torque a robot s times as heavy has its drift, its input's share over s, and s times the force."""
    scene = tick(state)
    oracle = OraclePolicy(TruePlant(scaled(URDF, SCALE))).estimate(scene, NONE)
    seen, shrink = scene.seen, 1 / SCALE - 1
    in_torque = seen.nominal_a @ np.linalg.inv(seen.control_a)
    drift = seen.nominal_b - in_torque @ seen.control_b
    alpha = np.vstack([shrink * seen.nominal_a[:3], np.zeros((2, 4))])
    model = PinocchioModel()
    model.update(*state)
    beta = np.concatenate([shrink * (seen.nominal_b - drift)[:3], (SCALE - 1) * model.pinned().force.b[::-1]])
    assert oracle.alpha == pytest.approx(alpha, rel=1e-7, abs=1e-7)
    assert oracle.beta == pytest.approx(beta, rel=1e-7, abs=1e-6)


def output_acceleration(state, plant, torque):
    """y'' (4,) of another robot, by pinocchio."""
    outputs = VirtualConstraints(GAIT).evaluate(*state)
    return outputs.jacobian @ plant.pinned().acceleration(torque) + outputs.bias


def torque_of(scene, mu):
    """u (4,) by the nominal robot."""
    return scene.seen.control_a @ mu + scene.seen.control_b


def test_first_approach_makes_the_true_output_acceleration_mu(state):
    scene = tick(state, "io-rl-clf-qp")
    heavy = TruePlant(scaled(URDF, SCALE), motor_gain=0.85, joint_damping=1.0)
    oracle = OraclePolicy(heavy, io=True).estimate(scene, NONE)
    plant = PinocchioModel(scaled(URDF, SCALE), motor_gain=0.85, joint_damping=1.0)
    plant.update(*state)
    mu = np.array([10.0, -20.0, 30.0, 5.0])
    torque = torque_of(scene, mu + oracle.alpha @ mu + oracle.beta)
    assert output_acceleration(state, plant, torque) == pytest.approx(mu, abs=1e-7)


def test_it_knows_each_motor_dry_friction_and_the_slope(state):
    q, dq = state[0], np.where(np.arange(7) < 3, state[1], [0, 0, 0, 0.9, -0.8, 0.7, -0.6])
    scene = tick((q, dq), "io-rl-clf-qp")
    gains, rise = np.array([0.8, 1.0, 1.1, 0.9]), np.radians(3)
    known = TruePlant(URDF, motor_gains=tuple(gains), coulomb=5.0, slope=3.0)
    oracle = OraclePolicy(known, io=True).estimate(scene, NONE)
    plant = PinocchioModel()
    plant.model.gravity.linear = 9.81 * np.array([-np.sin(rise), 0, -np.cos(rise)])
    plant.update(q, dq)
    mu = np.array([10.0, -20.0, 30.0, 5.0])
    torque = gains * torque_of(scene, mu + oracle.alpha @ mu + oracle.beta) - 5.0 * np.sign(dq[3:])
    assert output_acceleration((q, dq), plant, torque) == pytest.approx(mu, abs=1e-7)


def test_no_error_when_the_plant_is_nominal(state):
    oracle = OraclePolicy(TruePlant(URDF)).estimate(tick(state), NONE)
    assert oracle.alpha == pytest.approx(0, abs=1e-9)
    assert oracle.beta == pytest.approx(0, abs=1e-9)


def test_with_the_right_leg_standing_its_masses_are_the_stance_legs():
    numbers = TruePlant(URDF, motor_gains=(0.7, 0.8, 0.9, 1.0)).robot(0)
    unlike = replace(numbers, links=numbers.links * np.array([1, 1.1, 1.2, 1.3, 1.4])[:, None])
    assert unlike.mirrored().links == pytest.approx(unlike.links[[0, 3, 4, 1, 2]])
    assert unlike.mirrored().motor_gain == pytest.approx([0.9, 1.0, 0.7, 0.8])
    assert unlike.mirrored().mirrored().row == pytest.approx(unlike.row)
