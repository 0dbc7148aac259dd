"""Recordings made by version 358b837, whose messages had a bare stamp and RABBIT's lengths, and the first ones."""

import lzma
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_description.state import ACTUATED, TICK_SECONDS
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.checking import check_episodes, replayed
from rabbit_recording.contents import contents
from rabbit_recording.former_messages import Renewal
from rabbit_recording.open_recording import opened
from rabbit_recording.reader import last_episode, messages, read_episodes
from rabbit_recording.recover import recover
from recorded_walk import MESSAGES, SEED, TYPES
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

EPISODE = "rabbit_msgs/msg/Episode"
DATA = Path(__file__).parent / "data"
NEW_FIELDS = ("sender", "controller", "refused_controller")  # the first recordings had none
WALKED = {"former_best": {1: (1, 166)}, "former_trained": {1: (2, 46), 2: (3, 56)}}  # seed, ticks
ROUNDING = 1e-11  # N m: they were made with OSQP, whose answer was polished by LAPACK then
LEARNS = 5  # tick in which the identification of `best` first says something; it said something else then


def former(name: str, folder: Path) -> Path:
    """One of the recordings."""
    path = folder / f"{name}.mcap"
    path.write_bytes(lzma.decompress((DATA / f"{name}.mcap.xz").read_bytes()))
    return path


@pytest.mark.parametrize("name", WALKED)
def test_each_tick_is_replayed(name: str, tmp_path: Path) -> None:
    checked = list(check_episodes(former(name, tmp_path)))
    assert {e.episode.number: (e.episode.seed, e.replayed) for e in checked} == WALKED[name]
    assert not any(e.episode.lost for e in checked)
    if name == "former_best":
        assert first_apart(former(name, tmp_path)) == LEARNS
    else:
        assert max(e.furthest for e in checked) <= ROUNDING


def first_apart(path: Path) -> int:
    """The first tick whose replayed torque is another one."""
    episode = last_episode(path, 1)
    pairs = zip(episode.records, replayed(episode), strict=True)
    return next(o.tick for record, (_, o) in pairs if np.abs(o.torque - record.output.torque).max() > ROUNDING)


def test_its_contents_are_told(tmp_path: Path) -> None:
    found = contents(former("former_best", tmp_path))
    (episode,) = found.episodes
    assert (episode.outcome, episode.touchdowns, episode.policies, episode.lost) == ("walked", 4, ["zero"], 0)
    assert {topic.name: topic.messages for topic in found.topics}["/controller_state"] == episode.recorded


def test_a_controller_state_of_then_is_two_messages_of_today(tmp_path: Path) -> None:
    names = ("controller_state", "learner_terms")
    told = list(messages(former("former_best", tmp_path), *names))
    assert [topic for topic, _ in told] == [*names] * (len(told) // 2)
    for topic, message in told:
        assert message.header.stamp.sec * 100 + message.header.stamp.nanosec // 10_000_000 == message.tick
        if topic == "controller_state":
            assert message.names == ["V", "B1", "B2"]
            assert np.isfinite(message.values).all()
        else:
            assert len(message.alpha) == 4 * len(message.quantities)


def test_what_was_learned_from_is_read(tmp_path: Path) -> None:
    path = former("former_trained", tmp_path)
    transitions = [message for _, message in messages(path, "transition")]
    assert len(transitions) == sum(ticks for _, ticks in WALKED["former_trained"].values())
    outputs = [record.output for episode in read_episodes(path).values() for record in episode.records]
    for transition, output in zip(transitions, outputs, strict=True):
        np.testing.assert_array_equal(transition.mu, output.mu)
        np.testing.assert_array_equal(transition.observation, output.observation)


def test_a_cut_one_is_recovered_and_replays_until_its_robot_is_identified(tmp_path: Path) -> None:
    path = former("former_best", tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    recovered = recover(path, tmp_path / "recovered").path
    (checked,) = check_episodes(recovered)
    assert 0 < checked.replayed < 166
    assert first_apart(recovered) == LEARNS


def test_one_made_before_controllers_had_names_is_read(tmp_path: Path) -> None:
    path = without_names(former("former_trained", tmp_path), tmp_path / "first")
    checked = list(check_episodes(path))
    assert [(e.episode.controller, e.replayed) for e in checked] == [("", 46), ("", 56)]
    assert max(e.furthest for e in checked) <= ROUNDING


def test_one_made_before_episodes_said_how_long_a_tick_is(write_bag: Any, tmp_path: Path) -> None:
    path = without_tick_seconds(write_bag(tmp_path / "now"), tmp_path / "then")
    (episode,) = contents(path).episodes
    assert (episode.recorded > 0, episode.lost) == (True, 0)
    with opened(path) as reader:
        renewal = Renewal(reader, TYPES)
        assert renewal.former == {EPISODE}
        told = [
            renewal.messages(each, data)[each.topic] for each, _, data in reader.messages() if each.msgtype == EPISODE
        ]
    again: list[Any] = [TYPES.deserialize_cdr(data, EPISODE) for data in told]
    assert [(each.seed, each.tick_seconds, tuple(each.joints)) for each in again] == [
        (SEED, TICK_SECONDS, ACTUATED)
    ] * 2


def without_tick_seconds(recording: Path, out: Path) -> Path:
    """The recording with episodes as they were before they had the field."""
    types = graph_types([MESSAGES])
    text = (MESSAGES / "msg" / "Episode.msg").read_text().replace("float64 tick_seconds", "# ")
    del types.fielddefs[EPISODE], types.types[EPISODE]
    types.register(get_types_from_msg(text, EPISODE))
    with opened(recording) as reader:
        writer = BagWriter(out, types)
        for each in reader.connections:
            assert isinstance(each.ext, ConnectionExtRosbag2)
            writer.add(each.topic, each.msgtype, each.ext.offered_qos_profiles)
        for each, at, data in reader.messages():
            message = reader.deserialize(data, each.msgtype)
            writer.write(each.topic, at, bytes(types.serialize_cdr(message, each.msgtype)))
        writer.close()
    return out


def without_names(recording: Path, out: Path) -> Path:
    """The recording without the fields that the first ones had not."""
    types = get_typestore(Stores.ROS2_JAZZY)
    with opened(recording) as reader:
        connections = [each for each in reader.connections if each.msgtype.startswith("rabbit_msgs/")]
        for each in connections:
            lines = each.msgdef.data.split("\n====", 1)[0].splitlines()
            text = "\n".join(line for line in lines if line.split()[1:2] not in [[name] for name in NEW_FIELDS])
            types.register(get_types_from_msg(text, each.msgtype))
        writer = BagWriter(out, types)
        for each in connections:
            assert isinstance(each.ext, ConnectionExtRosbag2)
            writer.add(each.topic, each.msgtype, each.ext.offered_qos_profiles)
        for each, at, data in reader.messages(connections):
            fields: dict[str, Any] = vars(reader.deserialize(data, each.msgtype))
            kept = {name: value for name, value in fields.items() if name not in (*NEW_FIELDS, "__msgtype__")}
            kept["stamp"] = types.types["builtin_interfaces/msg/Time"](kept["stamp"].sec, kept["stamp"].nanosec)
            message = types.types[each.msgtype](**kept)
            writer.write(each.topic, at, bytes(types.serialize_cdr(message, each.msgtype)))
        writer.close()
    return out
