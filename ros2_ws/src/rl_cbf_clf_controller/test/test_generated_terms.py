"""The generated code against pinocchio and numpy, which derive the same terms in other ways."""

import ctypes

import numpy as np
import pinocchio as pin
import pytest
from rabbit_description import URDF_PATH
from rabbit_description.gait import load_gait, load_gaits
from rabbit_description.state import Array, StonePreview
from rl_cbf_clf_controller import generated_model, generated_outputs
from rl_cbf_clf_controller.foot_velocity import FootVelocity
from rl_cbf_clf_controller.generated.build import build
from rl_cbf_clf_controller.generated_model import (
    GeneratedFootVelocity,
    GeneratedModel,
    GeneratedMotionTerms,
    leg_lengths,
    make_model,
)
from rl_cbf_clf_controller.generated_outputs import GeneratedOutputs
from rl_cbf_clf_controller.link_parameters import MotionTerms, read_links
from rl_cbf_clf_controller.nominal_model import INPUT_MAP, NominalModel
from rl_cbf_clf_controller.step_outputs import LibrarySteps, StepOutputs, Touchdown
from rl_cbf_clf_controller.step_paths import step_path
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints


def random_states(count: int) -> list[tuple[Array, Array]]:
    """Walking-like random states `(q_s, dq_s)`."""
    rng = np.random.default_rng(7)
    center = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
    return [(center + rng.uniform(-0.5, 0.5, 7), rng.uniform(-5, 5, 7)) for _ in range(count)]


STATES = random_states(1000)
TOLERANCE = 1e-10  # of the largest number in an array
OTHER_ROBOT = URDF_PATH.read_text(encoding="utf-8").replace("left_knee", "left_elbow")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The library, built from the present sources."""
    return ctypes.CDLL(str(build(tmp_path_factory.mktemp("generated"))))


def odd_robot(seed: int) -> NominalModel:
    """A robot with bent links of random masses, no two of them alike, weak motors and damped joints."""
    rng = np.random.default_rng(seed)
    robot = NominalModel(motor_gain=rng.uniform(0.5, 1), joint_damping=rng.uniform(0, 2))
    model = robot.model
    for joint in range(3, 8):
        model.inertias[joint].mass *= rng.uniform(0.5, 3)
        model.inertias[joint].lever = model.inertias[joint].lever + rng.uniform(-0.05, 0.05, 3)
        model.inertias[joint].inertia = model.inertias[joint].inertia * rng.uniform(0.5, 3)
    for joint in range(4, 8):
        model.jointPlacements[joint].translation = model.jointPlacements[joint].translation + rng.normal(0, 0.03, 3)
    for foot in ("left_foot", "right_foot"):
        model.frames[model.getFrameId(foot)].placement.translation = np.array([rng.normal(0, 0.03), 0, -0.4])
    return robot


def of(model, q, dq):
    """All that a model says at a state, by name."""
    feet = model.update(q, dq)
    dynamics = model.pinned()
    affine = {"acceleration": dynamics.acceleration, "force": dynamics.force}
    return vars(feet) | {f"{name}.{part}": getattr(each, part) for name, each in affine.items() for part in "ab"}


def assert_equal(found, expected):
    """The same names and, to `TOLERANCE`, the same numbers."""
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=0, abs=TOLERANCE * max(1, np.abs(value).max())), name


@pytest.mark.parametrize("robot", [NominalModel(), *(odd_robot(seed) for seed in range(4))])
def test_dynamics_are_pinocchios(library, robot):
    generated = GeneratedModel(library, robot.model, robot.motor_gain, robot.joint_damping)
    for q, dq in STATES:
        assert_equal(of(generated, q, dq), of(robot, q, dq))


def test_a_believed_robot_is_pinocchios(library):
    reference = NominalModel()
    generated = GeneratedModel(library, reference.model)
    theta = read_links(reference.model) * np.random.default_rng(1).uniform(0.5, 2, 12)
    for model in (reference, generated):
        model.believe(theta, 0.8, 1.5)
    for q, dq in STATES[:50]:
        assert_equal(of(generated, q, dq), of(reference, q, dq))


def test_results_are_not_overwritten_by_the_next_call(library):
    model = GeneratedModel(library, NominalModel().model)
    (q, dq), (other, rates) = STATES[:2]
    feet, dynamics = model.update(q, dq), model.pinned()
    kept = feet.swing.copy(), dynamics.force.b.copy()
    model.update(other, rates)
    assert (feet.swing == kept[0]).all()
    assert (dynamics.force.b == kept[1]).all()


@pytest.mark.parametrize("robot", [NominalModel(), *(odd_robot(seed) for seed in range(2))])
def test_terms_of_the_identification_are_pinocchios(library, robot):
    rng = np.random.default_rng(5)
    terms = (GeneratedMotionTerms(leg_lengths(robot.model)), MotionTerms(robot.model))
    velocities = (GeneratedFootVelocity(leg_lengths(robot.model)), FootVelocity(robot.model))
    for q, dq in STATES:
        ddq, theta = rng.uniform(-50, 50, 7), read_links(robot.model) * rng.uniform(0.5, 2, 12)
        found, expected = (dict(zip("YMJ", each(q, dq, ddq, theta), strict=True)) for each in terms)
        assert_equal(found, expected)
        found, expected = (dict(zip("vs", each(q, dq), strict=True)) for each in velocities)
        assert_equal(found, expected)


def test_the_regressor_says_the_same_as_the_pinned_dynamics(library):
    """Y theta = B u + J' F at the acceleration and the force that the pinned model gives for u."""
    robot = GeneratedModel(library, NominalModel().model)
    regressor, u = GeneratedMotionTerms(leg_lengths(robot.model)), np.array([10.0, -20.0, 5.0, 30.0])
    theta = read_links(robot.model)
    for q, dq in STATES[:50]:
        robot.update(q, dq)
        dynamics = robot.pinned()
        Y, _, jacobians = regressor(q, dq, dynamics.acceleration(u), theta)
        assert Y @ theta == pytest.approx(INPUT_MAP @ u + jacobians[0].T @ dynamics.force(u), abs=1e-9)


