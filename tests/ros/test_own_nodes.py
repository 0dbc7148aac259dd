"""A controller and a simulator of one's own work with all that shows or checks a walk; the page and RViz show it."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from page_client import PageClient, free_port
from rabbit_command import RABBIT, rabbit
from rabbit_common.exit_codes import ExitCode
from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import ACTUATED
from rabbit_recording.contents import contents
from recorded_walk import read_episodes
from rl_cbf_clf_controller.ros.robot_controller import yaw_of
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from .conftest import make_package

EXAMPLES = Path(__file__).parents[2] / "examples"
WALK = ("--terrain", "flat", "--stones", 3, "--ready-timeout", 180)


@contextmanager
def example(name: str, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """One of the examples, as a user starts it."""
    process = subprocess.Popen([sys.executable, EXAMPLES / f"{name}.py", *words])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def said_by(*words: object) -> str:
    """What a command prints that ends well."""
    done = rabbit(*words)
    assert done.returncode == 0, done.stderr
    return done.stdout


def assert_shown_and_checked(recording: Path) -> None:
    """Information, check, plot, film and page tell of its ticks, which a walk of a controller of ours has too."""
    (episode,), page = contents(recording).episodes, recording.with_suffix(".html")
    assert episode.recorded > 0
    assert (episode.lost, episode.first) == (0, 0)
    assert f"{episode.recorded} ticks, 0 lost, 0 replayed" in said_by("bag", "check", recording)
    plotted = said_by("bag", "plot", recording).split()
    assert {Path(line).stem for line in plotted} >= {"walk", "swing_foot", "rows"}
    said_by("video", recording, "--no-gif")
    assert recording.with_suffix(".mp4").stat().st_size > 10_000
    said_by("bag", "show", recording, "--export", page)
    assert page.is_file()


def watched(folder: Path, *words: object, **environment: str) -> PageClient:
    """A page that was open during a walk to this folder, to the last word that was said."""
    port = free_port()
    command = [*RABBIT, "walk", *map(str, words), "--out", folder, "--view", "--view-port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env={**os.environ, **environment})
    with PageClient(f"http://127.0.0.1:{port}", timeout=300, watches=False) as client:
        while client.hear(0.5) or process.poll() is None:
            pass
    assert process.returncode == ExitCode.WALKED
    return client


def test_a_controller_of_another_package_walks(tmp_path: Path) -> None:
    package = make_package(tmp_path / "install", "stranger", {"pd": (EXAMPLES / "own_controller_node.py").read_text()})
    folder = tmp_path / "walk"
    client = watched(folder, *WALK, "--controller", "stranger/pd", "--pace", 2, **package)
    episode = read_episodes(folder / "recording")[1]
    assert (episode.outcome, episode.controller, len(episode.landings)) == ("walked", "pd", 3)
    assert {record.output.stance for record in episode.records} == {0, 1}
    for (row,) in client.rows:
        assert math.isnan(row["V"])
    assert client.rows
    assert client.words["about"]["walkers"][0]["name"] == "pd"
    assert {"walk.mp4", "walk.gif", "records.npz", "summary.json"} <= {path.name for path in folder.iterdir()}


def test_a_controller_and_a_simulator_of_ones_own_are_shown_and_recorded(tmp_path: Path, world: Any) -> None:
    frames: list[TFMessage] = []
    stones: list[MarkerArray] = []
    world.node.create_subscription(TFMessage, "tf", frames.append, 10)
    world.node.create_subscription(MarkerArray, "markers", stones.append, 10)
    states, episodes, port = world.hear("state"), world.hear("episode"), free_port()
    world.start("viewer", port=port)
    world.start("recorder", path=str(tmp_path / "recording"))
    world.wait(lambda: len({status.name for m in world.hear("diagnostics") for status in m.status}) == 2)
    with (
        PageClient(f"http://127.0.0.1:{port}", watches=False) as client,
        example("own_simulator_node", *world.space),
        example("own_controller_node", *world.space),
    ):
        world.wait(lambda: bool(episodes) and episodes[-1].outcome == "walked")
        world.wait(lambda: bool(frames and stones))
        client.wait(lambda client: len(client.rows) > 0)
    world.processes.send("recorder", signal.SIGINT)
    assert world.processes.wait("recorder", 60) == 0
    stamps = {(state.header.stamp.sec, state.header.stamp.nanosec): state for state in states}
    for frame in frames:
        moved = {one.child_frame_id: one for one in frame.transforms}
        at = frame.transforms[0].header.stamp
        turn = moved["left_thigh"].transform.rotation
        assert 2 * math.atan2(turn.y, turn.w) == pytest.approx(stamps[at.sec, at.nanosec].q[3])
    assert_shown_and_checked(tmp_path / "recording")


@pytest.mark.parametrize(
    ("controller", "code", "word"),
    [
        ("none", ExitCode.NODE_DIED, "simulator: waiting for a controller"),
        ("nowhere/pd", ExitCode.NODE_DIED, "package nowhere: not in the sourced workspaces"),
        ("rabbit_sim/pd", ExitCode.NODE_DIED, "rabbit_sim has no executable pd; it has: robot, simulator"),
    ],
)
def test_a_controller_that_is_not_there_is_one_line(tmp_path: Path, controller: str, code: int, word: str) -> None:
    done = rabbit("walk", "--controller", controller, "--out", tmp_path / "walk", "--ready-timeout", "20")
    assert done.returncode == code
    assert word in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_turn_too_large_for_its_squares_is_not_known() -> None:
    assert math.isnan(yaw_of(Quaternion(y=1e200, z=1e200, w=1e200, x=-1e200)))
    assert yaw_of(Quaternion(z=math.sin(0.3), w=math.cos(0.3))) == pytest.approx(0.6)


SPINS = """
import rclpy, runpy, sys
spin = rclpy.spin

