"""What happens once a step: it begins without error, ends on its stone, and knows missing numbers; in C to the bit."""

import subprocess
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.functions import places_of
from hypothesis import given, settings
from hypothesis import strategies as st
from rabbit_description import GAITS, LIBRARIES
from rabbit_description.gait import load_gaits, shipped
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.rabbit_step import HIGHEST_STONE
from rl_cbf_clf_controller.robot_numbers import Feet, read_robot
from rl_cbf_clf_controller.step_begin import HIGHER, kept_at_first, step_functions
from rl_cbf_clf_controller.step_landing import DEPTH, LATE
from rl_cbf_clf_controller.step_paths import GaitExpressions, Shape, gait_row
from rl_cbf_clf_controller.virtual_constraints import RABBIT_ANGLES

path_outputs = pytest.importorskip("rabbit_gait_design.path_outputs", reason="no studies")
ROBOT, NONE = read_robot(), np.full(3, np.nan)
OUTPUTS, _, DESIRED = path_outputs.output_functions(RABBIT_ANGLES)
SLOPED = [name for name in shipped(LIBRARIES) if len(load_gaits(name).slopes) > 1]
SEEDS = st.integers(0, 2**16)
ROUNDING, H = 1e-15, 1e-6  # of q; of the phase
MOST_INSTRUCTIONS = 5000  # gcc takes a second for 10,000


class Beginning:
    """The functions of a shipped gait or library, for numpy; `robot` has another's lengths."""

    def __init__(self, name, regulation="learned", robot=ROBOT):
        self.gaits, self.robot, self.feet = load_gaits(name), robot, Feet(robot)
        self.row, self.singles = gait_row(self.gaits), getattr(self.gaits, "gaits", [self.gaits])
        shape = Shape.of(self.gaits)
        self.functions = step_functions(shape, regulation)
        self.places = places_of(kept_at_first(GaitExpressions(shape), shape))

    def first(self):
        return self.values(self.functions[0](self.row))

    def inputs(self, x, stone=NONE, seconds=np.nan, steps=None, slope_change=0.0):
        steps = self.first()["steps_after"] if steps is None else steps
        lengths = self.robot.joints.ravel(), self.robot.feet.ravel()
        return x, stone, seconds, steps, self.row, 0.5, *lengths, slope_change

    def begin(self, *inputs, **named):
        return self.values(self.functions[1](*self.inputs(*inputs, **named)))

    def values(self, found):
        names = "path", "phase_scale", "steps_after", "place"
        return {name: output.full().ravel() for name, output in zip(names, found)}  # noqa: B905  `first` has three

    def kept(self, found, name):
        return found["steps_after"][self.places[name][0]]

    def landed(self, seed):
        """A state that a touchdown may leave, beside every path."""
        rng = np.random.default_rng(seed)
        q, dq = self.singles[rng.integers(len(self.singles))].x_start
        return np.concatenate([q + rng.normal(0, 0.03, 7), dq + rng.normal(0, 0.3, 7)])

    def touchdowns(self, count):
        """Inputs of steps one after the other, with and without a stone; a new episode every eighth."""
        rng, steps = np.random.default_rng(0), None
        for k in range(count):
            near = rng.uniform(0.15, 0.7)
            stone = np.array([near, near + 0.05, rng.uniform(-0.1, 0.1)]) if rng.random() < 0.8 else NONE
            seconds, steps = (rng.uniform(0.2, 0.8), steps) if k % 8 else (np.nan, None)
            yield self.inputs(self.landed(k), stone, seconds, steps)
            steps = self.begin(self.landed(k), stone, seconds, steps)["steps_after"]


def desired(found, phase):
    """Controlled angles (4,) and their slopes in the phase, rad."""
    values = DESIRED(np.array([phase]), found["path"])
    return values.desired_0, values.desired_1


def phase_angle(found, phase):
    per_angle, start = found["phase_scale"]
    return (phase + start) / per_angle


def pose(controlled, angle, feet):
    """The swing foot (2,) from the stance foot, m, and the pitch, rad."""
    q = np.append(np.zeros(2), RABBIT_ANGLES.coordinates(controlled, angle))
    return feet(q).swing, q[2]


def landing(found, feet):
    return pose(desired(found, 1.0)[0], phase_angle(found, 1.0), feet)


@pytest.fixture(scope="module")
def slopes():
    return Beginning("slopes")


@pytest.mark.parametrize("name", shipped(LIBRARIES))
def test_a_step_begins_without_error(name):
    own = Beginning(name)
    for seed in range(30):
        x = own.landed(seed)
        for stone in (NONE, np.array([0.35, 0.4, 0.02])):
            found = own.begin(x, stone, 0.45)
            eta = OUTPUTS(x[:7], x[7:], found["phase_scale"], found["path"]).eta
            np.testing.assert_allclose(eta, 0, atol=1e-9)
            np.testing.assert_allclose(found["place"], own.feet(x[:7]).stance, atol=1e-12)


@pytest.mark.parametrize("name", shipped(GAITS))
def test_a_single_gait_s_path_is_its_own_in_every_step(name):
    own, gait = Beginning(name), load_gaits(name)
    before = own.begin(own.landed(0), np.array([0.35, 0.4, 0.1]), 0.5)
    for found in (own.first(), before):
        for end, angle in ((0, gait.phase_angle_start), (1, gait.phase_angle_end)):
            np.testing.assert_allclose(desired(found, end)[0], gait.coeffs[:, -end], atol=1e-13)
            assert phase_angle(found, end) == pytest.approx(angle, abs=1e-13)
        np.testing.assert_array_equal(found["path"][-4:], 0)
        assert own.kept(found, "wanted") == 0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", SLOPED)
