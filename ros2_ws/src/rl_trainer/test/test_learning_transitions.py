"""Transitions from ticks: differences that are exact where the truth is linear, and what is left out."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rabbit_description.state import Leg, RobotState
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.uncertainty import IO_RL_CLF_QP, RL_CLF_QP
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Replay
from rl_trainer.transitions import Doubt, Transition, TransitionBuilder

Tick = Callable[..., tuple[RobotState, ControllerOutput]]
PARAMETERS = TrainingParameters()
PAPER = TrainingParameters(measurement="paper")


def join(*ticks: tuple[RobotState, ControllerOutput], parameters: TrainingParameters = PARAMETERS) -> Transition:
    builder = TransitionBuilder(parameters)
    transitions = [builder.add(state, output) for state, output in ticks]
    assert transitions[0] is None
    assert transitions[-1] is not None
    return transitions[-1]


def test_what_the_controller_measured_belongs_to_the_tick_before(tick: Tick) -> None:
    """Of V its own difference may be taken in place of the gradient's."""
    measured = np.array([40.0, 10.0, 20.0, 310.0, -40.0])
    first = tick(20, output={"V": 2.0, "measured": np.full(5, 7.0)})
    second = tick(21, output={"V": 2.5, "measured": measured})
    np.testing.assert_array_equal(join(first, second).measured, measured)
    np.testing.assert_allclose(join(first, second, parameters=PAPER).measured, [50.0, *measured[1:]])


def test_nominal_is_taken_at_the_executed_mu(tick: Tick) -> None:
    mu, a, b = np.arange(4.0), np.arange(20.0).reshape(5, 4), np.arange(5.0)
    first = tick(20, output={"mu": mu, "mu_qp": -mu, "nominal_a": a, "nominal_b": b})
    np.testing.assert_allclose(join(first, tick(21)).nominal, a @ mu + b)


def test_nominal_of_a_tick_is_the_mean_of_its_ends_under_the_held_torque(tick: Tick) -> None:
    """Exact where the nominal value changes at a constant rate; the CLF's, where the nominal acceleration does."""
    rng = np.random.default_rng(3)
    mu, mu_held, (a, next_a) = rng.normal(size=4), rng.normal(size=4), rng.normal(size=(2, 5, 4))
    first = tick(20, output={"mu": mu, "nominal_a": a, "LgV": a[0]})
    second = tick(21, output={"mu_held": mu_held, "nominal_a": next_a})
    expected = (a @ mu + next_a @ mu_held) / 2
    expected[0] = a[0] @ (mu + mu_held) / 2
    np.testing.assert_allclose(join(first, second).nominal, expected)
    np.testing.assert_allclose(join(first, second, parameters=PAPER).nominal, a @ mu)


def test_error_is_the_papers_loss(tick: Tick) -> None:
    """V-dot measured 50, nominal 10, corrected by alpha mu + beta = 25: the estimate is 15 short."""
    alpha = np.zeros((5, 4))
    alpha[0] = [5, 0, 0, 0]
    output = {
        "mu": np.array([4.0, 0, 0, 0]),
        "nominal_b": np.array([10.0, 0, 0, 0, 0]),
        "alpha": alpha,
        "beta": np.array([5.0, 0, 0, 0, 0]),
    }
    transition = join(tick(20, output=output), tick(21, output={"V": 0.5}), parameters=PAPER)
    assert transition.target[0] == pytest.approx(40)
    assert transition.error[0] == pytest.approx(-15)


def test_error_of_the_first_approach_is_acceleration_minus_mu(tick: Tick) -> None:
    mu, problem = np.array([1.0, 2, 3, 4]), IO_RL_CLF_QP
    output = {"mu": mu, "nominal_a": np.eye(4), "alpha": 0.3 * np.ones((4, 4)), "beta": np.ones(4)}
    second = {"measured": np.array([10.0, 20, 30, 40])}
    ticks = tick(20, output=output, problem=problem), tick(21, output=second, problem=problem)
    transition = join(*ticks, parameters=TrainingParameters(problem=problem))
    np.testing.assert_allclose(transition.error, np.array([10.0, 20, 30, 40]) - mu)


@pytest.mark.parametrize(
    ("first", "second", "state", "doubt"),
    [
        ({}, {}, {}, Doubt.NONE),
        ({}, {"step_index": 1, "stance": Leg.RIGHT}, {}, Doubt.UNMEASURED),
        ({"step_index": 1, "step_time": 0.03}, {"step_index": 1}, {}, Doubt.SETTLING),
        ({"step_index": 1, "step_time": 0.04}, {"step_index": 1}, {}, Doubt.NONE),
        ({"step_index": 0, "step_time": 0.0}, {}, {}, Doubt.NONE),  # an episode does not begin with an impact
        ({}, {}, {"foot_force": np.zeros((2, 2))}, Doubt.FLIGHT),
        ({}, {}, {"foot_force": np.array([[0, 200.0], [0, 50.0]])}, Doubt.SCUFF),
        ({"saturated": True}, {}, {}, Doubt.SATURATED),
        ({"phase": 0.99}, {"phase": 1.01}, {}, Doubt.EDGE),
        ({"phase": 1.01}, {"phase": 1.03}, {}, Doubt.NONE),
        ({"phase": -0.01}, {"phase": 0.02}, {}, Doubt.EDGE),
        ({"eta": np.array([0, 0.7, 0, 0, 0, 0, 0, 0])}, {}, {}, Doubt.FAR),
        ({"eta": np.array([0, 0, 0, 0, 0, 0, 0, -13.0])}, {}, {}, Doubt.FAR),
    ],
)
def test_doubts(tick: Tick, first: dict[str, Any], second: dict[str, Any], state: dict[str, Any], doubt: Doubt) -> None:
    transition = join(tick(20, output=first), tick(21, state=state, output=second))
    assert transition.doubt == doubt
    assert Replay(PARAMETERS).add(transition) == (doubt == Doubt.NONE)
    assert np.isnan(transition.measured).all() == (doubt == Doubt.UNMEASURED)


def test_gaps_are_never_bridged(tick: Tick) -> None:
    builder = TransitionBuilder(PARAMETERS)
    made = [builder.add(*tick(k)) for k in (0, 1, 3, 4)]
    assert [transition is not None for transition in made] == [False, True, False, True]
    builder.reset()
    assert builder.add(*tick(5)) is None


@pytest.mark.parametrize(("height", "pitch", "failed"), [(0.78, 0.0, False), (0.69, 0.0, True), (0.78, -1.1, True)])
def test_the_last_transition_knows_of_failure_by_pose(tick: Tick, height: float, pitch: float, failed: bool) -> None:
    builder = TransitionBuilder(PARAMETERS)
    builder.add(*tick(7))
    state, _ = tick(8, state={"q": np.array([0, height, pitch, 0, 0, 0, 0]), "running": False})
    last = builder.add(state)
    assert last is not None
    assert last.failed == failed
    assert last.doubt & Doubt.UNMEASURED
    assert builder.add(state) is None


def test_another_controllers_output_is_refused(tick: Tick) -> None:
    with pytest.raises(ValueError, match="quantities"):
        TransitionBuilder(PARAMETERS).add(*tick(0, problem=RL_CLF_QP))
