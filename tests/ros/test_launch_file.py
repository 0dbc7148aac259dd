"""walk.launch.py: what it starts, says and leaves is what `rabbit walk` does. graph.launch.py: in a user's own file.

launch itself is not among the wheels.
"""

import os
import re
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml
from rabbit_bringup.commands.walk import DEFAULTS
from rabbit_command import rabbit
from rabbit_recording.reader import iterate_episodes
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from .conftest import make_package

ROOT = Path(__file__).parents[2]
FILE = ROOT / "ros2_ws" / "src" / "rabbit_bringup" / "launch" / "walk.launch.py"
LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
arguments = [word.split(":=", 1) for word in sys.argv[2:]]
service = LaunchService(argv=sys.argv[2:], noninteractive=True)
included = IncludeLaunchDescription(AnyLaunchDescriptionSource(sys.argv[1]), launch_arguments=arguments)
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""
OWN_CONTROLLER = """
import rclpy
from rabbit_common.ros.qos import TICK
from rabbit_msgs.msg import RobotState, TorqueCommand

def answer(state):
    torques.publish(TorqueCommand(episode=state.episode, tick=state.tick, torque=[0.0] * 4, sender="me"))

rclpy.init()
node = rclpy.create_node("own")
torques = node.create_publisher(TorqueCommand, "torque", TICK)
node.create_subscription(RobotState, "state", answer, TICK)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    pass
"""
MONITOR = """
import rclpy
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_msgs.msg import Episode
from sensor_msgs.msg import JointState

def take(side, episode):
    if episode.phase == Episode.ENDED and episode.tick > 0:
        ended[side] = f"{episode.outcome} by {episode.controller.split()[0]}"
    if len(ended) == 2:
        print(f"both ended: {ended['left']}, {ended['right']}, {len(encoders)}", flush=True)

rclpy.init()
node = rclpy.create_node("monitor")
ended, encoders = {}, []
node.create_subscription(JointState, "left/encoders", encoders.append, TICK)
for side in ("left", "right"):
    node.create_subscription(Episode, f"{side}/episode", lambda m, side=side: take(side, m), EVENT)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    pass
"""
SMALL = {"stones": "2", "trainer": "false", "pictures": "false", "video": "false", "ready_timeout": "180"}
PATIENCE = 180.0  # s

needs_launch = pytest.mark.skipif(
    not (find_spec("launch") and find_spec("launch_ros")), reason="launch and launch_ros are not installed"
)


@needs_launch
def test_a_users_launch_file_starts_two_graphs_replaces_a_controller_and_goes_on(tmp_path: Path) -> None:
    """The one of docs/operations.md."""
    text = (ROOT / "docs" / "operations.md").read_text(encoding="utf-8")
    (file := tmp_path / "two.launch.py").write_text(text.split("```python\n")[1].split("```")[0])
    programs = {"my_controller": OWN_CONTROLLER, "my_monitor": MONITOR}
    environment = {**os.environ, **make_package(tmp_path / "prefix", "my_package", programs)}
    command = [sys.executable, "-u", "-c", LAUNCH, str(file)]
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        said = []
        for line in running.stdout:
            said.append(line)
            if "both ended" in line:
                break
        time.sleep(1.0)
        assert running.poll() is None, "".join(said)
        running.send_signal(signal.SIGINT)
        said += running.stdout.readlines()
        assert running.wait(PATIENCE) == 0
    (heard,) = re.findall(r"both ended: (.*)", "".join(said))
    left, right, encoders = heard.split(", ")
    assert (left, int(encoders) > 100) == ("walked by /left/controller", True)
    assert right == "fall by me"
    (episode,) = iterate_episodes(tmp_path / "left" / "recording")
    assert (episode.outcome, episode.lost) == ("walked", 0)


@needs_launch
def test_arguments_show_the_defaults_that_hold() -> None:
    from launch.launch_description_sources import get_launch_description_from_python_launch_file as read

    shown = {}
    for argument in read(str(FILE.with_name("graph.launch.py"))).get_launch_arguments():
        shown[argument.name] = "".join(part.text for part in argument.default_value)
        assert argument.description not in ("", "no description given"), argument.name
    own = {**DEFAULTS.always, **DEFAULTS.bare}
    for model in (SimulationParameters, ControllerParameters):
        holds = model(**{name: value for name, value in own.items() if name in model.model_fields})
        assert model(**{name: shown[name] for name in model.model_fields}) == holds


def launch(*words: str) -> "subprocess.CompletedProcess[str]":
    """`ros2 launch rabbit_bringup walk.launch.py WORDS`."""
    command = [sys.executable, "-c", LAUNCH, str(FILE), *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)


@needs_launch
def test_both_launchers_start_the_same_nodes_and_say_the_same(tmp_path: Path) -> None:
    asked = {**SMALL, "namespace": "both", "seed": "3", "record": "1"}
    by_launch = launch(*(f"{n}:={v}" for n, v in asked.items()), f"out:={tmp_path / 'launch'}")
    assert by_launch.returncode == 0, by_launch.stdout + by_launch.stderr
    words = ("--no-trainer", "--no-pictures", "--no-video", "--stones=2", "--seed=3", "--namespace=both")
    by_rabbit = rabbit("walk", *words, "--ready-timeout=180", "--out", tmp_path / "rabbit")
    assert by_rabbit.returncode == 0, by_rabbit.stderr

    def parameters(name: str) -> Any:
        text = (tmp_path / name / "parameters.yaml").read_text()
        return yaml.safe_load(text.replace(str(tmp_path / name), "FOLDER"))

    assert parameters("launch") == parameters("rabbit")
    said = re.findall(r"^\[walk-\d+\] (?:\[\w+\] )?(.*)$", by_launch.stdout, re.MULTILINE)
    lines = [line for line in by_rabbit.stdout.splitlines() if line.startswith(("episode ", "walked"))]
    assert lines == [line for line in said if line.startswith(("episode ", "walked"))]
