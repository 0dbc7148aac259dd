"""What adaptation learns from, what it estimates, and whose estimates it adds to."""

from dataclasses import replace

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from rabbit_description.gait import load_gait
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.identification import SIZE, is_physical
from rl_cbf_clf_controller.identified_robot import KNOWN, IdentifiedRobot, is_pinned
from rl_cbf_clf_controller.parameters import ParameterError, load_parameters
from rl_cbf_clf_controller.policy import Policy, ZeroPolicy
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.scene import ControllerError

GAIT = load_gait("authors_035")
STANDING = np.array([[0.0, 300.0], [0.0, 0.0]])
TORQUE = np.array([10.0, -20.0, 30.0, 5.0])
NONE = Estimates.zero(5, 4)


def controller(policy=None, **changes):
    parameters = load_parameters("ours", controller="rl-cbf-clf-qp", gait="authors_035", **changes)
    return Controller(parameters, GAIT, policy or ZeroPolicy(parameters.problem))


def state_of(q, dq):
    return RobotState(0, q, dq, np.zeros((2, 2)), np.zeros(2, bool), 0, StonePreview(1, 0.35, 0.40))


def measured(scene, tick, torque, force):
    """The same state with other sensors."""
    return replace(scene, tick=tick, torque=torque, force=force)


def test_only_pinned_ticks_count(state):
    good = measured(controller().look(state_of(*state)), 7, TORQUE, STANDING)
    assert is_pinned(6, good)
    bad = [
        replace(good, tick=8),  # a tick is missing
        replace(good, torque=np.full(4, np.nan)),  # the legs have swapped
        replace(good, force=np.zeros((2, 2))),  # flight
        replace(good, force=np.array([[0.0, 300.0], [0.0, 40.0]])),  # the swing foot touches
    ]
    assert not any(is_pinned(6, each) for each in bad)


def test_after_a_bounce_it_waits_again(state):
    """The fourth and the tenth tick are the first to teach; a bounce in the seventh."""
    adaptation, here = IdentifiedRobot(read_robot()), controller().look(state_of(*state))
    learned = []
    for tick in range(12):
        force = np.zeros((2, 2)) if tick == 6 else STANDING
        before = adaptation.known
        adaptation.estimate(measured(here, tick, TORQUE, force), NONE)
        learned.append(not np.array_equal(adaptation.known, before))
    assert [tick for tick in range(12) if learned[tick]] == [3, 4, 5, 9, 10, 11]


def test_at_first_the_robot_is_the_nominal_one(state):
    """So nothing is added to the policy's estimates."""
    here, adaptation = controller().look(state_of(*state)), IdentifiedRobot(read_robot())
    estimates = adaptation.estimate(measured(here, 0, np.full(4, np.nan), STANDING), NONE)
    assert estimates.alpha == pytest.approx(0, abs=1e-9)
    assert estimates.beta == pytest.approx(0, abs=1e-7)
    assert adaptation.known.shape == (len(KNOWN),)
    assert adaptation.known[SIZE:].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("which", [0, 4, 8])
def test_a_link_without_mass_is_no_robot(which):
    theta = read_robot().theta
    assert is_physical(theta)
    for impossible in (np.where(np.arange(12) == which, -1.0, theta), np.where(np.arange(12) == which + 2, 9.0, theta)):
        assert not is_physical(impossible)  # no mass; a CoM too far off for the inertia


class Trained(Policy):
    """A policy that was trained beside an adaptation."""

    version = "trained"

    def __init__(self, adaptation):
        self.adaptation = adaptation

    def estimate(self, scene, before):
        return NONE


@pytest.mark.parametrize(("trained", "runs"), [("none", "identification"), ("identification", "none")])
def test_a_policy_that_adds_to_another_adaptation_is_refused(state, trained, runs):
    here = state_of(*state)
    walking = controller(Trained(runs), adaptation=runs)
    walking.step(here)
    with pytest.raises(ControllerError, match=f"policy trained adds to adaptation {trained}: expected {runs}"):
        walking.policy = Trained(trained)
    assert walking.policy.adaptation == runs
    with pytest.raises(ControllerError):
        controller(Trained(trained), adaptation=runs)


@pytest.mark.parametrize("name", ["io-rl-clf-qp", "l1-clf-qp"])
def test_a_controller_that_estimates_no_rows_has_nothing_to_adapt(name):
    with pytest.raises(ParameterError, match="estimates no rows"):
        load_parameters("ours", controller=name, adaptation="identification")
