"""What sourcing the built workspace gives a shell that has nothing else: the command, the index, nodes that start."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
INSTALL = WORKSPACE / "install"
EXECUTABLES = {"simulator": "rabbit_sim", "controller": "rl_cbf_clf_controller", "trainer": "rl_trainer"}
EXECUTABLES["estimator"] = "rabbit_estimator"
NAMESPACE = "/test_workspace"
DISCOVERY = ("ROS_DOMAIN_ID",)
PATIENCE = 180  # s, on a busy machine


def shell(command: str) -> list[str]:
    """A bash that reads no start-up file, sources the workspace and becomes the command."""
    return ["bash", "--norc", "--noprofile", "-c", f'source "{INSTALL}/setup.bash" && exec {command}']


def empty_environment() -> dict[str, str]:
    """Nothing but this test's ROS domain."""
    return {name: os.environ[name] for name in DISCOVERY}


def output(command: str) -> str:
    """What a command prints in the otherwise empty environment."""
    run = subprocess.run(
        shell(command), env=empty_environment(), cwd="/", capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.mark.skipif(not INSTALL.is_dir(), reason="the workspace is not built")
class TestWorkspace:
    def test_the_command_is_on_the_path(self) -> None:
        assert "walk" in output("rabbit --help")

    def test_every_node_starts_and_ends_when_told(self, onlooker: Node, nodes: dict[str, subprocess.Popen]) -> None:
        deadline = time.monotonic() + PATIENCE
        seen: set[str] = set()
        while not set(nodes) <= seen and time.monotonic() < deadline:
            time.sleep(0.2)
            seen = {name for name, space in onlooker.get_node_names_and_namespaces() if space == NAMESPACE}
        assert set(nodes) <= seen
        for node in nodes.values():
            node.send_signal(signal.SIGINT)
        assert {name: node.wait(PATIENCE) for name, node in nodes.items()} == dict.fromkeys(nodes, 0)


@pytest.fixture
def onlooker() -> Iterator[Node]:
    """A node that sees the others."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("onlooker", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def nodes() -> Iterator[dict[str, subprocess.Popen]]:
    """All node executables, started by `rabbit run`, each in an empty environment."""
    commands = {
        name: f"rabbit run {package} {name} --ros-args -r __ns:={NAMESPACE}" for name, package in EXECUTABLES.items()
    }
    running = {
        name: subprocess.Popen(shell(command), env=empty_environment(), cwd="/") for name, command in commands.items()
    }
    yield running
    for node in running.values():
        node.kill()
        node.wait()
