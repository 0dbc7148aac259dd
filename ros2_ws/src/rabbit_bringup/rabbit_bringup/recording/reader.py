"""Reads a recording back into what a rollout in process gives: ticks and landings, by episode. No ROS needed."""

import json
import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.gait_library import Gaits, parse_gaits
from rabbit_description.state import RobotState, StonePreview
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.message_fields import output_of
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.rollout import Record

from rabbit_bringup.recording.bag_writer import RecordingError
from rabbit_bringup.recording.opening import opened, told

OWN_TYPES = "rabbit_msgs/"
BY_TICK = ("state", "torque", "controller_state")
TOPICS = (*BY_TICK, "preview", "landing", "episode", "policy_swap", "controller_settings")
WAITING = 0  # phase in rabbit_msgs/Episode
NEIGHBOURS = 3  # episodes whose messages may be mixed


@dataclass(frozen=True)
class RecordedSwap:
    """A policy that came in force before the answer to `tick`; `data` is empty for the built-in zero policy."""

    tick: int
    version: str
    data: bytes


@dataclass(frozen=True)
class RecordedSettings:
    """What the controller went by from the answer to `tick` on."""

    tick: int
    parameters: ControllerParameters
    gait: Gaits


@dataclass
class RecordedEpisode:
    """One episode, by its number in the recording: where the simulator was started again, these count on.

    `sigma` is the exploration it was announced with, NaN for the controller's own parameter. `swaps` begin with the
    policy in force at its start, `settings` with what the controller went by. `ticks` are as many as there were torques
    awaited, by what was recorded; `last` is the state that got no torque, if it was recorded; `missing` counts ticks
    with a gap.
    """

    number: int
    seed: int = 0
    sigma: float = math.nan
    outcome: str = ""
    reason: str = ""
    records: list[Record] = field(default_factory=list)
    landings: list[Landing] = field(default_factory=list)
    swaps: list[RecordedSwap] = field(default_factory=list)
    settings: list[RecordedSettings] = field(default_factory=list)
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


def messages_by_run(path: Path, *names: str) -> Iterator[tuple[int, str, Any]]:
    """As `messages`, before each the simulator's run that it belongs to, from 0; a simulator begins one by waiting.

    The topic `episode` must be among the names.
    """
    run, is_begun = 0, False
    for topic, message in messages(path, *names):
        if topic == "episode" and message.episode == 0 and message.phase == WAITING and is_begun:
            run, is_begun = run + 1, False
        is_begun |= message.episode > 0
        yield run, topic, message


def read_episodes(path: Path) -> dict[int, RecordedEpisode]:
    """All episodes of a recording, by number."""
    return {episode.number: episode for episode in iterate_episodes(path)}


def iterate_episodes(path: Path) -> Iterator[RecordedEpisode]:
    """One episode after another, so that a long recording needs the memory of a few of them.

    Raises:
        RecordingError: as `messages`; or messages that are defined otherwise than this version's.
    """
    gathered: dict[tuple[int, int], _Gathered] = {}
    in_force = _InForce()
    number = 0
    try:
        for run, topic, message in messages_by_run(path, *TOPICS):
            gathered.setdefault((run, message.episode), _Gathered()).add(topic, message)
            if len(gathered) > NEIGHBOURS:
                number += yield from _finish(gathered, in_force, number)
        while gathered:
            number += yield from _finish(gathered, in_force, number)
    except (AttributeError, TypeError, ValueError) as error:
        raise RecordingError(
            f"recording {path}: recorded under other message definitions, or damaged: {error}"
        ) from error


def _finish(
    gathered: "dict[tuple[int, int], _Gathered]", in_force: "_InForce", number: int
) -> Generator[RecordedEpisode, None, bool]:
    """Yield the first of the gathered episodes and return True; False if it is what was told before a run's first."""
    key = min(gathered)
    episode = gathered.pop(key).finish(in_force)
    is_one = key[1] > 0
    if is_one:
        episode.number = number + 1
        yield episode
    return is_one


@dataclass
class _InForce:
    """What an episode begins with: the newest of the ones before."""

    swap: RecordedSwap | None = None
    settings: RecordedSettings | None = None


class _Gathered:
    """The messages of one episode."""

    def __init__(self) -> None:
        self._episode = RecordedEpisode(0)
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
        elif topic == "controller_settings":
            law = ControllerParameters.model_validate_json(message.parameters)
            gait = parse_gaits(json.loads(message.gait))
            self._episode.settings.append(RecordedSettings(message.tick, law, gait))
        elif message.accepted:
            self._episode.swaps.append(RecordedSwap(message.tick, message.version, bytes(message.data)))

    def finish(self, in_force: _InForce) -> RecordedEpisode:
        """The episode, which begins with what is `in_force`; that becomes what was at its end."""
        episode = self._episode
        for tick in sorted(self._ticks["state"]):
            self._add_tick(tick)
        if in_force.swap and not (episode.swaps and episode.swaps[0].tick == 0):
            episode.swaps.insert(0, replace(in_force.swap, tick=0))
        if in_force.settings and not (episode.settings and episode.settings[0].tick == 0):
            episode.settings.insert(0, replace(in_force.settings, tick=0))
        in_force.swap = episode.swaps[-1] if episode.swaps else in_force.swap
        in_force.settings = episode.settings[-1] if episode.settings else in_force.settings
        return episode

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
        applied=message.applied,
    )
