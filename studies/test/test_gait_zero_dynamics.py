"""The zero dynamics against mechanics (more: `test_planar_gait.py`), and CasADi's robot against pinocchio's."""

import numpy as np
import pinocchio as pin
import pytest
from rabbit_description.gait import GaitLibrary, load_gait, load_gaits
from rabbit_description.state import Array
from rabbit_gait_design import symbolic_robot
from rabbit_gait_design.orbit import Orbit
from rabbit_gait_design.zero_dynamics import ZeroDynamics, nominal_model

GAIT = load_gait("stones_0350_070")
POINTS = [(0.0, 1.7), (0.3, 2.4), (0.7, 2.0), (1.0, 3.0)]


@pytest.fixture(scope="module")
def dynamics() -> ZeroDynamics:
    return ZeroDynamics(GAIT)


@pytest.mark.parametrize("slope", [0.0, 5.0, -3.0])
@pytest.mark.parametrize(("phase", "rate"), POINTS)
def test_angular_momentum_about_the_foot_changes_by_gravity_alone(phase: float, rate: float, slope: float) -> None:
    """d/dt H_stance = total mass g times the lever arm of the weight: no torque acts at a point foot. H by differences.

    On a slope that rises by gamma the arm is x cos(gamma) - z sin(gamma).
    """
    dynamics = ZeroDynamics(GAIT, nominal_model(slope))
    instant, model, h = dynamics.at(phase, rate), dynamics.model.model, 1e-5
    data = model.createData()

    def momentum(t: float) -> tuple[float, Array]:
        q, dq = instant.q + t * instant.dq + t * t / 2 * instant.ddq, instant.dq + t * instant.ddq
        spin = pin.computeCentroidalMomentum(model, data, q, dq)
        com = pin.centerOfMass(model, data, q)
        return spin.angular[1] + np.cross(com, spin.linear)[1], com

    rate_of_change, com = (momentum(h)[0] - momentum(-h)[0]) / (2 * h), momentum(0.0)[1]
    arm = com @ [np.cos(np.radians(slope)), 0.0, -np.sin(np.radians(slope))]
    assert rate_of_change == pytest.approx(32 * 9.81 * arm, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("slope", [-6.0, 0.0, 6.0])
def test_over_a_step_the_motors_work_is_the_energy_gained(slope: float) -> None:
    """Kinetic energy and height, the height being that above the horizon."""
    library = load_gaits("slopes")
    assert isinstance(library, GaitLibrary)
    gait = library.rows[library.slopes.index(slope)][1]
    orbit = Orbit(gait, 801)
    up = np.array([np.sin(np.radians(slope)), 0.0, np.cos(np.radians(slope))])

    def energy(at: int) -> float:
        q, dq = orbit.instants[at].q, orbit.instants[at].dq
        orbit.dynamics.model.update(q, dq)
        com = pin.centerOfMass(orbit.dynamics.model.model, orbit.dynamics.model.data, q)
        return float(dq @ orbit.dynamics.model.mass_matrix() @ dq / 2 + 32 * 9.81 * com @ up)

    power = np.sum(orbit.series("torque") * orbit.series("dq")[:, 3:], axis=1)
    assert np.trapezoid(power, orbit.times) == pytest.approx(energy(-1) - energy(0), abs=0.02)
    climbed = 32 * 9.81 * gait.step_length * up[0]
    lost = energy(-1) - climbed - energy(0)  # at the impact, from which the next step begins as this one did
    assert lost > 0


def test_uniform_mass_scale_leaves_the_zero_dynamics_unchanged(dynamics: ZeroDynamics) -> None:
    heavy = nominal_model()
    for inertia in heavy.model.inertias:
        inertia.mass, inertia.inertia = 2 * inertia.mass, 2 * inertia.inertia
    phases = np.linspace(0, 1, 7)
    scaled = ZeroDynamics(GAIT, heavy)
    assert np.array(scaled.transition(phases)) == pytest.approx(np.array(dynamics.transition(phases)), abs=1e-8)
    ours, theirs = dynamics.at(0.4, 2.0), scaled.at(0.4, 2.0)
    assert theirs.torque == pytest.approx(2 * ours.torque)
    assert theirs.force == pytest.approx(2 * ours.force)


def test_least_phase_rate_parts_the_steps_that_are_completed(dynamics: ZeroDynamics) -> None:
    least, phases = dynamics.least_phase_rate(), np.linspace(0, 1, 201)
    assert np.isfinite(dynamics.phase_rates(phases, 1.001 * least)).all()
    assert np.isnan(dynamics.phase_rates(phases, 0.999 * least)[-1])


PLANE = [0, 2]
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def random_motion(seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, 7), rng.uniform(-3, 3, 7), rng.uniform(-20, 20, 7)


@pytest.mark.parametrize("slope", [0.0, 6.0, -4.0])
@pytest.mark.parametrize("seed", range(5))
def test_mass_matrix_and_bias_forces(seed: int, slope: float) -> None:
    q, dq, _ = random_motion(seed)
    model = nominal_model(slope).model
    data = model.createData()
    upper = np.triu(pin.crba(model, data, q))
    mass_matrix, bias_forces = symbolic_robot.dynamics(slope)
    assert np.array(mass_matrix(q)) == pytest.approx(upper + np.triu(upper, 1).T, rel=1e-9, abs=1e-9)
    assert np.array(bias_forces(q, dq)).ravel() == pytest.approx(pin.nle(model, data, q, dq), rel=1e-9, abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_feet(seed: int) -> None:
    q, dq, ddq = random_motion(seed)
    model = nominal_model().model
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