def published_late(node):
    rclpy.shutdown()  # as a signal does, whatever a callback is about to do
    publisher = next(iter(node.publishers))
    publisher.publish(publisher.msg_type())

rclpy.spin = published_late if "late" in sys.argv else lambda node: print("spins", flush=True) or spin(node)
runpy.run_path(sys.argv[1])
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, None])
@pytest.mark.parametrize("name", ["own_controller_node", "own_simulator_node"])
def test_a_signal_ends_an_example_without_a_traceback(name: str, number: signal.Signals | None) -> None:
    """As `timeout` and Ctrl-C do; None: one that comes as the node publishes."""
    words = [sys.executable, "-c", SPINS, str(EXAMPLES / f"{name}.py"), "spins" if number else "late"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout
    if number:
        assert process.stdout.readline() == "spins\n"
        time.sleep(0.7)  # rclpy's first wait begins meanwhile: a signal before it is an RCLError of rclpy
        process.send_signal(number)
    said = process.communicate(timeout=60)[1]
    assert (process.returncode, said) == (0, "")


def test_rows_are_the_recorded_ticks(tmp_path: Path) -> None:
    """Of a walk that is watched at the pace of real time."""
    short = ("--no-pictures", "--no-video", "--no-trainer", "--stones", 4, "--seed", 4)
    client = watched(tmp_path / "walk", *short)
    records = {record.state.tick: record for record in read_episodes(tmp_path / "walk" / "recording")[1].records}
    rows = {int(row["tick"]): row for (row,) in client.rows}
    assert len(rows) >= 10
    for tick, row in rows.items():
        record = records[tick]
        output, force = record.output, record.state.foot_force[record.output.stance]
        assert row["V"] == np.float32(output.V)
        np.testing.assert_array_equal([row["B1"], row["B2"]], output.barriers.astype(np.float32))
        np.testing.assert_array_equal([row["F_T"], row["F_N"]], force.astype(np.float32))
        applied = records[tick - 1].output.torque if tick else np.full(4, np.nan)  # over the tick that ended
        torque = [row[f"torque_{joint}"] for joint in ACTUATED]
        np.testing.assert_array_equal(torque, applied.astype(np.float32))
        np.testing.assert_array_equal(row["force_ratio"], np.float32(force_ratio(force)))
