"""What adaptation learns from, what it estimates, and whose estimates it adds to."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from rabbit_description.gait import load_gait
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.identification import RATE_NOISE, SIZE, is_physical
from rl_cbf_clf_controller.identified_robot import (
    CORRELATED,
    FIRST_DIFFERENCES,
    KNOWN,
    PITCH_RATE,
    SETTLING,
    IdentifiedRobots,
    rate_variance,
)
from rl_cbf_clf_controller.parameters import ParameterError, load_parameters
from rl_cbf_clf_controller.policy import Policy, ZeroPolicy
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.scene import ControllerError, Scene

GAIT = load_gait("authors_035")
STANDING = np.array([[0.0, 300.0], [0.0, 0.0]])
TORQUE = np.array([10.0, -20.0, 30.0, 5.0])
NONE = Estimates.zero(5, 4)


def controller(policy=None, **changes):
    parameters = load_parameters("ours", controller="rl-cbf-clf-qp", gait="authors_035", **changes)
    return Controller(parameters, GAIT, policy or ZeroPolicy(parameters.problem))


def state_of(q, dq):
    return RobotState(0, q, dq, np.zeros((2, 2)), np.zeros(2, bool), 0, StonePreview(1, 0.35, 0.40))


def learns(adaptation, scene, tick, torque=TORQUE, force=STANDING):
    """What it says at the same state with other sensors."""
    return adaptation.estimate(np.array([tick]), scene.x[None], scene.p[None], force[None], torque[None])[0]


def adapting(state):
    """A scene and a robot of which nothing is known."""
    own = controller(adaptation="identification")
    return own.look(state_of(*state)), own._robot


@pytest.mark.parametrize(
    "wrong",
    [
        {"tick": 8},  # a tick is missing
        {"torque": np.full(4, np.nan)},  # the legs have swapped
        {"force": np.zeros((2, 2))},  # flight
        {"force": np.array([[0.0, 300.0], [0.0, 40.0]])},  # the swing foot touches
    ],
)
def test_only_pinned_ticks_count(state, wrong):
    here, adaptation = adapting(state)
    for tick in range(7):
        learns(adaptation, here, tick)
    learns(adaptation, here, **{"tick": 7, **wrong})
    assert adaptation.known.standing == 0
    assert adaptation.known.share == 1


def test_after_a_bounce_it_waits_again(state):
    """The fourth and the tenth tick are the first to teach; a bounce in the seventh."""
    here, adaptation = adapting(state)
    learned = []
    for tick in range(12):
        before = adaptation.shown
        learns(adaptation, here, tick, force=np.zeros((2, 2)) if tick == 6 else STANDING)
        learned.append(not np.array_equal(adaptation.shown, before))
    assert [tick for tick in range(12) if learned[tick]] == [3, 4, 5, 9, 10, 11]


def test_at_first_the_robot_is_the_nominal_one(state):
    """So nothing is added to the policy's estimates; and again, in another episode."""
    here, adaptation = adapting(state)
    first = adaptation.shown
    estimates = learns(adaptation, here, 0, np.full(4, np.nan))
    assert estimates.alpha == pytest.approx(0, abs=1e-9)
    assert estimates.beta == pytest.approx(0, abs=1e-7)
    assert first.shape == (1, len(KNOWN))
    assert first[0, SIZE:].tolist() == [0.0, 0.0, 0.0]
    for tick in range(1, 9):
        learns(adaptation, here, tick)
    assert not np.array_equal(adaptation.shown, first)
    adaptation.reset()
    np.testing.assert_array_equal(adaptation.shown, first)


def fed(adaptation: IdentifiedRobots, scene: Scene, rates: np.ndarray, *, pause_every: int = 10**9) -> float:
    """The variance of the rates' errors that is found from these pitch rates, rad/s, with a flight now and then."""
    for tick, rate in enumerate(rates):
        x = scene.x.copy()
        x[PITCH_RATE] = rate
        force = STANDING if tick % pause_every else np.zeros((2, 2))
        learns(adaptation, replace(scene, x=x), tick, force=force)
    return rate_variance(adaptation.known.squares.item(), adaptation.known.differences.item())


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.2])
def test_white_noise_on_a_swing_of_the_torso_is_found(state, sigma):
    time = 0.01 * np.arange(4000)
    rates = 1.5 * np.sin(2 * np.pi * 2.0 * time) + sigma * np.random.default_rng(0).standard_normal(len(time))
    here, adaptation = adapting(state)
    for pause_every in (10**9, 20):
        adaptation.reset()
        variance = fed(adaptation, here, rates, pause_every=pause_every)
        found = np.sqrt((variance - RATE_NOISE**2) / CORRELATED)
        assert found == pytest.approx(sigma, abs=0.012), "of the swing itself 0.01 rad/s is left"


def test_it_waits_for_its_first_differences_and_a_pause_is_no_noise(state):
    """Even acceleration is no noise either."""
    here, adaptation = adapting(state)
    rates = [start + at for start in (0.0, 5.0, -5.0) for at in range(SETTLING + 4)]
    assert fed(adaptation, here, np.array(rates), pause_every=SETTLING + 4) == pytest.approx(RATE_NOISE**2)
    for ticks, knows in ((SETTLING + 1 + FIRST_DIFFERENCES, False), (SETTLING + 2 + FIRST_DIFFERENCES, True)):
        adaptation.reset()
        fed(adaptation, here, np.arange(float(ticks)))
        assert (adaptation.known.share != 1) == knows


@pytest.mark.parametrize("which", [0, 4, 8])
def test_a_link_without_mass_is_no_robot(which):
    theta = read_robot().theta
    assert is_physical(ca.DM(theta))
    for impossible in (np.where(np.arange(12) == which, -1.0, theta), np.where(np.arange(12) == which + 2, 9.0, theta)):
        assert not is_physical(ca.DM(impossible))  # no mass; a CoM too far off for the inertia


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
