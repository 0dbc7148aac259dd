"""CasADi's robot against pinocchio's: two independent derivations of the same equation of motion."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from rabbit_description.state import Array
from rabbit_gait_design import symbolic_robot
from rabbit_gait_design.orbit_point import DEGREE, dynamics_residual, path
from rabbit_gait_design.zero_dynamics import loaded_model

PLANE = [0, 2]
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def random_motion(seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, 7), rng.uniform(-3, 3, 7), rng.uniform(-20, 20, 7)


@pytest.mark.parametrize("slope", [0.0, 6.0, -4.0])
@pytest.mark.parametrize("seed", range(5))
def test_mass_matrix_and_bias_forces(seed: int, slope: float) -> None:
    q, dq, _ = random_motion(seed)
    model = loaded_model(slope=slope).model
    data = model.createData()
    upper = np.triu(pin.crba(model, data, q))
    mass_matrix, bias_forces = symbolic_robot.dynamics(slope)
    assert np.array(mass_matrix(q)) == pytest.approx(upper + np.triu(upper, 1).T, rel=1e-9, abs=1e-9)
    assert np.array(bias_forces(q, dq)).ravel() == pytest.approx(pin.nle(model, data, q, dq), rel=1e-9, abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_feet(seed: int) -> None:
    q, dq, ddq = random_motion(seed)
    model = loaded_model().model
    data = model.createData()
    pin.forwardKinematics(model, data, q, dq, ddq)
    pin.updateFramePlacements(model, data)
    motion = symbolic_robot.foot_motion()(q=q, dq=dq, ddq=ddq)
    for leg, name in (("left", "stance"), ("right", "swing")):
        frame = model.getFrameId(f"{leg}_foot")
        velocity = pin.getFrameVelocity(model, data, frame, WORLD).linear[PLANE]
        acceleration = pin.getFrameClassicalAcceleration(model, data, frame, WORLD).linear[PLANE]
        jacobian = pin.computeFrameJacobian(model, data, q, frame, WORLD)[PLANE]
        assert np.array(motion[name]).ravel() == pytest.approx(data.oMf[frame].translation[PLANE], abs=1e-12)
        assert np.array(motion[f"v_{name}"]).ravel() == pytest.approx(velocity, abs=1e-10)
        assert np.array(motion[f"a_{name}"]).ravel() == pytest.approx(acceleration, abs=1e-9)
        assert np.array(motion[f"J_{name}"]) == pytest.approx(jacobian, abs=1e-12)


def test_path_starts_and_ends_at_the_outer_control_points() -> None:
    rng = np.random.default_rng(1)
    coeffs, phase_range = rng.uniform(-1, 1, (4, DEGREE + 1)), np.array([-0.3, 0.25])
    for s, ends in ((0.0, (0, 1)), (1.0, (-2, -1))):
        q, q_s, _ = (np.array(value).ravel() for value in path()(coeffs, phase_range, s))
        assert q[3:] == pytest.approx(coeffs[:, 0 if s == 0 else -1], abs=1e-12)
        assert q_s[3:] == pytest.approx(DEGREE * (coeffs[:, ends[1]] - coeffs[:, ends[0]]), abs=1e-12)
        assert q[2] + q[3] + q[4] / 2 == pytest.approx(phase_range[int(s)], abs=1e-12)
        stance, _ = symbolic_robot.feet()(q)
        assert ca.DM(stance).full().ravel() == pytest.approx([0, 0], abs=1e-12)


def test_weight_alone_holds_a_robot_that_does_not_move() -> None:
    """At rest, F = total weight upwards and u = the joints' gravity torques solve the equation of motion."""
    coeffs, phase_range = np.tile([[-0.2], [0.3], [0.1], [0.4]], DEGREE + 1), np.array([-0.1, 0.1])
    q = np.array(path()(coeffs, phase_range, 0.5)[0]).ravel()
    _, bias_forces = symbolic_robot.dynamics()
    gravity = np.array(bias_forces(q, np.zeros(7))).ravel()
    weight = np.array([0.0, gravity[1]])
    jacobian = np.array(symbolic_robot.foot_motion()(q=q, dq=np.zeros(7), ddq=np.zeros(7))["J_stance"])
    torque = (gravity - jacobian.T @ weight)[3:]
    residual = np.array(dynamics_residual()(coeffs, phase_range, 0.5, 0.0, 0.0, torque, weight)).ravel()
    assert gravity[1] == pytest.approx(32 * 9.81)
    assert residual[[0, 1, 3, 4, 5, 6]] == pytest.approx(np.zeros(6), abs=1e-9)
