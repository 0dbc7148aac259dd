"""A walking graph on the page and through RViz's topics, against the recording."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_client import PageClient, free_port
from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import ACTUATED
from rabbit_recording.reader import read_episodes
from rl_trainer.rollout import Record

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")
WALK = ("--no-pictures", "--no-video", "--no-trainer", "--stones", "4", "--seed", "4", "--view")


class Seen:
    """What a client saw of a walk, by tick, and what was recorded of it."""

    def __init__(self, folder: Path) -> None:
        port = free_port()
        command = [*RABBIT, "walk", "--out", str(folder), *WALK, "--view-port", str(port)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        with PageClient(f"http://127.0.0.1:{port}", timeout=300, watches=False) as client:
            while process.poll() is None:
                client.hear(0.5)
        self.about = client.words["about"]
        self.refused = client.words.get("refused")
        self.rows = {int(row[0]["tick"]): row[0] for row in client.rows}
        self.said, errors = process.communicate()
        assert process.returncode == 0, errors
        self.records: dict[int, Record] = {
            record.state.tick: record for record in read_episodes(folder / "recording")[1].records
        }


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """One walk at the pace of real time, for all tests here."""
    return Seen(tmp_path_factory.mktemp("viewed") / "walk")


def test_rows_are_the_recorded_ticks(seen: Seen) -> None:
    assert len(seen.rows) >= 10
    for tick, row in seen.rows.items():
        record = seen.records[tick]
        output, force = record.output, record.state.foot_force[record.output.stance]
        assert row["V"] == np.float32(output.V)
        np.testing.assert_array_equal([row["B1"], row["B2"]], output.barriers.astype(np.float32))
        np.testing.assert_array_equal([row["F_T"], row["F_N"]], force.astype(np.float32))
        applied = seen.records[tick - 1].output.torque if tick else np.full(4, np.nan)  # over the tick that ended
        torque = [row[f"torque_{joint}"] for joint in ACTUATED]
        np.testing.assert_array_equal(torque, applied.astype(np.float32))
        ratio = force_ratio(force)
        np.testing.assert_array_equal(row["force_ratio"], np.float32(ratio))


def test_rviz_hears_the_same(world: Any) -> None:
    """Markers and tf of the newest tick, and the URDF, to a node that asks for them."""
    from rabbit_common.ros.qos import WEIGHTS
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
    world.wait(lambda: len(arrays) > 20 and len(arrays[-1].markers) > 3)
    world.wait(lambda: bool(urdf))
    assert 'robot name="rabbit"' in urdf[0].data
    frames, last = list(transforms), arrays[-1].markers
    stamps = {
        (each.sec, each.nanosec) for each in (last[1].header.stamp, *(f.transforms[0].header.stamp for f in frames))
    }
    known: dict[tuple[int, int], Any] = {}

    def states_are_heard() -> bool:  # a state may come after what was drawn of it
        known.update({(state.header.stamp.sec, state.header.stamp.nanosec): state for state in states})
        return stamps <= known.keys()

    world.wait(states_are_heard)
    for message in frames:
        moved = {each.child_frame_id: each for each in message.transforms}
        stamp = message.transforms[0].header.stamp
        q = known[stamp.sec, stamp.nanosec].q
        assert (moved["slide_x"].transform.translation.x, moved["slide_z"].transform.translation.z) == (q[0], q[1])
    assert last[0].action == Marker.DELETEALL
    near = [box.pose.position.x - box.scale.x / 2 for box in last[1:]]
    assert near == sorted(near)


def test_wrong_ticks_are_refused_and_the_view_goes_on(world: Any) -> None:
    """Each is counted under its reason, and shows nothing; the next episode is seen."""
    from rabbit_msgs.msg import ControllerState, Episode, LearnerTerms, RobotState
    from rabbit_msgs.srv import ResetEpisode

    port, episodes, diagnostics = free_port(), world.hear("episode"), world.hear("diagnostics")
    world.start("viewer", port=port)
    world.start("simulator", stones=1, motor_lag=0.004, pace=1.0, episodes=0)
    world.start("controller", controller="cbf-clf-qp")
    world.go()
    with PageClient(f"http://127.0.0.1:{port}", watches=False) as client:

        def refused() -> set[str]:
            return {v.key for m in diagnostics for s in m.status for v in s.values if v.key.startswith("refused tick")}

        def shows(episode: int) -> bool:
            client.hear(0.01)
            title = client.words.get("about", {}).get("title", "")
            return title.startswith(f"episode {episode},") and len(client.rows) > 3

        assert world.ask(ResetEpisode, "reset_episode", seed=1).success
        world.wait(lambda: bool(episodes) and episodes[-1].phase == Episode.ENDED)
        now = episodes[-1]
        world.wait(lambda: shows(now.episode))
        wrong = {"not finite": (float("nan"), 0, now.controller), "no leg": (0.0, 2, now.controller)}
        wrong |= {"another controller": (0.0, 0, "a stranger"), "wrong length": (0.0, 0, now.controller)}
        for number, (reason, (q, stance, sender)) in enumerate(wrong.items(), 10_000):
            at = {"episode": now.episode, "tick": number}
            rest = {"dq": [0.0] * 7, "foot_force": [0.0] * 4, "contact": [False] * 2, "applied": [0.0] * 4}
            world.say("state", RobotState(**at, q=[q] * 7, **rest))
            world.say("controller_state", ControllerState(**at, stance=stance, sender=sender))
            world.say("learner_terms", LearnerTerms(**at, sender=sender, alpha=[0.0]))
            world.wait(lambda reason=reason: f"refused tick: {reason}" in refused())
        assert all(row[0]["tick"] < 10_000 for row in client.rows)
        assert world.ask(ResetEpisode, "reset_episode", seed=1).success
        world.wait(lambda: shows(now.episode + 1))


def rabbit(*words: str) -> subprocess.CompletedProcess[str]:
    """Call the command and wait."""
    return subprocess.run([*RABBIT, *words], capture_output=True, text=True, timeout=300, check=False)
