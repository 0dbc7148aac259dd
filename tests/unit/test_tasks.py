"""A cart before a wall, half as heavy in its model: what follows from the task is compared with closed forms."""

import base64
import csv
import gzip
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Clf, System
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.estimates import Estimates
from own_cart import CART, LIMIT, POLE
from rabbit_command import invoke
from rabbit_description.task import ControlTask, Impact, TaskError
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.task_source import load_task
from rabbit_experiments.cache import Cache
from rabbit_experiments.task_rides import TaskRide, rides_of
from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import BagWriter
from rabbit_recording.checking import check_episodes
from rabbit_recording.contents import contents
from rabbit_recording.task_recording import recorded_ride, write_ride
from rabbit_viewer.page.ride import ended_of
from rl_cbf_clf_controller.policy import LearnedPolicy
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.task_episode import ride_of
from rl_trainer.task_training import measured_problem, train
from scipy.linalg import expm


def checked(task, bag):
    """How many ticks of the only episode were replayed, which did not come out, and by how much at most."""
    (episode,) = check_episodes(bag, task)
    return episode.replayed, episode.differing, episode.furthest


@pytest.fixture
def task(cart):
    return load_task(str(cart))


def test_the_plant_is_the_exact_solution_of_a_linear_system():
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    A, b = np.array([[0.0, 1.0], [-4.0, -0.4]]), np.array([0.0, 2.0])
    system = System(x, u, ca.DM(A) @ x + ca.DM(b) * u)
    task = ControlTask("spring", system, [Clf(x[0])], {}, {}, ((0, 0), (0, 0)), seconds=0.05)
    found = task.moved(np.array([1.0, -0.5]), np.zeros(0), np.array([0.7])).x
    held = expm(0.05 * np.block([[A, 0.7 * b[:, None]], [np.zeros((1, 3))]]))
    assert found == pytest.approx((held @ [1.0, -0.5, 1.0])[:2], abs=1e-13)


@pytest.mark.parametrize(("controller", "mass"), [("nominal", 1.0), ("oracle", 2.0)])
def test_where_the_barrier_alone_decides_the_input_is_its_closed_form(task, controller, mass):
    ride = ride_of(TaskController(task), controller, 1)
    near = [m for m in ride.moments if "wall" in m.decided.active and abs(m.u[0]) < LIMIT]
    assert len(near) > 50
    for m in near:  # B'' = -u / mass = -2 pole B' - pole^2 B, but for the slack of last resort, mu over its weight
        x, v = m.x
        assert m.u[0] == pytest.approx(mass * (POLE**2 * (1 - x) - 2 * POLE * v), abs=1e-4)


def test_the_oracle_keeps_the_barrier_and_the_nominal_controller_does_not(task):
    controller = TaskController(task)
    assert all(ride_of(controller, "oracle", seed).is_kept for seed in range(5))
    assert not any(ride_of(controller, "nominal", seed).is_kept for seed in range(5))


def test_no_input_exceeds_its_limit_also_with_noise(task):
    ride = ride_of(TaskController(task), "nominal", 1, sigma=30.0)
    assert max(abs(m.u[0]) for m in ride.moments) == LIMIT