def test_a_step_ends_at_its_stone_s_height_with_its_pitch(name, seed):
    """From the depth to the height that a preview may have; for robots with other legs."""
    rng = np.random.default_rng(seed)
    longer = 1 + 0.05 * rng.standard_normal((6, 2))
    own = Beginning(name, robot=replace(ROBOT, joints=longer[:4] * ROBOT.joints, feet=longer[4:] * ROBOT.feet))
    for height in np.linspace(-HIGHEST_STONE, HIGHEST_STONE, 41):
        x, near = own.landed(rng.integers(999)), rng.uniform(0.2, 0.45)
        level, found = (own.begin(x, np.array([near, near + 0.05, h - HIGHER])) for h in (0, height))
        (foot, pitch), (level_foot, level_pitch) = landing(found, own.feet), landing(level, own.feet)
        np.testing.assert_allclose(foot, level_foot + (0, height), atol=1e-12)
        assert pitch == pytest.approx(level_pitch, abs=1e-12)
        change = desired(found, 1.0)[0] - desired(level, 1.0)[0]
        bends, stays = (change[2:], change[:2]) if height > 0 else (change[:2], change[2:])
        if abs(height) > 1e-3:
            assert bends[1] > 0, "the knee of the leg that is shorter"
        np.testing.assert_allclose(stays, 0, atol=1e-12)


@settings(deadline=None)
@given(seed=SEEDS, height=st.floats(-0.04, 0.04))
def test_a_foot_that_finds_no_ground_goes_straight_down(slopes, seed, height):
    found = slopes.begin(slopes.landed(seed), np.array([0.35, 0.4, height]))
    (foot, pitch), (end, slope) = landing(found, slopes.feet), desired(found, 1.0)
    below, lower_pitch = pose(end + LATE * (slope + found["path"][-4:]), phase_angle(found, 1 + LATE), slopes.feet)
    np.testing.assert_allclose(below, foot - (0, DEPTH), atol=1e-9)
    assert lower_pitch == pytest.approx(pitch, abs=1e-9)


def bits(values):
    """Of numbers; NaN are alike."""
    return np.where(np.isnan(values.full()), np.nan, values.full()).tobytes()


@pytest.mark.parametrize("name", [*shipped(LIBRARIES), shipped(GAITS)[0]])
def test_in_c_it_is_the_same_to_the_bit(name, tmp_path):
    own = Beginning(name)
    generator = ca.CodeGenerator("steps.c")
    for function in own.functions:
        assert function.n_instructions() < MOST_INSTRUCTIONS
        generator.add(function)
    source, library = generator.generate(f"{tmp_path}/"), tmp_path / "steps.so"
    options = "-shared", "-fPIC", "-O1", "-ffp-contract=off", "-w"
    subprocess.run(["gcc", *options, source, "-o", str(library), "-lm"], check=True)
    first, begin = (ca.external(name, str(library)) for name in ("first", "begin"))
    calls = [(own.functions[0], first, (own.row,))]
    calls += [(own.functions[1], begin, inputs) for inputs in own.touchdowns(200)]
    for machine, compiled, inputs in calls:
        for one, other in zip(machine(*inputs), compiled(*inputs), strict=True):
            assert bits(one) == bits(other)


@pytest.mark.parametrize("since", [-0.3, -0.01, 0.0, 0.02, 0.3, 0.5, 0.9, 1.0, 1.02, 1.4])
def test_desired_outputs_are_smooth_within_a_step_and_beyond_its_ends(slopes, since):
    """Along a motion each derivative is the slope of the one before it."""
    (q, dq), outputs = np.split(slopes.landed(0), 2), path_outputs.VirtualConstraints(slopes.singles[0])
    found = slopes.begin(slopes.landed(0), np.array([0.42, 0.47, 0.0]))
    outputs.row, outputs.scale = found["path"], found["phase_scale"]
    rate = outputs.evaluate(q, dq).phase_rate
    q = q + since / rate * dq
    behind, here, ahead = (outputs.evaluate(q + step / rate * dq, dq) for step in (-H, 0, H))
    per_time = rate / (2 * H)
    assert here.dy == pytest.approx((ahead.y - behind.y) * per_time, abs=1e-3)
    assert here.bias == pytest.approx((ahead.dy - behind.dy) * per_time, abs=1e-2)


@pytest.mark.parametrize("name", ["ours", "best"])
def test_rounding_of_the_state_changes_the_first_torque_of_a_step_by_rounding(slopes, name):
    """The first tick of an episode begins a step."""
    parameters = load_parameters(name, gait="slopes", qp_solver="daqp")
    controller = Controller(parameters, slopes.gaits, ZeroPolicy(parameters.problem))

    def first_torque(q, dq):
        controller.reset(0)
        stone = StonePreview(1, 0.38, 0.43)
        return controller.step(RobotState(0, q, dq, np.zeros((2, 2)), np.zeros(2, dtype=bool), 0, stone)).torque

    for seed in range(10):
        q, dq = np.split(slopes.landed(seed), 2)
        signs = np.random.default_rng(seed).choice([-1, 0, 1], (4, 7))
        torques = [first_torque(q * (1 + ROUNDING * sign), dq) for sign in signs]
        np.testing.assert_allclose(torques, torques[:1] * 4, rtol=0, atol=1e-6)
