"""Reads a recording back into what a rollout in process gives: ticks and landings, by episode. No ROS needed."""

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.state import RobotState, StonePreview
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.message_fields import output_of
from rl_trainer.rollout import Record

from rabbit_bringup.recording.bag_writer import RecordingError
from rabbit_bringup.recording.opening import opened, told

OWN_TYPES = "rabbit_msgs/"
BY_TICK = ("state", "torque", "controller_state")
TOPICS = (*BY_TICK, "preview", "landing", "episode", "policy_swap")
NEIGHBOURS = 3  # episodes whose messages may be mixed


@dataclass(frozen=True)
class RecordedSwap:
    """A policy that came in force before the answer to `tick`; `data` is empty for the built-in zero policy."""

    tick: int
    version: str
    data: bytes


@dataclass
class RecordedEpisode:
    """One episode.

    `sigma` is the exploration it was announced with, NaN for the controller's own parameter. `swaps` begin with the
    policy in force at its start. `ticks` are as many as there were torques awaited, by what was recorded; `last` is the
    state that got no torque, if it was recorded; `missing` counts ticks with a gap.
    """

    number: int
    seed: int = 0
    sigma: float = math.nan
    outcome: str = ""
    reason: str = ""
    records: list[Record] = field(default_factory=list)
    landings: list[Landing] = field(default_factory=list)
    swaps: list[RecordedSwap] = field(default_factory=list)
    last: RobotState | None = None
    ticks: int = 0
    missing: int = 0


def messages(path: Path, *names: str) -> Iterator[tuple[str, Any]]:
    """Topic (its last part) and message of this project's own types, in the order of time; all of them if no `names`.

    Raises:
        RecordingError: no recording, one that cannot be read, or a topic that is in it from several graphs.
    """
    with opened(path) as reader, told(path):
        ours = [c for c in reader.connections if c.msgtype.startswith(OWN_TYPES)]
        chosen = [c for c in ours if not names or last_name(c.topic) in names]
        topics = sorted({c.topic for c in chosen})
        several = [topic for topic in topics if [*map(last_name, topics)].count(last_name(topic)) > 1]
        if several:
            raise RecordingError(f"recording {path}: of several graphs: {', '.join(several)}")
        for connection, _, data in reader.messages(chosen) if chosen else ():
            yield last_name(connection.topic), reader.deserialize(data, connection.msgtype)


def last_name(topic: str) -> str:
    """`state` of `/left/state`."""
    return topic.split("/")[-1]


def read_episodes(path: Path) -> dict[int, RecordedEpisode]:
    """All episodes of a recording, by number."""
    return {episode.number: episode for episode in iterate_episodes(path)}


def iterate_episodes(path: Path) -> Iterator[RecordedEpisode]:
    """One episode after another, so that a long recording needs the memory of a few of them.

    Raises:
        RecordingError: as `messages`; or messages that are defined otherwise than this version's.
    """
    gathered: dict[int, _Gathered] = {}
    in_force: RecordedSwap | None = None
    try:
        for topic, message in messages(path, *TOPICS):
            gathered.setdefault(message.episode, _Gathered(message.episode)).add(topic, message)
            while len(gathered) > NEIGHBOURS:
                in_force = yield from gathered.pop(min(gathered)).finish(in_force)
        for number in sorted(gathered):
            in_force = yield from gathered[number].finish(in_force)
    except (AttributeError, TypeError, ValueError) as error:
        raise RecordingError(
            f"recording {path}: recorded under other message definitions, or damaged: {error}"
        ) from error


class _Gathered:
    """The messages of one episode."""

    def __init__(self, number: int) -> None:
        self._episode = RecordedEpisode(number)
        self._ticks: dict[str, dict[int, Any]] = {name: {} for name in BY_TICK}
        self._previews: dict[int, Any] = {}

    def add(self, topic: str, message: Any) -> None:
        """Take in one message."""
        if topic in BY_TICK:
            self._ticks[topic][message.tick] = message
        elif topic == "preview":
            self._previews[message.index] = message
        elif topic == "landing":
            self._episode.landings.append(Landing(**{n: getattr(message, n) for n in Landing.__dataclass_fields__}))
        elif topic == "episode":
            for name in ("seed", "sigma", "outcome", "reason"):
                setattr(self._episode, name, getattr(message, name))
            self._episode.ticks = max(self._episode.ticks, message.tick)
        elif message.accepted:
            self._episode.swaps.append(RecordedSwap(message.tick, message.version, bytes(message.data)))

    def finish(self, in_force: RecordedSwap | None) -> Generator[RecordedEpisode, None, RecordedSwap | None]:
        """Yield the episode, unless it is what was told before the first; return the policy in force at its end."""
        episode = self._episode
        for tick in sorted(self._ticks["state"]):
            self._add_tick(tick)
        if in_force and not (episode.swaps and episode.swaps[0].tick == 0):
            episode.swaps.insert(0, replace(in_force, tick=0))
        if episode.number > 0:
            yield episode
        return episode.swaps[-1] if episode.swaps else None

    def _add_tick(self, tick: int) -> None:
        state = _state(self._ticks["state"][tick], self._previews)
        torque, details = self._ticks["torque"].get(tick), self._ticks["controller_state"].get(tick)
        if torque is not None and details is not None:
            self._episode.records.append(Record(state, output_of(details, np.array(torque.torque))))
        elif state.running:
            self._episode.missing += 1
        self._episode.last = state
        self._episode.ticks = max(self._episode.ticks, tick)


def _state(message: Any, previews: dict[int, Any]) -> RobotState:
    stone = previews.get(message.touchdowns + 1) if message.previewed else None
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
