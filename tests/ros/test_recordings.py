"""Recordings of a running graph: begun in the middle, killed, on a full disk, and played again."""

import resource
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rabbit_bringup.launching.walk import WalkOptions, WalkSettings
from rabbit_bringup.ros.walk_monitor import walk_through
from rabbit_recording.checking import check_episodes
from rabbit_recording.episode_inventory import Presence
from rabbit_recording.open_recording import opened
from rabbit_recording.reader import iterate_inventories
from rabbit_recording.recover import recover
from rabbit_recording.ros.player import play
from rabbit_sim.parameters import SimulationParameters
from rclpy.serialization import deserialize_message
from recorded_walk import read_episodes
from rl_cbf_clf_controller.parameters import ControllerParameters
from std_srvs.srv import SetBool

PLANT, PARAMETERS = {"motor_lag": 0.004, "stones": 4}, ControllerParameters()


def test_a_recorder_begun_in_the_middle_tells_recorded_from_announced(world: Any) -> None:
    """The simulator holds while the recorder comes up in the middle of an episode, so that nothing is lost."""
    states = world.hear("state")
    world.walk(pace=1.0, **{**PLANT, "stones": 2, "episodes": 1000})
    world.wait(lambda: bool(states) and states[-1].episode > 1 and states[-1].tick > 20)
    assert world.ask(SetBool, "pause", data=True).success
    path = world.folder / "recording"
    world.start("recorder", path=str(path))
    world.go()
    begun = states[-1].episode
    world.wait(lambda: states[-1].episode > begun + 1 and states[-1].tick > 20)
    world.processes.stop(("recorder",))
    accounts = list(iterate_inventories(path))
    there = [account for account in accounts if account.presence is Presence.RECORDED]
    assert [episode.number for episode in accounts if episode.presence is Presence.ANNOUNCED] == list(range(1, begun))
    assert [episode.number for episode in there] == list(range(begun, there[-1].number + 1))
    assert [(episode.begins, episode.ends) for episode in (there[0], there[1])] == [(False, True), (True, True)]
    ends = {end.episode: end.tick for end in world.ends()}
    for episode in there:
        assert episode.lost == 0
        assert episode.recorded == episode.last - episode.first + 1
        assert not episode.ends or episode.last == ends[episode.number] - 1
    checked = list(check_episodes(path))
    assert [(e.replayed, e.differing) for e in checked] == [(0, []), *((e.recorded, []) for e in there[1:])]


def test_further_topics_are_recorded_where_they_are_asked_for(world: Any) -> None:
    """Standard ones, one of a stranger, and one that nobody publishes; the ticks stay whole."""
    from std_msgs.msg import String

    path, words = world.folder / "recording", world.node.create_publisher(String, "words", 10)
    asked = ["left_foot/wrench", "right_foot/wrench", "tf", "words", "nothing", "torque"]
    world.start("simulator", **{**PLANT, "stones": 1})
    world.start("controller")
    world.start("recorder", path=str(path), topics=asked)
    names = [f"/{world.namespace}/{name}" for name in asked[:4]]
    world.wait(lambda: all(world.node.count_subscribers(name) for name in names))
    world.spin(1.0)
    words.publish(String(data="before the walk"))
    assert world.ask(SetBool, "pause", data=False).success
    world.ended()
    assert any("nothing" in said.message for said in world.statuses("recorder"))
    world.processes.stop()
    (checked,) = check_episodes(path)
    assert (checked.episode.lost, checked.differing) == (0, [])
    with opened(path) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
        ticks = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages() if c.topic.endswith("/state")]
        forces = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages() if c.topic == names[0]]
    assert [counts[name] for name in names] == [len(ticks)] * 3 + [1]
    for state, wrench in zip(ticks, forces, strict=True):
        force = wrench.wrench.force
        assert wrench.header.frame_id == "l_sole"
        assert np.hypot(force.x, force.z) == pytest.approx(np.hypot(*state.foot_force[:2]))


def test_a_full_disk_stops_the_recording_not_the_walk(world: Any) -> None:
    states = world.hear("state")
    world.walk(records=True, pace=1.0, **PLANT)
    world.wait(lambda: len(states) > 80)
    full = (world.folder / "recording" / "recording.mcap").stat().st_size
    resource.prlimit(world.processes.pid("recorder"), resource.RLIMIT_FSIZE, (full, full))
    assert world.ended().outcome == "walked"
    said = world.statuses("recorder")
    assert any(s.level == DiagnosticStatus.ERROR and "recording stopped" in s.message for s in said)
    world.processes.stop()
    assert world.log("recorder").count("recording stopped") == 1
    assert len(read_episodes(recover(world.folder / "recording").path)[1].records) > 1


def test_a_recording_is_played_again(world: Any, tmp_path: Path) -> None:
    options, plant, recording = WalkOptions(trainer=False), SimulationParameters(stones=1), tmp_path / "recording"
    walk_through(WalkSettings(folder=tmp_path, options=options, simulation=plant, controller=PARAMETERS, policy="zero"))
    heard = {name: world.hear(name) for name in ("state", "torque", "controller_state", "preview", "clock")}
    count = play(recording, rate=5.0, namespace=world.namespace, delay=3.0)
    with opened(recording) as reader:
        assert count == reader.message_count
        recorded: dict[str, list[bytes]] = {name: [] for name in heard}
        for connection, _, data in reader.messages():
            recorded.get(connection.topic[1:], []).append(data)
    world.wait(lambda: all(len(heard[name]) == len(recorded[name]) for name in heard))
    for name, messages in heard.items():
        for message, data in zip(messages, recorded[name], strict=True):
            again = deserialize_message(data, type(message))
            for field in again.get_fields_and_field_types():  # not the bytes: what pads them may differ
                both = [getattr(copy, field) for copy in (message, again)]
                both = [np.asarray(value) if isinstance(value, array) else value for value in both]  # NaN is NaN
                np.testing.assert_equal(*both, err_msg=f"{name}.{field}")
