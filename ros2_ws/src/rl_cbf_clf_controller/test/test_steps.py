"""Steps through a gait library: outputs that begin with the step, and the torque of its first tick."""

import numpy as np
import pytest
from numpy_steps import Steps
from rabbit_description.gait import load_gaits
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.robot_numbers import read_robot

LANDED = load_gaits("paper_stones").x_start
ROUNDING = 1e-15  # of q
MOST = 1e-6  # N m
H = 1e-6  # of the phase


STEPS = Steps(load_gaits("slopes"), load_parameters("ours"), read_robot())


def begun(q, dq):
    """Outputs of the step that begins there."""
    return STEPS.begin(np.concatenate([q, dq]), stone=StonePreview(1, 0.42, 0.47))


def landed(seed):
    """A state that a touchdown may leave, beside the path of the step that begins there."""
    rng = np.random.default_rng(seed)
    return LANDED[0] + rng.normal(0, 0.03, 7), LANDED[1] + rng.normal(0, 0.3, 7)


@pytest.mark.parametrize("name", ["ours", "best"])
def test_rounding_of_the_state_changes_the_first_torque_of_a_step_by_rounding(name):
    """The first tick of an episode begins a step."""
    parameters = load_parameters(name, gait="slopes", qp_solver="daqp")
    controller = Controller(parameters, load_gaits("slopes"), ZeroPolicy(parameters.problem))

    def first_torque(q, dq):
        controller.reset(0)
        stone = StonePreview(1, 0.38, 0.43)
        return controller.step(RobotState(0, q, dq, np.zeros((2, 2)), np.zeros(2, dtype=bool), 0, stone)).torque

    for seed in range(20):
        q, dq = landed(seed)
        signs = np.random.default_rng(seed).choice([-1, 0, 1], (8, 7))
        torques = [first_torque(q * (1 + ROUNDING * sign), dq) for sign in signs]
        np.testing.assert_allclose(torques, torques[:1] * 8, rtol=0, atol=MOST)


@pytest.mark.parametrize("since", [-0.3, -0.01, 0.0, 0.02, 0.3, 0.5, 0.9])
def test_desired_outputs_are_smooth_before_at_and_after_the_beginning_of_a_step(since):
    """Along a motion each derivative is the slope of the one before it."""
    q, dq = landed(0)
    outputs = begun(q, dq)
    rate = outputs.evaluate(q, dq).phase_rate
    q = q + since / rate * dq
    behind, here, ahead = (outputs.evaluate(q + step / rate * dq, dq) for step in (-H, 0, H))
    per_time = rate / (2 * H)
    assert here.dy == pytest.approx((ahead.y - behind.y) * per_time, abs=1e-3)
    assert here.bias == pytest.approx((ahead.dy - behind.dy) * per_time, abs=1e-2)
