"""The zero dynamics against mechanics, and CasADi's robot against pinocchio's."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from rabbit_description.gait import Gait, GaitLibrary, load_gait, load_gaits
from rabbit_description.state import SWAP_STATE, Array
from rabbit_gait_design import symbolic_robot
from rabbit_gait_design.orbit import Orbit, start_phase_rate
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rabbit_gait_design.zero_dynamics import ZeroDynamics, loaded_model
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints
from scipy.integrate import solve_ivp

GAIT = load_gait("stones_0350_070")
POINTS = [(0.0, 1.7), (0.3, 2.4), (0.7, 2.0), (1.0, 3.0)]


LONGEST_STEP = 3.0  # s
HIP_FALL = 0.5  # m


@dataclass(frozen=True)
class Step:
    """The next post-impact state `q`, `dq` (7,), and the step's duration, s."""

    q: Array
    dq: Array
    duration: float


class OracleWalk:
    """The Poincaré map of `gait` on `model` under exact input-output linearisation of that model."""

    def __init__(self, gait: Gait, model: PinocchioModel, eps: float = 0.05, kp: float = 0.5, kd: float = 3**0.5 / 2):
        self.model = model
        self._constraints = VirtualConstraints(gait)
        self._gains = kp / eps**2, kd / eps

    def acceleration(self, q: Array, dq: Array) -> Array:
        """(7,), at a state in stance/swing order."""
        self.model.update(q, dq)
        pinned = self.model.pinned()
        outputs = self._constraints.evaluate(q, dq)
        wanted = -self._gains[0] * outputs.y - self._gains[1] * outputs.dy
        y_ddot = outputs.second_derivative(pinned.acceleration)
        return pinned.acceleration(np.linalg.solve(y_ddot.a, wanted - y_ddot.b))

    def step(self, q: Array, dq: Array) -> Step | None:
        """Walk one step from a post-impact state; None if the swing foot never lands ahead."""

        def motion(_: float, x: Array) -> Array:
            return np.concatenate([x[7:], self.acceleration(x[:7], x[7:])])

        start = np.concatenate([q, dq])
        events = [self._landing, self._turning_back, _falling]
        solution = solve_ivp(motion, (0.0, LONGEST_STEP), start, "RK45", events=events, rtol=1e-8, atol=1e-9)
        if not len(solution.t_events[0]):
            return None
        x = solution.y_events[0][0]
        after, _ = self.model.impact(x[:7], x[7:])
        landed = x[:7].copy()
        landed[:2] -= self.model.update(x[:7], x[7:]).swing
        return Step(landed[SWAP_STATE], after[SWAP_STATE], float(solution.t[-1]))

    def phase_rate(self, q: Array, dq: Array) -> float:
        """Rate of the phase, 1/s."""
        return self._constraints.evaluate(q, dq).phase_rate

    def _landing(self, _: float, x: Array) -> float:
        if self._constraints.evaluate(x[:7], x[7:]).phase < 0.5:
            return 1.0
        return float(self.model.update(x[:7], x[7:]).swing[1])

    def _turning_back(self, _: float, x: Array) -> float:
        return self.phase_rate(x[:7], x[7:])

    _landing.terminal, _landing.direction = True, -1  # type: ignore[attr-defined]
    _turning_back.terminal = True  # type: ignore[attr-defined]


def _falling(_: float, x: Array) -> float:
    return float(x[1] - HIP_FALL)


_falling.terminal = True  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def dynamics() -> ZeroDynamics:
    return ZeroDynamics(GAIT)


@pytest.mark.parametrize(("phase", "rate"), POINTS)
def test_outputs_are_zero_and_the_stance_foot_rests(dynamics: ZeroDynamics, phase: float, rate: float) -> None:
    instant = dynamics.at(phase, rate)
    outputs = VirtualConstraints(GAIT).evaluate(instant.q, instant.dq)
    assert outputs.eta == pytest.approx(np.zeros(8), abs=1e-12)
    assert (outputs.phase, outputs.phase_rate) == pytest.approx((phase, rate), abs=1e-12)
    feet = dynamics.model.update(instant.q, instant.dq)
    assert instant.q[:2] == pytest.approx(feet.hip, abs=1e-12)
    assert instant.dq[:2] == pytest.approx(feet.hip_rate, abs=1e-12)


