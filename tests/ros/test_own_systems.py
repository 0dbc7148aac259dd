"""Tasks of one's own through nodes: the same inputs as in process, swaps, refusals, and a filter before a robot."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rabbit_command import rabbit
from rabbit_common.ros.qos import TICK
from rabbit_description.task import ControlTask
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.task_source import load_task
from rabbit_msgs import msg
from rabbit_recording.task_recording import recorded_ride
from rclpy.qos import qos_profile_sensor_data
from rl_cbf_clf_controller.ros.robot_controller import RobotControllerNode
from rl_cbf_clf_controller.task_controller import NOMINAL, TaskController
from rl_cbf_clf_controller.weights import PolicyFile, read
from rl_trainer.rollout import Record, rollout
from rl_trainer.task_episode import ride_of
from rl_trainer.task_training import train
from std_msgs.msg import Float64MultiArray, Header
from std_srvs.srv import SetBool
from untrained_policy import policy_file, policy_metadata

from .conftest import in_process

EXAMPLES = Path(__file__).parents[2] / "examples"
SEED = 3


def path_of(name: str) -> str:
    """Of an example."""
    return str(EXAMPLES / (name if name.endswith(".yaml") else f"{name}.py"))


def hear(world: Any, kind: Any, name: str, qos: Any = TICK) -> list[Any]:
    """All messages of a topic from now on."""
    heard: list[Any] = []
    world.node.create_subscription(kind, name, heard.append, qos)
    return heard


def play(world: Any, name: str, episodes: int = 1, **of_controller: Any) -> list[Any]:
    """Start both nodes; the torques."""
    torques = hear(world, msg.TorqueCommand, "torque")
    hear(world, msg.TaskParameters, "parameters")
    states = hear(world, msg.RobotState, "state")
    world.start_task("controller", path_of(name), **of_controller)
    world.wait(lambda: bool(world.statuses("controller")))
    world.start_task("simulator", path_of(name), seed=SEED, episodes=episodes, readers=2, answer_timeout=60.0)
    world.wait(lambda: bool(states))
    return torques


def small_policy(task: ControlTask, number: int = 0) -> PolicyFile:
    """A policy of a task with small random weights."""
    rng = np.random.default_rng(number)
    metadata = policy_metadata(TaskController(task).problem, training_seed=number)
    return policy_file(metadata, lambda shape: rng.normal(0, 0.1, shape))


@pytest.mark.parametrize("name", ["segway", "obstacle_arm", "amber_3m.yaml"])
def test_nodes_answer_as_a_ride_in_process(world: Any, name: str) -> None:
    torques = play(world, name)
    end = world.ended()
    ride = ride_of(TaskController(load_task(path_of(name))), NOMINAL, SEED)
    assert (end.outcome, end.touchdowns) == (ride.outcome, ride.impacts)
    world.wait(lambda: len(torques) >= len(ride.moments))
    assert [list(torque.torque) for torque in torques] == [moment.u.tolist() for moment in ride.moments]
    assert {torque.policy_version for torque in torques} == {NOMINAL}


def test_a_policy_is_swapped_between_two_ticks(world: Any) -> None:
    task = load_task(path_of("segway"))
    other, fit = dataclasses.replace(task, name="another"), small_policy(task)
    swaps = world.hear("policy_swap")
    torques = play(world, "segway", episodes=100)  # a policy is taken at a tick
    for file in (small_policy(other), fit):
        world.say("policy", msg.PolicyWeights(version=file.version, source="test", data=file.encode()))
        world.wait(lambda file=file: file.version in [swap.version for swap in swaps])
    first, refused, swap = swaps
    world.wait(lambda: torques[-1].episode > swap.episode)
    assert (first.version, first.accepted, refused.accepted, swap.accepted) == (NOMINAL, True, False, True)
    assert "trained for another" in refused.reason
    assert (swap.episode, swap.tick) > (1, 0)
    controller, rest = TaskController(task), [torque for torque in torques if torque.episode == swap.episode]
    expected = []

    def go_on(record: Record) -> None:
        expected.append(record.output.torque.tolist())
        if len(expected) == swap.tick:
            controller.policy = controller.fitted(fit)

    rollout(TaskSimulation(task), controller, SEED + swap.episode - 1, go_on)
    got = [list(torque.torque) for torque in rest]
    assert len(got) > swap.tick
    assert got == expected
    assert [torque.policy_version == fit.version for torque in rest] == [torque.tick >= swap.tick for torque in rest]


ROVER = """
import casadi as ca
from cbf_clf_qp import Barrier, System
from rabbit_description.task import ControlTask

