"""The oracle's reward on the rigid plant: nominal + alpha mu + beta against the true derivative at the same state.

The truth comes from the plant's own equations of motion: V and B-dot a short time before and after, and the ground
force at the instant. Only differencing errors are left. So what the trainer measures on a walk is the true model error.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pinned_motion import accelerations
from rabbit_description.state import Array, RobotState
from rabbit_experiments.evaluation import episode
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbations.joints import JointDamping
from rabbit_sim.pinned_dynamics import PinnedDynamics
from rabbit_sim.robot_urdf import leg_shape, perturbed_urdf
from rl_cbf_clf_controller.controller_output import ControllerOutput, from_flat
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit
from rl_trainer.rollout import Record, rollout
from rl_trainer.transitions import Doubt, TransitionBuilder
from walked import make_assembly, with_law

SHORT = 5e-6  # s, between which V and B-dot are differenced
PLANTS: list[dict[str, float]] = [
    {"mass_scale": 2.0},
    {"mass_scale": 0.7, "payload": 20.0},
    {"payload": 32.0, "motor_loss": 0.15, "joint_damping": 1.0},
    {"mass_scale": 2.0, "link_bend": 0.05},
    {"mass_scale": 2.0, "leg_stretch": 1.03},
    {"mass_scale": 2.0, "left_leg_scale": 1.3},
    {"mass_scale": 2.0, "slope": 2.0, "left_knee_gain": 0.9, "right_hip_gain": 0.8},
]


class Truth:
    """The perturbed robot's motion from a state, under the torque that the plant's motors give."""

    def __init__(self, plant: SimulationParameters) -> None:
        feet = RabbitFeet(leg_shape(plant))
        urdf = perturbed_urdf(plant)
        damping = JointDamping(joint_damping=plant.joint_damping).joint_torque(urdf)
        self._dynamics = PinnedDynamics(urdf, feet, [damping], plant.slope)
        gains = plant.left_hip_gain, plant.left_knee_gain, plant.right_hip_gain, plant.right_knee_gain
        self._share = (1 - plant.motor_loss) * np.array(gains)

    def acceleration_and_force(self, q: Array, dq: Array, output: ControllerOutput) -> tuple[Array, Array]:
        return accelerations(self._dynamics, q, dq, self._share * output.torque, output.stance)

    def after(self, state: RobotState, output: ControllerOutput, h: float) -> RobotState:
        """The state `h` seconds later, by one Runge-Kutta step."""
        q, v1 = state.q, state.dq
        a1 = self.acceleration_and_force(q, v1, output)[0]
        v2 = v1 + h / 2 * a1
        a2 = self.acceleration_and_force(q + h / 2 * v1, v2, output)[0]
        v3 = v1 + h / 2 * a2
        a3 = self.acceleration_and_force(q + h / 2 * v2, v3, output)[0]
        v4 = v1 + h * a3
        a4 = self.acceleration_and_force(q + h * v3, v4, output)[0]
        return replace(state, q=q + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4), dq=v1 + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4))


def estimated_and_true(controller: str, policy: str, **plant: float) -> tuple[Array, Array]:
    """The quantities (n,) as the controller estimates them at the executed mu, and as they are.

    In the first approach the quantities are the outputs' accelerations, and mu is what they should be.
    """
    parts = make_assembly(controller, policy, plant="rigid", motor_lag=0.0, **plant)
    simulation, built = parts.build()
    truth, pairs = Truth(parts.simulation), list[tuple[Array, Array]]()

    def look(record: Record) -> None:
        state, output = record.state, record.output
        if state.tick >= 60 or state.tick % 3:
            return
        before, later = (built.look(truth.after(state, output, h)) for h in (-SHORT, SHORT))
        if parts.controller.problem.corrects_input:
            if not output.saturated:
                pairs.append((output.mu, (later.seen.eta - before.seen.eta)[4:] / (2 * SHORT)))
            return
        nominal = output.nominal_a @ output.mu + output.nominal_b
        force = truth.acceleration_and_force(state.q, state.dq, output)[1]
        pairs.append((nominal + output.alpha @ output.mu + output.beta, derivatives(before, later, force)))

    episode(simulation, built, 1, look)
    simulation.close()
    estimated, true = (np.array(values) for values in zip(*pairs, strict=True))
    return estimated, true


def derivatives(before: Scene, later: Scene, force: Array) -> Array:
    """V', B1'', B2'', F_N, F_T."""
    ends = [(seen.V[0], seen.B1_state[1], seen.B2_state[1]) for seen in (before.seen, later.seen)]
    return np.array([*np.subtract(ends[1], ends[0]) / (2 * SHORT), force[1], force[0]])


