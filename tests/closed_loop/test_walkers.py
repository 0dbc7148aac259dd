"""Tasks with impacts: a ball that bounces, by its closed form; walkers, by pinocchio and the rigid plant."""

import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import yaml
from cbf_clf_qp import Clf, System
from cbf_clf_qp.functions import NumpyFunction
from planar_robot import PlanarPlant, dynamics_of
from rabbit_description import URDF_PATH
from rabbit_description.state import Leg
from rabbit_description.task import ControlTask, Impact, Limit, TaskError
from rabbit_description.task_source import load_task
from rabbit_description.task_state import p_of
from rabbit_gait_design.hybrid_zero_dynamics import RepeatedStep, Walker
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rl_cbf_clf_controller.planar_walker import read_walker
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.task_episode import ride_of
from rl_trainer.task_training import transitions_of
from walking_states import scaled

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
GRAVITY, BOUNCE = 9.81, 0.8
WALKERS = [EXAMPLES / "three_link_walker.yaml", EXAMPLES / "amber_3m.yaml", URDF_PATH.with_suffix(".yaml")]


@pytest.fixture(params=WALKERS, ids=lambda path: path.stem)
def walker(request):
    return read_walker(request.param)


def ball(**changes):
    """From 1 m; its rate is reversed, and BOUNCE times what it was."""
    z, v, u = (ca.SX.sym(name) for name in ("z", "v", "u"))
    impact = Impact(guard=z, after=ca.vertcat(0, -BOUNCE * v))
    system = System(ca.vertcat(z, v), u, ca.vertcat(v, u - GRAVITY))
    given = {"impact": impact, "seconds": 0.05, "duration": 10.0, "limit": 0.0, **changes}
    return ControlTask("ball", system, [Clf(z)], {}, {}, ((1.0, 0.0), (1.0, 0.0)), **given)


def test_a_ball_bounces_by_its_closed_form():
    task, falling = ball(), np.sqrt(2 / GRAVITY)
    x, impacts = np.array([1.0, 0.0]), 0
    for k in range(1, 29):
        moved = task.moved(x, np.zeros(0), np.zeros(1))
        x, impacts, since = moved.x, impacts + moved.impacts, 0.05 * k - falling
        if since >= 0:  # flights of twice BOUNCE^n times the first fall
            n, flight = 1, 2 * BOUNCE * falling
            while since > flight:
                since, n, flight = since - flight, n + 1, BOUNCE * flight
            rate = BOUNCE**n * GRAVITY * falling
            assert impacts == n
            assert x == pytest.approx([rate * since - GRAVITY * since**2 / 2, rate - GRAVITY * since], abs=1e-9)
    assert impacts == 2


def floating(walker, x):
    """q and q' (n,) of the whole robot, its stance foot at rest at the origin."""
    n = len(walker.coordinates)
    kinematics = PinocchioModel(walker.urdf, feet=walker.feet)
    q, dq = (np.concatenate([np.zeros(2), part]) for part in (x[1 : 1 + n], x[2 + n :]))
    feet = kinematics.update(q, dq)
    q[:2], dq[:2] = feet.hip, feet.hip_rate
    return q, dq


def test_the_motion_is_pinocchios(walker):
    task, rng, model = walker.task, np.random.default_rng(1), PinocchioModel(scaled(walker.urdf, 2.0), feet=walker.feet)
    p, n = task.parameters_at({"mass": 2.0}, {}), len(walker.coordinates)
    inputs = {name: getattr(task.system, name) for name in ("x", "p", "u")}
    motion = NumpyFunction.of("motion", inputs, {"x_dot": task.system.x_dot})
    for _ in range(5):
        x = np.array(task.start[0]) + rng.normal(0, 0.3, 2 * n + 2)
        x[[0, n + 1]], u = 0, rng.normal(0, 30, len(walker.motors))
        q, dq = floating(walker, x)
        model.update(q, dq)
        expected = model.pinned().acceleration(u)[2:]
        assert motion(x, p, u).x_dot == pytest.approx([0, *x[n + 2 :], 0, *expected], rel=1e-9, abs=1e-9)


