"""Reads a recording back into what a rollout in process gives: ticks and landings, by episode. No ROS needed."""

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_common.task_messages import state_of
from rabbit_description.state import DOF, RobotState, StonePreview
from rabbit_description.task import ControlTask
from rabbit_description.task_state import layout_of
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.message_fields import output_of
from rl_trainer.rollout import Record

from rabbit_recording import RecordingError
from rabbit_recording.active_settings import Policies, RecordedSettings, Settings
from rabbit_recording.episode_inventory import (
    BY_TICK,
    DETAILS,
    OTHERS,
    EpisodeInventory,
    Gathered,
    Gathering,
    Presence,
    Ticks,
)
from rabbit_recording.message_header import SimulatedTime
from rabbit_recording.open_recording import one_line_errors
from rabbit_recording.stored_messages import stored_messages

UNDER_OTHERS = "recorded under other message definitions, or damaged"


@dataclass(frozen=True)
class RecordedSwap:
    """The policy that made the torques from `tick` on; `data`: empty for the built-in zero policy, None if unknown."""

    tick: int
    version: str
    data: bytes | None


@dataclass
class RecordedEpisode(EpisodeInventory):
    """One episode with its ticks in full.

    `sigma` is the exploration it was announced with, NaN for the controller's parameter. `swaps` begin with the policy
    of the first recorded tick, `settings` with what the controller went by at the start. `end`: of a control task, the
    state after the last tick, which no controller sees; None: not known.
    """

    sigma: float = math.nan
    records: list[Record] = field(default_factory=list)
    landings: list[Landing] = field(default_factory=list)
    swaps: list[RecordedSwap] = field(default_factory=list)
    settings: list[RecordedSettings] = field(default_factory=list)
    end: RobotState | None = None


def messages(path: Path, *names: str) -> Iterator[tuple[str, Any]]:
    """Topic (its last part) and message of this project's own types, in the order of time; all of them if no `names`.

    Raises `RecordingError`, as `stored_messages`.
    """
    with one_line_errors(path), stored_messages(path, *names) as stored:
        for message in stored:
            yield message.topic, message.decode()


def iterate_episodes(path: Path, task: ControlTask | None = None) -> Iterator[RecordedEpisode]:
    """One episode after another, the lost ones too; a long recording needs the memory of a few of them.

    Of a `task`; None: of RABBIT.

    Raises `RecordingError`, as `iterate_inventories`.
    """
    announced = _Announced()
    with one_line_errors(path, UNDER_OTHERS):
        for gathered, inventory in _finished(path, announced):
            if inventory.presence is not Presence.ANNOUNCED:
                yield _decoded(gathered, inventory, announced, task)


def last_episode(path: Path, number: int | None = None, task: ControlTask | None = None) -> RecordedEpisode:
    """Episode `number`, or the last one that has ticks; raises `RecordingError`."""
    chosen: RecordedEpisode | None = None
    for episode in iterate_episodes(path, task):
        if episode.records and number in (None, episode.number):
            chosen = episode
    if chosen is None:
        raise RecordingError(f"recording {path}: no ticks of {f'episode {number}' if number else 'a walk'} in it")
    return chosen


def iterate_inventories(path: Path) -> Iterator[EpisodeInventory]:
    """What the recording holds of the episodes, also of those that were merely announced. No tick is decoded.

    Raises `RecordingError`, as `stored_messages`; or of messages that are defined otherwise than this version's.
    """
    with one_line_errors(path, UNDER_OTHERS):
        yield from (inventory for _, inventory in _finished(path))


@dataclass
class _Announced:
    """What the controller has announced so far."""

    policies: Policies = field(default_factory=Policies)
    settings: dict[str, Settings] = field(default_factory=lambda: defaultdict(Settings))  # by controller


def _finished(path: Path, announced: _Announced | None = None) -> Iterator[tuple[Gathered, EpisodeInventory]]:
    gathering, time = Gathering(), SimulatedTime(path)
    names = (*BY_TICK, *OTHERS, *(("policy_swap", "controller_settings") if announced else ()))
    with stored_messages(path, *names) as stored:
        for message in stored:
            time.follow(message.topic, message.data)
            if announced and message.topic == "policy_swap":
                announced.policies.add(message.decode())
            elif announced and message.topic == "controller_settings":
                said = message.decode()
                announced.settings[said.sender].add(said, gathering.newest)
            else:
                gathering.add(message)
                yield from gathering.finished()
        yield from gathering.finished(all_of_them=True)


def _decoded(
    gathered: Gathered, inventory: EpisodeInventory, announced: _Announced, task: ControlTask | None
) -> RecordedEpisode:
    """The episode in full; what only it needed is forgotten."""
    episode, ticks = RecordedEpisode(**vars(inventory)), gathered.ticks
    if (said := gathered.announced) is not None:
        episode.sigma = said.sigma
        if task and any(getattr(said, name) != names for name, names in layout_of(task).names.items()):
            was = ", ".join((*said.coordinates, *said.joints))
            raise RecordingError(f"of another system, with {was}; not of {task.name}")
    previews: dict[int, StonePreview | None] = {}  # as first seen, by index of the stone
    for tick in gathered.full_ticks(ticks):
        torque = ticks["torque"][tick].decode()
        version, episode.controller = torque.policy_version, torque.sender
        state = _task_state(task, ticks, tick) if task else _state(gathered, ticks, tick, previews)
        # what a controller of a task made of a state, a replay says
        of_tick = (None if task else ticks[topic].get(tick) for topic in DETAILS)
        details, terms = (message and message.decode() for message in of_tick)
        output = output_of(details, terms, np.array(torque.torque), state, version)
        episode.records.append(Record(state, output))
        if not episode.swaps or version != episode.swaps[-1].version:
            episode.swaps.append(RecordedSwap(tick, version, announced.policies.get(version)))
    for _, landing in sorted(gathered.landings.items()):
        episode.landings.append(Landing(**{name: getattr(landing, name) for name in Landing.__dataclass_fields__}))
    if not task:
        episode.settings = announced.settings[episode.controller].of(gathered.episode)
    elif (after := max(ticks["torque"], default=-1) + 1) in ticks["state"] and after in ticks["parameters"]:
        episode.end = _task_state(task, ticks, after)
    if episode.swaps:
        announced.policies.forget_before(episode.swaps[-1].version)
    return episode


def _state(gathered: Gathered, ticks: Ticks, tick: int, previews: dict[int, StonePreview | None]) -> RobotState:
    """RABBIT's, with the stone that it sees."""
    message = ticks["state"][tick].decode()
    if len(message.q) != DOF:
        raise RecordingError(
            f"{len(message.q)} coordinates: no robot of ours; of your own system `rabbit bag` plots, shows, checks and "
            "explains it with `--task`"
        )
    stone = message.touchdowns + 1
    if stone not in previews:
        previews[stone] = gathered.preview(stone, ticks["state"][tick].stamp)
    return RobotState.of_message(message, previews[stone] if message.previewed else None)


def _task_state(task: ControlTask, ticks: Ticks, tick: int) -> RobotState:
    if tick not in ticks["parameters"]:
        raise RecordingError(f"what {task.name} was commanded is not in it: no topic `parameters`")
    state, parameters = (ticks[topic][tick].decode() for topic in ("state", "parameters"))
    return state_of(task, state, parameters)
