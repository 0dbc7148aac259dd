"""The live view of a walking graph, through a websocket and through RViz's topics, against the recording."""

import json
import socket
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_client import Channel, Listener
from rabbit_description.force_ratio import LOADED
from rabbit_description.state import Leg
from rabbit_recording.reader import read_episodes
from rabbit_viewer.live.plots import JOINTS
from rabbit_viewer.skeleton import feet, torso_points
from rl_trainer.rollout import Record
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")
WALK = ("--no-pictures", "--no-video", "--no-trainer", "--stones", "4", "--seed", "4", "--view")


def free_port() -> int:
    """One that was free a moment ago."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def decoder(channel: Channel) -> Callable[[bytes], Any]:
    """A decoder made from nothing but the advertised definition."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(channel.schema, channel.schema_name))
    return lambda data: store.deserialize_cdr(data, channel.schema_name)


class Seen:
    """What a client saw of a walk, and what was recorded of it; by tick."""

    def __init__(self, folder: Path) -> None:
        port = free_port()
        command = [*RABBIT, "walk", "--out", str(folder), *WALK, "--view-port", str(port)]
        self.plots: dict[int, dict[str, float]] = {}
        self.scenes: dict[int, Any] = {}
        self.frames: dict[int, Any] = {}
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        with Listener(f"ws://127.0.0.1:{port}", timeout=300) as listener:
            while process.poll() is None:
                if message := listener.hear(0.5):
                    tick = message.nanoseconds // 10_000_000
                    channel = next(each for each in listener.channels.values() if each.topic == message.topic)
                    self._keep(channel, tick, message.data)
        self.said, errors = process.communicate()
        assert process.returncode == 0, errors
        self.records: dict[int, Record] = {
            record.state.tick: record for record in read_episodes(folder / "recording")[1].records
        }

    def _keep(self, channel: Channel, tick: int, data: bytes) -> None:
        if channel.topic == "/plots":
            self.plots[tick] = json.loads(data)
        else:
            kept = {"/scene": self.scenes, "/tf": self.frames}[channel.topic]
            kept[tick] = decoder(channel)(data)


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """One walk at the pace of real time, for all tests here."""
    return Seen(tmp_path_factory.mktemp("viewed") / "walk")


def test_plots_are_the_recorded_ticks(seen: Seen) -> None:
    assert len(seen.plots) >= 10
    offset = {values["tick"] - tick for tick, values in seen.plots.items()}
    assert len(offset) == 1  # simulated time runs with the ticks
    for values in seen.plots.values():
        record = seen.records[int(values["tick"])]
        output, force = record.output, record.state.foot_force[record.output.stance]
        assert values["V"] == output.V
        assert [values["B1"], values["B2"]] == output.barriers.tolist()
        assert values["clf_slack"] == output.clf_slack
        applied = seen.records[values["tick"] - 1].output.torque if values["tick"] else ()  # over the tick that ended
        assert [values[joint] for joint in JOINTS if joint in values] == list(applied)
        assert [values["F_T"], values["F_N"]] == force.tolist()
        if force[1] > LOADED:
            assert values["force_ratio"] == abs(force[0]) / force[1]
        else:
            assert "force_ratio" not in values


def test_the_scene_is_the_recorded_tick(seen: Seen) -> None:
    assert len(seen.scenes) >= 10
    shift = next(int(values["tick"]) - tick for tick, values in seen.plots.items())
    for tick, update in seen.scenes.items():
        record = seen.records[tick + shift]
        q, stance = record.state.q[None], record.output.stance
        drawn = groups(update)
        swing, standing, torso = ([(p.x, p.z) for p in line.points] for line in drawn["robot"])
        np.testing.assert_array_equal(torso, torso_points(q)[0])
        np.testing.assert_array_equal(standing[2], feet(q)[0, stance])
        np.testing.assert_array_equal(swing[2], feet(q)[0, Leg(stance).other])
        stone = record.state.preview
        if stone is not None:
            ahead = drawn["stones"][-1]
            edges = [ahead.pose.position.x + side * ahead.scale.x / 2 for side in (-1, 1)]
            foot = feet(q)[0, stance, 0]
            np.testing.assert_allclose(edges, [foot + stone.l_min, foot + stone.l_max], atol=1e-12)
    assert any("area" in groups(update) for update in seen.scenes.values())
    assert any("cone" in groups(update) for update in seen.scenes.values())


