"""What is in a recording: topics with counts and QoS, how long it is, what of each episode."""

import json
from dataclasses import dataclass
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, Qos
from rosbags.rosbag2 import Reader

from rabbit_recording.bag_writer import LOST, RecordingError
from rabbit_recording.episode_inventory import EpisodeInventory
from rabbit_recording.open_recording import begin_of, one_line_errors, opened, storage_files
from rabbit_recording.reader import iterate_inventories


@dataclass(frozen=True)
class TopicContents:
    """One topic. `lost`: messages that were sent while the recorder listened and did not reach it; None: not known."""

    name: str
    type: str
    messages: int
    qos: str
    lost: int | None = None


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
        lost = lost_messages(reader)
        topics = [
            TopicContents(c.topic, c.msgtype, c.msgcount, qos_text(c.ext.offered_qos_profiles), lost.get(c.topic))
            for c in sorted(reader.connections, key=lambda c: c.topic)
            if isinstance(c.ext, ConnectionExtRosbag2)
        ]
        seconds = (reader.end_time - begin_of(reader)) / 1e9 if reader.message_count else 0.0
        count = sum(topic.messages for topic in topics)
    files = storage_files(path)
    size = sum(file.stat().st_size for file in files)
    return Contents([f.name for f in files], size, seconds, count, topics, list(iterate_inventories(path)))


def lost_messages(reader: AnyReader) -> dict[str, int]:
    """How many messages of each topic the recorder saw go past, as it noted at its end."""
    lost: dict[str, int] = {}
    for part in reader.readers:
        if isinstance(part, Reader) and part.storage.metadata.custom:
            lost |= json.loads(part.storage.metadata.custom.get(LOST, "{}"))
    if not all(isinstance(count, int) for count in lost.values()):
        raise RecordingError(f"metadata.yaml: {LOST}: expected a count for each topic")
    return lost


def qos_text(profiles: list[Qos]) -> str:
    """As in `reliable, volatile, last 5000`."""
    words = [
        f"{p.reliability.name}, {p.durability.name}, {p.history.name.removeprefix('KEEP_')} {p.depth}" for p in profiles
    ]
    return "; ".join(words).lower().replace("_", " ")