def test_the_state_after_the_last_tick_counts(task, tmp_path):
    """From rest under 20 N a cart of 2 kg is at 5 t^2: before the wall as the last tick begins, beyond as it ends."""
    own = replace(task, controllers={"bang": lambda x, p: [100.0]}, start=((0.0, 0.0), (0.0, 0.0)), duration=0.45)
    ride = ride_of(TaskController(own), "bang", 1)
    assert ride.moments[-1].output.barriers[0] == pytest.approx(1 - 5 * 0.44**2)
    write_ride(ride, tmp_path / "bag", None)
    for seen in (ride, recorded_ride(own, tmp_path / "bag")):
        assert seen.outcome == "done"
        assert seen.margins == pytest.approx([1 - 5 * 0.45**2])
        assert not seen.is_kept
        assert "wall broken, at least -0.0125 at 0.45 s" in ended_of(seen)["reason"]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"commands": lambda rng: lambda t: {}}, "commands give nothing: expected target"),
        ({"commands": lambda rng: lambda t: {"goal": 1.0}}, "commands give goal: expected target"),
        ({"nominal": {"mas": 1.0}}, "nominal = mas: expected one of mass, target"),
        ({"true": {"target": 1.0}}, "true = target: expected one of mass"),
        ({"true": {"mass": np.nan}}, "mass = nan"),
        ({"start": ((0,), (0,))}, "start = "),
        ({"start": ((1, 0), (0, 0))}, "start = "),
        ({"start": ((np.nan, 0), (np.nan, 0))}, "start = "),
        ({"start": ((0, 0), (0, np.inf))}, "start = "),
        ({"start": ((0, 0),)}, "start = "),
        ({"commands": lambda rng: lambda t: {"target": "far"}}, "commands = {'target': 'far'}"),
        ({"seconds": 0.0}, "seconds = 0.0"),
        ({"limit": (1.0, 2.0)}, "limit = (1.0, 2.0)"),
        ({"coordinates": ("a", "b", "c")}, "coordinates = "),
        ({"coordinates": ("a", "a")}, "expected names that differ"),
        ({"impact": Impact(ca.SX(1), ca.SX(2, 1), held=ca.SX(2, 1))}, "held has 2 components; expected 1"),
        ({"inputs": ("a", "b")}, "inputs = ('a', 'b'): expected names of 1 components"),
    ],
)
def test_what_does_not_fit_is_named(task, change, text):
    with pytest.raises(TaskError) as error:
        replace(task, **change)
    assert text in str(error.value)


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("", "no task is given"),
        ("nosuch", "rabbit.systems nosuch"),
        ("nosuch.py", "nosuch.py: no such file"),
        (__file__, "0 objects"),
    ],
)
def test_a_source_without_a_task_is_named(source, text):
    with pytest.raises(TaskError, match=text):
        load_task(source)


def test_measured_units_hold_the_errors_closed_form(task):
    problem = measured_problem(task, 1)  # u = mu; of y'' and B'' the error is (1/2 - 1) mu, and no beta
    assert problem.alpha_scale == pytest.approx((0.75, 0.75))
    assert max(problem.beta_scale) == pytest.approx(1e-3)
    with pytest.raises(TaskError, match="cart: the nominal controller's rides end before anything is measured"):
        measured_problem(replace(task, duration=task.seconds), 1)


def test_training_finds_the_error_and_keeps_the_barrier(task, tmp_path):
    said = []
    policy, problem = train(task, 1, said.append)
    assert len(said) == 5
    controller = TaskController(task, problem)
    nominal, learned = (min(ride_of(controller, c, seed).margins[0] for seed in range(3)) for c in ("nominal", policy))
    assert learned > 0.2 * nominal
    path = tmp_path / "policy.safetensors"
    policy.file.write(path)
    again = TaskController(task)
    assert again.controlling(str(path)).version == policy.version
    with pytest.raises(TaskError, match="trained for cart; this task is other"):
        TaskController(replace(task, name="other")).controlling(str(path))
    ride = ride_of(again, again.controlling(str(path)), 5)
    write_ride(ride, tmp_path / "bag", policy)
    assert checked(task, tmp_path / "bag") == (300, [], 0.0)
    assert contents(tmp_path / "bag").episodes[0].policies == [policy.version]


def test_a_controller_of_the_tasks_own_is_the_one_that_acts(task):
    controller = TaskController(replace(task, controllers={"own": lambda x, p: [1.5]}))
    state = TaskSimulation(task).reset(1)
    controller.policy = "own"
    assert (controller.act(state).torque, controller.output().torque, controller.decided) == (1.5, 1.5, None)
    controller.policy = "nominal"
    assert controller.act(state).torque == controller.output().torque == controller.decided.u != 1.5


@pytest.mark.parametrize("controller", ["nominal", "oracle", "own"])
def test_a_recording_replays_to_the_bit_and_a_changed_one_is_found(task, tmp_path, controller):
    task = replace(task, controllers={"own": lambda x, p: [p[1] - x[0] - x[1]]})
    ride = ride_of(TaskController(task), controller, 3)
    write_ride(ride, tmp_path / "bag", None)
    (episode,) = contents(tmp_path / "bag").episodes
    assert (episode.recorded, episode.lost, episode.seed, episode.outcome) == (300, 0, 3, "done")
    assert checked(task, tmp_path / "bag") == (300, [], 0.0)
    moment = ride.moments[17]
    changed = replace(moment.output, torque=np.nextafter(moment.u, 100))
    ride.moments[17] = replace(moment, output=changed)
    write_ride(ride, tmp_path / "changed", None)
    count, wrong, furthest = checked(task, tmp_path / "changed")
    assert (count, wrong) == (300, [17])
    assert furthest > 0