def test_an_impact_is_pinocchios_and_loses_energy(walker):
    """And the legs change their places: twice, and all is as it was but for the rates."""
    task, rng, model = walker.task, np.random.default_rng(2), PinocchioModel(walker.urdf, feet=walker.feet)
    p, n = task.parameters_at({}, {}), len(walker.coordinates)
    strike = task._strike[1]
    for _ in range(5):
        x = np.array(task.start[0]) + rng.normal(0, 0.3, 2 * n + 2)
        x[[0, n + 1]], u = 0, rng.normal(size=len(walker.motors))
        q, dq = floating(walker, x)
        after, _ = model.impact(q, dq)
        struck = strike(x, p, u)
        assert struck.x[n + 2 :] == pytest.approx(after[walker.order][2:], rel=1e-9, abs=1e-9)
        assert struck.x[0] == pytest.approx(model.update(q, dq).swing[0])
        mass = model.mass_matrix()
        assert after @ mass @ after <= dq @ mass @ dq
        again = strike(struck.x, p, struck.u)
        assert again.x[1 : 1 + n] == pytest.approx(x[1 : 1 + n])
        assert again.u.tolist() == u.tolist()
        assert struck.u.tolist() == u[walker.swap].tolist()


def test_a_walk_is_the_rigid_plants_under_the_same_torques(walker):
    """Another integrator of another model, which knows left and right; two steps, for held torques are unstable."""
    task = replace(walker.task, impacts=2)
    ride, urdf = ride_of(TaskController(task), "oracle", 3), scaled(walker.urdf, 2.0)
    assert ride.outcome == "done"
    plant, n = PlanarPlant(dynamics_of(urdf, walker.feet), only_ahead=True), len(walker.coordinates)
    plant.reset(*floating(walker, ride.moments[0].x), Leg.LEFT)
    for moment in ride.moments:
        now = plant.observe()
        swapped = moment.state.touchdowns % 2
        order, motors = (walker.order, walker.swap) if swapped else (slice(None), slice(None))
        assert now.q[order][2:] == pytest.approx(moment.x[1 : 1 + n], abs=1e-6)
        assert now.dq[order][2:] == pytest.approx(moment.x[2 + n :], abs=1e-4)
        assert now.foot_position[swapped, 0] == pytest.approx(moment.x[0], abs=1e-6)
        plant.advance(moment.u[motors])


def test_the_gait_repeats(walker):
    """But for the digits that its file has."""
    hybrid = Walker(PinocchioModel(walker.urdf, feet=walker.feet), walker.angles, walker.order)
    step = RepeatedStep(hybrid, walker.path)
    assert step.exists
    assert step.rates[0] == pytest.approx(walker.file.phase_rate, abs=5e-3)
    q, dq = hybrid.after_impact(step.instants[-1].q, step.instants[-1].dq)
    assert q == pytest.approx(step.start[0], abs=1e-3)
    assert dq == pytest.approx(step.start[1], abs=1e-2)


def test_at_twice_the_mass_the_oracle_walks_and_the_nominal_controller_falls(walker):
    task = replace(walker.task, impacts=10)
    assert ride_of(TaskController(replace(task, true={})), "nominal", 5).outcome == "done"
    controller = TaskController(task)
    assert ride_of(controller, "oracle", 5).outcome == "done"
    ride = ride_of(controller, "nominal", 5)
    assert ride.outcome == "failed"
    assert ride.impacts <= 5


def test_no_transition_spans_an_impact_and_the_oracles_estimates_are_what_is_measured(walker):
    task = replace(walker.task, impacts=6)
    controller = TaskController(task)
    ride = ride_of(controller, "oracle", 3, sigma=1.0)
    transitions, jumps = transitions_of(ride, controller.problem), ride.moments[-1].state.touchdowns
    assert jumps == 5
    assert len(transitions) == len(ride.moments) - 1 - jumps
    errors, targets = (np.array([getattr(item, name)[0] for item in transitions]) for name in ("error", "target"))
    assert np.sqrt(np.mean(errors**2)) < 0.05 * np.sqrt(np.mean(targets**2))


def on_stones(tmp_path, stones="{nearest: 0.33, farthest: 0.37}"):
    """AMBER, once its file has stones."""
    (tmp_path / "amber_3m.urdf").write_bytes((EXAMPLES / "amber_3m.urdf").read_bytes())
    file, text = tmp_path / "amber_3m.yaml", (EXAMPLES / "amber_3m.yaml").read_text()
    file.write_text(f"{text}stones: {stones}\nsteps: 20\n")
    return load_task(str(file))


