"""The pinned-foot model against physics: the equation of motion, the constraint, energy and impact identities."""

import numpy as np
import pinocchio as pin
import pytest
from rabbit_description import URDF_PATH
from rabbit_description.state import ROBOT_MASS
from rl_cbf_clf_controller.nominal_model import INPUT_MAP, NominalModel

H = 1e-6


def leg_tip(q, hip, knee):
    """Foot position from trigonometry, metres."""
    thigh, shin = q[2] + q[hip], q[2] + q[hip] + q[knee]
    return q[:2] - 0.4 * np.array([np.sin(thigh) + np.sin(shin), np.cos(thigh) + np.cos(shin)])


def test_mass_is_the_papers():
    assert pin.computeTotalMass(NominalModel().model) == pytest.approx(ROBOT_MASS)


def test_feet_follow_trigonometry(state):
    q, dq = state
    feet = NominalModel().update(q, dq)
    assert feet.swing == pytest.approx(leg_tip(q, 5, 6) - leg_tip(q, 3, 4), abs=1e-12)
    assert feet.hip == pytest.approx(q[:2] - leg_tip(q, 3, 4), abs=1e-12)


def test_swing_jacobian_and_bias_by_differences(state):
    q, dq = state
    model = NominalModel()
    feet = model.update(q, dq)
    columns = [(model.update(q + H * e, dq).swing - model.update(q - H * e, dq).swing) / (2 * H) for e in np.eye(7)]
    assert feet.swing_jacobian == pytest.approx(np.array(columns).T, abs=1e-8)
    ahead, behind = model.update(q + H * dq, dq), model.update(q - H * dq, dq)
    assert feet.swing_bias == pytest.approx((ahead.swing_rate - behind.swing_rate) / (2 * H), abs=1e-6)


def test_stance_foot_does_not_accelerate_and_newton_holds(state):
    q, dq = state
    model = NominalModel()
    model.update(q, dq)
    dynamics, u = model.pinned(), np.array([10.0, -20.0, 5.0, 30.0])
    acceleration, force = dynamics.acceleration(u), dynamics.force(u)
    step = [leg_tip(q + s * 1e-4 * dq + 0.5 * (s * 1e-4) ** 2 * acceleration, 3, 4) for s in (-1, 0, 1)]
    assert (step[0] - 2 * step[1] + step[2]) / 1e-8 == pytest.approx(0, abs=1e-4)
    jacobian = np.array([(leg_tip(q + H * e, 3, 4) - leg_tip(q - H * e, 3, 4)) / (2 * H) for e in np.eye(7)]).T
    left = pin.rnea(model.model, model.model.createData(), q, dq, acceleration)
    assert left == pytest.approx(INPUT_MAP @ u + jacobian.T @ force, abs=1e-5)


def test_force_balances_weight_and_motion_of_the_centre_of_mass(state):
    q, dq = state
    model = NominalModel()
    model.update(q, dq)
    dynamics, u = model.pinned(), np.array([5.0, 5.0, -5.0, 8.0])
    data = model.model.createData()
    pin.centerOfMass(model.model, data, q, dq, dynamics.acceleration(u))
    expected = ROBOT_MASS * (data.acom[0] - model.model.gravity.linear)[[0, 2]]
    assert dynamics.force(u) == pytest.approx(expected, abs=1e-9)


def test_mass_matrix_rate_minus_twice_coriolis_is_skew(state):
    q, dq = state
    model = NominalModel().model
    data = model.createData()
    coriolis = pin.computeCoriolisMatrix(model, data, q, dq).copy()
    rate = (pin.crba(model, data, q + H * dq).copy() - pin.crba(model, data, q - H * dq)) / (2 * H)
    symmetric = np.triu(rate) + np.triu(rate, 1).T - 2 * coriolis
    assert symmetric + symmetric.T == pytest.approx(0, abs=1e-7)


def test_power_of_torque_is_the_rate_of_energy(state):
    q, dq = state
    model = NominalModel()
    model.update(q, dq)
    jacobian = np.array([(leg_tip(q + H * e, 3, 4) - leg_tip(q - H * e, 3, 4)) / (2 * H) for e in np.eye(7)]).T
    dq = dq - np.linalg.pinv(jacobian) @ jacobian @ dq  # the stance foot rests
    model.update(q, dq)
    u = np.array([10.0, -4.0, 7.0, 3.0])
    acceleration = model.pinned().acceleration(u)
    data = model.model.createData()

    def energy(t):
        return pin.computeMechanicalEnergy(
            model.model, data, q + t * dq + t**2 / 2 * acceleration, dq + t * acceleration
        )

    assert (energy(1e-5) - energy(-1e-5)) / 2e-5 == pytest.approx(u @ dq[3:], rel=1e-5)


def test_impact_stops_the_new_stance_foot_and_loses_energy(state):
    q, dq = state
    model = NominalModel()
    after, impulse = model.impact(q, dq)
    jacobian = np.array([(leg_tip(q + H * e, 5, 6) - leg_tip(q - H * e, 5, 6)) / (2 * H) for e in np.eye(7)]).T
    mass = model.mass_matrix()
    assert jacobian @ after == pytest.approx(0, abs=1e-7)
    assert mass @ (after - dq) == pytest.approx(jacobian.T @ impulse, abs=1e-6)
    assert after @ mass @ after <= dq @ mass @ dq


def test_uniform_scaling_scales_forces_and_slows_inputs(state):
    q, dq = state
    scale = 2.0
    text = URDF_PATH.read_text()
    nominal, heavy = NominalModel(text), NominalModel(text)
    for inertia in heavy.model.inertias:
        inertia.mass *= scale
        inertia.inertia = scale * inertia.inertia
    for model in (nominal, heavy):
        model.update(q, dq)
    light, full = nominal.pinned(), heavy.pinned()
    assert full.acceleration.b == pytest.approx(light.acceleration.b, rel=1e-9)
    assert full.acceleration.a == pytest.approx(light.acceleration.a / scale, rel=1e-9, abs=1e-12)
    assert full.force.b == pytest.approx(scale * light.force.b, rel=1e-9)
    assert full.force.a == pytest.approx(light.force.a, rel=1e-7, abs=1e-9)


def test_motor_gain_and_damping_enter_as_stated(state):
    q, dq = state
    u = np.array([10.0, -20.0, 5.0, 30.0])
    perturbed, nominal = NominalModel(motor_gain=0.85, joint_damping=0.7), NominalModel()
    perturbed.update(q, dq)
    nominal.update(q, dq)
    damping = 0.7 * np.diag(nominal.mass_matrix())[3:] * dq[3:]
    expected = nominal.pinned().acceleration(0.85 * u - damping)
    assert perturbed.pinned().acceleration(u) == pytest.approx(expected, rel=1e-9)