def test_a_recorder_may_have_heard_the_topics_of_a_tick_in_any_order(task, tmp_path, monkeypatch):
    written, write = [], BagWriter.write
    monkeypatch.setattr(BagWriter, "write", lambda bag, *message: written.append((bag, *message)))
    monkeypatch.setattr(BagWriter, "close", lambda bag: None)
    write_ride(ride_of(TaskController(task), "oracle", 3), tmp_path / "bag", None)
    monkeypatch.undo()
    for i in np.random.default_rng(1).permutation(len(written)):
        bag, topic, _, data = written[i]
        write(bag, topic, int(i), data)
    bag.close()
    assert checked(task, tmp_path / "bag") == (300, [], 0.0)


def test_a_recording_of_another_system_is_refused(task, tmp_path):
    write_ride(ride_of(TaskController(task), "nominal", 3), tmp_path / "bag", None)
    other = replace(task, name="lift", coordinates=("height",))
    with pytest.raises(RecordingError, match="of another system, with x, u1; not of lift"):
        checked(other, tmp_path / "bag")


def typed(*words):
    """A command's exit code, and what it printed."""
    result = invoke(*words)
    return result.exit_code, result.output


def test_all_pictures_but_films_are_made_where_no_encoder_is(cart, tmp_path, monkeypatch):
    words = ("--controller", "nominal,oracle", "--rides", 1, "--pictures", "--out", tmp_path / "p")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    code, said = typed("evaluate", "--task", cart, *words)
    assert (code, "rabbit_viewer[film]" in said) == (2, True), said
    for name in ("nominal", "oracle"):
        assert {path.name for path in (tmp_path / "p" / name).iterdir()} == {"recording", "rows.png"}


def test_the_commands(cart, task, tmp_path):
    code, said = typed("evaluate", "--task", cart, "--rides", 3, "--out", tmp_path / "e")
    assert code == 0, said
    summary = json.loads((tmp_path / "e" / "summary.json").read_text())
    assert (summary["nominal"]["kept"], summary["oracle"]["kept"]) == (0, 3)
    rows = list(csv.DictReader((tmp_path / "e" / "runs.csv").open()))
    assert [row["kept"] for row in rows] == ["False"] * 3 + ["True"] * 3
    first = ride_of(TaskController(task), "nominal", int(rows[0]["seed"]))
    assert float(rows[0]["wall"]) == first.margins[0]
    assert (tmp_path / "e" / "margins.png").is_file()
    words = ("--controller", "oracle", "--rides", 1, "--pictures", "--out", tmp_path / "p")
    for _ in range(2):  # the second call replaces the pictures of the first
        code, said = typed("evaluate", "--task", cart, *words)
        assert code == 0, said
    pictures = tmp_path / "p" / "oracle"
    assert {path.name for path in pictures.iterdir()} >= {"recording", "rows.png", "ride.mp4"}
    bag = pictures / "recording"
    said = "episode 1: 300 ticks, 0 lost, 300 replayed, inputs identical\n"
    assert typed("bag", "check", bag, "--task", cart) == (0, said)
    code, said = typed("bag", "check", bag)
    assert (code, "with `--task`" in said) == (2, True)
    code, said = typed("bag", "plot", bag, "--task", cart, "--out", tmp_path / "plot")
    assert (code, (tmp_path / "plot" / "rows.png").read_bytes()) == (0, (pictures / "rows.png").read_bytes()), said
    code, said = typed("bag", "show", bag, "--task", cart, "--export", tmp_path / "ride.html")
    assert code == 0, said
    code, said = typed("bag", "explain", bag, "--task", cart, "--worst", "--picture", tmp_path / "tick.png")
    assert (code, said.startswith("cart, oracle, tick "), (tmp_path / "tick.png").is_file()) == (0, True, True), said
    code, said = typed("bag", "explain", bag, "--task", cart, "--tick", 300)
    assert (code, "expected one from 0 to 299" in said) == (2, True)
    found = re.search(r'id="walk-data">(.*?)</script>', (tmp_path / "ride.html").read_text())
    assert found
    walk = json.loads(found[1])
    about = next(word for word in walk["words"] if word["type"] == "about")
    assert about["title"].startswith(f"cart, oracle, seed {rows[3]['seed']}: done")
    panels = {panel["title"]: panel.get("limits", []) for panel in about["walkers"][0]["panels"]}
    assert (panels["barriers B"], panels["input u"]) == ([0], [-LIMIT, LIMIT])
    assert len(gzip.decompress(base64.b64decode(walk["rows"]))) == 4 * 300 * len(about["walkers"][0]["columns"])
    cart.write_text(CART.replace("(4.0, 4.0)", "(4.0, 5.0)"))
    code, said = typed("bag", "check", bag, "--task", cart)
    assert (code, "differ" in said) == (1, True)


