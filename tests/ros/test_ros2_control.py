"""A robot behind ros2_control's standard topics, played by a stand-in in its own process: it walks, and it stops."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_common.ros.conversions import encoder_message, foot_wrench, header, imu_message
from rabbit_description.state import BodySensors
from rabbit_recording.timing import real_time_figures
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from .test_fuzz_graph import SENT, Stranger, faults

STAND_IN = Path(__file__).parents[1] / "shared" / "ros2_control_stand_in.py"
GAIT = "stones_0350_084"
PATIENT = 30.0  # s of the wall clock: on a busy machine a torque may take long, and the stand-in waits for it
DEAD = [("bridge",), ("controller",), ("bridge", "controller")]
SILENCE = 4.0  # s of the wall clock, in tests of those who die

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(world: Any) -> Iterator[Start]:
    """Starts stand-in, guard, bridge and controller, and enables the robot; `commands` of the world are what it is
    sent. `patience`: the time-outs of drives, guard and bridge; `meet`: what comes before the robot."""
    processes: list[subprocess.Popen[str]] = []
    world.commands = []
    world.node.create_subscription(Float64MultiArray, "commands", world.commands.append, 10)

    def make(
        stones: int,
        wrong: str = "",
        wrong_from: int = 0,
        patience: float = PATIENT,
        meet: Callable[[], object] = lambda: None,
        **own: Any,
    ) -> "subprocess.Popen[str]":
        plant = {"stones": stones, "motor_lag": 0.004}
        asked = {"plant": plant, "gait": GAIT, "seed": 1, "pace": 1, "waits": True, "seconds": 200}
        asked |= {"timeout": patience, "wrong": wrong, "wrong_from": wrong_from}
        world.processes.start("guard", (*world.space, "-p", f"timeout:={patience}"), "command_guard", "rabbit_bringup")
        parameters = {"stones": stones, "gait": GAIT, "stale": patience, "answer_timeout": 60.0, "held_ticks": 1000}
        words = [word for name, value in {**parameters, **own}.items() for word in ("-p", f"{name}:={value}")]
        world.processes.start("bridge", (*world.space, *words), "ros2_control", "rabbit_bringup")
        meet()
        command = [sys.executable, STAND_IN, json.dumps(asked), *world.space]
        robot = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        processes.append(robot)
        world.start("controller", controller="cbf-clf-qp", objective="pd_centred", gait=GAIT)
        for node in ("controller", "command_guard"):
            world.wait(lambda node=node: any(said.level == said.OK for said in world.statuses(node)))
        world.wait(lambda: world.ask(SetBool, "pause", data=False).success)
        return robot

    yield make
    for process in processes:
        process.kill()
        process.wait()


def test_the_robot_walks_through_standard_topics_alone(world: Any, start: Start, tmp_path: Path) -> None:
    world.start("recorder", path=str(tmp_path / "recording"))
    world.wait(lambda: bool(world.statuses("recorder")))
    robot = start(20)
    end = world.ended()
    assert (end.outcome, end.touchdowns) == ("walked", 20)
    seen = json.loads(robot.communicate(timeout=60)[0])
    assert (seen["outcome"], seen["stones"]) == ("walked", 20)
    assert seen["torque"] == [0.0] * 4  # once it is over
    world.processes.stop(("recorder",))
    figures = real_time_figures(tmp_path / "recording")
    assert figures is not None
    assert figures["damped"] == 0
    assert figures["response_ms"]["p50"] > 0


@pytest.mark.timeout(3600)
def test_strangers_before_the_robot_change_nothing(world: Any, start: Start) -> None:
    """Hostile messages and requests for bridge and guard, stamps of the far future among them; then it walks."""

    def meet() -> None:
        stranger = Stranger(world, ["ros2_control", "command_guard"])
        stranger.sends(SENT, seed=1)
        stranger.makes_good()
        assert not any(any(message.data) for message in world.commands)

    start(3, meet=meet)
    end = world.ended()
    assert (end.outcome, end.touchdowns) == ("walked", 3)
    assert faults(world) == []


def test_it_stops_when_it_is_told_to(world: Any, start: Start) -> None:
    states = world.hear("state")
    start(20)
    world.wait(lambda: bool(states) and states[-1].tick > 20)
    assert world.ask(SetBool, "pause", data=True).success
    end = world.ended()
    assert (end.outcome, end.reason) == ("reset", "stopped by the service pause")
    assert_at_rest(world)


def assert_at_rest(world: Any) -> None:
    """There were torques, and from now on there are none."""
    assert any(any(message.data) for message in world.commands)
    world.wait(lambda: list(world.commands[-1].data) == [0.0] * 4)
    world.commands.clear()
    world.spin(0.5)
    assert all(list(message.data) == [0.0] * 4 for message in world.commands)


@pytest.mark.parametrize(
    ("wrong", "own", "name"),
    [
        ("silent", {"stale": SILENCE}, "no sensors for 4."),
        ("back", {}, "clock went back: joint_states from 0."),
        ("frozen", {}, "frozen encoders: "),
        ("", {"joint_high": 0.8}, "joint limits: "),  # a knee goes farther in each step
    ],
)
def test_wrong_sensors_end_the_walk_under_their_own_name(
    world: Any, start: Start, wrong: str, own: dict[str, Any], name: str
) -> None:
    start(20, wrong, 40, **own)
    end = world.ended()
    assert end.outcome == "fault"
    assert end.reason.startswith(name)
    assert_at_rest(world)


@pytest.mark.parametrize("dead", DEAD, ids="+".join)
def test_no_torque_outlives_who_commanded_it(world: Any, start: Start, dead: tuple[str, ...]) -> None:
    start(20, patience=SILENCE)
    world.wait(lambda: len(torques(world)) > 40)
    world.processes.kill(dead)
    assert_at_rest(world)


def test_without_a_guard_too_the_drives_have_a_time_out(world: Any, start: Start) -> None:
    robot = start(20, patience=SILENCE)
    world.wait(lambda: len(torques(world)) > 40)
    world.processes.kill(("guard", "bridge", "controller"))
    assert any(world.commands[-1].data)
    assert json.loads(robot.communicate(timeout=60)[0])["torque"] == [0.0] * 4


def test_a_bridge_that_stood_still_sends_no_torque_of_old_sensors(world: Any, start: Start) -> None:
    start(20, patience=SILENCE)
    world.wait(lambda: len(torques(world)) > 40)
    world.processes.send("bridge", signal.SIGSTOP)
    world.spin(2 * SILENCE)
    world.commands.clear()
    world.processes.send("bridge", signal.SIGCONT)
    end = world.ended()
    assert (end.outcome, end.reason[:14]) == ("fault", "no sensors for")
    assert not torques(world)


def torques(world: Any) -> list[Any]:
    """The commands that are not zero."""
    return [message for message in world.commands if any(message.data)]


def hanging(at: Any) -> dict[str, Any]:
    """What the sensors of a robot say that hangs upright with one knee bent."""
    angles, upright = np.array([0.0, 1.5, 0.0, 0.0]), np.array([1.0, 0.0])
    sensors = BodySensors(angles, np.zeros(4), upright, 0.0, np.array([0.0, 9.81]))
    feet = {f"{foot}_foot/wrench": foot_wrench(np.zeros(2), 0.0, i, at) for i, foot in enumerate(("left", "right"))}
    return {"joint_states": encoder_message(sensors, at), "imu": imu_message(sensors, at, (1e-5,) * 3), **feet}


def test_a_robot_elsewhere_is_not_enabled_and_told_why(world: Any) -> None:
    world.processes.start("guard", world.space, "command_guard", "rabbit_bringup")
    world.processes.start("bridge", (*world.space, "-p", "stale:=30.0"), "ros2_control", "rabbit_bringup")
    assert world.ask(SetBool, "pause", data=False).message == "no sensors: joint_states has said nothing"
    kinds = {name: type(message) for name, message in hanging(header(0)).items()}
    publish = world.node.create_publisher
    publishers = {name: publish(kind, name, qos_profile_sensor_data) for name, kind in kinds.items()}
    ticks = count(1)
    world.wait(lambda: all(publisher.get_subscription_count() for publisher in publishers.values()))

    def refusal() -> str:
        for _ in range(3):
            at = header(next(ticks))
            for name, message in hanging(at).items():
                publishers[name].publish(message)
        return str(world.ask(SetBool, "pause", data=False).message)

    world.wait(lambda: "not near" in refusal())
    assert "left_knee 1.50 (expected 0.21)" in refusal()
    assert "torso 0.00 (expected 0.29)" in refusal()
