"""A graph that was told nothing of networks is bound to loopback, and others on this machine still hear it."""

import os
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
NAMESPACE = "/test_network"
COMMANDS = {
    "simulator": "rabbit run rabbit_sim simulator --ros-args -p start_paused:=true",
    "controller": "rabbit run rl_cbf_clf_controller controller --ros-args",
    "trainer": "rabbit run rl_trainer trainer --ros-args",
    "recorder": "rabbit run rabbit_recording recorder --ros-args",
    "viewer": "rabbit run rabbit_viewer viewer --ros-args -p port:=0",
}
PATIENCE = 180.0  # s, on a busy machine

pytestmark = pytest.mark.skipif(not Path("/proc/self/net/udp").exists(), reason="the kernel shows no sockets")


def bound_addresses(pid: int) -> set[str]:
    """IPv4 and IPv6 addresses that the UDP and TCP sockets of a process are bound to."""
    files = (path.readlink() for path in Path(f"/proc/{pid}/fd").iterdir() if path.is_symlink())
    own = {str(file)[8:-1] for file in files if str(file).startswith("socket:[")}
    found = set()
    for table in ("udp", "tcp", "udp6", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
            words = line.split()
            if words[9] in own:
                found.add(_address(words[1].split(":")[0]))
    return found


def _address(digits: str) -> str:
    """Of the table's words of 32 bits, each in the machine's order."""
    words = [int(digits[i : i + 8], 16) for i in range(0, len(digits), 8)]
    packed = struct.pack(f"={len(words)}I", *words)
    return socket.inet_ntop(socket.AF_INET if len(words) == 1 else socket.AF_INET6, packed)


@pytest.fixture
def onlooker() -> Iterator[Node]:
    """A node of this process, which sees the others."""
    context = Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("onlooker", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


def addresses(names: list[str], told: dict[str, str], onlooker: Node, folder: Path) -> set[str]:
    """What these nodes are bound to, started in an environment that says `told` and no more."""
    environment = {"ROS_DOMAIN_ID": os.environ["ROS_DOMAIN_ID"], "OMP_NUM_THREADS": "1", **told}
    source = f'source "{WORKSPACE}/install/setup.bash" && exec '
    shell = ["bash", "--norc", "--noprofile", "-c"]
    running = [
        subprocess.Popen([*shell, f"{source} {COMMANDS[name]} -r __ns:={NAMESPACE}"], env=environment, cwd=folder)
        for name in names
    ]
    try:
        end = time.monotonic() + PATIENCE
        while missing := set(names) - {n for n, at in onlooker.get_node_names_and_namespaces() if at == NAMESPACE}:
            assert time.monotonic() < end, missing
            assert all(process.poll() is None for process in running)
            time.sleep(0.1)
        return set().union(*(bound_addresses(process.pid) for process in running))
    finally:
        for process in running:
            process.send_signal(signal.SIGTERM)
        for process in running:
            assert process.wait(PATIENCE) == 0


def test_by_default_nothing_is_bound_beyond_loopback(onlooker: Node, tmp_path: Path) -> None:
    assert addresses(list(COMMANDS), {}, onlooker, tmp_path) == {"127.0.0.1"}


def test_a_wider_range_is_bound_to_all_addresses(onlooker: Node, tmp_path: Path) -> None:
    """Who wants other machines to hear gets it; and the test above could fail."""
    assert "0.0.0.0" in addresses(["simulator"], {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, onlooker, tmp_path)