@pytest.mark.parametrize("processes", [1, 2])
@pytest.mark.parametrize(("wrong", "said"), [("float('nan')", "nan"), ("'far'", "'far'")])
def test_commands_that_go_wrong_on_the_way_are_named_in_one_line(cart, tmp_path, wrong, said, processes):
    cart.write_text(CART.replace('"target": 1.2', f'"target": 1.2 if t < 0.5 else {wrong}'))
    words = ("--rides", 1, "--jobs", processes, "--out", tmp_path / "e")
    code, text = typed("evaluate", "--task", cart, *words)
    assert (code, text.splitlines()[-1]) == (2, f"rabbit: commands = {{'target': {said}}}: expected finite numbers")


def test_a_task_without_a_barrier_has_no_picture_of_margins(cart, tmp_path):
    cart.write_text(CART.replace(', Barrier("wall", 1 - x, poles=(4.0, 4.0))', ""))
    code, said = typed("evaluate", "--task", cart, "--rides", 1, "--jobs", 1, "--out", tmp_path / "e")
    assert code == 0, said
    assert {row["kept"] for row in csv.DictReader((tmp_path / "e" / "runs.csv").open())} == {"True"}
    assert not (tmp_path / "e" / "margins.png").exists()


def test_a_benchmark_goes_from_the_nominal_plant_beyond_the_true_one(cart, tmp_path):
    """The nominal controller keeps the wall where its model is right; any number of processes says the same."""
    said = {}
    for processes in (1, 2):
        out = tmp_path / str(processes)
        code, text = typed("benchmark", "--task", cart, "--rides", 2, "--jobs", processes, "--out", out)
        assert code == 0, text
        said[processes] = (out / "benchmark.md").read_text()
    assert said[1] == said[2]
    rows = [[cell.split()[0] for cell in line.split("|")[2:4]] for line in said[1].splitlines() if "mass:" in line]
    assert rows[0] == ["2", "2"]
    assert rows[2:] == [["0", "2"]] * 3
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "1" / "cache").rglob("*.json.gz")}
    assert typed("benchmark", "--task", cart, "--rides", 2, "--jobs", 1, "--out", tmp_path / "1")[0] == 0
    assert kept == {path: path.stat().st_mtime_ns for path in (tmp_path / "1" / "cache").rglob("*.json.gz")}


@pytest.mark.parametrize("controller", ["nominal", "oracle"])
@pytest.mark.parametrize("name", ["segway.py", "obstacle_arm.py", "three_link_walker.yaml"])
def test_rides_side_by_side_are_the_rides_alone(name, controller):
    """To the bit: with one input and several, through impacts, and as one robot after the other ends."""
    rides = rides_of(str(Path(__file__).parents[2] / "examples" / name), [controller], 3, 1)
    assert len({ride.companions for ride in rides}) == 1
    together = dict(TaskRide.do_together(rides))
    assert [together[ride] for ride in rides] == [ride.do() for ride in rides]


def test_another_urdf_is_another_ride(tmp_path):
    for kind in (".yaml", ".urdf"):
        (tmp_path / f"walker{kind}").write_bytes((Path(__file__).parents[2] / f"examples/amber_3m{kind}").read_bytes())
    walker = tmp_path / "walker.yaml"
    walker.write_text(walker.read_text().replace("amber_3m.urdf", "walker.urdf"))
    (ride,) = rides_of(str(walker), ["nominal"], 1, 1)
    before = Cache(tmp_path).key(ride)
    with (tmp_path / "walker.urdf").open("a") as urdf:
        urdf.write("<!-- another -->")
    after = Cache(tmp_path).key(ride)
    assert (before.asked, before.made_with != after.made_with) == (after.asked, True)


def test_an_output_error_that_the_objective_needs_is_not_taken_for_zero(task):
    class Unstructured(LearnedPolicy):
        version = "unstructured"

        def act(self, observation, LgV):
            return Estimates(np.zeros((2, 1)), np.zeros(2))

    needy = replace(task, objective=lambda terms: terms.output_error + Affine.identity(1))
    with pytest.raises(ValueError, match="expected a structured policy"):
        ride_of(TaskController(needy), Unstructured(), 1)
    assert ride_of(TaskController(task), Unstructured(), 1).outcome == "done"
