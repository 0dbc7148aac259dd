"""A robot behind ros2_control's standard topics, played by a stand-in in its own process: it walks, and it stops."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_bringup.ros.ros2_control import Hardware, HardwareParameters, in_world
from rabbit_common.ros.conversions import foot_wrench, header
from rabbit_msgs.msg import Episode
from rabbit_recording.timing import real_time_figures
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

STAND_IN = Path(__file__).parents[1] / "shared" / "ros2_control_stand_in.py"
GAIT = "stones_0350_084"
STALE = 10.0  # s of the wall clock: on a busy machine a torque may take long, and the stand-in waits for it

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(world: Any) -> Iterator[Start]:
    """Starts stand-in, node and controller, and enables the robot; `commands` of the world are what it is sent."""
    processes: list[subprocess.Popen[str]] = []
    world.commands = []
    world.node.create_subscription(Float64MultiArray, "commands", world.commands.append, 10)

    def make(stones: int, mute: int = 0, **own: Any) -> "subprocess.Popen[str]":
        plant = {"stones": stones, "motor_lag": 0.004}
        asked = {"plant": plant, "gait": GAIT, "seed": 1, "pace": 1, "mute": mute, "waits": True, "seconds": 200}
        space = ("--ros-args", "-r", f"__ns:=/{world.namespace}")
        robot = subprocess.Popen(
            [sys.executable, STAND_IN, json.dumps(asked), *space], stdout=subprocess.PIPE, text=True
        )
        processes.append(robot)
        parameters = {"stones": stones, "gait": GAIT, "stale": STALE, "answer_timeout": 60.0, "held_ticks": 1000, **own}
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        world.processes.start("simulator", (*space, *words), "ros2_control", "rabbit_bringup")
        world.start("controller", controller="cbf-clf-qp", objective="pd_centred", gait=GAIT)
        said = world.hear("diagnostics")
        world.wait(lambda: any(s.name.endswith("/controller") and s.level == s.OK for m in said for s in m.status))
        assert world.ask(SetBool, "pause", data=False).success
        return robot

    yield make
    for process in processes:
        process.kill()
        process.wait()


def ended(world: Any) -> Episode:
    """How the episode did."""
    episodes = world.hear("episode")
    world.wait(lambda: bool(episodes) and episodes[-1].phase == Episode.ENDED)
    return episodes[-1]


def test_the_robot_walks_through_standard_topics_alone(world: Any, start: Start, tmp_path: Path) -> None:
    world.start("recorder", path=str(tmp_path / "recording"))
    said = world.hear("diagnostics")
    world.wait(lambda: any(status.name.endswith("/recorder") for m in said for status in m.status))
    robot = start(20)
    end = ended(world)
    assert (end.outcome, end.touchdowns) == ("walked", 20)
    seen = json.loads(robot.communicate(timeout=60)[0])
    assert (seen["outcome"], seen["stones"]) == ("walked", 20)
    assert seen["torque"] == [0.0] * 4  # once it is over
    world.processes.stop(("recorder",))
    figures = real_time_figures(tmp_path / "recording")
    assert figures is not None
    assert figures["damped"] == 0
    assert figures["response_ms"]["p50"] > 0


def test_it_stops_where_the_sensors_fall_silent(world: Any, start: Start) -> None:
    start(20, mute=30, stale=2.0)
    end = ended(world)
    assert end.outcome == "fault"
    assert end.reason.startswith("no sensors for 2.")
    assert_at_rest(world)


def test_it_stops_when_it_is_told_to(world: Any, start: Start) -> None:
    states = world.hear("state")
    start(20)
    world.wait(lambda: bool(states) and states[-1].tick > 20)
    assert world.ask(SetBool, "pause", data=True).success
    end = ended(world)
    assert (end.outcome, end.reason) == ("reset", "stopped by the service pause")
    assert_at_rest(world)


def test_it_stops_at_a_joints_limit(world: Any, start: Start) -> None:
    start(20, joint_high=0.8)  # a knee goes farther in each step
    end = ended(world)
    assert end.outcome == "fault"
    assert "knee" in end.reason
    assert_at_rest(world)


def assert_at_rest(world: Any) -> None:
    """There were torques, and from now on there are none."""
    assert any(any(message.data) for message in world.commands)
    world.wait(lambda: list(world.commands[-1].data) == [0.0] * 4)
    world.commands.clear()
    world.spin(0.5)
    assert all(list(message.data) == [0.0] * 4 for message in world.commands)


def test_a_message_of_other_joints_is_refused(world: Any) -> None:
    said = world.hear("diagnostics")
    space = ("--ros-args", "-r", f"__ns:=/{world.namespace}")
    world.processes.start("simulator", space, "ros2_control", "rabbit_bringup")
    publisher = world.node.create_publisher(JointState, "joint_states", qos_profile_sensor_data)
    world.wait(lambda: publisher.get_subscription_count() > 0)
    world.spin(0.5)
    wrong = JointState(name=["left_hip", "left_knee"], position=[0.0, 0.0], velocity=[0.0, 0.0])

    def is_refused() -> bool:
        publisher.publish(wrong)
        return any("refused joint_states: other joints" in v.key for m in said for s in m.status for v in s.values)

    world.wait(is_refused)


def test_a_torque_goes_as_far_and_as_fast_as_it_may() -> None:
    sent: list[Any] = []
    robot = Hardware(HardwareParameters(command_rate=1e3, command_limit=25.0), sent.append)
    for _ in range(4):
        robot.command(np.array([100.0, -100.0, 5.0, 0.0]))
    robot.stop()
    steps = [[10, -10, 5, 0], [20, -20, 5, 0], [25, -25, 5, 0], [25, -25, 5, 0], [0, 0, 0, 0]]
    np.testing.assert_allclose(sent, steps)


def test_a_force_in_the_sole_is_that_of_the_ground() -> None:
    rng = np.random.default_rng(0)
    for angle in rng.uniform(-2, 2, 10):
        force = rng.normal(size=2)
        said = foot_wrench(force, float(angle), 0, header(1)).wrench.force
        np.testing.assert_allclose(in_world(np.array([said.x, said.z]), angle), force)
