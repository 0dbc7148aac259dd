"""What is in a recording: topics with counts and QoS, how long it is, episodes with seeds, outcomes and policies."""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, Qos
from rosbags.rosbag2 import Reader

from rabbit_bringup.recording.bag_writer import LOST
from rabbit_bringup.recording.opening import opened, storage_files
from rabbit_bringup.recording.reader import messages_by_run


@dataclass(frozen=True)
class TopicContents:
    """One topic. `lost`: messages that were sent while the recorder listened and did not reach it; None: not known."""

    name: str
    type: str
    messages: int
    qos: str
    lost: int | None = None


@dataclass
class EpisodeContents:
    """One episode, as the simulator and the controller told it; `ticks` of its last announcement.

    `number` is its number in the recording, `run` counts how often the simulator was started anew before.
    """

    number: int
    run: int = 0
    seed: int = 0
    stones: int = 0
    touchdowns: int = 0
    ticks: int = 0
    outcome: str = ""
    reason: str = ""
    policies: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Contents:
    """A recording."""

    files: list[str]
    bytes: int
    seconds: float
    messages: int
    topics: list[TopicContents]
    episodes: list[EpisodeContents]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def contents(path: Path) -> Contents:
    """Look into a recording; raises `RecordingError`."""
    with opened(path) as reader:
        lost = lost_messages(reader)
        topics = [
            TopicContents(c.topic, c.msgtype, c.msgcount, qos_text(c.ext.offered_qos_profiles), lost.get(c.topic))
            for c in sorted(reader.connections, key=lambda c: c.topic)
            if isinstance(c.ext, ConnectionExtRosbag2)
        ]
        seconds = reader.duration / 1e9 if reader.message_count else 0.0
    files = storage_files(path)
    size = sum(file.stat().st_size for file in files)
    count = sum(topic.messages for topic in topics)
    return Contents([f.name for f in files], size, seconds, count, topics, episodes(path))


def lost_messages(reader: AnyReader) -> dict[str, int]:
    """How many messages of each topic the recorder saw go past, as it noted at its end."""
    lost: dict[str, int] = {}
    for part in reader.readers:
        if isinstance(part, Reader) and part.storage.metadata.custom:
            lost |= json.loads(part.storage.metadata.custom.get(LOST, "{}"))
    return lost


def episodes(path: Path) -> list[EpisodeContents]:
    """Seeds, outcomes and policies."""
    found: dict[tuple[int, int], EpisodeContents] = {}
    in_force = ""
    for run, topic, message in messages_by_run(path, "episode", "policy_swap"):
        episode = found.setdefault((run, message.episode), EpisodeContents(0, run))
        if topic == "policy_swap":
            in_force = message.version if message.accepted else in_force
        else:
            for name in ("seed", "stones", "touchdowns", "outcome", "reason"):
                setattr(episode, name, getattr(message, name))
            episode.ticks = message.tick
        if in_force and in_force not in episode.policies:
            episode.policies.append(in_force)
    walked = [found[run, number] for run, number in sorted(found) if number > 0]
    return [replace(episode, number=i) for i, episode in enumerate(walked, start=1)]


def qos_text(profiles: list[Qos]) -> str:
    """As in `reliable, volatile, last 5000`."""
    words = [
        f"{p.reliability.name}, {p.durability.name}, {p.history.name.removeprefix('KEEP_')} {p.depth}" for p in profiles
    ]
    return "; ".join(words).lower().replace("_", " ")