def relative_error(estimated: Array, true: Array) -> Array:
    """Root mean square of the error over that of the truth, by quantity."""
    error: Array = np.sqrt(((estimated - true) ** 2).mean(axis=0) / (true**2).mean(axis=0))
    return error


@pytest.mark.parametrize("controller", ["rl-cbf-clf-qp", "io-rl-clf-qp"])
@pytest.mark.parametrize("plant", PLANTS)
def test_reward_of_every_quantity_is_zero(controller: str, plant: dict[str, float]) -> None:
    estimated, true = estimated_and_true(controller, "oracle", **plant)
    assert len(true) >= 5
    assert relative_error(estimated, true).max() < 1e-6


def test_without_it_the_reward_is_not() -> None:
    assert relative_error(*estimated_and_true("cbf-clf-qp", "zero", mass_scale=2.0)).min() > 0.05


STEPS = 4
EXPLORING = {"mass_scale": 2.0, "motor_lag": 0.0, "stones": STEPS}


@pytest.mark.parametrize("plant", ["pybullet", "rigid"])
@pytest.mark.parametrize("problem", PAPER)
def test_targets_are_the_true_errors(problem: Problem, plant: str) -> None:
    """At the executed mu, noise on: relative error below 0.1; of the forces, which the engine's ground gives, 0.25.

    In the first approach the oracle cancels the error, so y'' must be mu; the error counts against the input's size.
    """
    exploring = make_assembly(problem.name, "oracle", plant=plant, **EXPLORING)
    simulation, controller = with_law(exploring, sigma=5.0).build()
    parameters = TrainingParameters(problem=problem)
    builder = TransitionBuilder(parameters)
    target, true, size, io = [], [], [], problem.corrects_input

    def observe(record: Record) -> None:
        transition = builder.add(record.state, record.output)
        if transition is not None and not transition.doubt & ~Doubt.SATURATED:
            unit = error_unit(transition.LgV, parameters)
            target.append(transition.target / unit)
            true.append(transition.correction / unit)  # the oracle's: exact
            size.append((transition.correction + transition.mu if io else transition.correction) / unit)

    rollout(simulation, controller, 11, observe)
    simulation.close()
    assert len(target) > 30 * STEPS
    error = np.linalg.norm(np.array(target) - true, axis=0) / np.linalg.norm(size, axis=0)
    limit = [0.25 if name in ("C1", "C2") else 0.1 for name in problem.quantities]
    assert (error < limit).all(), dict(zip(problem.quantities, error, strict=True))


def test_beside_an_adaptation_the_target_is_what_it_leaves() -> None:
    """The robot is found within a step; what is left to learn is less than a tenth of the nominal model's error."""
    exploring = make_assembly("rl-cbf-clf-qp", plant="rigid", **EXPLORING)
    simulation, controller = with_law(exploring, adaptation="identification", sigma=5.0).build()
    builder = TransitionBuilder(TrainingParameters(problem=RL_CBF_CLF_QP))
    left, whole = [], []

    def observe(record: Record) -> None:
        transition = builder.add(record.state, record.output)
        if transition is not None and not transition.doubt & ~Doubt.SATURATED and transition.step_index:
            assert not transition.alpha.any()  # the policy's own
            found = from_flat(previous[0].adapted, 5, 4)
            left.append(transition.target)
            whole.append(transition.target + found.error(transition.mu))
        previous[0] = record.output

    previous: list[Any] = [None]
    rollout(simulation, controller, 11, observe)
    simulation.close()
    assert len(left) > 20 * STEPS
    assert (np.linalg.norm(left, axis=0) < 0.1 * np.linalg.norm(whole, axis=0)).all()
