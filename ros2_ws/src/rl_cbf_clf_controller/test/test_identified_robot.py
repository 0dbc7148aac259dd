"""What adaptation learns from, what it estimates, and whose estimates it adds to."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import DOF, TICK_SECONDS
from rl_cbf_clf_controller.identification import RATE_NOISE, SIZE, is_physical
from rl_cbf_clf_controller.identified_robot import KNOWN, NOISE_WEIGHT, PITCH, after_tick, first_known, rate_variance
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.scene import ControllerError, Scene
from walking_states import make_controller, state_of

STANDING = np.array([[0.0, 300.0], [0.0, 0.0]])
TORQUE = np.array([10.0, -20.0, 30.0, 5.0])
NONE = Estimates.zero(5, 4)
ONE = pytest.mark.parametrize("state", [0], indirect=True)


def controller(policy=None, **changes):
    return make_controller(policy, controller="rl-cbf-clf-qp", gait="authors_035", **changes)


@cache
def adapting_controller():
    """Its functions take a while to build."""
    return controller(adaptation="identification")


@cache
def function_after_tick():
    return after_tick(read_robot(), gives_way=False)


class Identified:
    """A robot of which nothing is known at first."""

    def __init__(self):
        self._robot, self._after = read_robot(), function_after_tick()
        self.reset()

    def reset(self):
        first = first_known(self._robot).values()
        self.known = self._after.values(np.concatenate([np.ravel(value) for value in first]))

    def learns(self, scene, tick, torque=TORQUE, force=STANDING):
        """What it says at the same state with other sensors."""
        sensed = np.array([tick]), scene.x, force, torque
        self.known = self._after(self.known.row, *sensed, self._robot.joints, self._robot.feet)
        return scene.error_of(self.known.numbers)

    @property
    def shown(self):
        return np.concatenate([self.known.used, self.known.offsets, self.known.doubts[:1]])


def adapting(state):
    """A scene and a robot of which nothing is known."""
    adapting_controller().reset(0)
    return adapting_controller().look(state_of(*state)), Identified()


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
        adaptation.learns(here, tick)
    adaptation.learns(here, **{"tick": 7, **wrong})
    assert adaptation.known.standing == 0
    assert adaptation.known.share == 1


def test_after_a_bounce_it_waits_again(state):
    """The fourth and the tenth tick are the first to teach; a bounce in the seventh."""
    here, adaptation = adapting(state)
    learned = []
    for tick in range(12):
        before = adaptation.shown
        adaptation.learns(here, tick, force=np.zeros((2, 2)) if tick == 6 else STANDING)
        learned.append(not np.array_equal(adaptation.shown, before))
    assert [tick for tick in range(12) if learned[tick]] == [3, 4, 5, 9, 10, 11]


def test_at_first_the_robot_is_the_nominal_one(state):
    """So nothing is added to the policy's estimates; and again, in another episode."""
    here, adaptation = adapting(state)
    first = adaptation.shown
    estimates = adaptation.learns(here, 0, np.full(4, np.nan))
    assert estimates.alpha == pytest.approx(0, abs=1e-9)
    assert estimates.beta == pytest.approx(0, abs=1e-7)
    assert first.shape == (len(KNOWN),)
    assert first[SIZE:].tolist() == [0.0, 0.0, 0.0]
    for tick in range(1, 9):
        adaptation.learns(here, tick)
    assert not np.array_equal(adaptation.shown, first)
    adaptation.reset()
    np.testing.assert_array_equal(adaptation.shown, first)


def fed(adaptation: Identified, scene: Scene, pitch: np.ndarray, rates: np.ndarray, pause_every: int = 10**9) -> float:
    """The variance of the rates' errors found from pitches, rad, and rates, rad/s, with a flight now and then."""
    for tick, (angle, rate) in enumerate(zip(pitch, rates, strict=True)):
        x = scene.x.copy()
        x[PITCH], x[DOF + PITCH] = angle, rate
        force = STANDING if tick % pause_every else np.zeros((2, 2))
        adaptation.learns(replace(scene, x=x), tick, force=force)
    return rate_variance(adaptation.known.errors.item(), adaptation.known.differences.item())


def sigma_of(variance: float) -> float:
    """The standard deviation, rad/s, of the rates' errors, from what `rate_variance` says."""
    return float(np.sqrt(max(variance - RATE_NOISE**2, 0) / NOISE_WEIGHT))


@ONE
@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.2])
def test_white_noise_on_a_swing_of_the_torso_is_found(state, sigma):
    phase = 2 * np.pi * 2.0 * 0.01 * np.arange(4000)
    pitch, rates = -1.5 / (4 * np.pi) * np.cos(phase), 1.5 * np.sin(phase)
    rates += sigma * np.random.default_rng(0).standard_normal(len(rates))
    here, adaptation = adapting(state)
    for pause_every in (10**9, 20):
        adaptation.reset()
        assert sigma_of(fed(adaptation, here, pitch, rates, pause_every)) == pytest.approx(sigma, abs=0.012)


@ONE
@pytest.mark.parametrize(
    ("rates", "most"),
    [(0.15 * (-1.0) ** np.arange(200), 1e-6), (np.repeat([0.0, 3.0], 25), 0.02)],
    ids=["chatter", "push"],
)
def test_torques_that_chatter_are_no_noise_and_neither_is_a_push(state, rates, most):
    """The rate jumps to and fro by 0.3 rad/s from tick to tick, or once by 3 rad/s, evenly, and the pitch with it."""
    pitch = TICK_SECONDS * np.concatenate([[0.0], np.cumsum((rates[1:] + rates[:-1]) / 2)])
    assert sigma_of(fed(*reversed(adapting(state)), pitch, rates)) == pytest.approx(0.0, abs=most)


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


@ONE
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
