"""What is in a recording: topics with counts and QoS, how long it is, what of each episode."""

from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2

from rabbit_recording.episode_inventory import EpisodeInventory
from rabbit_recording.open_recording import begin_of, one_line_errors, opened, storage_files
from rabbit_recording.reader import iterate_inventories


@dataclass(frozen=True)
class TopicContents:
    """One topic."""

    name: str
    type: str
    messages: int
    qos: str


@dataclass(frozen=True)
class Contents:
    """A recording; `seconds` from its first tick on, `episodes` also those that were merely announced."""

    files: list[str]
    bytes: int
    seconds: float
    messages: int
    topics: list[TopicContents]
    episodes: list[EpisodeInventory]


def contents(path: Path) -> Contents:
    """Look into a recording; raises `RecordingError`."""
    with opened(path) as reader, one_line_errors(path):
        topics = [
            TopicContents(name, topic.connections[0].msgtype, topic.msgcount, _qos_text(topic.connections[0]))
            for name, topic in sorted(reader.topics.items())
        ]
        seconds = (reader.end_time - begin_of(reader)) / 1e9 if reader.message_count else 0.0
        count = reader.message_count
    files = storage_files(path)
    size = sum(file.stat().st_size for file in files)
    return Contents([f.name for f in files], size, seconds, count, topics, list(iterate_inventories(path)))


def _qos_text(connection: Connection) -> str:
    """The QoS in words, as in `reliable, volatile, last 5000`."""
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    words = [
        f"{p.reliability.name}, {p.durability.name}, {p.history.name.removeprefix('KEEP_')} {p.depth}"
        for p in connection.ext.offered_qos_profiles
    ]
    return "; ".join(words).lower().replace("_", " ")