def groups(update: Any) -> dict[str, list[Any]]:
    """A scene's markers by namespace."""
    found: dict[str, list[Any]] = defaultdict(list)
    for marker in update.markers:
        found[marker.ns].append(marker)
    return found


def test_the_hip_frame_is_the_recorded_hip(seen: Seen) -> None:
    shift = next(int(values["tick"]) - tick for tick, values in seen.plots.items())
    for tick, frames in seen.frames.items():
        moved = {frame.child_frame_id: frame.transform.translation for frame in frames.transforms}
        q = seen.records[tick + shift].state.q
        assert (moved["slide_x"].x, moved["slide_z"].z) == (q[0], q[1])


def test_walk_says_where_it_can_be_seen(seen: Seen) -> None:
    assert "live view at ws://127.0.0.1:" in seen.said


def test_rviz_hears_the_same(world: Any) -> None:
    """Markers and tf of the newest tick, and the URDF, to a node that asks for them."""
    from rabbit_ros.ros.qos import WEIGHTS
    from std_msgs.msg import String
    from tf2_msgs.msg import TFMessage
    from visualization_msgs.msg import Marker, MarkerArray

    transforms: list[Any] = []
    arrays: list[Any] = []
    urdf: list[Any] = []
    world.node.create_subscription(TFMessage, "tf", transforms.append, 10)
    world.node.create_subscription(MarkerArray, "markers", arrays.append, 10)
    world.node.create_subscription(String, "robot_description", urdf.append, WEIGHTS)
    states = world.hear("state")
    world.start("viewer", port=0)
    world.start("simulator", stones=3, motor_lag=0.004, pace=0.3)
    world.start("controller", controller="cbf-clf-qp")
    world.go()
    world.wait(lambda: len(arrays) > 20)
    world.wait(lambda: bool(urdf))
    assert 'robot name="rabbit"' in urdf[0].data
    frames, last = list(transforms), arrays[-1].markers
    stamps = {
        (each.sec, each.nanosec) for each in (last[1].header.stamp, *(f.transforms[0].header.stamp for f in frames))
    }
    known: dict[tuple[int, int], Any] = {}

    def states_are_heard() -> bool:  # a state may come after what was drawn of it
        known.update({(state.stamp.sec, state.stamp.nanosec): state for state in states})
        return stamps <= known.keys()

    world.wait(states_are_heard)
    for message in frames:
        moved = {each.child_frame_id: each for each in message.transforms}
        stamp = message.transforms[0].header.stamp
        q = known[stamp.sec, stamp.nanosec].q
        assert (moved["slide_x"].transform.translation.x, moved["slide_z"].transform.translation.z) == (q[0], q[1])
    assert last[0].action == Marker.DELETEALL
    assert {marker.ns for marker in last[1:]} >= {"robot", "stones", "area", "cone", "words"}
    stamp = last[1].header.stamp
    state = known[stamp.sec, stamp.nanosec]
    torso = next(marker for marker in last if (marker.ns, marker.id) == ("robot", 2))
    assert (torso.points[0].x, torso.points[0].z) == (state.q[0], state.q[1])


def rabbit(*words: str) -> subprocess.CompletedProcess[str]:
    """Call the command and wait."""
    return subprocess.run([*RABBIT, *words], capture_output=True, text=True, timeout=300, check=False)


def test_no_graph_is_one_line() -> None:
    done = rabbit("view", "--port", "0", "--wait", "0.5", "--namespace", "nobody_here")
    assert done.returncode == 2
    assert done.stderr == "error: no graph in namespace /nobody_here after 0.5 s; start one with `rabbit walk`\n"


def test_a_taken_port_is_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        done = rabbit("view", "--port", str(taken.getsockname()[1]))
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "Address already in use" in line


@pytest.mark.parametrize("words", [("--port", "70000"), ("--rate", "0"), ("--namespace", "a b")])
def test_bad_values_are_one_line(words: tuple[str, str]) -> None:
    done = rabbit("view", *words)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert " ".join(words) in line


def test_the_layout_is_written(tmp_path: Path) -> None:
    assert rabbit("view", "--layout", str(tmp_path / "layout.json")).returncode == 0
    assert json.loads((tmp_path / "layout.json").read_text())["layout"]
    assert rabbit("view", "--layout", "/proc/nowhere/layout.json").returncode == 2
