"""A three-link walker's gait on its hybrid zero dynamics: the impact closes it, and it is stable."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rabbit_command import invoke
from rabbit_description.planar_urdf import with_planar_base
from rabbit_description.task_source import load_task
from rabbit_gait_design.hybrid_zero_dynamics import RepeatedStep, Walker, impact_invariant
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rabbit_gait_design.planar_design import PlanarDesignError, PlanarSpecification, design
from rabbit_gait_design.walker_guess import double_support, guesses
from rl_cbf_clf_controller.planar_walker import read_walker
from rl_cbf_clf_controller.task_controller import TaskController
from rl_cbf_clf_controller.virtual_constraints import Angles, StepPath
from rl_trainer.task_episode import ride_of
from scipy.integrate import solve_ivp

EXAMPLES = Path(__file__).parents[2] / "examples"
URDF = with_planar_base((EXAMPLES / "three_link_walker.urdf").read_text())
TORSO_AND_LEGS = np.array([[0.0, 0, 1, 0, 0], [0.0, 0, 2, 1, 1]])  # its pitch, and the sum of the legs' angles
STANCE_LEG = np.array([0.0, 0, 1, 1, 0])
LATER = np.array([[0.2, 0.2, 0.2, 0.2], [0.0, -0.1, -0.05, 0.0]])  # control points from the third on


@pytest.fixture(scope="module")
def walker() -> Walker:
    return Walker(PinocchioModel(URDF), Angles(TORSO_AND_LEGS, STANCE_LEG), np.array([0, 1, 2, 4, 3]))


@pytest.fixture(scope="module")
def step(walker: Walker) -> RepeatedStep:
    return RepeatedStep(walker, impact_invariant(walker, LATER, 0.25), points=41)


def test_the_outputs_are_zero_over_the_step_and_the_foot_rests(walker, step):
    for instant, phase in zip(step.instants, step.phases, strict=True):
        feet = walker.model.update(instant.q, instant.dq)
        assert instant.q[:2] == pytest.approx(feet.hip, abs=1e-12)
        assert instant.dq[:2] == pytest.approx(feet.hip_rate, abs=1e-12)
        outputs = step.dynamics.constraints.evaluate(instant.q, instant.dq)
        assert outputs.eta == pytest.approx(np.zeros(4), abs=1e-12)
        assert outputs.phase == pytest.approx(phase, abs=1e-12)


def walk_through(walker, step, q, dq):
    """The whole pinned robot under exact input-output linearisation, from a state through the impact."""

    def control(x):
        walker.model.update(x[:5], x[5:])
        acceleration = walker.model.pinned().acceleration
        outputs = step.dynamics.constraints.evaluate(x[:5], x[5:])
        y_ddot = outputs.second_derivative(acceleration)
        return acceleration, np.linalg.solve(y_ddot.a, -100 * outputs.y - 20 * outputs.dy - y_ddot.b)

    def motion(_, x):
        acceleration, torque = control(x)
        return np.concatenate([x[5:], acceleration(torque)])

    def end(_, x):
        return step.dynamics.constraints.evaluate(x[:5], x[5:]).phase - 1

    end.terminal = True
    x = solve_ivp(motion, (0, 5), np.concatenate([q, dq]), rtol=1e-10, atol=1e-11, events=[end]).y_events[0][0]
    return walker.after_impact(x[:5], x[5:])


def test_the_robot_walks_it_and_comes_back_by_the_eigenvalue(walker, step):
    """The Poincare map of the whole robot, restricted to the zero dynamics: its derivative is below 1."""
    assert step.exists
    assert 0 < step.eigenvalue < 1
    q, dq = step.start
    back = walk_through(walker, step, q, dq)
    assert back[0] == pytest.approx(q, abs=1e-7)
    assert back[1] == pytest.approx(dq, abs=1e-6)
    sigma = lambda rates: (rates @ STANCE_LEG) ** 2  # noqa: E731
    faster = walk_through(walker, step, q, 1.01 * dq)[1]
    returned = (sigma(faster) - sigma(dq)) / (sigma(1.01 * dq) - sigma(dq))
    assert returned == pytest.approx(step.eigenvalue, rel=1e-4)


def test_a_step_too_slow_to_pass_the_vertical_does_not_exist(walker):
    assert not RepeatedStep(walker, impact_invariant(walker, LATER * [[0.2], [1.0]], 0.3), points=21).exists


GUESS = StepPath(np.array([[0.15, 0.15, 0.15, 0.15], [0.0, 0.0, -0.1, 0.0]]), 0.0, 0.23)


def test_a_gait_is_found_that_keeps_its_conditions(walker):
    wanted = PlanarSpecification(step_length=0.45, speed=0.8, torque_limit=100.0)
    iterations = []
    gait = design(walker, wanted, GUESS, lambda iteration, cost: iterations.append((iteration, cost)))
    assert iterations
    assert gait.exists
    assert gait.eigenvalue <= wanted.max_eigenvalue + 1e-3
    length, height = gait.series("swing")[-1]
    assert (length, height, length / gait.duration) == pytest.approx((0.45, 0.0, 0.8), abs=2e-3)
    late = gait.series("swing")[(gait.phases > wanted.clear_from + 0.02) & (gait.phases < 0.98), 1]
    assert late.min() > 0
    assert gait.series("swing_rate")[-1, 1] < -wanted.landing_speed + 1e-3
    force = gait.series("force")
    assert force[:, 1].min() > wanted.min_normal_force
    assert (np.abs(force[:, 0]) <= wanted.friction_limit * force[:, 1] * 1.001).all()
    assert np.abs(gait.series("torque")).max() <= wanted.torque_limit * 1.001


def test_what_cannot_be_is_refused_by_name(walker):
    wanted = PlanarSpecification(step_length=0.45, speed=0.8, torque_limit=1.0)
    with pytest.raises(PlanarDesignError, match="torque by"):
        design(walker, wanted, GUESS)


def test_a_guess_goes_from_one_double_support_to_the_next() -> None:
    """Of AMBER, by its URDF alone: the feet a step apart on the ground; the legs exchanged; between, a bent knee."""
    own = read_walker(EXAMPLES / "amber_3m.yaml")
    amber = Walker(PinocchioModel(own.urdf, feet=own.feet), own.angles, own.order)
    end = double_support(amber, 0.35)
    assert amber.model.update(end, np.zeros(7)).swing == pytest.approx([0.35, 0.0], abs=1e-3)
    assert amber.model.update(end[amber.swap], np.zeros(7)).swing == pytest.approx([-0.35, 0.0], abs=1e-3)
    paths = list(guesses(amber, 0.35))
    assert len(paths) == 3
    for path, flexion in zip(paths, (0.6, 1.0, 0.3), strict=True):
        assert path.coeffs[:, -1] == pytest.approx(own.angles.controlled @ end)
        swing_knee = path.coeffs[own.outputs.index("swing_knee")]
        assert swing_knee.max() - swing_knee[0] == pytest.approx(flexion, abs=1e-3)
    assert (paths[0].phase_angle_start, paths[0].phase_angle_end) == pytest.approx((-0.203, 0.202), abs=0.01)  # AMBER's


@pytest.mark.thorough
def test_a_walker_without_a_path_gets_one_by_which_it_walks(tmp_path: Path) -> None:
    (tmp_path / "three_link_walker.urdf").write_text((EXAMPLES / "three_link_walker.urdf").read_text())
    kept = [line for line in (EXAMPLES / "three_link_walker.yaml").read_text().splitlines() if "[" not in line]
    without = "\n".join(line for line in kept if not line.startswith(("path", "phase_rate")))
    (tmp_path / "robot.yaml").write_text(without)
    done = invoke("gait", "--task", tmp_path / "robot.yaml", "--step-length", 0.5, "--speed", 1)
    assert done.exit_code == 0, done.output
    task = load_task(str(tmp_path / "robot_gait.yaml"))
    assert ride_of(TaskController(replace(task, impacts=20)), "oracle", 1).outcome == "done"
