"""The oracle against a scaled robot and the true dynamics; the robust rows bound the true ones."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import NumpyFunction
from cbf_clf_qp.quantity import Terms
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rabbit_description import URDF_PATH
from rabbit_description.gait import load_gait
from rl_cbf_clf_controller.kinds import find_kind
from rl_cbf_clf_controller.oracle import OraclePolicy, TruePlant
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.walking import Walking
from rl_cbf_clf_controller.worst_case import worst_cases
from walking_states import make_controller, scaled, state_of

PinocchioModel = pytest.importorskip("rabbit_gait_design.pinocchio_model", reason="no studies").PinocchioModel
VirtualConstraints = pytest.importorskip("rabbit_gait_design.path_outputs", reason="no studies").VirtualConstraints
NONE = Estimates.zero(5, 4)
GAIT = load_gait("authors_035")
SCALE = 2.0
URDF = URDF_PATH.read_text()


def tick(state, controller="cbf-clf-qp"):
    return make_controller(controller=controller, gait="authors_035").look(state_of(*state))


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


def test_with_the_right_leg_standing_its_masses_are_the_stance_legs():
    numbers = TruePlant(URDF, motor_gains=(0.7, 0.8, 0.9, 1.0)).robot(0)
    unlike = replace(numbers, links=numbers.links * np.array([1, 1.1, 1.2, 1.3, 1.4])[:, None])
    assert unlike.mirrored().links == pytest.approx(unlike.links[[0, 3, 4, 1, 2]])
    assert unlike.mirrored().motor_gain == pytest.approx([0.9, 1.0, 0.7, 0.8])
    assert unlike.mirrored().mirrored().row == pytest.approx(unlike.row)


CENTER = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
STATES = st.tuples(
    arrays(float, 7, elements=st.floats(-0.3, 0.3)).map(lambda q: CENTER + q),
    arrays(float, 7, elements=st.floats(-3, 3)),
)
INPUTS = arrays(float, 4, elements=st.floats(-500, 500))
BOUNDED_ABOVE = np.array([1.0, -1.0, -1.0])  # V-dot from above, B'' from below: the sign that makes more worse
CONE = np.array([[-1.0, 0.0], [-0.6, 1.0], [-0.6, -1.0]])  # C1 and both cone rows, in (F_N, F_T), from above


built = cache(make_controller)


def violations(controller, scene, mu, estimates=NONE):
    """By how much each row but saturation is exceeded at `mu` without slack, over its norm; shape (cases, 6)."""
    data = controller.qp.programme(scene.x, scene.p, estimates)
    return (data.A[:-4, :4] @ mu - data.upper[:-4]).reshape(-1, 6)


@cache
def corner_function():
    """The corners' alpha (2, 5, 4) and beta (2, 5) of (x, p)."""
    w = Walking()
    parameters = load_parameters("ours", controller="robust-cbf-clf-qp")
    terms = Terms(w.system, find_kind("robust-cbf-clf-qp").quantities(w, parameters), w.output_dynamics.inverse())
    low, high = worst_cases(w, parameters)(terms)
    found = {"low_a": low.a, "low_b": low.b, "high_a": high.a, "high_b": high.b}
    return NumpyFunction.of("corners", {"x": w.system.x, "p": w.system.p}, found)


@settings(max_examples=60, deadline=None)
@given(state=STATES, mu=INPUTS, where=st.floats(0, 1), low=st.floats(0.3, 1), width=st.floats(0, 3))
def test_the_corners_of_a_scale_range_bound_every_robot_in_it(state, mu, where, low, width):
    """They are the models at its ends; no row's expression is above the larger corner's; kept rows imply true ones."""
    robust, gains = built(controller="robust-cbf-clf-qp"), {"robust_scale_min": low, "robust_scale_max": low + width}
    robust.parameters = load_parameters("ours", controller="robust-cbf-clf-qp", **gains)  # inputs of its tick
    robust.reset(0)
    scene = robust.look(state_of(*state))
    at_low, true, at_high = (
        OraclePolicy(TruePlant(scaled(URDF, low + share * width))).estimate(scene, NONE) for share in (0, where, 1)
    )
    of = corner_function()(scene.x, scene.p)
    found = np.array([of.low_a @ mu + of.low_b, of.high_a @ mu + of.high_b])
    for corner, end in zip(found, (at_low.error(mu), at_high.error(mu)), strict=True):
        assert corner == pytest.approx(end, rel=1e-6, abs=1e-6 * (1 + np.abs(end).max()))
    rounding = 1e-7 * (1 + np.abs(found).max())
    error = true.error(mu)
    assert (BOUNDED_ABOVE * error[:3] <= (BOUNDED_ABOVE * found[:, :3]).max(axis=0) + rounding).all()
    assert (CONE @ error[3:] <= (found[:, 3:] @ CONE.T).max(axis=0) + rounding).all()
    kept = (violations(robust, scene, mu) <= -1e-6).all(axis=0)
    at_truth = violations(built(controller="rl-cbf-clf-qp"), scene, mu, true)
    assert (at_truth[0, kept] <= 0).all()