def test_a_walker_whose_file_has_stones_lands_on_them(tmp_path):
    """The stones differ, each is announced as the one before is reached, and the next foot comes down on it."""
    ride = ride_of(TaskController(on_stones(tmp_path)), "oracle", 3)
    assert ride.outcome == "done"
    near, far = (list(ride.task.system.named).index(name) for name in ("l_min", "l_max"))
    announced = {moment.state.touchdowns: p_of(moment.state)[[near, far]] for moment in ride.moments}
    places = np.unique([moment.x[0] for moment in ride.moments])
    landed = [edges[0] <= step <= edges[1] for step, edges in zip(np.diff(places), announced.values(), strict=False)]
    assert len(landed) == 19
    assert all(landed)
    assert np.ptp([edges[0] for edges in announced.values()]) > 0.02


def test_a_foot_beside_its_stone_finds_no_ground(tmp_path):
    task = on_stones(tmp_path, stones="{nearest: 0.1, farthest: 0.1, width: 0.01}")
    task = replace(task, quantities=task.quantities[:1])  # without the barriers, which would take the foot there
    ride = ride_of(TaskController(task), "oracle", 3)
    assert (ride.outcome, ride.impacts) == ("failed", 0)
    assert "swing foot" in ride.reason


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("{hip: right_hip,", "{knee: right_hip,", "expected foot and joints by the same names"),
        ("phase_range: [-0.2527,", "phase_range: [0.2527,", "expected a sum that grows"),
        ("limit: 100", "limits: -1", "limits"),
        ("urdf: three_link_walker.urdf", "urdf: no.urdf", "urdf no.urdf: No such file"),
        ("limit: 100", "limit: 100\nstones: {nearest: 0.4, farthest: 0.3}", "expected nearest <= farthest"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path, old, new, text):
    source = (EXAMPLES / "three_link_walker.yaml").read_text()
    assert old in source
    (tmp_path / "walker.yaml").write_text(source.replace(old, new))
    (tmp_path / "three_link_walker.urdf").write_text((EXAMPLES / "three_link_walker.urdf").read_text())
    with pytest.raises(TaskError) as error:
        load_task(str(tmp_path / "walker.yaml"))
    assert text in str(error.value)
    assert "\n" not in str(error.value)


def test_a_failure_names_its_limit():
    """Each limit in turn is set to where the three-link walker passes it first."""
    walker = read_walker(EXAMPLES / "three_link_walker.yaml")
    ride = ride_of(TaskController(replace(walker.task, impacts=10)), "nominal", 5)
    assert ride.outcome == "failed"
    name, value = ride.reason.split(":")[0].split(" = ")
    assert name in walker.task.limits
    limit = walker.task.limits[name]
    assert not limit.least <= float(value) <= limit.most
    high = replace(walker.task, failed={"hip": Limit(walker.task.limits["hip"].value, least=2.0, unit="m")})
    ended = ride_of(TaskController(high), "oracle", 5)
    assert (ended.outcome, len(ended.moments)) == ("failed", 1)
    assert re.fullmatch(r"hip = 0\.9\d+: expected at least 2 m", ended.reason)


def test_a_file_says_the_same_in_any_order_of_its_keys(tmp_path):
    """As `yaml.safe_dump` sorts them, and backwards."""
    (tmp_path / "amber_3m.urdf").write_bytes((EXAMPLES / "amber_3m.urdf").read_bytes())
    said, walkers = yaml.safe_load((EXAMPLES / "amber_3m.yaml").read_text()), []
    for keys in (list(said), sorted(said), sorted(said, reverse=True)):
        outputs = sorted(said["outputs"], reverse=keys[0] > keys[1])
        written = {key: said[key] for key in keys} | {"outputs": {name: said["outputs"][name] for name in outputs}}
        (tmp_path / "walker.yaml").write_text(yaml.safe_dump(written, sort_keys=False))
        walkers.append(read_walker(tmp_path / "walker.yaml"))
    first, *others = walkers
    for other in others:
        assert other.outputs == first.outputs
        assert np.array_equal(other.path.coeffs, first.path.coeffs)
        assert np.array_equal(other.angles.controlled, first.angles.controlled)
