"""Reads a recording back into what a rollout in process gives: ticks and landings, by episode. No ROS needed."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.state import RobotState, StonePreview
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.message_fields import output_of
from rl_trainer.rollout import Record
from rosbags.highlevel import AnyReader, AnyReaderError

from rabbit_bringup.recording.bag_writer import RecordingError

TOPICS = ("state", "preview", "landing", "episode", "torque", "controller_state", "policy_swap")
Key = tuple[int, int]  # episode and tick, or episode and stone


@dataclass(frozen=True)
class RecordedSwap:
    """A policy that came in force before the answer to `tick`; `data` is empty for the built-in zero policy."""

    tick: int
    version: str
    data: bytes


@dataclass
class RecordedEpisode:
    """One episode.

    `swaps` begin with the policy in force at its start. `last` is the state that got no torque, if it was recorded;
    `missing` counts ticks with a gap.
    """

    number: int
    seed: int = 0
    outcome: str = ""
    reason: str = ""
    records: list[Record] = field(default_factory=list)
    landings: list[Landing] = field(default_factory=list)
    swaps: list[RecordedSwap] = field(default_factory=list)
    last: RobotState | None = None
    missing: int = 0


def messages(path: Path, *names: str) -> Iterator[tuple[str, Any]]:
    """Topic (its last part) and message, in the order of recording; all topics if no `names`.

    Raises:
        RecordingError: no recording, or one that cannot be read.
    """
    try:
        with AnyReader([path]) as reader:
            chosen = [c for c in reader.connections if not names or c.topic.split("/")[-1] in names]
            for connection, _, data in reader.messages(chosen):
                yield connection.topic.split("/")[-1], reader.deserialize(data, connection.msgtype)
    except (AnyReaderError, OSError) as error:
        raise RecordingError(f"recording {path}: {error}") from error


def read_episodes(path: Path) -> dict[int, RecordedEpisode]:
    """All episodes of a recording, by number."""
    tables: dict[str, dict[Key, Any]] = {name: {} for name in TOPICS}
    episodes: dict[int, RecordedEpisode] = {}
    for topic, message in messages(path, *TOPICS):
        episode = episodes.setdefault(message.episode, RecordedEpisode(message.episode))
        if topic == "episode":
            episode.seed, episode.outcome, episode.reason = message.seed, message.outcome, message.reason
        elif topic == "landing":
            episode.landings.append(Landing(**{n: getattr(message, n) for n in Landing.__dataclass_fields__}))
        else:
            tables[topic][message.episode, message.index if topic == "preview" else message.tick] = message
    for key in sorted(tables["state"]):
        _add_tick(episodes[key[0]], key, tables)
    _add_swaps(episodes, sorted(tables["policy_swap"].items()))
    return {number: episode for number, episode in sorted(episodes.items()) if number > 0}


def _add_swaps(episodes: dict[int, RecordedEpisode], swaps: list[tuple[Key, Any]]) -> None:
    in_force: RecordedSwap | None = None
    for number in sorted(episodes):
        here = [
            RecordedSwap(tick, message.version, bytes(message.data))
            for (episode, tick), message in swaps
            if episode == number and message.accepted
        ]
        carried = [replace(in_force, tick=0)] if in_force and not (here and here[0].tick == 0) else []
        episodes[number].swaps = carried + here
        in_force = episodes[number].swaps[-1] if episodes[number].swaps else None


def _add_tick(episode: RecordedEpisode, key: Key, tables: dict[str, dict[Key, Any]]) -> None:
    state = _state(tables["state"][key], tables["preview"])
    torque, details = tables["torque"].get(key), tables["controller_state"].get(key)
    if torque is not None and details is not None:
        episode.records.append(Record(state, output_of(details, np.array(torque.torque))))
    elif state.running:
        episode.missing += 1
    episode.last = state


def _state(message: Any, previews: dict[Key, Any]) -> RobotState:
    stone = previews.get((message.episode, message.touchdowns + 1)) if message.previewed else None
    return RobotState(
        tick=message.tick,
        q=message.q,
        dq=message.dq,
        foot_force=message.foot_force.reshape(2, 2),
        contact=message.contact,
        touchdowns=message.touchdowns,
        preview=StonePreview(stone.index, stone.l_min, stone.l_max) if stone else None,
        running=message.running,
    )