x, y, yaw, v, w = (ca.SX.sym(name) for name in ("x", "y", "yaw", "v", "w"))
ahead = ca.vertcat(x + 0.3 * ca.cos(yaw), y + 0.3 * ca.sin(yaw))
rover = System(ca.vertcat(x, y, yaw), ca.vertcat(v, w), ca.vertcat(v * ca.cos(yaw), v * ca.sin(yaw), w))
TASK = ControlTask(
    "rover", rover, [Barrier("wall", 2 - ahead[0], poles=(1.0,))], {}, {}, ((0, 0, 0), (0, 0, 0)),
    coordinates=("x", "y", "yaw"), inputs=("linear_x", "angular_z"),
)
"""


def test_a_rover_is_filtered_from_odometry_to_twist_and_stops_where_states_fall_silent(world: Any) -> None:
    path = world.folder / "rover.py"
    path.write_text(ROVER)
    twists = hear(world, Twist, "cmd_vel", 10)
    topics = {"input": "odom", "output": "cmd_vel", "filters": True, "stale": 1.0, "stale_wanted": 60.0}
    world.start_task("controller", str(path), "robot_controller", **topics)
    odometry = world.node.create_publisher(Odometry, "odom", qos_profile_sensor_data)
    wanted = world.node.create_publisher(Float64MultiArray, "wanted", qos_profile_sensor_data)
    world.wait(lambda: all(publisher.get_subscription_count() for publisher in (odometry, wanted)))
    world.spin(0.5)
    refused = world.ask(SetBool, "pause", data=False)
    assert (refused.success, refused.message) == (False, "no state yet")
    message = Odometry()
    message.pose.pose.position.x, message.pose.pose.orientation.w = 1.2, 1.0

    def drives(until: Any) -> None:
        def goes_on() -> bool:
            odometry.publish(message)
            return bool(until())

        world.wait(goes_on)

    drives(lambda: "accepted state" in world.figures("controller"))
    wanted.publish(Float64MultiArray(data=[2.0, 0.5]))
    assert world.ask(SetBool, "pause", data=False).success
    drives(lambda: twists[-1].linear.x > 0.4)
    slack = 1.5 / 1e6  # of last resort, for 1.5 m/s more; v <= 2 - 1.2 - 0.3
    assert (twists[-1].linear.x, twists[-1].angular.z) == pytest.approx((0.5 + slack, 0.5), abs=1e-8)
    world.wait(lambda: twists[-1].linear.x == twists[-1].angular.z == 0)
    last = "paused: no state for 1."
    world.wait(lambda: any(s.level == s.ERROR and last in s.message for s in world.statuses("controller")))


def test_nothing_is_measured_over_a_pause(tmp_path: Path) -> None:
    """In which the robot may have been carried anywhere."""
    (tmp_path / "rover.py").write_text(ROVER)
    measured = list[bool]()
    with in_process(RobotControllerNode, "-p", f"task:={tmp_path / 'rover.py'}", "-p", "stale:=10.0") as node:
        node._take(Header(), np.zeros(3), np.zeros(3))
        for place in (0.0, 0.5):
            for is_paused in (True, False):
                assert node._on_pause(SetBool.Request(data=is_paused), SetBool.Response()).success
            for _ in range(2):
                node._take(Header(), np.array([place, 0.0, 0.0]), np.zeros(3))
                measured.append(bool(np.isfinite(node._answerer.controller.output().measured).all()))
    assert measured == [False, True, False, True]


@pytest.mark.parametrize("name", ["segway.py", "three_link_walker.yaml"])
def test_the_graph_learns_what_is_learned_in_process(world: Any, name: str) -> None:
    """The policy after each episode is in the folder: but for who asked, it is the one of a training in process."""
    for file in EXAMPLES.glob(f"{Path(name).stem}.*"):
        text = file.read_text() + ("steps: 4\n" if file.suffix == ".yaml" else "")
        (world.folder / file.name).write_text(text)
    folder, task = world.folder / "learned", str(world.folder / name)
    world.start_task("trainer", task, seed=1, folder=str(folder))
    world.start_task("controller", task)
    simulated = {"episodes": 2, "readers": 2, "trainer": "follow", "answer_timeout": 60.0}
    world.start_task("simulator", task, **simulated)
    expected, _ = train(load_task(task), 1, episodes=2)
    path = folder / "policies" / "002.safetensors"
    world.wait(path.exists)
    learned = read(path)
    assert learned.metadata.model_copy(update={"command": ""}) == expected.file.metadata
    for array, values in expected.file.arrays.items():
        np.testing.assert_array_equal(learned.arrays[array], values)


def test_a_trainer_and_a_simulator_that_are_started_again_go_on(world: Any) -> None:
    task, folder = str(EXAMPLES / "segway.py"), world.folder / "learned"
    played = {"task": task, "episodes": 1000, "readers": 2, "trainer": "follow"}
    world.start_task("controller", task)
    world.start_task("simulator", **played)
    world.start_task("trainer", task, folder=str(folder))

    def learns_on() -> None:
        done = len(list((folder / "policies").glob("*.safetensors")))
        world.wait(lambda: (folder / "policies" / f"{done + 2:03d}.safetensors").exists())

    learns_on()
    for name, parameters in (("trainer", {"task": task, "folder": str(folder)}), ("simulator", played)):
        world.processes.stop([name])
        world.start_task(name, **parameters)
        learns_on()


def test_rabbit_walk_learns_on_a_task_and_its_recording_replays(tmp_path: Path) -> None:
    """With exploration, and with every policy that was swapped in."""
    task, out = path_of("segway"), tmp_path / "walk"
    done = rabbit("walk", "--task", task, "--episodes", 3, "--swap-at", "episode", "--no-video", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "3 of 3 episodes walked" in done.stdout
    assert len(list((out / "training" / "policies").glob("*.safetensors"))) == 3
    assert (out / "pictures" / "rows.png").is_file()
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["task"], summary["walked"], summary["exit_code"], summary["ticks"]) == ("segway", True, 0, 2400)
    rows = [(row["run"], row["outcome"], row["ticks"]) for row in summary["episodes"]]
    assert rows == [(k, "done", 800) for k in (1, 2, 3)]
    replayed = recorded_ride(load_task(task), out / "recording")  # the last episode
    assert [*summary["episodes"][-1]["least_barriers"].values()] == replayed.barriers.min(axis=0).tolist()
    checked = rabbit("bag", "check", out / "recording", "--task", task)
    said = [f"episode {k}: 800 ticks, 0 lost, 800 replayed, inputs identical" for k in (1, 2, 3)]
    assert (checked.returncode, checked.stdout.splitlines()) == (0, said)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--mass-scale", 2), "--mass-scale beside --task"),
        (("--policy", "nosuch"), "controller nosuch: expected one of nominal, oracle"),
        (("--view",), "--view beside --task"),
        (("--controller", "oracle"), "--controller oracle beside --task: expected --policy"),
    ],
)
def test_what_a_walk_of_a_task_cannot_be_is_named(tmp_path: Path, words: tuple[object, ...], text: str) -> None:
    done = rabbit("walk", "--task", path_of("segway"), *words, "--out", tmp_path / "walk")
    assert (done.returncode, done.stdout) == (2, "")
    assert text in done.stderr
    assert not (tmp_path / "walk").exists()


def test_noise_is_of_a_tick_whether_or_not_those_before_were_seen() -> None:
    """So a recording with a gap replays, and a controller that comes late explores as it would have."""
    controller = TaskController(load_task(path_of("segway")))
    controller.sigma = 1.0
    states: list[Any] = []
    last = rollout(TaskSimulation(controller.task), controller, 7, lambda record: states.append(record))
    assert not last.running
    controller.reset(7)
    for k in (0, 5, 6, 300):
        assert controller.step(states[k].state).omega.tolist() == states[k].output.omega.tolist()