def with_phase(constraints, q, phase):
    """The state with its pitch such that the phase is `phase`."""
    q = q.copy()
    here = constraints.evaluate(q, np.zeros(7)).phase
    per_pitch = constraints.evaluate(q + np.eye(7)[2], np.zeros(7)).phase - here
    q[2] += (phase - here) / per_pitch
    return q


def step_into(begun_at: float) -> StepOutputs:
    """Of a step that begins off its path, at a phase."""
    path = step_path(load_gaits("paper_stones"), 0.38, 0.44)
    q, dq = STATES[3]
    state = with_phase(VirtualConstraints(path), q, begun_at), dq
    return StepOutputs(path, *state, faded=0.7, descent=np.array([0.5, -1.0, 1.5, -2.0]))


@pytest.mark.parametrize("make", [lambda: VirtualConstraints(load_gait("authors_035")), lambda: step_into(0.02),
                                  lambda: step_into(0.45), lambda: step_into(-0.1)])  # fmt: skip
def test_outputs_are_numpys_inside_the_phase_and_beyond_its_ends(library, make):
    constraints = make()
    generated = GeneratedOutputs(library, constraints)
    phases = np.random.default_rng(2).uniform(-0.4, 1.4, len(STATES))
    for (q, dq), phase in zip(STATES, phases, strict=True):
        q = with_phase(constraints, q, phase)
        found, expected = generated.evaluate(q, dq), constraints.evaluate(q, dq)
        assert_equal({name: getattr(found, name) for name in vars(expected)}, vars(expected))


@pytest.fixture
def built(library, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if `make build` had put the library in its place."""
    monkeypatch.setattr(generated_model, "load_library", lambda: library)
    monkeypatch.setattr(generated_outputs, "load_library", lambda: library)


@pytest.fixture
def not_built(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if there had been no compiler."""
    monkeypatch.setattr(generated_model, "load_library", lambda: None)
    monkeypatch.setattr(generated_outputs, "load_library", lambda: None)


@pytest.mark.usefixtures("built")
def test_rabbits_model_and_outputs_are_generated_code():
    assert make_model().computed_by == "generated code"
    steps = LibrarySteps(load_gaits("paper_stones"), 0.5, NominalModel())
    assert isinstance(steps.first(), GeneratedOutputs)
    touchdown = Touchdown(*STATES[0], 0.4, stone=StonePreview(1, 0.38, 0.42))
    assert isinstance(steps.begin(touchdown), GeneratedOutputs)


@pytest.mark.usefixtures("not_built")
def test_without_the_library_it_is_pinocchio():
    assert make_model().computed_by == "pinocchio"
    assert isinstance(LibrarySteps(load_gaits("paper_stones"), 0.5, NominalModel()).first(), VirtualConstraints)


@pytest.mark.usefixtures("built")
def test_another_robots_model_is_pinocchio():
    assert make_model(OTHER_ROBOT).computed_by == "pinocchio"


def test_generated_code_refuses_another_robot(library):
    with pytest.raises(ValueError, match=r"left_elbow.*expected those of RABBIT"):
        GeneratedModel(library, pin.buildModelFromXML(OTHER_ROBOT))


def test_what_is_built_is_not_built_again(tmp_path):
    (tmp_path / "model_terms-old.so").touch()
    first = build(tmp_path)
    assert list(tmp_path.iterdir()) == [first]
    before = first.stat()
    assert build(tmp_path) == first
    assert first.stat() == before
