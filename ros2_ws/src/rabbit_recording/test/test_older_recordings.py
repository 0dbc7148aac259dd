"""Recordings whose messages lack the fields that came later."""

from pathlib import Path
from typing import Any

import pytest
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.checking import check_episodes
from rabbit_recording.contents import contents
from rabbit_recording.older_messages import LATER, Renewal
from rabbit_recording.open_recording import opened
from recorded_walk import MESSAGES, SEED, TYPES
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.typesys import get_types_from_msg

LACKING = {"rabbit_msgs/msg/Episode", "rabbit_msgs/msg/RobotState", "rabbit_msgs/msg/StonePreview"}


@pytest.fixture
def older(write_bag: Any, tmp_path: Path) -> Path:
    """A recording made before simulators said who they are."""
    types, out = graph_types([MESSAGES]), tmp_path / "older"
    for kind in LACKING:
        lines = (MESSAGES / "msg" / f"{kind.rpartition('/')[2]}.msg").read_text().splitlines()
        text = "\n".join(line for line in lines if line.split()[1:2] not in [[name] for name in LATER])
        del types.fielddefs[kind], types.types[kind]
        types.register(get_types_from_msg(text, kind))
    with opened(write_bag(tmp_path / "now")) as reader:
        writer = BagWriter(out, types)
        for each in reader.connections:
            assert isinstance(each.ext, ConnectionExtRosbag2)
            writer.add(each.topic, each.msgtype, each.ext.offered_qos_profiles)
        for each, at, data in reader.messages():
            message = reader.deserialize(data, each.msgtype)
            writer.write(each.topic, at, bytes(types.serialize_cdr(message, each.msgtype)))
        writer.close()
    return out


def test_it_is_read_and_replayed(older: Path) -> None:
    (episode,) = contents(older).episodes
    assert (episode.recorded > 0, episode.lost) == (True, 0)
    (checked,) = check_episodes(older)
    assert (checked.replayed, checked.furthest) == (episode.recorded, 0.0)


def test_its_messages_are_those_of_today(older: Path) -> None:
    with opened(older) as reader:
        renewal = Renewal(reader, TYPES)
        assert renewal.older == LACKING
        for each, _, data in reader.messages():
            message: Any = TYPES.deserialize_cdr(renewal.message(each, data), each.msgtype)
            if each.msgtype in LACKING:
                assert message.sender == ""
            if each.msgtype.endswith("Episode"):
                assert message.seed == SEED