@pytest.mark.parametrize(("payload", "slope"), [(0.0, 0.0), (30.0, 0.0), (0.0, 5.0), (30.0, -3.0)])
@pytest.mark.parametrize(("phase", "rate"), POINTS)
def test_angular_momentum_about_the_foot_changes_by_gravity_alone(
    phase: float, rate: float, payload: float, slope: float
) -> None:
    """d/dt H_stance = total mass g times the lever arm of the weight: no torque acts at a point foot. H by differences.

    On a slope that rises by gamma the arm is x cos(gamma) - z sin(gamma).
    """
    dynamics = ZeroDynamics(GAIT, loaded_model(payload, slope=slope))
    instant, model, h = dynamics.at(phase, rate), dynamics.model.model, 1e-5
    data = model.createData()

    def momentum(t: float) -> tuple[float, Array]:
        q, dq = instant.q + t * instant.dq + t * t / 2 * instant.ddq, instant.dq + t * instant.ddq
        spin = pin.computeCentroidalMomentum(model, data, q, dq)
        com = pin.centerOfMass(model, data, q)
        return spin.angular[1] + np.cross(com, spin.linear)[1], com

    rate_of_change, com = (momentum(h)[0] - momentum(-h)[0]) / (2 * h), momentum(0.0)[1]
    arm = com @ [np.cos(np.radians(slope)), 0.0, -np.sin(np.radians(slope))]
    assert rate_of_change == pytest.approx((32 + payload) * 9.81 * arm, rel=1e-5, abs=1e-4)


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


def test_phase_rates_are_those_of_the_pinned_robot_with_exact_linearisation(dynamics: ZeroDynamics) -> None:
    walk = OracleWalk(GAIT, dynamics.model)
    first = start_phase_rate(GAIT)
    q, dq = dynamics.state(0.0, first)
    taken = walk.step(q, dq)
    assert taken is not None
    orbit = Orbit(GAIT)
    assert taken.duration == pytest.approx(orbit.times[-1], rel=1e-4)
    assert walk.phase_rate(taken.q, taken.dq) == pytest.approx(first, rel=1e-3)


def test_uniform_mass_scale_leaves_the_zero_dynamics_unchanged(dynamics: ZeroDynamics) -> None:
    heavy = loaded_model()
    for inertia in heavy.model.inertias:
        inertia.mass, inertia.inertia = 2 * inertia.mass, 2 * inertia.inertia
    phases = np.linspace(0, 1, 7)
    scaled = ZeroDynamics(GAIT, heavy)
    assert np.array(scaled.transition(phases)) == pytest.approx(np.array(dynamics.transition(phases)), abs=1e-8)
    ours, theirs = dynamics.at(0.4, 2.0), scaled.at(0.4, 2.0)
    assert theirs.torque == pytest.approx(2 * ours.torque)
    assert theirs.force == pytest.approx(2 * ours.force)


@pytest.mark.parametrize("payload", [0.0, 40.0])
def test_least_phase_rate_parts_the_steps_that_are_completed(payload: float) -> None:
    dynamics = ZeroDynamics(GAIT, loaded_model(payload))
    least, phases = dynamics.least_phase_rate(), np.linspace(0, 1, 201)
    assert np.isfinite(dynamics.phase_rates(phases, 1.001 * least)).all()
    assert np.isnan(dynamics.phase_rates(phases, 0.999 * least)[-1])
    walk = OracleWalk(GAIT, dynamics.model)
    assert walk.step(*dynamics.state(0.0, 1.01 * least)) is not None
    assert walk.step(*dynamics.state(0.0, 0.98 * least)) is None


def test_impact_loses_energy_and_leaves_the_landed_foot_at_rest() -> None:
    orbit = Orbit(GAIT)
    last = orbit.instants[-1]
    after, _ = orbit.dynamics.model.impact(last.q, last.dq)
    model = orbit.dynamics.model
    model.update(last.q, last.dq)
    mass = model.mass_matrix()
    assert after @ mass @ after < last.dq @ mass @ last.dq
    feet = model.update(last.q, after)
    landed_foot_rate = feet.swing_rate + after[:2] - feet.hip_rate  # the old stance foot moves now
    assert landed_foot_rate == pytest.approx([0, 0], abs=1e-9)


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
