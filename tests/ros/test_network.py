"""Who hears a graph by default, and what is said of an environment or argument that cannot be used."""

import os
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import rclpy
from rabbit_command import rabbit
from rabbit_common.ros.namespace_check import hold_name
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


RECORDER = ("run", "rabbit_recording", "recorder")


def last_line(*words: str, **environment: str) -> tuple[int, str]:
    """Exit code and last line of a command."""
    done = rabbit(*words, **environment)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-r", "foo"), "remap rule: '-r foo'"),
        (("--params-file", "/nowhere.yaml"), "/nowhere.yaml"),
        (("-p", "path"), "'-p path'"),
        (("--bogus",), "unknown ROS arguments ['--bogus']"),
        (("--log-level", "loud"), "--log-level loud"),
    ],
)
def test_a_node_refuses_a_wrong_argument_in_one_line(words: tuple[str, ...], said: str) -> None:
    code, line = last_line(*RECORDER, "--ros-args", *words)
    assert (code, line.startswith("error: "), said in line) == (2, True, True), line
    assert "/src/" not in line  # where in ROS's sources


@pytest.mark.parametrize(
    "words", [RECORDER, ("view",), ("walk", "--out"), ("policy", "load", "rl-cbf-clf-qp")], ids=lambda words: words[0]
)
def test_a_domain_that_is_none_is_refused_by_all(words: tuple[str, ...], tmp_path: Path) -> None:
    if words[-1] == "--out":
        words = (*words, str(tmp_path / "walk"))
    code, line = last_line(*words, ROS_DOMAIN_ID="abc")
    assert code == 2
    assert line.endswith("ROS_DOMAIN_ID abc: expected a whole number from 0 to 232")
    assert not (tmp_path / "walk").exists()


@pytest.mark.parametrize("name", ["/here", "/long" * 50])
def test_a_name_is_held_once_until_it_is_closed(name: str) -> None:
    with closing(hold_name(name)), closing(hold_name(f"{name}/there")), pytest.raises(OSError, match="in use"):
        hold_name(name)
    hold_name(name).close()
